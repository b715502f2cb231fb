"""The crossings of court lines that were set by hand: they fit one camera, and judge cameras."""

import numpy as np
import pytest

from data_tools.court_truth import court_frames
from fieldcalib import Camera, calibrate_from_segments
from fieldcalib.fields.catalogue import field_named
from fieldcalib.fields.segments import Point

FRAMES = court_frames()
FIRST = list({frame.clip: frame for frame in reversed(FRAMES)}.values())


def fitted(frame):
    points = {f"{n}": Point(tuple(X)) for n, X in enumerate(frame.X)}
    pixels = {f"{n}": xy[None] for n, xy in enumerate(frame.xy)}
    behind = [stand for stand in field_named(frame.field).stands if stand.name == "behind left goal"]
    return calibrate_from_segments(points, pixels, frame.size, prior=behind).required_camera


def turned(camera):
    """The same view from the other side of the court."""
    turn = np.array([-1.0, -1.0, 1.0])
    return Camera(camera.K, camera.R * turn, camera.C * turn, camera.image_size, camera.dist)


@pytest.mark.parametrize("frame", FRAMES, ids=[f"{frame.clip} {frame.number}" for frame in FRAMES])
def test_the_crossings_of_a_frame_fit_one_camera(frame):
    off = frame.distances(fitted(frame))
    assert np.median(off) < 0.5
    assert np.max(off) < 1.0


@pytest.mark.parametrize("frame", FIRST, ids=[frame.clip for frame in FIRST])
def test_a_camera_is_right_within_3_px_of_1280_columns(frame):
    camera, unit = fitted(frame), frame.size[0] / 1280.0

    def moved(pixels):
        K = camera.K + np.array([[0.0, 0.0, pixels * unit], [0.0] * 3, [0.0] * 3])
        return Camera(K, camera.R, camera.C, camera.image_size, camera.dist)

    assert frame.is_right(moved(2.0))
    assert not frame.is_right(moved(4.0))
    assert frame.is_right(turned(camera))


def test_a_camera_that_is_off_at_one_end_is_not_right():
    frame = FIRST[0]
    camera = fitted(frame)
    stretched = Camera(camera.K, camera.R, camera.C, camera.image_size, camera.k + (3.0, 0.0))
    off = frame.distances(stretched)
    assert np.max(off) > 6.0
    assert not frame.is_right(stretched)


def test_every_clip_has_ten_frames_in_which_both_ends_of_the_court_show():
    for clip in {frame.clip for frame in FRAMES}:
        frames = [frame for frame in FRAMES if frame.clip == clip]
        assert len(frames) == 10
        for frame in frames:
            assert len(frame.X) >= 6
            assert np.ptp(frame.X[:, 0]) > 0.6 * field_named(frame.field).length
