"""Arguments of wrong types and values: errors that say what was expected; names that would steer a terminal."""

import warnings

import numpy as np
import pytest
from commands import run

from fieldcalib import (
    Camera,
    calibrate_from_homography,
    calibrate_from_points,
    calibrate_from_segments,
    soccer,
)
from fieldcalib.draw import draw_calibration, draw_field, draw_minimap, overhead_camera, render_field
from fieldcalib.io.boxes.files import open_boxes
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.label_studio import parse_label_studio
from fieldcalib.io.streams import Stream
from fieldcalib.io.videos import VideoWriter

SIZE = (960, 540)
CAMERA = Camera.from_angles(-0.3, 1.35, 0.0, 1600.0, (0.0, 68.0, -17.0), SIZE)
LABELS = ("Side line left", "Side line top", "Big rect. left main", "Big rect. left top", "Circle left")
PIXELS = {label: CAMERA.project(soccer()[label].sample(7.0)) for label in LABELS}
X = np.array([point.X for name, point in soccer().points.items() if name.startswith("L_PENALTY")])
XY = CAMERA.project(X)
IMAGE = np.zeros((540, 960, 3), np.uint8)


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
    "no field of a calibration": (lambda found: draw_calibration(IMAGE, found, None), "expected a field"),
    "no camera on a map": (lambda _: draw_minimap("camera", soccer()), "expected a Camera"),
    "no field from above": (lambda _: overhead_camera(None), "expected a Field"),
    "a size of a field": (lambda _: soccer("105", 68.0), "expected length and width as numbers"),
    "a fine picture from above": (lambda _: overhead_camera(soccer(), 1e-308), "the picture would have"),
    "a text as metres": (lambda found: found.probability("1"), "metres must be a positive number, got '1'"),
    "a list as metres": (lambda found: found.probability([1]), "metres must be a positive number"),
    "a frame rate": (lambda _: VideoWriter("a.mp4", 1e12), "expected at most 1000 frames per second"),
}


@pytest.mark.parametrize(("call", "message"), WRONG.values(), ids=WRONG)
def test_wrong_arguments_are_told(found, call, message):
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # NumPy warns of what it drops
        with pytest.raises(ValueError, match=message):
            call(found)


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
