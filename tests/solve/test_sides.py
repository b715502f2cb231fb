"""The side of the field on which a camera is: a convention, or what the user says."""

import json
from dataclasses import replace

import numpy as np
import pytest
from commands import lines_of, run
from networks import FIELD, KnownCameras
from pictures import picture
from synthetic import observe
from views import camera

import fieldcalib
from data_tools.sides import PLACES, frame_from, is_right, summary
from fieldcalib import Calibration, Point, Tracker, calibrate_from_images, calibrate_from_segments
from fieldcalib.assess.findings import UP_TO_SIDE, What
from fieldcalib.draw.scene import render_field
from fieldcalib.fields import tennis
from fieldcalib.fields.field import side_of_stand, turned_camera, turned_stand
from fieldcalib.fields.traits import ALL_STANDS, OPPOSITE_TRIBUNE
from fieldcalib.images.camera_side import CameraSide
from fieldcalib.io.image_files import encode_image
from fieldcalib.localize import localize
from fieldcalib.solve.from_segments import calibrate_frame
from fieldcalib.solve.request import GivenCamera, Task
from fieldcalib.solve.solver_options import DEFAULT_FLAGS
from fieldcalib.solve.solver_options import CalibrationFlags as F

MAIN = camera(24, 78, 1400.1, (3.3, 68.2, -17.1))
BEHIND = camera(88, 70, 1100.0, (-78.0, 3.0, -22.0))
MIDDLE = camera(1, 70, 2400.0, (1.3, 68.2, -26.1))
SEEN = {"beside": MAIN, "behind an end": BEHIND}
OPPOSITE = {"beside": "opposite tribune", "behind an end": "behind right goal"}


def from_picture(truth, **how):
    """The calibration of a picture whose labels are named as seen from the main side."""
    (found,) = calibrate_from_images(FIELD, [picture(truth)], KnownCameras([truth]), **how)
    return found


def at(truth):
    return {"rvec": np.zeros(3), "tvec": -truth.C, "flags": DEFAULT_FLAGS | F.CALIB_FIX_POSITION}


@pytest.mark.parametrize("where", SEEN)
def test_without_a_word_the_main_side_is_taken_and_the_other_one_is_an_alternative(where):
    found = from_picture(SEEN[where])
    assert found.verdict == "good"
    assert is_right(found.camera, SEEN[where], FIELD)
    (other,) = found.alternatives
    assert is_right(other, turned_camera(SEEN[where]), FIELD)
    assert "if the side is right" in found._repr_html_()
    assert "side" not in found.reason
    assert Calibration.from_dict(found.to_dict()).alternatives == found.alternatives


@pytest.mark.parametrize("where", SEEN)
def test_the_user_decides_the_side(where):
    truth = turned_camera(SEEN[where])
    ways = {"side": {"side": "opposite"}, "prior": {"prior": OPPOSITE[where]}, "position": at(truth)}
    for way, said in ways.items():
        (found,) = calibrate_from_images(FIELD, [picture(SEEN[where])], KnownCameras([SEEN[where]]), **said)
        assert (way, found.verdict, found.alternatives) == (way, "good", ())
        assert is_right(found.camera, truth, FIELD)
        assert is_right(found.uncertainty.camera, truth, FIELD)
    assert from_picture(SEEN[where], side="main").alternatives == ()


@pytest.mark.parametrize("where", SEEN)
def test_labels_of_the_opposite_side_leave_the_camera_that_names_the_ends_as_it_sees_them(where):
    """As for pictures: the image is the same; the verdict and the probability are for either side."""
    main, turned = SEEN[where], turned_camera(SEEN[where])
    frame = observe(FIELD.markings, main)
    swapped = {FIELD.symmetric[label]: xy for label, xy in frame.items()}
    known, found = (calibrate_from_segments(FIELD, pixels, main.image_size) for pixels in (frame, swapped))
    assert (known.verdict, known.alternatives) == ("good", ())
    assert is_right(found.camera, turned, FIELD)
    (other,) = found.alternatives
    assert is_right(other, main, FIELD)
    assert found.verdict == "good"
    assert found.has_finding(What.SEEN_FROM_OPPOSITE)
    assert found.probability() == pytest.approx(known.probability(), abs=0.05)
    for said in ({"prior": OPPOSITE[where]}, at(turned)):
        told = calibrate_from_segments(FIELD, swapped, main.image_size, **said)
        assert is_right(told.camera, turned, FIELD)
        assert told.alternatives == ()
        assert not told.has_finding(What.SEEN_FROM_OPPOSITE)


def test_the_opposite_side_is_the_main_one_turned():
    """The same picture: the same errors, and the same probability."""
    main, opposite = from_picture(MAIN), from_picture(MAIN, side="opposite")
    np.testing.assert_allclose(opposite.camera.C, main.alternatives[0].C, atol=0.1)
    assert opposite.probability() == pytest.approx(main.probability(), abs=0.01)
    assert {FIELD.symmetric[label] for label in opposite.pixel_counts} == set(main.pixel_counts)


@pytest.mark.parametrize("side", [None, "main", "opposite"])
def test_where_no_end_is_in_view_labels_of_pictures_are_as_good_as_elsewhere(side):
    """A person who labels the middle line and the circle leaves open what a picture leaves open anyway."""
    seen = {label: MIDDLE.project(FIELD[label].sample(2.0)) for label in ("Middle line", "Circle central")}
    inside = {label: xy[np.all((xy > 0.0) & (xy < (959.0, 539.0)), axis=1)] for label, xy in seen.items()}
    prior = CameraSide.of(Task(FIELD), side).task(Task(FIELD)).prior
    found = calibrate_frame(Task(FIELD, prior=prior, side=side), inside, (960, 540), None)
    assert (len(found.alternatives), found.has_finding(What.OTHER_SIDE)) == (side is None, side is None)
    assert (found.camera.C[1] < 0.0) == (side == "opposite")


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        ({}, ("main", False)),
        ({"side": "main"}, ("main", True)),
        ({"side": "opposite"}, ("opposite", True)),
        ({"prior": "main left"}, ("main", True)),
        ({"prior": ["main center", "behind left goal"]}, ("main", True)),
        ({"prior": ["main center", "behind right goal"]}, ("main", False)),
        ({"prior": "behind right goal"}, ("opposite", True)),
        ({"prior": OPPOSITE_TRIBUNE}, ("opposite", True)),
        ({"prior": None}, ("main", False)),
        ({"given": GivenCamera(rvec=MAIN.to_opencv()[0]), "flags": F.CALIB_FIX_ROTATION}, ("main", True)),
        ({"given": GivenCamera(rvec=BEHIND.to_opencv()[0]), "flags": F.CALIB_FIX_ROTATION}, ("main", True)),
        (
            {"given": GivenCamera(rvec=turned_camera(BEHIND).to_opencv()[0]), "flags": F.CALIB_FIX_ROTATION},
            ("opposite", True),
        ),
    ],
)
def test_what_tells_the_side(said, expected):
    of_camera = {name: value for name, value in said.items() if name != "side"}
    on = CameraSide.of(Task(FIELD, **of_camera), said.get("side"))
    assert (on.side, on.is_said) == expected


def test_contradictions_are_errors():
    image, network = [picture(MAIN)], KnownCameras([MAIN])
    with pytest.raises(ValueError, match="its prior is on the opposite side"):
        calibrate_from_images(FIELD, image, network, side="main", prior="opposite tribune")
    with pytest.raises(ValueError, match="its prior is on the main side"):
        calibrate_from_images(FIELD, image, network, side="opposite", **at(MAIN))
    with pytest.raises(ValueError, match="side must be 'main' or 'opposite', got 'left'"):
        calibrate_from_images(FIELD, image, network, side="left")
    uneven = replace(FIELD, segments={name: one for name, one in FIELD.segments.items() if name != "Circle left"})
    with pytest.raises(
        ValueError, match="the same from both sides, which it does not for 'Circle right': leave it out"
    ):
        calibrate_from_images(uneven, image, network, side="main")
    with pytest.raises(ValueError, match="labelled pixels name the ends"):
        fieldcalib.calibrate({"Middle line": [(1, 2), (3, 9)]}, image_size=(960, 540), side="main", progress=False)


def test_turned_stands_are_on_the_other_side():
    for stand in ALL_STANDS:
        assert {side_of_stand(stand, FIELD), side_of_stand(turned_stand(stand), FIELD)} == {"main", "opposite"}
        twice = turned_stand(turned_stand(stand))
        assert (twice.x, twice.y, twice.z) == (stand.x, stand.y, stand.z)
        assert np.mod(np.subtract(twice.pan, stand.pan), 360.0).tolist() == [0.0, 0.0]


def test_a_turned_network_names_the_ends_the_other_way_round():
    on = CameraSide.of(Task(FIELD), "opposite")
    (found,) = localize(FIELD, [picture(MAIN)], KnownCameras([MAIN]))
    (turned,) = localize(FIELD, [picture(MAIN)], on.network(KnownCameras([MAIN]), FIELD))
    assert {FIELD.symmetric[label] for label in turned.pixels} == set(found.pixels)


@pytest.mark.slow
def test_a_court_that_is_searched_for_is_on_the_side_that_is_said():
    truth = camera(88, 75, 1400.0, (-32.0, 1.0, -9.0))
    image = render_field(truth, tennis())
    (found,), (other,) = (calibrate_from_images(tennis(), [image], side=side) for side in (None, "opposite"))
    assert (found.verdict, other.verdict) == ("good", "good")
    assert is_right(found.camera, truth, tennis())
    assert is_right(other.camera, turned_camera(truth), tennis())
    assert (len(found.alternatives), other.alternatives) == (1, ())


def test_a_point_without_paint_on_one_side_does_not_tell_the_sides_of_a_court_apart():
    """Two cameras explain the picture alike: each had been taken for the rival of the other, and both were refused."""
    truth = camera(88, 75, 1400.0, (-32.0, 1.0, -9.0))
    court = tennis().with_segments({"Umpire": Point((0.0, -7.0, -2.0))})
    image = render_field(truth, court)
    (found,), (other,) = (calibrate_from_images(court, [image], side=side) for side in (None, "opposite"))
    assert (found.verdict, other.verdict) == ("good", "good")
    assert is_right(found.camera, truth, court)
    assert is_right(found.alternatives[0], turned_camera(truth), court)
    assert is_right(other.camera, turned_camera(truth), court)


def test_streams_are_on_the_side_that_is_said():
    for side, truth in ((None, MAIN), ("opposite", turned_camera(MAIN))):
        with Tracker(FIELD, KnownCameras([MAIN]), side=side, wait=True) as tracker:
            found = tracker.update(picture(MAIN))
        assert is_right(found.camera, truth, FIELD)
        assert len(found.alternatives) == (side is None)


def test_results_say_once_that_they_are_up_to_the_side(tmp_path, know):
    """In the summary, the report and what Python prints; no frame says it again."""
    (tmp_path / "one.png").write_bytes(encode_image(picture(MAIN), ".png"))
    know([MAIN])
    run("run", tmp_path / "one.png", "--out", tmp_path / "open", "--report")
    know([MAIN])
    run("run", tmp_path / "one.png", "--out", tmp_path / "said", "--side", "opposite")
    for name, notes in (("open", [UP_TO_SIDE]), ("said", [])):
        assert json.loads((tmp_path / name / "summary.json").read_text()).get("notes", []) == notes
        results = fieldcalib.read(tmp_path / name)
        assert ("main side assumed" in repr(results), list(results.notes)) == (bool(notes), notes)
        (line,) = lines_of(tmp_path / name)
        assert UP_TO_SIDE not in json.dumps(line)
    assert UP_TO_SIDE[:60] in (tmp_path / "open" / "report.html").read_text()
    assert fieldcalib.read(tmp_path / "said")["one"].camera.C[1] < 0.0


def test_pictures_from_the_opposite_side():
    """They are drawn from there; what is measured of them counts the turned cameras."""
    frame = frame_from(next(iter(PLACES)), 2)
    main = turned_camera(frame.camera)
    (found,) = calibrate_from_images(FIELD, [frame.image], KnownCameras([main]))
    record = summary([found], [frame])
    assert record["good"] == record["right once turned"] == record["right alternative"] == 1
    assert record["right"] == 0
