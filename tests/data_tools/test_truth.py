"""The tools that compare the frames of a clip with true cameras."""

import json
from dataclasses import replace

import numpy as np
import pytest
from networks import KnownCameras, looked_at

from data_tools import filmed, sequences
from data_tools.clips import SegmentationNetwork
from data_tools.synthetic.film import Scene, film, write_clip
from data_tools.synthetic.paths import with_displaced_lines
from data_tools.truth import Compared, by_basis, compared
from fieldcalib import Camera, soccer
from fieldcalib.assess.camera_errors import KnownErrors
from fieldcalib.assess.findings import Status
from fieldcalib.assess.result import Calibration
from fieldcalib.fields.segments import Arc, Line
from fieldcalib.geometry.lens import RadialLens
from fieldcalib.io.samples import TrueFrame
from fieldcalib.problem.layout import Layout

FIELD = soccer(size_known=True)
SIZE = (480, 270)
TRUTH = Camera.from_angles(-0.2, 1.34, 0.002, 700.0, (0.0, 66.0, -16.0), SIZE)
LAYOUT = Layout.of(SIZE)
SIGMA = np.array([1e-3, 1e-3, 1e-3, 4e-3, 0.1, 0.3, 0.1])


def found(off, sigma=SIGMA):
    """A camera whose parameters are off by so many standard deviations."""
    theta, covariance = LAYOUT.theta(TRUTH), np.zeros(2 * (LAYOUT.size,))
    theta[:7] += off * SIGMA
    covariance[range(7), range(7)] = np.square(sigma)
    errors = KnownErrors(LAYOUT, theta, covariance)
    return Calibration(errors.camera, Status.ACCEPTED, "", 0.0, 0.0, {}, errors=errors)


def held(result):
    return result.holds_focal_length, result.holds_own, result.holds_centre, result.holds_field


def test_errors_are_those_of_the_camera():
    result = compared(found(np.eye(7)[3]), TRUTH, FIELD, "lines")
    assert result.focal_length_percent == pytest.approx(100.0 * np.expm1(4e-3))
    assert result.centre_m == 0.0
    result = compared(found(np.eye(7)[5]), TRUTH, FIELD, "lines")
    assert (result.focal_length_percent, result.centre_m) == (pytest.approx(0.0, abs=1e-9), pytest.approx(0.3))
    assert result.field_m == pytest.approx(0.3, rel=0.01)  # who stands elsewhere sees the ground elsewhere
    rolled = compared(found(np.eye(7)[2]), TRUTH, FIELD, "lines")
    assert 0.02 < rolled.image_px / (1280.0 / 480.0) < 0.24  # a milliradian, of pixels up to 275 from the centre


def test_regions_hold_what_is_within_their_radius():
    assert held(compared(found(np.zeros(7)), TRUTH, FIELD, "lines")) == (1.0, 1.0, 1.0, 1.0)
    joint = np.sqrt([9.49, 7.81])  # 95 % of chi-squared with 4 and 3 degrees of freedom
    for factor, expected in ((0.99, 1.0), (1.01, 0.0)):
        own = factor * joint[0] * np.array([0.5, 0.5, 0.5, 0.5, 0.0, 0.0, 0.0])
        assert compared(found(own), TRUTH, FIELD, "lines").holds_own == expected
        centre = factor * joint[1] * np.array([0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0]) / np.sqrt(3.0)
        assert compared(found(centre), TRUTH, FIELD, "lines").holds_centre == expected
        focal = factor * 1.96 * np.eye(7)[3]
        assert compared(found(focal), TRUTH, FIELD, "lines").holds_focal_length == expected


def test_a_pan_of_a_full_turn_more_is_the_same():
    turned = found(np.zeros(7))
    theta = turned.errors.theta + 2.0 * np.pi * np.eye(LAYOUT.size)[0]
    errors = KnownErrors(LAYOUT, theta, turned.errors.covariance)
    assert compared(replace(turned, errors=errors), TRUTH, FIELD, "lines").holds_own == 1.0


def test_ellipses_on_the_ground_that_are_too_small_do_not_hold_it():
    off = np.array([1.0, -1.0, 1.0, 1.0, -1.0, 1.0, 1.0])
    assert compared(found(off), TRUTH, FIELD, "lines").holds_field == 1.0
    assert compared(found(off, 0.1 * SIGMA), TRUTH, FIELD, "lines").holds_field < 0.2


def test_each_basis_has_a_line():
    frame = compared(found(np.zeros(7)), TRUTH, FIELD, "lines")
    tied = frame._replace(basis="matches", centre_m=0.2, holds_centre=0.0)
    lines = [json.loads(line) for line in by_basis([tied, frame, tied._replace(holds_centre=1.0)])]
    assert [line["basis"] for line in lines] == ["matches", "lines"]
    assert (lines[0]["frames"], lines[0]["centre_m"], lines[0]["holds_centre"]) == (2, 0.2, 50.0)
    assert set(lines[1]) == {"frames", *Compared._fields}


def test_painted_lines_lie_beside_the_true_ones():
    lines = [with_displaced_lines(FIELD, np.random.default_rng(seed), 0.05) for seed in range(40)]
    for label in FIELD.markings:
        true = FIELD[label]
        if isinstance(true, Arc):
            off = [one[label].radius - true.radius for one in lines]
            assert all(one[label].center == true.center for one in lines)
        elif isinstance(true, Line) and true.start[2] == true.end[2] == 0.0:
            along = np.subtract(true.end, true.start)
            normal = np.array([-along[1], along[0], 0.0]) / np.linalg.norm(along)
            moved = np.array([np.subtract(one[label].start, true.start) for one in lines])
            off = moved @ normal
            np.testing.assert_allclose(moved, off[:, None] * normal, atol=1e-9)
        else:
            assert all(one[label] == true for one in lines)
            continue
        assert 0.03 < np.std(off) < 0.07
    for one in lines:
        assert len({one[label].radius for label in one if label.startswith("Circle central")}) == 1


@pytest.fixture
def measured(tmp_path):
    """A measured camera that zooms by a fifth."""
    f = 2800.0 * np.linspace(1.0, 1.2, 700)
    K = np.zeros((len(f), 3, 3))
    K[:, 0, 0] = K[:, 1, 1] = f
    K[:, :, 2] = 960.0, 540.0, 1.0
    k = [
        np.append(RadialLens(np.hypot(960.0, 540.0)).to_opencv(np.array([0.03, 0.0]), one)[:2], np.zeros(3))
        for one in f
    ]
    R = Camera.from_angles(0.0, 1.35, 0.0, 2800.0, (1.0, 66.0, -16.0), (1920, 1080)).R
    R = R @ np.diag([1.0, -1.0, -1.0])
    t = -R @ np.array([1.0, -66.0, 16.0])
    np.savez(tmp_path / "a.npz", K=K, k=np.array(k), R=R[None], t=t[None])
    return tmp_path


@pytest.mark.slow
def test_matches_tell_frames_without_labels(measured, capsys):
    assert sequences.main([str(measured), "--matches", "--count", "16", "--paint", "0"]) == 0
    rows = {row.get("basis"): row for row in map(json.loads, capsys.readouterr().out.splitlines())}
    tied = rows["matches"]
    assert tied["frames"] + rows["lines and matches"]["frames"] == 16
    assert tied["frames"] > 3
    assert tied["image_px"] < 1.5
    assert tied["holds_field"] > 85.0
    assert tied["focal_length_percent"] < rows["one by one"]["focal_length_percent"]


@pytest.mark.slow
@pytest.mark.parametrize("ties", [[], ["--matches"]])
def test_regions_of_a_camera_that_flies_hold_the_truth(measured, capsys, ties):
    assert sequences.main([str(measured), "--flies", "--count", "20", *ties]) == 0
    rows = {row.get("basis"): row for row in map(json.loads, capsys.readouterr().out.splitlines())}
    together = rows["lines and matches" if ties else "lines"]
    assert together["focal_length_percent"] < rows["one by one"]["focal_length_percent"]
    assert min(together["holds_own"], together["holds_centre"], together["holds_field"]) > 90.0


@pytest.mark.slow
def test_a_filmed_clip_is_compared_with_its_cameras(tmp_path, monkeypatch, capsys):
    share = np.linspace(0.0, 1.0, 12)
    cameras = [
        Camera.from_angles(-0.42 + 0.12 * s, 1.3, 0.0, 560.0 * (1.0 + 0.1 * s), (1.0, 64.0, -16.0), SIZE) for s in share
    ]
    frames = [TrueFrame(camera, 0, 0) for camera in cameras]
    scene = Scene(FIELD, 5, 4.0, np.zeros((12, 0, 2)), [])
    write_clip(tmp_path / "clip.mp4", scene, frames)
    keys = [cameras[t] for t in looked_at(list(film(scene, frames)))]
    monkeypatch.setattr(SegmentationNetwork, "load", lambda: KnownCameras(keys))
    assert filmed.main([str(tmp_path / "clip.mp4")]) == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    first, second = (index for index, row in enumerate(rows) if "lines" in row)
    assert [row["clips"] for row in (rows[first], rows[second])] == [1, 1]
    whole, withheld = rows[first + 1 : second], {row["basis"]: row for row in rows[second + 1 :]}
    assert sum(row["frames"] for row in whole) + rows[first]["lost"] == 12
    assert withheld["matches"]["frames"] == 4  # the third second
    assert all(row["image_px"] < 3.0 for row in whole)
