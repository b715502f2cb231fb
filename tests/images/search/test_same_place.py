"""Courts in pictures of one tripod: where it stands is found from some of them, and courts in the others from there."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from data_tools.nonsense import nonsense
from data_tools.rink_points import FIELD, point_named
from fieldcalib import Camera, calibrate_from_images, read
from fieldcalib.assess.findings import Status
from fieldcalib.assess.result import Calibration
from fieldcalib.cli.main import main
from fieldcalib.draw.scene import render_field
from fieldcalib.fields import field_named, tennis
from fieldcalib.images.camera_side import twin_of
from fieldcalib.images.clip.keyframes import SearchedKeyframes
from fieldcalib.images.from_images import How
from fieldcalib.images.search.place_search import Place, place_of, pooled_place, search_from
from fieldcalib.solve.request import Task

SIZE = (960, 540)
RINK, COURT = field_named(FIELD), tennis()
PLACE = Place(np.array([0.0, 37.0, -12.5]), np.full(3, 0.5), (1.5, 3.0))
STAND = (-32.0, 1.0, -9.0)


def view(pan, tilt, f, C=(0.2, 37.3, -12.6), k=(0.0, 0.0)):
    return Camera.from_angles(np.radians(pan), np.radians(tilt), 0.0, f, C, SIZE, k=k)


def off(found, truth, field):
    """Median distance of the points of the field in view, pixels."""
    x, y = (np.linspace(-half, half, 25) for half in field.half_extent)
    X = np.array([(a, b, 0.0) for a in x for b in y])
    xy = truth.project(X)
    seen = np.all((xy > 0.0) & (xy < SIZE), axis=1)
    return np.median(np.linalg.norm(found.project(X[seen]) - xy[seen], axis=1))


def on_court(pan, f):
    """A view of the court of tennis from behind, of the same tripod."""
    return Camera.from_angles(np.radians(pan), 1.3, 0.0, f, STAND, SIZE)


@pytest.mark.parametrize("pan", [-34.0, pytest.param(20.0, marks=pytest.mark.slow)])
def test_a_zone_of_a_rink_is_found_from_a_known_place(pan):
    """Circles and marks tell the view; hardly a line crosses the picture."""
    truth = view(pan, 75.0, 2300.0)
    found = search_from(Task(RINK), RINK, render_field(truth, RINK), PLACE)
    assert found.accepted
    assert off(found.camera, truth, RINK) < 2.0


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])
def test_nothing_is_found_in_pictures_without_a_field(seed):
    assert not search_from(Task(RINK), RINK, nonsense(seed), PLACE).accepted


def test_another_field_is_not_found_from_a_known_place():
    picture = render_field(on_court(90.0, 1400.0), COURT)
    assert not search_from(Task(RINK), RINK, picture, PLACE).accepted


@pytest.mark.slow
def test_the_place_comes_from_pictures_that_are_found_by_themselves():
    views = [on_court(pan, 1300.0) for pan in (86.0, 90.0, 95.0)]
    place = pooled_place(COURT, [render_field(one, COURT) for one in views])
    assert place is not None
    assert np.linalg.norm(place.C - STAND) < 0.7
    assert abs(place.bend) < 0.02
    truth = on_court(94.0, 1900.0)
    (found,) = calibrate_from_images(COURT, [render_field(truth, COURT)], place=place)
    assert found.accepted
    assert off(found.camera, truth, COURT) < 2.0


def test_there_is_no_place_without_a_court():
    assert pooled_place(COURT, [nonsense(seed) for seed in range(2)]) is None
    assert place_of([]) is None


@pytest.mark.slow
def test_keyframes_that_were_refused_are_searched_again(monkeypatch):
    close, whole = on_court(94.0, 1900.0), on_court(90.0, 1300.0)
    nothing = Calibration.without_camera(Status.TOO_FEW_SEGMENTS, "nothing was found")
    first = SearchedKeyframes(How(Task(COURT)))
    with monkeypatch.context() as patched:
        patched.setattr("fieldcalib.images.clip.keyframes.search_courts", lambda task, images: [nothing])
        first = first.searched({0: render_field(close, COURT)})
    assert list(first.refused) == [0]
    again = first.searched({25: render_field(whole, COURT)}).searched_again()
    assert sorted(again.found) == [0, 25]
    assert off(again.found[0].camera, close, COURT) < 2.0


def test_a_camera_that_moves_has_no_place():
    options = How(Task(COURT), camera="moving")
    found = SearchedKeyframes(options).searched({0: render_field(on_court(90.0, 1300.0), COURT)})
    assert found.found
    assert found.place is None


def test_names_of_points_of_rinks():
    assert point_named(RINK, "11_top_right_vertical_line_2") is not None
    assert point_named(RINK, "left_goal_D_near") is None


@pytest.mark.slow
def test_the_camera_on_the_other_side_of_a_court_is_an_alternative():
    """Nothing tells the ends of a court apart: the camera behind the left one is given, and as good as it was."""
    (found,) = calibrate_from_images(COURT, [render_field(on_court(90.0, 1400.0), COURT)])
    (other,) = found.alternatives
    assert found.camera.C[0] < 0.0
    np.testing.assert_allclose(other.C, found.camera.C * (-1.0, -1.0, 1.0))
    X = np.array([(-11.0, 3.0, 0.0), (4.0, -5.0, 0.0)])
    np.testing.assert_allclose(other.project(X * (-1.0, -1.0, 1.0)), found.camera.project(X), atol=1e-9)
    assert found.verdict == "good"
    assert found.probability() > 0.9
    assert Calibration.from_dict(found.to_dict()).alternatives == found.alternatives


def test_a_field_with_one_service_line_has_no_twin():
    uneven = replace(COURT, segments={k: s for k, s in COURT.segments.items() if k != "Service line left"})
    assert twin_of(on_court(90.0, 1400.0), COURT) is not None
    assert twin_of(on_court(90.0, 1400.0), uneven) is None


@pytest.mark.slow
def test_pictures_of_one_camera_on_the_command_line(tmp_path, capsys):
    views = {f"{pan:.0f}": on_court(pan, 1300.0) for pan in (86.0, 90.0, 95.0)}
    for name, one in views.items():
        cv2.imwrite(str(tmp_path / f"{name}.png"), render_field(one, COURT))
    pictures, out = [str(tmp_path / f"{name}.png") for name in views], tmp_path / "out"
    assert main(["run", "--field", "tennis", "--same-camera", "--out", str(out), *pictures]) == 0
    assert "the camera stands at (-3" in capsys.readouterr().err
    found = read(out)
    assert all(found[name].accepted and off(found[name].camera, one, COURT) < 2.0 for name, one in views.items())


@pytest.mark.parametrize("more", [["--clip"], []], ids=["a clip", "soccer"])
def test_what_is_searched_from_no_place_is_refused(more, tmp_path, capsys):
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((90, 160, 3), np.uint8))
    code = main(["run", "--same-camera", *more, "--out", str(tmp_path / "out"), str(tmp_path / "a.png")])
    assert code == 2
    assert "--same-camera is of" in capsys.readouterr().err
