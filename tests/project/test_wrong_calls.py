"""Arguments of wrong types and values: errors that say what was expected; names that would steer a terminal."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from commands import run

from fieldcalib import (
    Camera,
    Editor,
    Field,
    Point,
    PointCloud,
    SegmentationNetwork,
    calibrate,
    calibrate_from_homography,
    calibrate_from_points,
    calibrate_from_segments,
    calibrate_sequence,
    calibrate_video,
    field,
    locate_on_ground,
    read,
    soccer,
)
from fieldcalib.draw import (
    contact_sheet,
    draw_calibration,
    draw_field,
    draw_minimap,
    draw_players,
    draw_segments,
    label_colour,
    overhead_camera,
    plot_sequence,
    render_field,
    worst_frames,
)
from fieldcalib.fields import DISTRIBUTIONS, basketball, field_homography, ice_hockey
from fieldcalib.images import match_background, match_far, refine_on_image
from fieldcalib.io import key_points, read_annotations
from fieldcalib.io.boxes import open_boxes
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.label_studio import parse_label_studio
from fieldcalib.io.streams import Stream
from fieldcalib.io.videos import VideoWriter
from fieldcalib.localize import ridge_points
from fieldcalib.metrics import compound_score, evaluate_segments, iou_part, iou_whole, projection_error
from fieldcalib.problem import RobustLoss
from fieldcalib.processes import Processes
from fieldcalib.solve import camera_from_homography

SIZE = (960, 540)
CAMERA = Camera.from_angles(-0.3, 1.35, 0.0, 1600.0, (0.0, 68.0, -17.0), SIZE)
LABELS = ("Side line left", "Side line top", "Big rect. left main", "Big rect. left top", "Circle left")
PIXELS = {label: CAMERA.project(soccer()[label].sample(7.0)) for label in LABELS}
X = np.array([point.X for name, point in soccer().points.items() if name.startswith("L_PENALTY")])
XY = CAMERA.project(X)
H = CAMERA.homography
IMAGE = np.zeros((540, 960, 3), np.uint8)
HUGE = np.full((3, 3), 1e308)


def of_segments(pixels=PIXELS, size=SIZE, **keywords):
    return calibrate_from_segments(soccer(), pixels, size, **keywords)


@pytest.fixture(scope="module")
def found():
    return of_segments()


WRONG = {
    "an infinite size": (lambda _: of_segments(size=(np.inf, 540)), "image_size must be"),
    "an infinite size of points": (lambda _: calibrate_from_points(X, XY, (np.inf, 540)), "image_size must be"),
    "a size of a homography": (lambda _: calibrate_from_homography(np.eye(3), (np.inf, 540)), "image_size must be"),
    "a number for points": (lambda _: calibrate_from_points(3.0, XY, SIZE), "object_points: expected an array"),
    "nothing for points": (lambda _: calibrate_from_points(None, None, SIZE), "object_points: expected an array"),
    "complex points": (lambda _: calibrate_from_points(X, XY + 1j, SIZE), "(?s)image_points: .* got complex ones"),
    "complex pixels": (
        lambda _: of_segments({**PIXELS, "Circle left": PIXELS["Circle left"] + 1j}),
        "(?s)'Circle left': .* got complex ones",
    ),
    "a complex homography": (lambda _: calibrate_from_homography(1j * np.eye(3), SIZE), "got complex ones"),
    "a complex camera": (lambda _: Camera(1j * np.eye(3), np.eye(3), np.zeros(3), SIZE), "K: .* got complex ones"),
    "complex world points": (lambda found: found.camera.project(1j * np.ones(3)), "got complex ones"),
    "large weights": (lambda _: of_segments(weights=dict.fromkeys(PIXELS, 1e14)), "expected a weight up to 1e"),
    "large weights of points": (lambda _: calibrate_from_points(X, XY, SIZE, weights=1e200), "expected a weight up to"),
    "a text as flags": (lambda _: of_segments(flags="CALIB_FIX_K1"), "flags must be a combination"),
    "a float as flags": (lambda _: of_segments(flags=1.5), "flags must be a combination"),
    "flags of a clip whose camera is turned": (
        lambda _: calibrate_video(soccer(), [IMAGE, IMAGE], flags=-0.5, rvec=np.zeros(3)),
        "flags must be a combination",
    ),
    "arrays for a truth": (
        lambda _: calibrate_video(soccer(), [IMAGE, IMAGE], estimate_aspect=np.zeros(2)),
        "estimate_aspect must be True or False",
    ),
    "a list as flags": (
        lambda _: calibrate_from_points(X, XY, SIZE, flags=[1]),
        "flags must be a combination",
    ),
    "texts as criteria": (lambda _: of_segments(criteria=("a", 1, 2)), "criteria must be"),
    "no field to render": (lambda _: render_field(CAMERA, None), "expected a Field"),
    "no camera to render": (lambda _: render_field(None, soccer()), "expected a Camera"),
    "no field to draw": (lambda _: draw_field(IMAGE, CAMERA, None), "expected a field"),
    "no camera to draw": (lambda _: draw_field(IMAGE, None, soccer()), "expected a Camera"),
    "no calibration to draw": (lambda _: draw_calibration(IMAGE, None, soccer()), "expected a Calibration"),
    "no field of a calibration": (lambda found: draw_calibration(IMAGE, found, "soccer"), "expected a field"),
    "no camera on a map": (lambda _: draw_minimap("camera", soccer()), "expected a Camera"),
    "no field from above": (lambda _: overhead_camera(None), "expected a Field"),
    "a size of a field": (lambda _: soccer("105", 68.0), "expected length and width as numbers"),
    "a fine picture from above": (lambda _: overhead_camera(soccer(), 1e-308), "the picture would have"),
    "a text as metres": (lambda found: found.probability("1"), "metres must be a positive number, got '1'"),
    "a list as metres": (lambda found: found.probability([1]), "metres must be a positive number"),
    "a number for labels": (lambda _: draw_segments(IMAGE, 3), "expected a Mapping"),
    "a text as radius": (lambda _: draw_segments(IMAGE, PIXELS, radius="4"), "radius must be a positive number"),
    "a number as label": (lambda _: label_colour(3), "expected a str"),
    "a fine brush": (lambda _: draw_field(IMAGE, CAMERA, soccer(), thickness=0.5), "thickness must be a whole number"),
    "no colours": (lambda _: draw_field(IMAGE, CAMERA, soccer(), colours=None), "expected a Mapping"),
    "no trails": (lambda _: draw_minimap(CAMERA, soccer(), trails=None), "expected trails of points, a list"),
    "no camera of players": (lambda _: draw_players(IMAGE, None, X), "expected a Camera"),
    "no random numbers": (lambda _: render_field(CAMERA, soccer(), rng=3), "expected a Generator"),
    "no pictures": (lambda _: contact_sheet(None, []), "expected pictures, a list, got a NoneType"),
    "no calibrations": (lambda _: worst_frames(3), "expected calibrations, a list, got an int"),
    "no number of frames": (lambda found: worst_frames([found], "2"), "count must be a whole number"),
    "a rate of a plot": (lambda found: plot_sequence([found], frames_per_second="25"), "frames_per_second must be a"),
    "no camera of a homography": (lambda _: field_homography(H, soccer()), "expected a Camera"),
    "no field of a homography": (lambda _: field_homography(CAMERA, None), "expected a Field"),
    "a text as zeta": (lambda _: camera_from_homography(H, SIZE, zeta="1"), "zeta must be positive"),
    "no ground points": (lambda _: camera_from_homography(H, SIZE, points=3), "expected a Mapping"),
    "cells of nothing": (lambda _: iou_part(CAMERA, CAMERA, SIZE, cell="1"), "cell must be a number"),
    "cells without number": (lambda _: iou_part(CAMERA, CAMERA, SIZE, cell=1e-9), "at most 5000000 of them"),
    "no field of an overlap": (lambda _: iou_part(CAMERA, CAMERA, SIZE, field=3), "expected a Field"),
    "no predictions": (lambda _: evaluate_segments(None, [], SIZE), "expected predictions, a list"),
    "a text as completeness": (lambda _: compound_score([0.5, 0.5, 0.5], "1"), "completeness must be a number"),
    "steps of no length": (lambda _: soccer()["Middle line"].sample(0.0), "spacing must be positive"),
    "steps without number": (lambda _: soccer()["Circle left"].sample(1e-12), "spacing must be positive"),
    "steps of a text": (lambda _: soccer()["Middle line"].sample("1"), "spacing must be positive"),
    "a text as a point": (lambda _: Point("a"), "a Point.*: expected numbers"),
    "a text as points": (lambda _: PointCloud("a"), "expected numbers"),
    "a number as a range": (lambda _: replace(DISTRIBUTIONS["main center"], x=3), r"x must be \(low, high\)"),
    "a text as a length": (lambda _: Field("28", 15.0, {}), "a Field needs length as a number"),
    "no stands": (lambda _: Field(28.0, 15.0, {}, stands=3), "expected stands, a list"),
    "stands by name": (lambda _: Field(28.0, 15.0, {}, stands=("main",)), "expected a CameraDistribution"),
    "more segments": (lambda _: soccer().with_segments(None), "expected a Mapping"),
    "a text as an angle": (
        lambda _: Camera.from_angles("x", 1.3, 0.0, 1500.0, (0, 60, -15), SIZE),
        "pan: expected numbers",
    ),
    "three principal points": (
        lambda _: Camera.from_angles(0.0, 1.3, 0.0, 1500.0, (0, 60, -15), SIZE, (1, 2, 3)),
        "principal_point must be a finite array",
    ),
    "two of three numbers": (lambda _: Camera.from_opencv([0, 0], [0, 0, 0], CAMERA.K, None, SIZE), "rvec must be"),
    "a text as a lens": (lambda _: Camera(CAMERA.K, CAMERA.R, CAMERA.C, SIZE, "a"), "expected numbers"),
    "a number as markings": (lambda found: found.seen_in_image(3), "expected markings in view, a list"),
    "names as markings": (lambda found: found.seen_in_image(["Middle line"]), "expected a MarkingInView"),
    "an unknown model": (lambda _: key_points([[1, 2, 1]], 3), "expected the name of a model"),
    "a text as confidence": (
        lambda _: key_points(np.ones((32, 3)), "roboflow-32", least_confidence="1"),
        "least_confidence must be a number",
    ),
    "half a process": (lambda _: Processes(1.5), "jobs must be a whole number"),
    "processes by name": (lambda _: Processes("2"), "jobs must be a whole number"),
    "a text as an in-goal": (lambda _: field("rugby-union", in_goal="6"), "deep in goal"),
    "a text as a corner": (lambda _: field("ice-hockey-iihf", corner_radius="7"), "have a radius"),
    "a text as a width": (lambda _: field("futsal", width="20"), "expected length and width as numbers"),
    "a list as rules": (lambda _: ice_hockey(["nhl"]), "rules of ice hockey must be one of"),
    "a list as a net": (lambda _: field("volleyball", net=["men"]), "net of a volleyball court must be one of"),
    "a list as a sport": (lambda _: field(["tennis"]), "expected a field among"),
    "an array as a loss": (lambda _: RobustLoss(np.zeros(2), 3.0), "loss must be one of"),
    "a text as a scale": (lambda _: RobustLoss("cauchy", "3"), "the scale of a loss must be"),
    "an array as a prior": (lambda _: of_segments(prior=np.zeros((2, 2))), "unknown camera distribution"),
    "a text as an error": (lambda found: locate_on_ground(found, XY, pixel_sd="1"), "pixel_sd must be"),
    "a truth as names": (
        lambda _: calibrate_sequence(soccer(), [PIXELS], SIZE, shared=True),
        "expected names to share",
    ),
    "a camera for a calibration": (lambda _: refine_on_image(soccer(), IMAGE, CAMERA), "expected a Calibration"),
    "a list as a code": (lambda _: basketball(["nba"]), "rules of a basketball court must be one of fiba"),
    "a number as a colour": (lambda _: draw_field(IMAGE, CAMERA, soccer(), colour=3), "expected a colour"),
    "a list as a kind": (lambda _: iou_whole(CAMERA, CAMERA, SIZE, kind=[]), "kind must be one of"),
    "a text as a new length": (lambda _: soccer().resized([105], 68.0), "length must be a number"),
    "no step": (lambda _: calibrate(IMAGE, step=None, progress=False), "step must be a whole number"),
    "numbers for pictures": (lambda _: calibrate([1, 2], progress=False), "image must be an array .* got int"),
    "pixels before the field": (
        lambda _: calibrate_from_segments(PIXELS, soccer(), SIZE),
        "expected a Line.* the field comes first, as soccer.*then the pixels",
    ),
    "an endless step": (lambda _: calibrate(IMAGE, step=np.inf, progress=False), "step must be a whole number"),
    "a camera beyond floats": (lambda _: Camera(1e300 * CAMERA.K, CAMERA.R, CAMERA.C, SIZE), "K must be"),
    "pixels beyond floats": (lambda _: soccer()["Circle left"].order([[1e308, 1e308]] * 3), "expected finite pixels"),
    "negative squares": (lambda _: RobustLoss("cauchy", 3.0).evaluate(-1.0), "must not be negative"),
    "arrays of matches": (lambda _: match_far(IMAGE, IMAGE, moving=np.zeros(2)), "moving must be True or False"),
    "a long integer for points": (lambda _: key_points(-(10**400)), "expected a result with `keypoints`"),
    "a long integer for a camera": (lambda _: iou_part(-(10**400), CAMERA, SIZE), "expected a Camera"),
    "a long integer to evaluate": (lambda _: projection_error(-(10**400), CAMERA, SIZE), "expected a Camera"),
    "a complex homography to evaluate": (lambda _: iou_whole(1j * np.eye(3), CAMERA, SIZE), "expected a Camera"),
    "long integers for pixels": (
        lambda _: evaluate_segments([CAMERA], [{"Middle line": [[10**400, 1]]}], SIZE),
        "expected finite pixels",
    ),
    "arrays of classes": (lambda _: ridge_points(np.zeros((2, 9, 16)), np.eye(2), soccer(), SIZE), "expected a str"),
    "a picture for trails": (
        lambda _: draw_players(IMAGE, CAMERA, X, trails=np.zeros((540, 960, 3))),
        "expected trails of at most 100000 places",
    ),
    "a set of pictures": (lambda _: contact_sheet({1}, ["a"]), "expected pictures, a list, got a set"),
    "many coefficients": (lambda _: of_segments(dist_coeffs=np.zeros((540, 960))), "dist_coeffs must be .{,300}$"),
    "a wide line": (lambda _: render_field(CAMERA, soccer(), line_width=1e308), "line_width must be at most"),
    "a frame rate": (lambda _: VideoWriter("a.mp4", 1e12), "expected at most 1000 frames per second"),
}


def test_a_homography_beyond_floats_is_no_camera():
    """Its scale is free, but here all numbers are alike."""
    assert match_background(IMAGE, IMAGE, start=HUGE) is None
    assert calibrate_from_homography(HUGE, SIZE).camera is None


@pytest.mark.parametrize(("call", "message"), WRONG.values(), ids=WRONG)
def test_wrong_arguments_are_told(found, call, message):
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # NumPy warns of what it drops
        with pytest.raises(ValueError, match=message):
            call(found)


PATHS = {
    "read": read,
    "read_annotations": lambda path: list(read_annotations(path)),
    "SegmentationNetwork.load": SegmentationNetwork.load,
    "calibrate": lambda path: calibrate(path, progress=False),
    "calibrate, of several": lambda path: calibrate([path], progress=False),
    "calibrate_video": lambda path: calibrate_video(soccer(), path),
    "Editor": Editor,
    "Editor, out": lambda path: Editor([IMAGE], out=path),
    "Editor, labels": lambda path: Editor([IMAGE], labels=path),
    "Results.save": lambda path: calibrate(PIXELS, image_size=SIZE, progress=False).save(path),
}


@pytest.mark.parametrize("call", PATHS.values(), ids=PATHS)
@pytest.mark.parametrize(("path", "said"), [("é" * 300, "too long"), ("\ud800", "no file can have"), ("\0", "a null")])
def test_paths_that_no_file_can_have_are_told(tmp_path, monkeypatch, call, path, said):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=f"expected the path of .*{said}"):
        call(path)
    assert list(tmp_path.iterdir()) == []


def test_captions_may_have_bytes_of_other_encodings():
    """Names of files that are not in UTF-8 have surrogates, at which OpenCV ends the process."""
    assert contact_sheet([IMAGE], ["T\udcfcrkei"], title="\udcfc").shape[2] == 3
    assert len(label_colour("\udcfc")) == 3


def test_points_at_infinity_are_left_out():
    far = [(np.inf, 0.0), (1e308, 1.0), (0.0, -np.inf)]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.array_equal(draw_players(IMAGE, CAMERA, far), IMAGE)


def test_predictions_that_are_no_list():
    (annotation,) = parse_label_studio('[{"data": {"image": "1.jpg"}, "predictions": 5}]')
    assert "predictions" in annotation.problem


def test_a_table_with_an_open_quote(tmp_path):
    path = tmp_path / "boxes.csv"
    path.write_text('frame,"x,y,width,height\n1,2,3,4,5\n')
    with pytest.raises(BrokenFileError, match=r"boxes\.csv, line"), open_boxes(path) as table:
        list(table.rows)


ESCAPE = "\x1b[2J\x9b.json"


def test_names_do_not_steer_the_terminal(tmp_path, capsys):
    (tmp_path / f"a{ESCAPE}").write_text("{")
    run("calibrate", tmp_path, "--size", "960x540", "--out", tmp_path / f"out{ESCAPE}")
    run("calibrate", tmp_path / f"none{ESCAPE}", "--size", "960x540", "--out", tmp_path / "other")
    run(f"calibrate{ESCAPE}")
    said = capsys.readouterr()
    assert "\\x1b[2J\\x9b.json" in said.err
    assert "\x1b" not in said.out + said.err
    assert "\x9b" not in said.out + said.err


@pytest.mark.parametrize("secret", ["se@cret", "se/cret", "se:cret", "s?e#cret"])
def test_passwords_are_not_printed(secret):
    stream = Stream(f"rtsp://user:{secret}@host/live")
    for text in (str(stream), repr(stream), stream.name):
        assert "cret" not in text
        assert "user" not in text
    assert str(stream) == "rtsp://host/live"
    assert str(Stream("http://host:80/a@b")) == "http://host:80/a@b"


def test_pixels_at_infinity_show_no_ground(found):
    far = [(np.inf, 0.0), (1e300, 1.0), (-1e200, 1e200)]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.isnan(found.image_to_field(far)).all()


@pytest.mark.parametrize("count", [1, 3])
def test_what_no_frame_determines_has_large_errors(count):
    """Frames of one zoom do not tell how the lens follows the zoom, and no prior does."""
    sequence = calibrate_sequence(soccer(), [PIXELS] * count, SIZE, prior=None)
    errors = dict(zip(sequence.names, np.sqrt(np.diagonal(sequence.covariance)), strict=True))
    assert np.isfinite(list(errors.values())).all()
    assert errors["a1 slope"] > 100.0
