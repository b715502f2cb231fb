"""The field from above: top views of images, mosaics of clips, maps with players, plots on mplsoccer's pitches."""

import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from fieldcalib import Calibration, Camera, Status, soccer
from fieldcalib.cli.main import main
from fieldcalib.draw import draw_minimap, mosaic, overhead_camera, render_field, top_view
from fieldcalib.fields import Ground
from fieldcalib.fields.catalogue import FIELDS, tennis
from fieldcalib.io.videos import VideoWriter

FIELD = soccer()
SIZE = (640, 360)
BROADCAST = Camera.from_angles(0.1, np.radians(78), 0.01, 700.0, (0.0, 62.0, -18.0), SIZE, k=(-0.15, 0.0))
RANGE = 160.0  # m, of the colours of `coded`


def coded(camera, terrain=None):
    """An image whose blue and green say where on the ground a pixel is."""
    width, height = camera.image_size
    X = camera.image_to_field(np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1), terrain=terrain)
    image = np.zeros((height, width, 3), np.uint8)
    image[..., :2] = np.clip(np.nan_to_num(X[..., :2] / RANGE + 0.5) * 255.0, 0, 255).round()
    return image


def ground(overhead):
    width, height = overhead.image_size
    return overhead.image_to_field(np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1))[..., :2]


@pytest.mark.parametrize("camera", [BROADCAST, BROADCAST.scaled((1280, 720))], ids=["640", "1280"])
def test_places_are_where_the_camera_says_with_its_lens(camera):
    overhead = overhead_camera(FIELD, 0.25, margin=3.0)
    picture, seen = top_view(coded(camera), camera, overhead)
    shown = (picture[..., :2] / 255.0 - 0.5) * RANGE
    off = (shown - ground(overhead))[seen]
    assert seen.mean() > 0.3
    assert np.abs(off.mean(axis=0)).max() < 0.02  # a pixel of the picture is 0.25 m
    assert np.abs(off).max() < RANGE / 255.0
    assert np.all(picture[~seen] == picture[~seen][0])


def test_views_from_above_follow_the_ground():
    crowned, overhead = FIELD.with_ground(Ground(1.5, fall=0.5)), overhead_camera(FIELD, 0.25)
    picture, seen = top_view(coded(BROADCAST, crowned.terrain), BROADCAST, overhead, crowned)
    off = ((picture[..., :2] / 255.0 - 0.5) * RANGE - ground(overhead))[seen]
    assert np.abs(off).max() < RANGE / 255.0
    flat, _ = top_view(coded(BROADCAST, crowned.terrain), BROADCAST, overhead)
    assert np.abs(flat.astype(int) - picture)[seen].max() > 3.0 / RANGE * 255.0  # 1.5 m of height, seen from 18 m
    both, _ = mosaic([(coded(BROADCAST, crowned.terrain), BROADCAST)], overhead, crowned)
    assert np.array_equal(both, picture)
    down = Camera.from_angles(0.0, 0.0, 0.0, 100.0, (0.0, 0.0, -20.0), (100, 50))  # sees less of nearer ground
    assert draw_minimap(down, crowned).mean() < draw_minimap(down, FIELD).mean()


def test_what_is_seen_ends_with_the_image_and_before_the_horizon():
    low = Camera.from_angles(0.0, np.radians(88), 0.0, 500.0, (0.0, 60.0, -4.0), SIZE)  # its horizon is in the image
    overhead = overhead_camera(FIELD, 0.5)
    _, seen = top_view(coded(low), low, overhead)
    xy = low.project(np.concatenate([ground(overhead), np.zeros((*seen.shape, 1))], axis=-1))
    in_image = np.all((xy >= 0.0) & (xy <= np.subtract(SIZE, 1.0)), axis=-1)
    assert not np.any(seen & ~in_image)
    distance = np.linalg.norm(ground(overhead) - low.C[:2], axis=-1)
    coarse = distance * (60.0 - ground(overhead)[..., 1]) / (500.0 * 4.0)  # m of ground along a ray, for a pixel
    assert not np.any(seen & (coarse > 2.1))
    assert np.mean(seen[in_image & (coarse < 1.9)]) > 0.95


def test_pictures_of_courts_are_as_large_as_those_of_pitches():
    assert overhead_camera(soccer()).image_size == overhead_camera(soccer(), 0.1).image_size == (1150, 780)
    for field in FIELDS.values():
        assert 1000 < max(overhead_camera(field()).image_size) < 2500
    assert overhead_camera(tennis()).focal_length == pytest.approx(100.0 / 0.021)


def test_overhead_cameras_have_the_far_side_above_and_metres_as_pixels():
    overhead = overhead_camera(FIELD, 0.5, margin=10.0)
    assert overhead.image_size == (250, 176)
    np.testing.assert_allclose(
        overhead.project([[10.0, 0.0, 0.0]]) - overhead.project([[0.0, 0.0, 0.0]]), [[20.0, 0.0]]
    )
    assert overhead.project([0.0, -34.0, 0.0])[1] == pytest.approx(19.5)
    with pytest.raises(ValueError, match="positive metres per pixel"):
        overhead_camera(FIELD, 0.0)
    with pytest.raises(ValueError, match="up to 32766 a side"):
        overhead_camera(FIELD, 0.001)


def test_a_mosaic_is_the_median_of_what_is_seen():
    overhead = overhead_camera(FIELD, 0.5)
    values = np.random.default_rng(0).integers(0, 256, (4, *SIZE[::-1], 3), dtype=np.uint8)
    pans = [Camera.from_angles(pan, 1.3, 0.0, 500.0, (0.0, 60.0, -18.0), SIZE) for pan in (-0.3, 0.0, 0.1, 0.4)]
    picture, seen = mosaic(zip(values, pans, strict=True), overhead)
    views = [top_view(image, camera, overhead) for image, camera in zip(values, pans, strict=True)]
    stack = np.ma.array([view for view, _ in views], mask=[~np.repeat(m[..., None], 3, axis=-1) for _, m in views])
    expected = np.ma.median(stack.astype(float), axis=0)
    assert np.array_equal(seen, np.any([mask for _, mask in views], axis=0))
    assert len({int(n) for n in np.unique(np.sum([mask for _, mask in views], axis=0))}) >= 4
    assert np.abs(picture[seen].astype(float) - expected.data[seen]).max() <= 0.5
    with pytest.raises(ValueError, match="at least one image"):
        mosaic([], overhead)


def test_what_moves_disappears_from_a_mosaic():
    overhead = overhead_camera(FIELD, 0.25)
    clean = render_field(BROADCAST, FIELD)
    frames = []
    for k in range(5):
        frame = clean.copy()
        frame[100:200, 60 + 100 * k : 90 + 100 * k] = (0, 0, 255)
        frames.append((frame, BROADCAST))
    expected, _ = top_view(clean, BROADCAST, overhead)
    assert np.array_equal(mosaic(frames, overhead)[0], expected)


# The command


def results(folder, cameras):
    folder.mkdir()
    lines = [
        {"id": id, **Calibration(camera, Status.ACCEPTED, "", 0.0, 0.0, {}, field=FIELD).to_dict()}
        for id, camera in cameras.items()
    ]
    (folder / "cameras.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    return folder


def test_the_command_draws_an_image_from_above_with_the_markings_around(tmp_path, capsys):
    cv2.imwrite(str(tmp_path / "frame.png"), coded(BROADCAST))
    cameras = results(tmp_path / "out", {"frame": BROADCAST})
    out = tmp_path / "top.png"
    command = ["topview", str(tmp_path / "frame.png"), "--cameras", str(cameras), "--out", str(out)]
    assert main([*command, "--metres-per-pixel", "0.25", "--margin", "3"]) == 0
    assert "444 x 296 pixels of 1 frame" in capsys.readouterr().out
    overhead = overhead_camera(FIELD, 0.25, 3.0)
    expected, seen = top_view(coded(BROADCAST), BROADCAST, overhead)
    picture = cv2.imread(str(out))
    assert np.array_equal(picture[seen], expected[seen])
    outside = picture[~seen]
    assert np.mean(np.any(outside != outside[0], axis=-1)) > 0.01


def test_the_command_draws_a_video_from_above(tmp_path, capsys):
    pans = [Camera.from_angles(pan, 1.3, 0.0, 500.0, (0.0, 60.0, -18.0), SIZE) for pan in np.linspace(-0.3, 0.3, 9)]
    with VideoWriter(tmp_path / "clip.mp4", 25.0) as video:
        for camera in pans:
            video.write(coded(camera))
    cameras = results(tmp_path / "out", {f"{k:06d}": camera for k, camera in enumerate(pans) if k != 4})
    out = tmp_path / "top.png"
    command = ["topview", str(tmp_path / "clip.mp4"), "--cameras", str(cameras), "--out", str(out)]
    assert main([*command, "--metres-per-pixel", "0.5"]) == 0
    assert "of 8 frames" in capsys.readouterr().out
    overhead = overhead_camera(FIELD, 0.5)
    _, seen = mosaic(((coded(camera), camera) for camera in pans), overhead)
    off = ((cv2.imread(str(out))[..., :2] / 255.0 - 0.5) * RANGE - ground(overhead))[seen]
    assert np.median(np.abs(off)) < 2.0  # frames are compressed; the next one is 4.5 m off


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["frame.png", "--out", "top.txt"], "is no picture"),
        (["other.png", "--out", "top.png"], "no image that is given has an accepted camera"),
        (["frame.png", "--cameras", "none", "--out", "top.png"], "does not exist"),
    ],
)
def test_what_cannot_be_drawn_is_said(tmp_path, monkeypatch, capsys, arguments, message):
    monkeypatch.chdir(tmp_path)
    for name in ("frame.png", "other.png"):
        cv2.imwrite(name, coded(BROADCAST))
    results(tmp_path / "out", {"frame": BROADCAST})
    assert main(["topview", "--cameras", "out", *arguments]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "top.png").exists()


# Maps with players


def changed(points, **options):
    """Where a map with points differs from one without."""
    return np.any(draw_minimap(BROADCAST, FIELD, points=points, **options) != draw_minimap(BROADCAST, FIELD), axis=-1)


def test_players_are_dots_on_the_map_in_their_colours():
    players, colours = [(20.0, -10.0), (-30.0, 20.0)], [(0, 0, 255), (255, 0, 0)]
    picture = draw_minimap(BROADCAST, FIELD, points=players, colours=colours)
    for (x, y), colour in zip(players, colours, strict=True):
        scale = min(336 / 119.0, 228 / 82.0)
        column, row = round(167.5 + scale * x), round(113.5 + scale * y)
        assert picture[row, column].tolist() == list(colour)
    assert 40 < changed(players).sum() < 250
    assert np.array_equal(changed([(20.0, -10.0, 5.0)]), changed([(20.0, -10.0)]))


def test_players_without_a_place_are_left_out():
    assert not changed([(np.nan, np.nan, np.nan), (500.0, 0.0, 0.0), (1e9, 0.0, 0.0)]).any()
    assert not changed(np.empty((0, 2))).any()


def test_trails_end_at_their_players_and_fade():
    trail = np.column_stack([np.linspace(-20.0, 20.0, 30), np.zeros(30)])
    drawn = np.abs(
        draw_minimap(BROADCAST, FIELD, trails=[trail], colours=(0, 0, 255)).astype(int) - draw_minimap(BROADCAST, FIELD)
    ).sum(axis=-1)
    row = drawn[113]
    assert row[115] > 0
    assert row[120:160].mean() < row[175:215].mean()
    trail[10:20] = np.nan
    with_gap = changed(None, trails=[trail])
    assert with_gap[113].any()
    assert not with_gap[113, 155:180].any()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"points": [1.0, 2.0]}, r"expected field points of shape \(N, 2\)"),
        ({"points": [(1.0, 2.0)] * 3, "colours": [(0, 0, 0)] * 2}, "or 3 of them"),
        ({"trails": [[1.0, 2.0]]}, r"expected field points of shape \(N, 2\)"),
    ],
)
def test_wrong_players_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        draw_minimap(BROADCAST, FIELD, **options)


# Plots


@pytest.fixture(scope="module")
def drawn():
    import matplotlib as mpl

    mpl.use("Agg")
    import mplsoccer  # noqa: F401  # of the extra: without it the tests are skipped

    from fieldcalib import plot

    pitch = plot.soccer_pitch(FIELD)
    return plot, pitch, pitch.draw()[1]


def test_players_are_plotted_with_y_up(drawn):
    plot, pitch, ax = drawn
    dots = plot.draw_players(pitch, ax, [[10.0, 5.0, 0.0], [np.nan, np.nan, 0.0]], color="red")
    np.testing.assert_array_equal(np.ma.filled(dots.get_offsets(), np.nan)[0], [10.0, -5.0])


def test_trails_are_plotted_with_y_up(drawn):
    plot, pitch, ax = drawn
    first, second = plot.draw_trails(
        pitch, ax, [[(0.0, 1.0), (np.nan, 2.0), (3.0, 4.0)], [(5.0, 6.0, 0.0)]], color="red"
    )
    np.testing.assert_array_equal(first.get_xydata(), [(0.0, -1.0), (np.nan, -2.0), (3.0, -4.0)])
    np.testing.assert_array_equal(second.get_xydata(), [(5.0, -6.0)])


def test_what_a_camera_sees_is_plotted(drawn):
    plot, pitch, ax = drawn
    down = Camera.from_angles(0.0, 0.0, 0.0, 100.0, (5.0, 10.0, -20.0), (100, 50))  # sees 20 x 10 m
    corners = plot.draw_visible_area(pitch, ax, down).get_xy()
    middle = (5.0 - 0.5 * 20 / 100, -10.0 + 0.5 * 20 / 100)  # the principal point is half a pixel off the middle
    np.testing.assert_allclose(corners.min(axis=0), np.subtract(middle, (10.0, 5.0)), atol=1e-4)
    np.testing.assert_allclose(corners.max(axis=0), np.add(middle, (10.0, 5.0)), atol=1e-4)
    outline = plot.visible_ground(Camera.from_angles(0.0, np.radians(89), 0.0, 500.0, (0.0, 60.0, -8.0), SIZE))
    assert np.linalg.norm(outline, axis=-1).max() <= 300.0
    assert outline[:, 1].min() < -150.0  # up to the horizon
    with pytest.raises(ValueError, match="sees no ground"):
        plot.visible_ground(Camera.from_angles(0.0, np.radians(150), 0.0, 500.0, (0.0, 60.0, -8.0), SIZE))


def test_errors_are_plotted_as_ellipses(drawn):
    plot, pitch, ax = drawn
    covariance = np.array([[[4.0, 1.5], [1.5, 1.0]]])
    ellipses = plot.draw_errors(pitch, ax, [[10.0, 5.0]], covariance)
    values, vectors = np.linalg.eigh(covariance[0] * [[1, -1], [-1, 1]])  # with y up
    radius = np.sqrt(-2.0 * np.log(0.05))
    assert ellipses.get_widths()[0] == pytest.approx(2.0 * radius * np.sqrt(values[1]))
    assert ellipses.get_heights()[0] == pytest.approx(2.0 * radius * np.sqrt(values[0]))
    angle = np.arctan2(vectors[1, 1], vectors[0, 1])
    turned = np.radians(ellipses.get_angles()[0]) - angle
    assert abs(np.sin(turned)) < 1e-9
    np.testing.assert_array_equal(ellipses.get_offsets(), [[10.0, -5.0]])


def test_other_pitches_are_refused(drawn):
    from mplsoccer import Pitch, VerticalPitch

    plot, _, ax = drawn
    with pytest.raises(ValueError, match=r"expected a pitch of type 'skillcorner'.*got 'opta'"):
        plot.draw_players(Pitch("opta"), ax, [[0.0, 0.0]])
    vertical = VerticalPitch("skillcorner", pitch_length=105, pitch_width=68)
    with pytest.raises(ValueError, match="got a VerticalPitch"):
        plot.draw_errors(vertical, ax, [[0.0, 0.0]], np.eye(2)[None])
    with pytest.raises(ValueError, match="expected field points"):
        plot.on_pitch([1.0])


def test_top_views_are_of_any_field():
    overhead = overhead_camera(tennis(), 0.05, 3.0)
    camera = Camera.from_angles(0.0, 1.0, 0.0, 500.0, (0.0, 20.0, -12.0), SIZE)
    _, seen = top_view(coded(camera), camera, overhead)
    assert seen.mean() > 0.3


def test_the_example_of_the_documentation_draws_a_picture(drawn, tmp_path, monkeypatch):
    page = (Path(__file__).parents[2] / "docs" / "how-to" / "players.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)
    monkeypatch.chdir(tmp_path)
    names = {}
    for code in blocks:
        if "top_view" not in code:  # that one is of an image
            exec(compile(code, "players.md", "exec"), names)
    assert cv2.imread("players.png").std() > 10.0  # grass, lines and dots
    assert len(names["ax"].collections) >= 2  # dots and ellipses
