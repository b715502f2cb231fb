"""data_tools.synthetic --field: frames of every field of the catalogue, and of one's own, agree with their truth."""

import json

import numpy as np
import pytest
from scipy.spatial import cKDTree

from data_tools.synthetic import CLASSES, frame
from data_tools.synthetic.__main__ import main
from data_tools.synthetic.areas import Area
from data_tools.synthetic.cache import read_frame, write_cache
from data_tools.synthetic.cameras import is_behind_goal, on_canonical_side, random_camera
from data_tools.synthetic.games import game_named
from data_tools.synthetic.looks import LOOKS, look_of
from data_tools.synthetic.masks import classes_of, markings_mask
from data_tools.synthetic.paint import coverage, with_marks
from fieldcalib import Arc, Camera, Field, Line, Point, soccer
from fieldcalib.draw.ground import Ground, rays
from fieldcalib.fields import CameraDistribution
from fieldcalib.fields.catalogue import FIELDS
from fieldcalib.fields.traits import SURFACES, WHITE, LineLook
from fieldcalib.io.field_files import write_field
from fieldcalib.io.soccernet import camera_from_record, parse_annotation

OTHERS = sorted(LOOKS)
SMALL, SIZE = (256, 144), (512, 288)
CENTRE_OF_SEED_1 = [-18.898, 95.211, -20.47]


def court(**more):
    lines = {
        "near": Line((-9.0, 4.0, 0.0), (9.0, 4.0, 0.0)),
        "far": Line((-9.0, -4.0, 0.0), (9.0, -4.0, 0.0)),
        "middle": Line((0.0, -4.0, 0.0), (0.0, 4.0, 0.0)),
        "hoop": Arc((5.0, 0.0, 0.0), 2.0),
        "post": Line((9.0, 0.0, -2.0), (9.0, 0.0, 0.0)),
        "spot": Point((3.0, 0.0, 0.0)),
    }
    seats = CameraDistribution("seats", (-30, 30), (55, 80), (-2, 2), (30, 70), (-6, 6), (10, 20), (-9, -4))
    return Field(18.0, 8.0, lines, stands=(seats,), lines=LineLook(width=0.05), **more)


@pytest.fixture(scope="module")
def frames():
    """Two small ones of each field."""
    return {name: [frame(seed, SMALL, name) for seed in (1, 2)] for name in OTHERS}


def views(name, count=2):
    """Cameras of a field, and the ground that they see."""
    game, rng = game_named(name), np.random.default_rng(5)
    for _ in range(count):
        camera = random_camera(game.field, SIZE, rng, game.stands)
        yield camera, Ground.of_rays(camera, rays(camera))


def in_image(camera, X):
    """Pixels of what is in view, off the border."""
    xy = camera.project(X)
    return xy[np.all((xy >= 2.0) & (xy <= np.array(camera.image_size) - 3.0), axis=1)]


# soccer


def test_without_a_name_frames_are_of_soccer():
    one, same = frame(1, SMALL), frame(1, SMALL, "soccer")
    assert np.array_equal(one.image, same.image)
    assert np.array_equal(one.mask, same.mask)
    assert game_named("soccer").classes == CLASSES == classes_of(soccer())


def test_cameras_of_soccer_are_those_of_earlier_versions(monkeypatch):
    """The first that the seeds draw, where frames are not hard; pictures depend on the version of OpenCV too."""
    monkeypatch.setattr("data_tools.synthetic.frames.HARD_SHARE", 0.0)
    assert np.round(frame(1, SMALL).camera.C, 3).tolist() == CENTRE_OF_SEED_1


# every field


@pytest.mark.parametrize("name", ["pickleball", "beach-volleyball", "lacrosse-men", "basketball-3x3"])
def test_fields_of_files_look_like_others_on_their_surface(name):
    made = frame(1, SMALL, name)
    assert made.image.shape == (144, 256, 3)
    assert set(np.unique(made.mask)) - {0}


@pytest.mark.parametrize("name", OTHERS)
def test_classes_are_the_markings(name):
    field, look = FIELDS[name](), LOOKS[name]
    edges = {label for label in field.markings if look.is_edge(label)}
    classes = game_named(name).classes
    assert set(classes) == set(field.markings) - edges
    assert list(classes) == sorted(classes)
    if name.startswith("ice-hockey"):
        assert edges == {
            f"Blue line {side} {edge} edge" for side in ("left", "right") for edge in ("inner", "outer")
        } | {
            "Centre line left edge",
            "Centre line right edge",
        }
    else:
        assert not edges


def test_frames_of_every_field(frames):
    for name, made in frames.items():
        classes = game_named(name).classes
        shown = [one for one in made if one.camera is not None]
        assert shown
        for one in shown:
            assert one.image.shape == (144, 256, 3)
            assert one.mask.max() <= len(classes)
            assert len(np.unique(one.mask)) >= 2
            assert one.camera == on_canonical_side(one.camera, one.field)
            assert one.behind_goal == is_behind_goal(one.camera, one.field)
        assert len({one.image.tobytes() for one in made}) == len(made)


def test_a_frame_is_a_function_of_its_seed_and_field(frames):
    name = "handball"
    again = frame(2, SMALL, name)
    assert np.array_equal(again.image, frames[name][1].image)
    assert np.array_equal(again.mask, frames[name][1].mask)


@pytest.fixture(scope="module", params=OTHERS)
def painted_views(request):
    """Name of a field, and views of it with the ground that they see and how much of it is painted."""
    field, look = game_named(request.param).field, LOOKS[request.param]
    return request.param, [(*view, coverage(view[1], field, look)) for view in views(request.param)]


def test_lines_are_painted_where_the_camera_sees_them(painted_views):
    """Along every painted line in view, the pixels have the share of paint that the line's width gives."""
    name, shown = painted_views
    game = game_named(name)
    seen = 0
    for camera, ground, layers in shown:
        for label, segment in game.field.markings.items():
            paint = game.field.paint_of(label)
            xy = in_image(camera, segment.sample(0.05))
            if np.any(segment.sample()[:, 2]) or not paint.is_along or paint.dashes or not len(xy):
                continue
            seen += 1
            x, y = np.rint(xy).astype(int).T
            cover = layers[paint.colour]
            highest = np.max([cover[y + dy, x + dx] for dx in (-1, 0, 1) for dy in (-1, 0, 1)], axis=0)
            expected = np.minimum(1.0, paint.width / ground.largest_pixel_size[y, x])
            resolved = expected > 0.1  # farther away, short lines are shorter than a pixel
            assert np.all((highest > 0.45 * expected)[resolved]), label
    assert seen > 5


def test_nothing_else_is_painted(painted_views):
    """Paint lies within half a line's width, and the pixel that it is counted in, of what is said to be painted."""
    name, shown = painted_views
    everything = with_marks(game_named(name).field, LOOKS[name])
    painted = 0
    for _, ground, layers in shown:
        for colour, cover in layers.items():
            here = cover > 0.2
            found = np.zeros(np.count_nonzero(here), bool)
            reach = {}
            for label, segment in everything.items():
                paint = everything.paint_of(label)
                if paint.colour == colour and paint.width and not np.any(segment.sample()[:, 2]):
                    far = 0.5 * paint.width + 2.0 * abs(paint.outwards)
                    reach.setdefault(far, []).append(segment.sample(0.05)[:, :2])
            for far, samples in reach.items():
                distance, _ = cKDTree(np.concatenate(samples)).query(ground.xy[:, here].T)
                found |= distance <= np.sqrt(2.0) * (far + 0.05) + ground.largest_pixel_size[here]  # ends are square
            assert np.all(found)
            painted += np.count_nonzero(here)
    assert painted > 500


def test_rows_of_american_football_are_marks_and_numbers_and_no_lines():
    field, look = FIELDS["american-football-nfl"](), LOOKS["american-football-nfl"]
    numbers = {label: segment for label, (segment, _) in look.marks(field).items()}
    y = np.concatenate([segment.sample(0.1) for segment in numbers.values()])[:, 1]
    rows = [field[f"Number row bottom {edge}"].start[1] for edge in ("inner", "outer")]
    assert np.min(np.abs(y)) > rows[0]
    assert np.max(np.abs(y)) < rows[1]
    for label, most in (("Hash row bottom inner", 0.4), ("Number row bottom inner", 0.3)):
        over = (2.5 * 0.9144, field[label].start[1], -60.0)
        above = Camera.from_angles(0.0, 1e-6, 0.0, 1500.0, over, SIZE)
        cover = coverage(Ground.of_rays(above, rays(above)), field, look)[WHITE]
        x, y = np.rint(in_image(above, field[label].sample(0.02))).astype(int).T
        assert np.mean(cover[y, x] > 0.5) < most, label


def test_tables_go_by_labels_that_there_are():
    for name, look in LOOKS.items():
        raised = [label for label, segment in FIELDS[name]().markings.items() if np.any(segment.sample()[:, 2])]
        starts = [start for table in (look.coloured, look.widths) for start, _ in table]
        for start in (*starts, *look.striped):
            assert any(label.startswith(start) for label in raised), (name, start)


@pytest.mark.parametrize("name", OTHERS)
def test_every_field_is_its_own_mirror_image(name):
    game = game_named(name)
    for behind_goal in (False, True):
        values = game.mirrored_values(behind_goal=behind_goal)
        assert sorted(values) == list(range(1 + len(game.classes)))
        assert np.array_equal(values[values], np.arange(1 + len(game.classes)))


@pytest.mark.parametrize(("C", "pan", "axis"), [((-3.0, 20.0, -8.0), -0.2, 0), ((-22.0, 2.0, -7.0), 1.5, 1)])
def test_a_mirrored_image_is_that_of_the_mirrored_court(C, pan, axis):
    game = game_named("basketball-fiba")
    camera = Camera.from_angles(pan, 1.2, 0.0, 500.0, C, SIZE, principal_point=(250.0, 140.0))
    mirror = np.ones(3)
    mirror[axis] = -1.0
    K = camera.K.copy()
    K[0, 2] = SIZE[0] - 1.0 - K[0, 2]
    mirrored = Camera(K, np.diag([-1.0, 1.0, 1.0]) @ camera.R @ np.diag(mirror), camera.C * mirror, SIZE)
    mask, other = (markings_mask(one, game.field, game.classes) for one in (camera, mirrored))
    assert mask.any()
    values = game.mirrored_values(behind_goal=axis == 1)
    assert np.mean(values[mask[:, ::-1]] == other) > 0.98  # where two cross, either


def test_sizes_vary_where_rules_let_them():
    rng = np.random.default_rng(0)
    for name, varies in (("futsal", True), ("ice-hockey-iihf", True), ("tennis", False)):
        sizes = {(field.length, field.width) for field in (game_named(name).random_field(rng) for _ in range(20))}
        assert (len(sizes) > 1) == varies


def test_areas():
    key = Area((8.0, 0.0), (14.0, 2.0))
    x, y = np.array([10.0, 10.0, -10.0, 7.0, 0.0], np.float32), np.array([0.0, 3.0, -1.0, 0.0, 0.0], np.float32)
    assert key.distance(x, y).tolist() == [-2.0, 1.0, -1.0, 1.0, 8.0]
    crease = Area((10.0, 0.0), (10.0, 0.0), 2.0, (10.0, 1.0))
    assert crease.distance(np.array([9.0, 11.0], np.float32), np.zeros(2, np.float32)).tolist() == [-1.0, 1.0]


# one's own


def test_a_field_in_a_file(tmp_path):
    path, out = tmp_path / "court.yaml", tmp_path / "out"
    write_field(path, court())
    assert main(["--field", str(path), "--out", str(out), "--count", "3", "--seed", "1", "--processes", "1"]) == 0
    classes = ["far", "hoop", "middle", "near", "post"]
    assert json.loads((out / "summary.json").read_text())["classes"] == classes
    cameras = sorted(out.glob("camera_*.json"))
    assert cameras
    for file in cameras:
        name = file.stem.removeprefix("camera_")
        camera = camera_from_record(json.loads(file.read_text()), SIZE)
        pixels = parse_annotation((out / f"{name}.json").read_text(), SIZE)
        assert set(pixels) <= set(classes)
        for label, xy in pixels.items():
            curve = camera.project(court()[label].sample(0.002))
            assert np.max(cKDTree(curve[np.all(np.isfinite(curve), axis=1)]).query(xy)[0]) < 0.5
        image, mask, _ = read_frame(out / f"{name}.jpg")
        assert image.shape == (*SIZE[::-1], 3)
        assert mask.max() <= len(classes)


def test_looks_of_fields_of_ones_own():
    assert look_of("court.yaml", court(surface="wood")).indoors
    assert look_of("court.yaml", court()).surfaces == ("grass",)
    for surface in SURFACES:
        own = court(surface=surface)
        assert look_of("court.yaml", own).surfaces == (surface,)


def test_a_field_that_is_no_mirror_image_has_cameras_on_all_sides():
    camera = Camera.from_angles(np.pi, 1.2, 0.0, 400.0, (0.0, -15.0, -6.0), SIZE)
    assert on_canonical_side(camera, court()) == camera  # its hoop is at one end


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('{"length": 20, "width": 10}', "segments"),
        ('{"length": 20, "width": 10, "segments": {"spot": {"kind": "Point", "X": [0, 0, 0]}}}', "it has 0"),
    ],
)
def test_files_that_are_no_such_field(tmp_path, capsys, content, message):
    path = tmp_path / "court.json"
    path.write_text(content)
    with pytest.raises(SystemExit):
        main(["--field", str(path), "--cache", str(tmp_path / "out")])
    assert message in capsys.readouterr().err


def test_clips_are_of_soccer(tmp_path, capsys):
    with pytest.raises(SystemExit):
        main(["--field", "tennis", "--clip", str(tmp_path / "clip.mp4")])
    assert "soccer only" in capsys.readouterr().err


def test_frames_of_two_fields_are_not_mixed(tmp_path):
    write_cache(tmp_path, range(1, 2), 1, "tennis")
    with pytest.raises(ValueError, match="frames of the field tennis with 15 classes"):
        write_cache(tmp_path, range(2, 3), 1, "badminton")
    (tmp_path / "summary.json").unlink()  # a folder of an earlier version
    with pytest.raises(ValueError, match="frames of the field soccer with 26 classes"):
        write_cache(tmp_path, range(2, 3), 1, "tennis")
