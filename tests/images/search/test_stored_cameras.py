"""Pictures that are recognised by the cameras of earlier results: fixed cameras, also those that moved a little."""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from networks import Blind
from pictures import picture

from data_tools.nonsense import nonsense
from fieldcalib import Camera, Results, calibrate, calibrate_from_segments, read, soccer
from fieldcalib.assess.findings import Finding, Status, What
from fieldcalib.assess.result import Calibration
from fieldcalib.cli.main import main
from fieldcalib.draw.scene import render_field
from fieldcalib.fields import tennis
from fieldcalib.images.camera_side import twin_of
from fieldcalib.images.search.stored_cameras import DIFFERENT, StoredCameras
from fieldcalib.results.frames import KeptFrames
from fieldcalib.solve.request import Task
from fieldcalib.solve.solver_options import DEFAULT_FLAGS, FISHEYE_FLAGS

SIZE = (960, 540)
FIELD = soccer()
CAMERA = Camera.from_angles(0.35, 1.36, 0.01, 900.0, (2.0, 66.0, -17.0), SIZE, k=(0.05, 0.0))


def turned(px, zoom=1.0, camera=CAMERA):
    """A camera whose picture is moved to the left by some pixels of its middle, and enlarged."""
    pan, tilt, roll = camera.angles
    f = camera.focal_length
    return Camera.from_angles(pan + px / f / np.sin(tilt), tilt, roll, f * zoom, camera.C, SIZE, k=camera.k)


def _by_labels(camera, field, flags):
    """A good calibration of a camera, by labels on all markings that it sees."""
    seen = {}
    for label, one in field.markings.items():
        xy = camera.project(one.sample(0.05 * field.scale))
        xy = xy[np.all((xy >= 0.0) & (xy < np.subtract(SIZE, 1)), axis=1)]
        seen |= {label: xy} if len(xy) > 1 else {}
    found = calibrate_from_segments(field, seen, SIZE, flags=flags)
    assert found.verdict == "good"
    return found


def stored(*cameras, field=FIELD, flags=DEFAULT_FLAGS):
    return {f"camera {number}": _by_labels(camera, field, flags) for number, camera in enumerate(cameras)}


@cache
def of_camera():
    """Earlier results, of the one camera; made once."""
    return stored(CAMERA)


def crowded(camera, seed=1):
    return picture(camera, FIELD, seed)


def farthest(found, truth, field=FIELD):
    """Largest distance of the markings in view, pixels."""
    X = np.concatenate([one.sample(1.0) for one in field.markings.values()])
    xy = truth.project(X)
    seen = np.all((xy > 0.0) & (xy < SIZE), axis=1)
    return np.max(np.linalg.norm(found.project(X[seen]) - xy[seen], axis=1))


def recognised(earlier, image, field=FIELD):
    return StoredCameras.of(earlier, field).recognised(Task(field), image)


def test_a_camera_that_has_not_moved_stays_as_it_is():
    earlier = of_camera()
    results = calibrate([crowded(CAMERA)], network=Blind(), same_camera=earlier, progress=False)
    found = results["000000"]
    assert found.verdict == "good"
    assert found.camera == earlier["camera 0"].camera
    assert found.findings == (Finding(What.RECOGNISED, "camera 0", (0.0,)),)
    assert found.reason == "recognised: the camera of 'camera 0', moved by 0.0 px since"
    assert {one.label for one in found.markings} >= {"Side line top", "Middle line"}
    assert found.probability() > 0.9


@pytest.mark.parametrize(("px", "zoom"), [(1.5, 1.0), (-7.0, 1.0), (9.0, 1.01), (0.0, 0.97)])
def test_a_camera_that_was_nudged_is_found_as_moved(px, zoom):
    truth = turned(px, zoom)
    found = recognised(of_camera(), crowded(truth))
    assert found.verdict == "good"
    assert farthest(found.camera, truth) < 1.0 < farthest(CAMERA, truth)
    (finding,) = found.findings
    border = 0.25 * np.abs(zoom - 1.0) * np.hypot(*SIZE)  # by which an enlargement moves the markings, about
    assert finding.numbers[0] == pytest.approx(np.hypot(px, border), rel=0.3)
    assert found.solved.pixels.labels  # its own lines
    assert np.linalg.norm(found.camera.C - CAMERA.C) < 0.2


@pytest.mark.parametrize("pan", [0.1, 0.107])
def test_a_fisheye_camera_keeps_its_lens(pan):
    before, now = (
        Camera.from_angles(one, 1.25, 0.0, 400.0, (2.0, 50.0, -14.0), SIZE, k=(0.02, 0.0, 0.0, 0.0), fisheye=True)
        for one in (0.1, pan)
    )
    found = recognised(stored(before, flags=FISHEYE_FLAGS), crowded(now))
    assert found.camera.fisheye
    assert farthest(found.camera, now) < 1.0


@pytest.mark.parametrize(
    "truth",
    [
        turned(90.0),
        turned(0.0, 1.3),
        Camera.from_angles(0.35, 1.36, 0.01, 900.0, (-14.0, 66.0, -17.0), SIZE),
        Camera.from_angles(-0.35, 1.2, 0.01, 900.0, (0.0, 60.0, -25.0), SIZE),
    ],
    ids=["turned", "zoomed", "elsewhere", "another"],
)
def test_pictures_of_other_cameras_are_not_recognised(truth):
    assert recognised(of_camera(), crowded(truth)) is None


@pytest.mark.parametrize("seed", range(4))
def test_pictures_without_a_field_are_not_recognised(seed):
    assert recognised(of_camera(), nonsense(seed)) is None


def test_pictures_that_are_not_recognised_go_the_usual_way():
    images = [np.zeros((540, 960, 3), np.uint8), crowded(CAMERA), nonsense(0)]
    results = calibrate(images, network=Blind(), same_camera=of_camera(), progress=False)
    alone = calibrate(images[::2], network=Blind(), progress=False)
    assert list(results.verdicts.values()) == ["reject", "good", "reject"]
    assert [results[k] for k in (0, 2)] == list(alone.values())


def test_the_camera_is_told_from_others():
    earlier = stored(CAMERA, turned(30.0), turned(12.0))
    assert recognised(earlier, crowded(turned(31.0))).findings[0].about == "camera 1"


def test_so_many_cameras_are_stored():
    (one,) = of_camera().values()
    many = {str(k): replace(one, camera=turned(8.0 * k)) for k in range(DIFFERENT + 6)}
    kept = [one.id for one in StoredCameras.of(many, FIELD).cameras]
    assert len(kept) == DIFFERENT
    assert {kept[0], kept[-1]} == {"0", str(DIFFERENT + 5)}


def test_cameras_that_are_alike_are_stored_once():
    assert len(StoredCameras.of(stored(CAMERA, turned(0.5), turned(20.0)), FIELD).cameras) == 2


def test_a_marking_beside_its_paint_is_no_recognised_picture():
    """A camera on another pitch that is 6 m wider: all other markings are where they were."""
    wider = soccer(105.0, 74.0, size_known=True)
    assert recognised(of_camera(), render_field(CAMERA, wider)) is None


def test_a_recognised_camera_recognises_further_pictures():
    """Its reason names the last picture, and no line of reasons grows."""
    first = recognised(of_camera(), crowded(turned(5.0)))
    second = recognised({"first": first}, crowded(turned(5.0), seed=2))
    assert second.findings == (Finding(What.RECOGNISED, "first", (0.0,)),)
    assert second.camera == first.camera


@pytest.mark.parametrize("pan", [90.0, 90.4])
def test_the_other_side_of_a_court_stays_an_alternative(pan):
    court = tennis()
    before, now = (Camera.from_angles(np.radians(p), 1.3, 0.0, 1400.0, (-32.0, 1.0, -9.0), SIZE) for p in (90.0, pan))
    (one,) = stored(before, field=court).values()
    one = replace(one, alternatives=(twin_of(one.camera, court),))
    found = recognised({"a": one}, render_field(now, court), court)
    (other,) = found.alternatives
    np.testing.assert_allclose(other.C, found.camera.C * (-1.0, -1.0, 1.0))
    assert farthest(found.camera, now, court) < 2.0


@pytest.mark.parametrize(
    ("earlier", "field", "message"),
    [
        ({}, FIELD, "no camera of the results is good"),
        (
            {"a": Calibration.without_camera(Status.TOO_FEW_SEGMENTS, "nothing")},
            FIELD,
            "no camera of the results is good",
        ),
        (of_camera(), tennis(), "of another field, 105 x 68 m, than that of 23.77 x 10.97 m"),
        (of_camera(), soccer(100.0, 64.0, size_known=True), "of another field, 105 x 68 m, than that of 100 x 64 m"),
        ({"a": CAMERA}, FIELD, "expected a Calibration, as in results, got a Camera"),
        ({"a": None}, FIELD, "expected a Calibration, as in results, got a NoneType"),
    ],
    ids=["empty", "no camera", "another sport", "another size", "cameras", "nothing"],
)
def test_results_that_cannot_recognise_a_picture(earlier, field, message):
    with pytest.raises(ValueError, match=message):
        StoredCameras.of(earlier, field)


def test_what_same_camera_is_not_of():
    image, earlier = crowded(CAMERA), of_camera()
    with pytest.raises(ValueError, match="same_camera is of pictures"):
        calibrate([image, image], clip=True, same_camera=earlier, progress=False)
    with pytest.raises(ValueError, match="leave one of them out"):
        calibrate([image], same_camera=earlier, camera_matrix=CAMERA.K, flags=1, progress=False)
    with pytest.raises(FileNotFoundError, match=r"cameras\.jsonl"):
        calibrate([image], same_camera="nowhere", progress=False)
    with pytest.raises(ValueError, match="side='opposite', but the camera of 'camera 0' is on the other: leave one"):
        calibrate([image], same_camera=earlier, side="opposite", progress=False)


def test_the_command_recognises_pictures_by_a_folder(tmp_path, capsys):
    earlier = of_camera()
    Results(KeptFrames(list(earlier), list(earlier.values()))).save(tmp_path / "earlier")
    shown = {"same": CAMERA, "moved": turned(4.0)}
    for name, one in shown.items():
        cv2.imwrite(str(tmp_path / f"{name}.png"), crowded(one))
    cv2.imwrite(str(tmp_path / "large.png"), crowded(CAMERA.scaled((1280, 720))))
    pictures = [str(tmp_path / f"{name}.png") for name in (*shown, "large")]
    before = "--out", str(tmp_path / "out"), "--same-camera", str(tmp_path / "earlier")
    assert main(["run", *before, *pictures]) == 0
    assert "images are compared with 1 camera of" in capsys.readouterr().err
    found = read(tmp_path / "out")
    moved = {
        name: [finding.numbers[0] for finding in found[name].findings if finding.what is What.RECOGNISED]
        for name in found
    }
    assert moved == {"same": [0.0], "moved": [pytest.approx(4.0, abs=0.8)], "large": []}
    assert all(farthest(found[name].camera, one) < 1.0 for name, one in shown.items())


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--field", "tennis"], "another field, 105 x 68 m, than that of 23.77 x 10.97 m"),
        (["--field-length", "100", "--field-size", "known"], "another field, 105 x 68 m, than that of 100 x 68 m"),
        (["--clip"], "--same-camera is of images"),
        (["--same-field"], "leave --same-field out"),
        (["--position", "0,66,-17"], "leave one of them out"),
        (["--side", "opposite"], "leave one of them out"),
    ],
    ids=["another sport", "another size", "a clip", "one field", "a known place", "another side"],
)
def test_a_folder_that_does_not_fit_is_refused(more, message, tmp_path, capsys):
    earlier = of_camera()
    Results(KeptFrames(list(earlier), list(earlier.values()))).save(tmp_path / "earlier")
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((540, 960, 3), np.uint8))
    out = ["--out", str(tmp_path / "out"), "--same-camera", str(tmp_path / "earlier"), str(tmp_path / "a.png")]
    assert main(["run", *more, *out]) == 2
    assert message in capsys.readouterr().err
