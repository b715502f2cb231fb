"""Clips that may be enlarged parts of larger pictures: what tells that, and what becomes of their cameras."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from pictures import picture
from test_clip_models import clip_of, finished, solved
from tripods import SIZE
from views import camera

from data_tools.pictures_in_pictures import WAYS, arranged, clip_views, counts
from fieldcalib import Camera, VideoCalibration, calibrate_video, soccer
from fieldcalib.assess.advice import WHICH_PART
from fieldcalib.assess.findings import ENLARGED, Verdict
from fieldcalib.images.shape.enlarged import LARGEST_SOFTNESS, Detail, are_interpolated, softness_of_shot

PART = (720, 405)  # px: three quarters of a frame
THIN = soccer(line_width=0.0)  # as the pictures are drawn
RNG = np.random.default_rng(0)
FRAMES = [
    cv2.GaussianBlur(picture(camera(pan, 78, 1400, (0, 68, -17))), (0, 0), 0.8).astype(np.int16)
    + RNG.integers(-3, 4, (540, 960, 3), np.int16)
    for pan in (-22, -21)
]
FRAMES = [np.clip(one, 0, 255).astype(np.uint8) for one in FRAMES]


def are_enlarged(share, interpolation=cv2.INTER_LINEAR, stored=lambda one: one):
    """Whether frames of which a part is shown in full size have the pattern of interpolation."""
    x, y = round(share * 960), round(share * 540)
    shown = [cv2.resize(one[:y, :x], (960, 540), interpolation=interpolation) for one in FRAMES]
    return are_interpolated([Detail.of(stored(one)) for one in shown])


def as_jpeg(image):
    return cv2.imdecode(cv2.imencode(".jpg", image, (cv2.IMWRITE_JPEG_QUALITY, 90))[1], cv2.IMREAD_COLOR)


@pytest.mark.parametrize("share", [0.6, 0.67, 0.7, 0.75, 0.8, 0.9])
def test_enlarging_leaves_a_pattern(share):
    assert are_enlarged(share)
    assert are_enlarged(share, cv2.INTER_CUBIC)


def test_whole_frames_have_no_pattern():
    assert not are_enlarged(1.0)
    assert not are_enlarged(1.0, stored=as_jpeg)  # a pattern of eight pixels
    assert not are_interpolated([])
    assert not are_interpolated([Detail.of(FRAMES[0][:90, :160])])


def test_enlarging_in_one_direction_is_no_zoom():
    wide = [cv2.resize(one[:, :720], (960, 540)) for one in FRAMES]
    assert not are_interpolated([Detail.of(one) for one in wide])


def test_a_shot_is_as_soft_as_most_of_its_keyframes_unless_interpolated():
    sharp, soft = (Detail.of(FRAMES[0])._replace(softness=value) for value in (0.1, 0.6))
    assert softness_of_shot([]) == 0.0
    assert softness_of_shot([sharp, soft, soft]) == 0.6
    enlarged = Detail.of(cv2.resize(FRAMES[0][:405, :720], (960, 540)))._replace(softness=0.0)
    assert softness_of_shot([enlarged]) == LARGEST_SOFTNESS


def short_shot(pan, focal_length, corner=(0, 0), *, is_soft=True, **options):
    """Keyframes of a shot that hardly pans, of which a part of three quarters of the size may be shown."""
    cameras = [camera_at(pan + 0.005 * k, focal_length) for k in range(3)]
    if corner != (0, 0):
        cameras = [one.cropped(corner, PART).scaled(SIZE) for one in cameras]
    clip = clip_of(cameras, noise=1.0)
    detail = Detail(LARGEST_SOFTNESS, *2 * [np.zeros(0, np.float32)])
    details = dict.fromkeys(clip.labels, detail) if is_soft else {}
    return cameras, finished(solved(replace(clip, details=details, how=replace(clip.how, **options))))


def camera_at(pan, focal_length):
    return Camera.from_angles(pan, 1.34, 0.003, focal_length, (1.0, 66.0, -17.0), SIZE)


@pytest.mark.slow
def test_a_shot_that_does_not_show_its_middle_is_not_trusted_if_it_looks_enlarged():
    (_, trusted), (_, found) = (short_shot(-0.38, 2000.0, (240, 0), is_soft=one) for one in (False, True))
    assert {one.verdict for one in trusted} == {Verdict.GOOD}
    assert {one.verdict for one in found} == {Verdict.CHECK}
    assert all(ENLARGED in one.findings for one in found)
    assert {one.remedy for one in found} == {WHICH_PART.text}
    assert len(VideoCalibration.from_dict(found.to_dict())[0].reason) == len(found[0].reason)


@pytest.mark.slow
def test_an_enlarged_shot_is_right_with_a_free_principal_point_if_it_is_sure():
    (cameras, trusted), (_, found) = (short_shot(-0.5, 1350.0, (0, 135), is_soft=one) for one in (False, True))
    assert not trusted.notes
    assert {one.verdict for one in found} == {Verdict.GOOD}
    assert "may be an enlarged part" in found.notes[0]
    off = [abs(one.camera.principal_point[0] - cameras[0].principal_point[0]) for one in (trusted[0], found[0])]
    assert off[1] < 0.5 * off[0]  # its height is hardly known: a turn of the camera compensates it


@pytest.mark.slow
def test_a_whole_shot_keeps_its_cameras_however_soft_it_is():
    (_, sharp), (_, soft) = (short_shot(-0.3, 1300.0, is_soft=one) for one in (False, True))
    assert {one.verdict for one in soft} == {Verdict.GOOD}
    assert soft == sharp


def test_a_shot_that_is_declared_whole_is_not_doubted():
    _, found = short_shot(-0.35, 1950.0, (240, 0), may_be_enlarged=False)
    assert {one.verdict for one in found} == {Verdict.GOOD}


@pytest.mark.slow
@pytest.mark.parametrize("way", ["zoom 1.33 lower right", "zoom 2 upper right"])
def test_pictures_of_a_digital_zoom_are_not_good_and_a_metre_off(way):
    """Of a shot of a second, whose lines do not tell where the middle is."""
    views = clip_views(1, 30)
    shown = [arranged([view], WAYS[way], np.random.default_rng(0)) for view in views]
    pictures = [one.image for one in shown]
    assert counts(calibrate_video(THIN, pictures, may_be_enlarged=False), shown)["good and 1 m off"] == 30
    found = counts(calibrate_video(THIN, pictures), shown)
    assert (found["good and 1 m off"], found["accepted"]) == (0, 30)
