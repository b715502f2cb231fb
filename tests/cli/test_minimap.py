"""Players on maps and top views, from the command line: places, colours, trails, and what is wrong with a table."""

import csv
import json

import cv2
import numpy as np
import pytest
from pictures import picture

from fieldcalib import Calibration, Camera, Status, soccer
from fieldcalib.cli.main import main
from fieldcalib.cli.players import SHIRTS
from fieldcalib.draw import draw_minimap, draw_players, minimap, overhead_camera
from fieldcalib.fields import Ground
from fieldcalib.fields.catalogue import tennis
from fieldcalib.io.players import Player, read_players
from fieldcalib.io.videos import VideoReader

SIZE = (640, 360)
CAMERA = Camera.from_angles(0.1, np.radians(78), 0.0, 700.0, (0.0, 62.0, -18.0), SIZE)
HEADER = ("frame", "track_id", "team", "field_x", "field_y")
RED, BLUE = SHIRTS["red"], SHIRTS["blue"]


@pytest.fixture
def folder(tmp_path):
    """Results of five frames, of which one is rejected and one has no camera, and a picture of the second one."""
    good = Calibration(CAMERA, Status.ACCEPTED, "", 0.0, 0.0, {}, field=soccer())
    rejected = Calibration.from_dict(good.to_dict() | {"status": str(Status.IMPROBABLE)})
    nothing = Calibration.without_camera(Status.TOO_FEW_SEGMENTS, "no labelled pixels")
    lines = [
        json.dumps({"id": f"{index:06d}", **found.to_dict()}) + "\n"
        for index, found in enumerate((good, good, rejected, nothing, good))
    ]
    (tmp_path / "cameras").mkdir()
    (tmp_path / "cameras" / "cameras.jsonl").write_text("".join(lines))
    cv2.imwrite(str(tmp_path / "000001.png"), picture(CAMERA, seed=None))
    return tmp_path


def table(folder, rows, header=HEADER):
    path = folder / "players.csv"
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([header, *rows])
    return path


ROWS = (
    (0, 1, "left", 10.0, -5.0),
    (0, 2, "right", 20.0, 5.0),
    (1, 1, "left", 12.0, -5.0),
    (1, 2, "right", "", ""),
    (2, 1, "left", 14.0, -5.0),
    (3, 3, "", -30.0, 0.0),
)


def command(name, folder, *options):
    return main([name, *map(str, options), "--cameras", str(folder / "cameras")])


def is_at(picture, colour, xy):
    x, y = np.rint(xy).astype(int)
    return np.abs(picture[y, x].astype(int) - colour).max() <= 2


def test_maps_have_players_in_the_colours_of_their_teams(folder, capsys):
    out = folder / "maps"
    assert command("minimap", folder, table(folder, ROWS), "--out", out) == 0
    assert "4 maps of 672 x 456 pixels\nteam: left is red, right is blue" in capsys.readouterr().out
    assert sorted(path.name for path in out.iterdir()) == [f"minimap_00000{index}.png" for index in range(4)]
    first, second, third, fourth = (cv2.imread(str(out / f"minimap_00000{index}.png")) for index in range(4))
    plain, dark = draw_minimap(CAMERA, soccer(), size=(672, 456)), draw_minimap(None, soccer(), size=(672, 456))

    expected = draw_minimap(CAMERA, soccer(), size=(672, 456), points=[(10.0, -5.0), (20.0, 5.0)], colours=[RED, BLUE])
    np.testing.assert_array_equal(first, expected)
    assert np.any(second != plain)
    changed = np.nonzero(np.any(second != plain, axis=-1))
    assert max(np.ptp(side) for side in changed) < 20  # one player: the other one has no point
    assert np.any(third != dark)  # rejected: the view is not drawn, what the table says is
    np.testing.assert_array_equal(third[:50], dark[:50])
    assert np.any(np.all(fourth == (150, 150, 150), axis=-1))  # of no team


def test_a_frame_without_players_is_a_map_of_the_field(folder):
    rows = [row for row in ROWS if row[0] != 1]
    assert command("minimap", folder, table(folder, rows), "--out", folder / "maps") == 0
    empty = cv2.imread(str(folder / "maps" / "minimap_000001.png"))
    np.testing.assert_array_equal(empty, draw_minimap(CAMERA, soccer(), size=(672, 456)))


def test_tables_may_say_that_the_coordinates_are_ours(folder):
    rows = [(*row, system) for row, system in zip(ROWS, ("fieldcalib", "soccernet", "", "", "", ""), strict=True)]
    assert command("minimap", folder, table(folder, rows, (*HEADER, "field_system")), "--out", folder / "maps") == 0


def test_teams_that_are_called_as_a_colour_have_it(folder, capsys):
    rows = [(0, track, team, 10.0 * track, 0.0) for track, team in enumerate(("White", "black", "referee"))]
    out = folder / "map.png"
    assert command("minimap", folder, table(folder, rows), "--out", out) == 0
    assert capsys.readouterr().out.endswith(" pixels\nteam: referee is red\n")  # not that black is black
    colours = [SHIRTS[name] for name in ("white", "black", "red")]
    points = [(0.0, 0.0), (10.0, 0.0), (20.0, 0.0)]
    expected = draw_minimap(CAMERA, soccer(), size=(672, 456), points=points, colours=colours)
    np.testing.assert_array_equal(cv2.imread(str(out)), expected)


def test_colours_by_any_column(folder, capsys):
    path = table(folder, ROWS[:2])
    assert command("minimap", folder, path, "--out", folder / "one.png", "--colour-by", "track_id") == 0
    assert "track_id: 1 is red, 2 is blue" in capsys.readouterr().out
    assert command("minimap", folder, path, "--out", folder / "one.png", "--colour-by", "shirt") == 2
    assert "line 1: expected a column 'shirt', got frame, track_id" in capsys.readouterr().err


def test_trails_go_back_so_many_frames_of_the_clip(folder):
    path = table(folder, ROWS)
    for frames, reach in ((1, 12.0), (5, 10.0)):
        maps = folder / f"maps {frames}"
        assert command("minimap", folder, path, "--out", maps, "--trails", frames) == 0
        picture = cv2.imread(str(maps / "minimap_000002.png"))
        trail = [(x, -5.0) for x in np.arange(reach, 14.5, 2.0)]
        expected = draw_minimap(
            None, soccer(), size=(672, 456), points=[(14.0, -5.0)], colours=RED, trails=[[*trail[:-1], (14.0, -5.0)]]
        )
        shown = np.any(picture != draw_minimap(None, soccer(), size=(672, 456)), axis=-1)
        wanted = np.any(expected != draw_minimap(None, soccer(), size=(672, 456)), axis=-1)
        assert np.mean(shown[wanted]) > 0.99
        assert np.mean(wanted[shown]) > 0.99


def test_trails_need_tracks(folder, capsys):
    path = table(folder, [(0, 1.0, 2.0)], ("frame", "field_x", "field_y"))
    assert command("minimap", folder, path, "--out", folder / "maps", "--trails", 3) == 2
    assert "has no column track_id, tracker_id or id: --trails needs one" in capsys.readouterr().err
    assert command("minimap", folder, path, "--out", folder / "maps") == 0


def test_a_video_has_a_map_for_each_frame(folder):
    path = table(folder, [*ROWS, (4, 1, "left", 16.0, -5.0)])
    out = folder / "maps.mp4"
    assert command("minimap", folder, path, "--out", out, "--size", "336x228", "--frames-per-second", 10) == 0
    with VideoReader(out) as video:
        assert video.frames_per_second == pytest.approx(10.0)
        assert [image.shape for image in video] == [(228, 336, 3)] * 5


def test_maps_without_players_are_of_all_frames(folder):
    assert command("minimap", folder, "--out", folder / "maps", "--size", "336x228") == 0
    assert len(list((folder / "maps").iterdir())) == 5
    np.testing.assert_array_equal(
        cv2.imread(str(folder / "maps" / "minimap_000004.png")), draw_minimap(CAMERA, soccer())
    )


@pytest.mark.parametrize(
    ("rows", "header", "message"),
    [
        (ROWS, ("frame", "track_id", "team", "x", "y"), "line 1: expected a column 'field_x', as project writes it"),
        (ROWS, ("time", "track_id", "team", "field_x", "field_y"), "line 1: expected a column 'frame'"),
        ([(0, 1, "a", "far", 2)], HEADER, "line 2: expected metres, got 'far'"),
        ([(0, 1, "a", 2)], HEADER, "line 2: expected 5 columns, got 4"),
        ([(77, 1, "a", 2, 3)], HEADER, "no frame of"),
        (
            [(0, 1, "a", 2, 3, "fieldcalib"), (0, 1, "a", 2, 3, "skillcorner")],
            (*HEADER, "field_system"),
            "line 3: the points are in the coordinates of 'skillcorner', expected those of 'fieldcalib'",
        ),
        ([(0, 1, "a", 60, 40)], HEADER, "most points of"),
        ([], HEADER, "boxes are of frames as 'none'"),
    ],
)
def test_what_is_wrong_with_a_table_is_said(folder, rows, header, message, capsys):
    assert command("minimap", folder, table(folder, rows, header), "--out", folder / "maps") == 2
    assert message in capsys.readouterr().err
    assert not (folder / "maps").exists()


def test_what_cannot_be_written_is_said_first(folder, capsys):
    path = table(folder, ROWS)
    assert command("minimap", folder, path, "--out", folder / "maps.gif") == 2
    assert "expected a name that ends with .mp4 or .png, or a folder" in capsys.readouterr().err
    assert command("minimap", folder, path, "--out", folder / "map.png") == 2
    assert "is one picture, and there are 4 frames" in capsys.readouterr().err
    assert command("minimap", folder, folder / "none.csv", "--out", folder / "maps") == 2
    assert "none.csv does not exist" in capsys.readouterr().err
    (folder / "maps").mkdir()
    (folder / "maps" / "minimap_000002.png").touch()
    assert command("minimap", folder, path, "--out", folder / "maps") == 2
    said = "minimap_000002.png is there already: remove the folder, if a run of this command was interrupted there"
    assert said in capsys.readouterr().err


def test_players_on_a_top_view(folder, capsys):
    path, out = table(folder, ROWS), folder / "top.png"
    options = (folder / "000001.png", "--out", out, "--metres-per-pixel", 0.25)
    assert command("topview", folder, *options) == 0
    plain = cv2.imread(str(out))
    assert command("topview", folder, *options, "--players", path, "--trails", 1) == 0
    assert "team: left is red, right is blue" in capsys.readouterr().out
    picture = cv2.imread(str(out))
    overhead = overhead_camera(soccer(), 0.25)
    trails = [[(10.0, -5.0), (12.0, -5.0)], [(20.0, 5.0), (np.nan, np.nan)]]
    expected = draw_players(plain, overhead, [(12.0, -5.0), (np.nan, np.nan)], colours=[RED, BLUE], trails=trails)
    np.testing.assert_array_equal(picture, expected)
    assert is_at(picture, RED, overhead.project([12.0, -5.0, 0.0]))
    path = table(folder, [row for row in ROWS if row[0] != 1])
    assert command("topview", folder, *options, "--players", path) == 0
    assert (
        "no players: they are those of 000001, the last frame that is drawn, and the table has"
        in capsys.readouterr().err
    )


def test_players_are_drawn_where_a_camera_sees_them():
    image = np.zeros((*SIZE[::-1], 3), np.uint8)
    behind = CAMERA.C[:2] + 10.0 * (CAMERA.C[:2] - CAMERA.image_to_field([320, 180])[:2])
    picture = draw_players(
        image, CAMERA, [(5.0, 3.0), behind, (np.nan, 0.0)], colours=RED, trails=[[behind, (5.0, 3.0)]]
    )
    assert is_at(picture, RED, CAMERA.project([5.0, 3.0, 0.0]))
    assert np.count_nonzero(picture.any(axis=-1)) < 300  # a dot and no trail
    assert not image.any()
    on_court = draw_players(image, CAMERA.scaled(SIZE), tennis()["Base line left"].sample(1.0))
    assert on_court.any()


def test_players_of_a_table(tmp_path):
    path = table(tmp_path, [("a", -1, "x", 1, 2), ("b", 5, "", "", "nan"), ("a", 6, "10", 3, 4), ("a", 7, "9", 3, 4)])
    players = read_players(path)
    assert list(players.frames) == ["a", "b"]
    assert players.frames["a"][0] == Player((1.0, 2.0), "x", "")  # -1 is no track
    assert np.isnan(players.frames["b"][0].X).all()
    assert players.groups == ["x", "9", "10"]
    assert (players.group_column, players.track_column, players.X.shape) == ("team", "track_id", (4, 2))


# the view of a camera


@pytest.mark.parametrize("tilt", [20, 60, 75, 82, 95])
@pytest.mark.parametrize("k1", [0.0, 0.02, -0.2])
def test_the_polygon_that_is_seen_is_what_is_seen_once_the_ground_is_projected(tilt, k1, monkeypatch):
    for pan, focal_length, C in ((0.4, 900.0, (3.0, 60.0, -15.0)), (-0.9, 350.0, (-20.0, 20.0, -8.0))):
        camera = Camera.from_angles(pan, np.radians(tilt), 0.02, focal_length, C, SIZE, k=(k1, 0.0))
        polygon = draw_minimap(camera, soccer())
        with monkeypatch.context() as patched:
            patched.setattr(minimap, "_border_on_ground", lambda camera, terrain: np.full((4, 3), np.nan))
            projected = draw_minimap(camera, soccer())
        differs = (np.abs(polygon.astype(int) - projected).max(axis=-1) > 12).astype(np.uint8)
        assert not cv2.erode(differs, np.ones((4, 4), np.uint8)).any()  # but for the width of the border


def test_players_on_raised_ground_stand_where_they_are_seen_and_on_a_map_where_they_are():
    field, foot = soccer().with_ground(Ground(0.4)), (320.0, 200.0)
    (X,) = CAMERA.image_to_field([foot], terrain=field.terrain)
    assert X[2] < -0.2
    on_image = draw_players(np.zeros((SIZE[1], SIZE[0], 3), np.uint8), CAMERA, [X], colours=RED)
    rows, columns = np.nonzero(on_image[..., 2] > 128)
    np.testing.assert_allclose((columns.mean(), rows.mean()), foot, atol=0.6)
    on_maps = [draw_minimap(None, field, points=[one], trails=[[one, (0.0, 0.0, X[2])]]) for one in (X, X * (1, 1, 0))]
    np.testing.assert_array_equal(*on_maps)
