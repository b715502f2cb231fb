"""Boxes of players to points on the field: files of all formats, standard deviations, coordinate systems."""

import csv
import json
import sys
import tracemalloc
from datetime import timedelta

import numpy as np
import pytest

import fieldcalib
from fieldcalib import Calibration, Camera, Status, calibrate_from_segments, soccer
from fieldcalib.assess.camera_errors import KnownErrors
from fieldcalib.assess.ground_points import locate_on_ground
from fieldcalib.cli.frame_cameras import Cameras
from fieldcalib.cli.main import main
from fieldcalib.fields.catalogue import tennis
from fieldcalib.io.boxes import foot_points, open_boxes
from fieldcalib.io.coordinates import SYSTEMS, scale_of_system, to_system
from fieldcalib.io.files import BrokenFileError
from fieldcalib.problem.layout import Layout

SIZE = (1280, 720)
LABELS = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top", "Circle right")
TRUTH = Camera.from_angles(0.3, 1.36, 0.01, 1700.0, (1.0, 66.0, -16.0), SIZE, k=(0.1, 0.0))
PLAYERS = np.array([[20.0, -10.0, 0.0], [33.5, 5.25, 0.0], [44.0, -20.0, 0.0]])


def calibrated(camera=TRUTH):
    pixels = {label: camera.project(soccer()[label].sample(3.0)) for label in LABELS}
    inside = {label: xy[np.all((xy >= 0.0) & (xy < SIZE), axis=1)] for label, xy in pixels.items()}
    return calibrate_from_segments(soccer(), {label: xy for label, xy in inside.items() if len(xy)}, SIZE)


@pytest.fixture(scope="module")
def calibration():
    return calibrated()


@pytest.fixture
def cameras(tmp_path, calibration):
    """A folder of results of four frames, of which one has no camera and one a rejected one."""
    nothing = Calibration.without_camera(Status.TOO_FEW_SEGMENTS, "no labelled pixels")
    rejected = Calibration.from_dict(calibration.to_dict() | {"status": str(Status.IMPROBABLE)})
    frames = {"000000": calibration, "000001": calibration, "000002": nothing, "000003": rejected}
    lines = [json.dumps({"id": id, **found.to_dict()}) + "\n" for id, found in frames.items()]
    folder = tmp_path / "cameras"
    folder.mkdir()
    (folder / "cameras.jsonl").write_text("".join(lines))
    return folder


def boxes_of(camera, X=PLAYERS, width=20.0, height=50.0):
    """Left, top, width and height of the boxes of players who stand at X."""
    corner = camera.project(X) + 0.5
    return np.column_stack(
        [corner[:, 0] - width / 2, corner[:, 1] - height, *np.full((2, len(X)), [[width], [height]])]
    )


def written(path, rows, header=None):
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([*([header] if header else []), *rows])
    return path


def projected(boxes, cameras, *options):
    out = boxes.parent / "players.csv"
    code = main(["project", str(boxes), "--cameras", str(cameras), "--out", str(out), *map(str, options)])
    if code != 0:
        assert not out.exists()
        return code
    with out.open(newline="") as file:
        return list(csv.DictReader(file))


def points(rows):
    return np.array([[float(row["field_x"]), float(row["field_y"])] for row in rows])


def test_players_are_found_where_they_stand(tmp_path, cameras, calibration):
    rows = [["0", "7", *map(repr, box), "blue"] for box in boxes_of(calibration.camera).tolist()]
    path = written(tmp_path / "boxes.csv", rows, ["frame", "track", "x", "y", "width", "height", "team"])
    found = projected(path, cameras)
    np.testing.assert_allclose(points(found), PLAYERS[:, :2], atol=1e-6)
    assert {(row["track"], row["team"], row["problem"]) for row in found} == {("7", "blue", "")}
    error = locate_on_ground(calibration, calibration.camera.project(PLAYERS), pixel_sd=2.0)
    deviations = [[float(row["field_x_sd"]), float(row["field_y_sd"])] for row in found]
    np.testing.assert_allclose(deviations, error.standard_deviations, atol=2e-6)
    np.testing.assert_allclose([float(row["field_correlation"]) for row in found], error.correlation, atol=2e-6)
    far = locate_on_ground(calibration, calibration.camera.project(PLAYERS), pixel_sd=2.0, relative_to="centre mark")
    from_centre = [[float(row[f"field_{axis}_sd_from_centre"]) for axis in "xy"] for row in found]
    np.testing.assert_allclose(from_centre, far.standard_deviations, atol=2e-6)
    assert np.all(far.standard_deviations[:, 0] > 1.3 * error.standard_deviations[:, 0])  # half of the length in it


LEFT_TOP = ("left", "top", "width", "height")
NAMES = [
    ("frame", "x", "y", "width", "height"),
    ("image_id", *LEFT_TOP),
    ("frame_index", "x1", "y1", "x2", "y2"),
    ("frame_number", "x_min", "y_min", "x_max", "y_max"),  # supervision's CSVSink
    ("Frame", "xmin", "ymin", "xmax", "ymax"),
]


@pytest.mark.parametrize("names", NAMES, ids=lambda names: names[1])
@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_names_of_columns_say_what_the_numbers_are(tmp_path, calibration, names, delimiter):
    edges = boxes_of(calibration.camera)
    numbers = edges if names[-1] == "height" else np.column_stack([edges[:, :2], edges[:, :2] + edges[:, 2:]])
    path = tmp_path / "boxes.csv"
    lines = [names, *(("000001.jpg", *map(repr, row)) for row in numbers.tolist())]
    path.write_text("\n".join(delimiter.join(line) for line in lines) + "\n", encoding="utf-8-sig")
    with open_boxes(path) as table:
        rows = list(table.rows)
    expected = np.column_stack([edges[:, :2], edges[:, :2] + edges[:, 2:]])
    np.testing.assert_allclose([row.box for row in rows], expected, atol=1e-9)
    assert [row.frame for row in rows] == ["000001.jpg"] * 3


def test_motchallenge_has_no_header_and_counts_from_1(tmp_path, cameras, calibration, capsys):
    rows = [[2, k, *box, 1, -1, -1, -1] for k, box in enumerate(boxes_of(calibration.camera).tolist())]
    path = written(tmp_path / "mot.txt", rows)
    assert projected(path, cameras) == 2
    assert "--frame-offset -1" in capsys.readouterr().err
    found = projected(path, cameras, "--frame-offset", -1)
    np.testing.assert_allclose(points(found), PLAYERS[:, :2], atol=1e-6)
    assert list(found[0])[:7] == ["frame", "id", "bb_left", "bb_top", "bb_width", "bb_height", "conf"]
    assert {row["problem"] for row in projected(path, cameras, "--frame-offset", 1)} == {"camera rejected"}


def test_files_of_the_game_state_are_read(tmp_path, cameras, calibration):
    boxes = [dict(zip("xywh", box, strict=True)) for box in boxes_of(calibration.camera).tolist()]
    players = [
        {"id": str(k), "image_id": "3021000001", "track_id": k, "supercategory": "object", "bbox_image": box}
        | {"attributes": {"role": "player", "jersey": None, "team": "left"}}
        for k, box in enumerate(boxes)
    ]
    camera = {"id": "9", "image_id": "3021000001", "supercategory": "camera", "parameters": {}}
    path = tmp_path / "021.json"
    path.write_text(json.dumps({"predictions": [camera, *players]}))
    found = projected(path, cameras)
    np.testing.assert_allclose(points(found), PLAYERS[:, :2], atol=1e-6)
    assert [(row["track_id"], row["role"], row["jersey"]) for row in found] == [
        (str(k), "player", "") for k in range(3)
    ]

    images = [{"image_id": "a", "file_name": "000001.jpg"}]  # the truth says the names of images
    path.write_text(json.dumps({"images": images, "annotations": [one | {"image_id": "a"} for one in players]}))
    np.testing.assert_allclose(points(projected(path, cameras)), PLAYERS[:, :2], atol=1e-6)


def test_game_states_get_the_places_of_their_boxes(tmp_path, cameras, calibration, capsys):
    boxes = [dict(zip("xywh", box, strict=True)) for box in boxes_of(calibration.camera).tolist()]
    state = {"predictions": [{"supercategory": "pitch", "lines": {}}]}
    state["predictions"] += [{"image_id": "3021000001", "bbox_image": box, "more": 1} for box in boxes]
    state["predictions"] += [{"image_id": "3021000003", "bbox_image": boxes[0]}]
    state["predictions"] += [{"image_id": "3021000001", "bbox_image": {"x": 1, "y": -900, "w": 9, "h": 9}}]
    path, out = tmp_path / "021.json", tmp_path / "placed.json"
    path.write_text(json.dumps(state))
    command = ["project", str(path), "--cameras", str(cameras), "--out", str(out)]
    assert main(command) == 0
    assert "5 rows" in capsys.readouterr().out
    pitch, *players, rejected, sky = json.loads(out.read_text())["predictions"]
    assert pitch == state["predictions"][0]
    assert rejected["bbox_pitch"] is sky["bbox_pitch"] is None
    assert [{k: v for k, v in one.items() if k != "bbox_pitch"} for one in players] == state["predictions"][1:4]
    for one, X, box in zip(players, PLAYERS, boxes, strict=True):
        place = one["bbox_pitch"]
        np.testing.assert_allclose([place["x_bottom_middle"], place["y_bottom_middle"]], X[:2], atol=1e-6)
        left = calibration.camera.project([place["x_bottom_left"], place["y_bottom_left"], 0.0])
        right = calibration.camera.project([place["x_bottom_right"], place["y_bottom_right"], 0.0])
        np.testing.assert_allclose([left[0] + 0.5, right[0] + 0.5], [box["x"], box["x"] + box["w"]], atol=1e-6)
    assert main([*command, "--to", "tracab"]) == 2
    table = written(tmp_path / "boxes.csv", [[0, 1, 2, 3, 4]], ["frame", "x", "y", "width", "height"])
    assert main(["project", str(table), "--cameras", str(cameras), "--out", str(out)]) == 2
    assert "tables end with .csv" in capsys.readouterr().err


def test_tables_of_tracklab_have_a_box_in_one_cell(tmp_path, cameras, calibration):
    cells = [f"[{'  '.join(map(repr, box))}]" for box in boxes_of(calibration.camera).tolist()]
    path = written(tmp_path / "detections.csv", [["1", cell] for cell in cells], ["image_id", "bbox_ltwh"])
    np.testing.assert_allclose(points(projected(path, cameras)), PLAYERS[:, :2], atol=1e-6)


def test_problems_are_said_and_nothing_is_dropped(tmp_path, cameras, calibration):
    low = [calibration.camera.image_size[0] / 2, 600.0, 10.0, 120.0]
    outside = boxes_of(calibration.camera, np.array([[30.0, -36.0, 0.0]]))[0]
    rows = [
        ["000000", 10.0, -400.0, 10.0, 20.0],
        ["000000", *outside],
        ["000000", *low],
        ["000000", "", "", "", ""],
        ["000001.jpg", *boxes_of(calibration.camera)[0]],
        ["img1/000001.png", *boxes_of(calibration.camera)[0]],
        ["1.0", *boxes_of(calibration.camera)[0]],
        ["000002", *low],
        ["000003", *low],
        ["77", *low],
    ]
    path = written(tmp_path / "boxes.csv", rows, ["frame", "x", "y", "width", "height"])
    found = projected(path, cameras)
    expected = ["above the horizon", "off the pitch", "cut by the image", "no box", "", "", "", "no camera"]
    assert [row["problem"] for row in found] == [*expected, "camera rejected", "no camera"]
    has_point = [bool(row["field_x"]) for row in found]
    assert has_point == [False, True, True, False, True, True, True, False, False, False]
    assert projected(path, cameras, "--keep-rejected")[8]["field_x"]


def test_players_behind_the_lines_of_a_court_with_a_net_are_no_problem(tmp_path):
    court = tennis()
    camera = Camera.from_angles(0.0, 1.2, 0.0, 900.0, (0.0, 25.0, -9.0), (960, 540))
    pixels = {label: camera.project(court[label].sample(1.0)) for label in court if not label.startswith("Net post")}
    out = tmp_path / "cameras"
    fieldcalib.calibrate({"000000": pixels}, field=court, image_size=(960, 540), progress=False).save(out)
    feet = np.array([[-court.length / 2.0 - 1.5, 1.0, 0.0], [0.0, -2.0, 0.0]])
    path = written(
        tmp_path / "boxes.csv", [["000000", *box] for box in boxes_of(camera, feet)], ["frame", "x", "y", "w", "h"]
    )
    found = projected(path, out)
    np.testing.assert_allclose(points(found), feet[:, :2], atol=0.05)
    assert [row["problem"] for row in found] == ["", ""]


def test_boxes_of_images_of_another_size(tmp_path, cameras, calibration):
    path = tmp_path / "boxes.csv"
    written(path, [["0", *box] for box in 1.5 * boxes_of(calibration.camera)], ["frame", "x", "y", "w", "h"])
    found = projected(path, cameras, "--size", "1920x1080")
    np.testing.assert_allclose(points(found), PLAYERS[:, :2], atol=1e-6)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("frame,x,y,width,height\n1,2,3,4,5\n1,2,3,4\n", "line 3: expected 5 columns, got 4"),
        (
            "frame,x,y,width,height\n1,2,3,4,5\n\n1,2,3,four,5\n",
            "line 4: expected numbers (left, top, width, height), got 2, 3, four",
        ),
        ("frame,x,y,width,height\n1,2,3,-4,5\n", "line 2: expected a box (left, top, width, height) of positive size"),
        ("frame,x1,y1,x2,y2\n1,5,3,4,5\n", "line 2: expected a box (left, top, right, bottom) of positive size"),
        ("frame,x,y,width,height\n,2,3,4,5\n", "line 2: the column 'frame' is empty"),
        ('frame,x,y,width,height\n1,"2"3,3,4,5\n', "line 2: "),
        ("frame,x,y,z\n1,2,3,4\n", "expected a column with the frame (frame, frame_id"),
        ("frame,x,y,x,width,height\n1,2,3,4,5,6\n", "the column 'x' is there twice"),
        ("1,2,3,4,5\n", "line 1: expected a header, or 6 to 10 numbers"),
        ("", "is empty"),
        ("frame,field_x,x,y,width,height\n1,2,2,3,4,5\n", "has the column 'field_x' already"),
        ("frame,x,y,width,height\n91,2,3,4,5\n", "has a camera in"),
        ("frame,x,y,width,height\n91,2,3,4,5\n", "boxes are of frames as '91', cameras of frames as '000000'"),
        ("frame,x,y,width,height\n2,2,3,4,5\n", "its frames were refused or not read"),
    ],
)
def test_what_is_malformed_is_named_and_nothing_is_written(tmp_path, cameras, capsys, content, message):
    path = tmp_path / "boxes.csv"
    path.write_text(content)
    assert projected(path, cameras) == 2
    assert message in capsys.readouterr().err
    assert sorted(file.name for file in tmp_path.iterdir()) == ["boxes.csv", "cameras"]


@pytest.mark.parametrize(
    ("record", "message"),
    [
        ({"x": 1}, "expected the key 'predictions'"),
        ({"predictions": [{"bbox_image": {"x": 1}, "image_id": "1"}]}, "entry 0: is no box with an image: 'y'"),
        ({"predictions": [3]}, "entry 0: expected an object, got int"),
    ],
)
def test_what_is_malformed_in_a_game_state_is_named(tmp_path, cameras, capsys, record, message):
    path = tmp_path / "state.json"
    path.write_text(json.dumps(record))
    assert projected(path, cameras) == 2
    assert message in capsys.readouterr().err


def test_the_file_of_the_boxes_is_not_overwritten(tmp_path, cameras, capsys):
    path = written(tmp_path / "players.csv", [[0, 1, 2, 3, 4]], ["frame", "x", "y", "width", "height"])
    assert main(["project", str(path), "--cameras", str(cameras), "--out", str(path)]) == 2
    assert "players.csv is read by this command" in capsys.readouterr().err
    assert path.read_text().startswith("frame,x")


def test_feet_are_the_middle_of_the_lower_edge_in_pixels_from_the_first_ones_centre():
    one_pixel = [[5.0, 7.0, 6.0, 8.0]]  # its lower edge is that of the pixel (5, 7)
    assert foot_points(one_pixel).tolist() == [[5.0, 7.5]]
    with pytest.raises(ValueError, match=r"expected boxes of shape"):
        foot_points([1.0, 2.0])
    with pytest.raises(ValueError, match=r"got \[680.0, 280.0, 40.0, 100.0\]: is it x, y, width and height"):
        foot_points([[100, 200, 140, 300], [680, 280, 40, 100]])


@pytest.mark.parametrize("pixel_sd", [pytest.param(0.0, marks=pytest.mark.slow), 2.0])
def test_standard_deviations_are_those_of_drawn_cameras_and_pixels(rng, pixel_sd):
    layout = Layout.of(SIZE)
    theta = layout.theta(TRUTH)
    spread = np.zeros(layout.size)
    spread[:4] = 2e-4, 3e-4, 1e-4, 5e-4
    spread[4:7] = 0.02
    covariance = np.diag(spread**2)
    covariance[0, 1] = covariance[1, 0] = 0.5 * spread[0] * spread[1]
    calibration = Calibration(TRUTH, Status.ACCEPTED, "", 0.0, 0.0, {}, errors=KnownErrors(layout, theta, covariance))
    xy = TRUTH.project(PLAYERS)
    found = locate_on_ground(calibration, xy, pixel_sd=pixel_sd)
    drawn = rng.multivariate_normal(theta, covariance, size=2000)
    seen = xy + pixel_sd * rng.standard_normal((len(drawn), *xy.shape))
    X = np.array([layout.camera(one).image_to_field(pixels) for one, pixels in zip(drawn, seen, strict=True)])[..., :2]
    np.testing.assert_allclose(found.X, PLAYERS, atol=1e-6)
    np.testing.assert_allclose(found.standard_deviations, X.std(axis=0), rtol=0.05)
    correlations = [np.corrcoef(X[:, k].T)[0, 1] for k in range(len(PLAYERS))]
    np.testing.assert_allclose(found.correlation, correlations, atol=0.06)


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.mark.parametrize(
    ("count", "size", "said"), [(120, SIZE, False), (120, (640, 360), True), (50, (640, 360), False)]
)
def test_boxes_of_images_of_another_size_are_spoken_of(tmp_path, cameras, capsys, rng, count, size, said):
    corner = rng.uniform((0.0, 0.0), np.array(size) - 60.0, size=(count, 2))
    rows = [["0", *map(repr, xy), "20", "55"] for xy in corner.tolist()]
    path = written(tmp_path / "boxes.csv", rows, ["frame", "x", "y", "width", "height"])
    assert projected(path, cameras)
    printed = capsys.readouterr().err
    assert ("in an image of 1280 x 720: were they found in one of another size" in printed) == said
    assert projected(path, cameras, "--size", f"{size[0]}x{size[1]}")
    assert capsys.readouterr().err == ""


def test_boxes_that_look_normalised_are_spoken_of(tmp_path, cameras, capsys):
    path = written(tmp_path / "boxes.csv", [["0", "0.5", "0.6", "0.1", "0.2"]], ["frame", "x", "y", "width", "height"])
    assert projected(path, cameras)
    assert "all boxes lie within 0..1: if they are shares of the picture, --size 1x1" in capsys.readouterr().err
    assert projected(path, cameras, "--size", "1x1")
    assert capsys.readouterr().err == ""


def test_cameras_are_read_again_when_they_are_asked_for(tmp_path, cameras, calibration):
    """What is held of a frame is its place in the file, wherever it is: lines of other lengths, one cut off."""
    path = cameras / "cameras.jsonl"
    long = json.dumps({"id": "000009", "message": "ü" * 50_000, "status": "broken file"}, ensure_ascii=False)
    path.write_bytes(f"{long}\n".encode() + path.read_bytes() + b'{"id": "0000')
    found = Cameras(cameras)
    assert found.of("000009") is None
    assert found.of("1").camera == calibration.camera
    assert found.of("3").status is Status.IMPROBABLE
    assert found.of("000010") is None
    many = path.read_bytes().splitlines(keepends=True)[1].replace(b"000000", b"%06d")
    path.write_bytes(b"".join(many.replace(b"%06d", b"%06d" % number) for number in range(500)))
    tracemalloc.start()
    found = Cameras(cameras)
    held, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert found.of("499").camera == calibration.camera
    assert held < 0.2 * path.stat().st_size


def test_an_uncertainty_that_is_not_known_is_left_empty(calibration):
    closed = Calibration(calibration.camera, Status.ACCEPTED, "", 0.0, 0.0, {})
    found = locate_on_ground(closed, calibration.camera.project(PLAYERS))
    assert np.isfinite(found.X).all()
    assert np.isnan(found.standard_deviations).all()
    with pytest.raises(ValueError, match="there is no camera"):
        locate_on_ground(Calibration.without_camera(Status.TOO_FEW_SEGMENTS, "none"), [[1.0, 2.0]])
    with pytest.raises(
        ValueError, match=r"expected a Calibration, got a Camera; camera.image_to_field\(xy\) gives the"
    ):
        locate_on_ground(calibration.camera, [[1.0, 2.0]])


# Coordinate systems


SIZES = [(105.0, 68.0), (101.3, 65.5)]


def by_kloppy(xy, system, length, width):
    """The points as kloppy transforms the frames of a data set of ours."""
    from kloppy.domain import (
        CustomCoordinateSystem,
        DatasetType,
        Dimension,
        Frame,
        MetricPitchDimensions,
        Origin,
        Period,
        Point,
        Point3D,
        Provider,
        VerticalOrientation,
        build_coordinate_system,
    )
    from kloppy.domain.services.transformers.dataset import DatasetTransformer

    dimensions = MetricPitchDimensions(
        x_dim=Dimension(-length / 2, length / 2),
        y_dim=Dimension(-width / 2, width / 2),
        pitch_length=length,
        pitch_width=width,
        standardized=False,
    )
    ours = CustomCoordinateSystem(
        origin=Origin.CENTER, vertical_orientation=VerticalOrientation.TOP_TO_BOTTOM, pitch_dimensions=dimensions
    )
    theirs = build_coordinate_system(Provider(system), DatasetType.TRACKING, pitch_length=length, pitch_width=width)
    transformer = DatasetTransformer(from_coordinate_system=ours, to_coordinate_system=theirs)
    period = Period(id=1, start_timestamp=timedelta(0), end_timestamp=timedelta(1))
    found = []
    for x, y in xy.tolist():
        frame = Frame(
            timestamp=timedelta(0),
            frame_id=1,
            ball_owning_team=None,
            ball_state=None,
            period=period,
            players_data={},
            other_data={},
            statistics=[],
            ball_coordinates=Point3D(x, y, None),
        )
        ball = transformer.transform_frame(frame).ball_coordinates
        assert isinstance(ball, Point)
        found.append((ball.x, ball.y))
    return np.array(found)


def test_systems_are_those_of_kloppy(rng):
    for length, width in SIZES:
        field = soccer(length, width)
        xy = rng.uniform(-0.5, 0.5, (200, 2)) * (length, width)
        for system in SYSTEMS[2:]:
            np.testing.assert_allclose(to_system(xy, system, field), by_kloppy(xy, system, length, width), atol=1e-9)


def test_systems_are_those_of_mplsoccer(rng):
    from mplsoccer import Standardizer

    knots = (-47.0, -41.5, -36.0, 0.0, 36.0, 41.5, 47.0)  # in between mplsoccer does not know circle and arc
    xy = np.column_stack([rng.choice(knots, 200), rng.uniform(-34.0, 34.0, 200)])
    for system in ("statsbomb", "tracab", "skillcorner", "secondspectrum"):
        theirs = Standardizer("skillcorner", system, length_from=105, width_from=68, length_to=105, width_to=68)
        expected = np.column_stack(theirs.transform(xy[:, 0], -xy[:, 1]))
        np.testing.assert_allclose(to_system(xy, system, soccer()), expected, rtol=1e-12, atol=1e-9)


def test_known_points_of_systems():
    corner, near_right = (52.5, -34.0), (52.5, 34.0)  # far right, near right
    for system, expected in {
        "soccernet": (corner, near_right),
        "skillcorner": ((52.5, 34.0), (52.5, -34.0)),
        "tracab": ((5250.0, 3400.0), (5250.0, -3400.0)),
        "statsbomb": ((120.0, 0.0), (120.0, 80.0)),
        "opta": ((100.0, 100.0), (100.0, 0.0)),
    }.items():
        np.testing.assert_allclose(to_system([corner, near_right], system, soccer()), expected)
    assert np.isnan(to_system([np.nan, 0.0], "opta", soccer())).all()
    assert to_system(np.zeros((3, 4, 3)), "tracab", soccer()).shape == (3, 4, 2)


def test_scales_are_derivatives(rng):
    xy = rng.uniform(-0.45, 0.45, (20, 2)) * (105.0, 68.0)
    for system in ("fieldcalib", "tracab", "statsbomb", "opta"):
        numeric = (to_system(xy + 1e-4, system, soccer()) - to_system(xy - 1e-4, system, soccer())) / 2e-4
        np.testing.assert_allclose(scale_of_system(xy, system, soccer()), numeric, rtol=1e-6)


def test_standard_deviations_are_in_the_unit_of_the_system(tmp_path, cameras, calibration):
    import kloppy  # noqa: F401  # of the extra: the command would only say that it is missing

    rows = [["0", *box] for box in boxes_of(calibration.camera)]
    path = written(tmp_path / "boxes.csv", rows, ["frame", "x", "y", "width", "height"])
    metres, centimetres = projected(path, cameras), projected(path, cameras, "--to", "tracab")
    for ours, theirs in zip(metres, centimetres, strict=True):
        assert float(theirs["field_x"]) == pytest.approx(100.0 * float(ours["field_x"]), abs=1e-3)
        assert float(theirs["field_y"]) == pytest.approx(-100.0 * float(ours["field_y"]), abs=1e-3)
        assert float(theirs["field_y_sd"]) == pytest.approx(100.0 * float(ours["field_y_sd"]), abs=1e-3)
        assert float(theirs["field_correlation"]) == pytest.approx(-float(ours["field_correlation"]), abs=1e-5)
        assert (ours["field_system"], theirs["field_system"]) == ("fieldcalib", "tracab")


def test_tables_in_other_coordinates_are_not_drawn(tmp_path, cameras, calibration, capsys):
    import kloppy  # noqa: F401

    rows = [["0", *box] for box in boxes_of(calibration.camera)]
    path = written(tmp_path / "boxes.csv", rows, ["frame", "x", "y", "width", "height"])
    draw = ["minimap", str(tmp_path / "players.csv"), "--cameras", str(cameras), "--out", str(tmp_path / "map.png")]
    projected(path, cameras)
    assert main(draw) == 0
    projected(path, cameras, "--to", "skillcorner")  # metres too, y the other way round
    capsys.readouterr()
    assert main(draw) == 2
    assert "are in the coordinates of 'skillcorner', expected those of 'fieldcalib'" in capsys.readouterr().err


def test_systems_that_nobody_has_are_refused(tmp_path, cameras, capsys):
    with pytest.raises(ValueError, match=r"expected a system among fieldcalib, soccernet, .*skillcorner.*, got 'mars'"):
        to_system([0.0, 0.0], "mars", soccer())
    with pytest.raises(ValueError, match="are of soccer pitches"):
        to_system([0.0, 0.0], "opta", tennis())
    with pytest.raises(ValueError, match=r"expected field points of shape \(\.\.\., 2\) or"):
        to_system([0.0], "opta", soccer())
    path = written(tmp_path / "boxes.csv", [[0, 1, 2, 3, 4]], ["frame", "x", "y", "width", "height"])
    assert projected(path, cameras, "--to", "mars") == 2
    assert "expected a system among" in capsys.readouterr().err


def test_misspelt_systems_are_named_without_kloppy(monkeypatch):
    monkeypatch.setitem(sys.modules, "kloppy.domain", None)  # not installed
    with pytest.raises(ValueError, match=r"expected a system among .*skillcorner.*, got 'skilcorner'"):
        to_system([0.0, 0.0], "skilcorner", soccer())
    with pytest.raises(ImportError, match="kloppy"):
        to_system([0.0, 0.0], "sportvu", soccer(104, 67))


# Other files of detectors


def of_file(path):
    with open_boxes(path) as table:
        return table, list(table.rows)


def yolo_lines(camera, *after):
    left, top, width, height = boxes_of(camera).T
    shares = np.column_stack([left + width / 2, top + height / 2, width, height]) / (*SIZE, *SIZE)
    return "".join(f"0 {' '.join(map(repr, row))} {' '.join(after)}\n" for row in shares.tolist())


def test_points_of_feet_need_no_boxes(tmp_path, cameras, calibration):
    xy = calibration.camera.project(PLAYERS)
    for names in (("x", "y"), ("foot_x", "foot_y"), ("pixel_x", "pixel_y")):
        path = tmp_path / f"{names[0]}.csv"
        with path.open("w", newline="") as file:
            csv.writer(file).writerows([("frame", *names), *((0, *row) for row in xy.tolist())])
        found = projected(path, cameras)
        np.testing.assert_allclose(points(found), PLAYERS[:, :2], atol=1e-6)
        assert {row["problem"] for row in found} == {""}


@pytest.mark.parametrize(
    ("after", "confidence", "track"),
    [((), "", ""), (("0.5",), "0.5", ""), (("7",), "", "7"), (("0.25", "7"), "0.25", "7")],
)
def test_a_folder_of_yolo_is_in_shares_of_the_image(tmp_path, cameras, calibration, after, confidence, track):
    folder = tmp_path / "labels"
    folder.mkdir()
    (folder / "000000.txt").write_text(yolo_lines(calibration.camera, *after))
    (folder / "000001.txt").write_text("\n")
    found = projected(folder, cameras)
    np.testing.assert_allclose(points(found), PLAYERS[:, :2], atol=1e-6)
    assert {(row["frame"], row["class"]) for row in found} == {("000000", "0")}
    assert {(row["confidence"], row["track_id"]) for row in found} == {(confidence, track)}
    alone = projected(folder / "000000.txt", cameras)
    np.testing.assert_allclose(points(alone), points(found))


def test_frames_of_a_video_by_ultralytics_count_from_1(tmp_path, cameras, calibration, capsys):
    folder = tmp_path / "labels"
    folder.mkdir()
    (folder / "match_2.txt").write_text(yolo_lines(calibration.camera))
    assert projected(folder, cameras) == 2
    assert "frames of ultralytics count from 1" in capsys.readouterr().err
    np.testing.assert_allclose(points(projected(folder, cameras, "--frame-offset", -1)), PLAYERS[:, :2], atol=1e-6)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0 0.5 0.5 0.1\n", "expected a column with the frame"),  # read as a table
        ("0 0.5 0.5 0.1 0.1 0.9 3\n0 0.5 0.5 0.1\n", "line 2: expected class, x_center"),
        ("0 500 300 20 50\n", "line 1: expected class, x_center, y_center, width, height in shares"),
        ("0 0.5 0.5 -0.1 0.1\n", "line 1: expected a box"),
        ("0 0.5 0.5 0.1 0.1\n0 0.5 0.5 0.1 nan\n", "line 2: expected a box"),
    ],
)
def test_malformed_lines_of_yolo_are_named(tmp_path, text, message):
    path = tmp_path / "a.txt"
    path.write_text(text)
    with pytest.raises(BrokenFileError, match=message):
        of_file(path)


def test_coco_is_a_dataset_or_a_list_of_detections(tmp_path, cameras, calibration):
    boxes = boxes_of(calibration.camera).tolist()
    detections = [{"image_id": 1, "category_id": 3, "bbox": box, "score": 0.9} for box in boxes]
    names = {
        "images": [{"id": 1, "file_name": "img1/000000.jpg", "width": 1280, "height": 720}],
        "categories": [{"id": 3, "name": "player"}],
    }
    with_names = names | {"annotations": [{"id": n, **one} for n, one in enumerate(detections)]}
    for content, frame, category in ((detections, "000001", "3"), (with_names, "000000", "player")):
        path = tmp_path / "boxes.json"
        path.write_text(json.dumps(content))
        found = projected(path, cameras)
        np.testing.assert_allclose(points(found), PLAYERS[:, :2], atol=1e-6)
        assert {(row["category"], row["score"]) for row in found} == {(category, "0.9")}, frame


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ([{"bbox": [1, 2, 3, 4]}], "entry 0: is no box with an image"),
        ([{"image_id": 1, "bbox": [1, 2, 3]}], "entry 0: expected four numbers in bbox"),
        ([{"image_id": 1, "bbox": 3}], "entry 0: is no box"),
        ([7], "entry 0: expected an object"),
        (7, "expected a JSON object or a list of boxes"),
        ({"a": 1}, "expected the key 'predictions' or 'annotations'"),
        ({"images": 3, "annotations": []}, "expected a list for the key 'images'"),
    ],
)
def test_malformed_json_is_named(tmp_path, content, message):
    path = tmp_path / "boxes.json"
    path.write_text(json.dumps(content))
    with pytest.raises(BrokenFileError, match=message):
        of_file(path)


def test_byte_track_writes_tables_of_motchallenge(tmp_path):
    path = tmp_path / "track.txt"
    path.write_text("1,7,100.0,200.0,40.0,100.0,0.91,-1,-1,-1\n")
    table, (row,) = of_file(path)
    assert table.counts_from_1 == "MOTChallenge"
    np.testing.assert_array_equal(foot_points(row.box), [119.5, 299.5])


def test_what_is_accepted_is_named(tmp_path, cameras, capsys):
    path = tmp_path / "boxes.csv"
    path.write_text("frame,a,b\n1,2,3\n")
    assert projected(path, cameras) == 2
    said = capsys.readouterr().err
    for name in ("image_id", "x1, y1, x2, y2", "bb_left", "bbox_ltwh", "foot_x, foot_y", "got frame, a, b"):
        assert name in said
    (tmp_path / "empty").mkdir()
    assert projected(tmp_path / "empty", cameras) == 2
    assert "COCO" in capsys.readouterr().err


def test_a_game_state_is_not_made_of_coco(tmp_path, cameras, capsys):
    path = tmp_path / "boxes.json"
    path.write_text(json.dumps([{"image_id": 1, "bbox": [1, 2, 3, 4]}]))
    assert main(["project", str(path), "--cameras", str(cameras), "--out", str(tmp_path / "out.json")]) == 2
    assert "tables end with .csv" in capsys.readouterr().err
