"""Parts of a long video: what they tell of one tripod and one pitch holds for all of them."""

from dataclasses import replace

import networks
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from networks import KnownPictures
from tripods import far_off

from data_tools.synthetic.film import Scene, film
from fieldcalib import Camera, calibrate_video, soccer
from fieldcalib.assess.findings import Verdict
from fieldcalib.assess.video import VideoCalibration
from fieldcalib.fields.sports.soccer import LINE_WIDTH
from fieldcalib.images.clip import from_video
from fieldcalib.images.clip.joined_parts import joined_parts
from fieldcalib.images.from_images import How
from fieldcalib.io.samples import TrueFrame
from fieldcalib.problem.layout import LOG_F, Layout, ZoomLaw
from fieldcalib.solve.request import Task

pytestmark = pytest.mark.slow  # its video of three parts takes ten seconds

SIZE, CENTRE = (480, 270), (1.0, 64.0, -16.0)
PITCH = {"length": 103.0, "width": 66.0}
SHOT = 9  # frames
# pan and focal length of the shots of each part: the last one sees the centre circle only, which tells no size
PARTS = (((-0.46, 480.0), (0.4, 500.0)), ((0.42, 800.0), (0.44, 900.0)), ((-0.02, 700.0), (0.02, 800.0)))
HOW = How(Task(soccer(line_width=LINE_WIDTH)))


def shot(number, pan, focal_length):
    share = np.linspace(0.0, 1.0, SHOT)
    return [
        TrueFrame(
            Camera.from_angles(pan + 0.06 * s, 1.3 + 0.01 * s, 0.0, focal_length * (1.0 + 0.08 * s), CENTRE, SIZE),
            number,
            0,
        )
        for s in share
    ]


FRAMES = [frame for k, view in enumerate(view for part in PARTS for view in part) for frame in shot(k, *view)]
TRUTHS = [frame.camera for frame in FRAMES]


@pytest.fixture(scope="module")
def pictures():
    return list(film(Scene.random(soccer(**PITCH, line_width=LINE_WIDTH), 5, TRUTHS), FRAMES))


@pytest.fixture(scope="module")
def network(pictures):
    """A network that recognises the pictures of this pitch."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(networks, "FIELD", soccer(**PITCH, line_width=LINE_WIDTH))
        yield KnownPictures(pictures, TRUTHS)


@pytest.fixture(autouse=True)
def short_parts(monkeypatch):
    monkeypatch.setattr(from_video, "PART", len(FRAMES) // len(PARTS))


@pytest.fixture(scope="module")
def both(pictures, network):
    """The whole video, and its parts before they were joined."""
    parts = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(from_video, "PART", len(FRAMES) // len(PARTS))
        found = calibrate_video(soccer(), pictures, network, parts=parts)
    assert len(parts) == len(PARTS)
    return found, [parts[k] for k in range(len(PARTS))]


def off(found):
    """Median error of each frame over the picture, pixels."""
    return np.array([np.median(far_off(one.camera, truth)) for one, truth in zip(found, TRUTHS, strict=True)])


def test_a_match_has_one_tripod_and_one_pitch(both):
    found, parts = both
    (tripod,) = found.tripods
    assert len(tripod) == len(FRAMES)
    assert set(found.tripod.tolist()) == {0}
    truth = dict(zip("xyz", CENTRE, strict=True)) | PITCH
    for name, value in truth.items():
        estimate, sigma = tripod.shared[name]
        assert abs(estimate - value) < 3.0 * sigma
        assert sigma <= min(part.tripods[0].shared[name][1] for part in parts if name in part.tripods[0].shared)
    assert {(one.field.length, one.field.width) for one in found} == {(tripod.field.length, tripod.field.width)}
    assert tripod.field.length == tripod.shared["length"][0]


def test_frames_follow_what_is_shared(both):
    """The part that tells no size is calibrated as well as the others, and knows that."""
    found, parts = both
    last = slice(len(FRAMES) - 2 * SHOT, None)
    assert "length" not in parts[-1].tripods[0].shared
    assert not any(one.verdict is Verdict.GOOD for one in parts[-1])
    assert all(one.verdict is Verdict.GOOD for one in found[last])
    apart = off([one for part in parts for one in part])
    assert np.max(off(found)[last]) < 0.5 * np.max(apart[last])
    assert np.max(off(found)) < 0.8
    mark = np.array([0.0, 0.0, 0.0])
    for one, truth in zip(found[last], TRUTHS[last], strict=True):
        V = one.uncertainty.covariance
        assert abs(one.camera.C[1] - truth.C[1]) < 3.0 * np.sqrt(V[5, 5])
        assert np.linalg.norm(one.camera.project(mark) - truth.project(mark)) < 1.0


def test_a_part_that_contradicts_the_others_is_left_as_it_is(both):
    _, parts = both
    (tripod,) = parts[1].tripods
    k = tripod.names.index("length")
    theta = tripod.frames.theta.copy()
    theta[:, tripod.layout.names.index("length")] += 8.0
    other = replace(
        tripod,
        values=tripod.values + 8.0 * np.eye(len(tripod.names))[k],
        field=tripod.field.resized(tripod.field.length + 8.0, tripod.field.width),
        frames=replace(tripod.frames, theta=theta),
    )
    found = joined_parts([parts[0], replace(parts[1], tripods=(other,)), parts[0]], HOW)
    assert sorted(map(len, found.tripods)) == [2 * SHOT, 4 * SHOT]
    assert found.tripods[1] == other


def test_one_part_is_left_as_it_is(both):
    _, parts = both
    assert joined_parts(parts[:1], HOW) == parts[0]


def test_two_parts_that_tell_the_same_are_surer(both):
    """What both tell counts twice, what the prior tells does not."""
    _, parts = both
    (tripod,) = joined_parts([parts[0], parts[0]], HOW).tripods
    (one,) = parts[0].tripods
    for name in ("x", "y", "z", "length", "width"):
        (value, sigma), (before, sigma_before) = tripod.shared[name], one.shared[name]
        assert abs(value - before) < 0.3 * sigma_before
        assert 0.65 < sigma / sigma_before < 0.85
    assert all(tripod.shared[name][1] > 0.65 * sigma for name, (_, sigma) in one.shared.items())


@given(st.floats(5.0, 8.0), st.integers(0, 1000))
def test_a_lens_may_be_told_at_another_zoom(reference, seed):
    rng = np.random.default_rng(seed)
    layout = Layout.of(SIZE, zoom_law=ZoomLaw(6.5))
    theta = rng.normal(size=layout.size)
    theta[LOG_F] += 6.5
    other, change = layout.referred(reference)
    np.testing.assert_allclose(
        other.at_zoom(change @ theta)[: layout.lens_block.stop],
        layout.at_zoom(theta)[: layout.lens_block.stop],
        atol=1e-9,
    )
    back, inverse = other.referred(6.5)
    assert back.zoom_law == layout.zoom_law
    np.testing.assert_allclose(inverse @ change, np.eye(layout.size), atol=1e-9)


def test_parts_of_no_frames():
    assert len(joined_parts([], HOW)) == 0
    nothing = VideoCalibration.joined([])
    assert len(joined_parts([nothing, nothing], HOW)) == 0
