"""Enlarged parts of frames (digital zoom): pictures that may be such ones, their cameras, and what doubt is left."""

import argparse

import cv2
import numpy as np
import pytest
from networks import FIELD, KnownCameras
from pictures import picture
from views import camera

from data_tools.pictures_in_pictures import WAYS, View, arranged, is_wrong
from data_tools.probability import largest_true_error
from fieldcalib import Calibration, Camera, calibrate_from_images
from fieldcalib.assess.advice import WHICH_PART
from fieldcalib.assess.findings import CUT, ENLARGED, Verdict
from fieldcalib.cli.camera_options import KnownCamera
from fieldcalib.console.options import add_options
from fieldcalib.images.shape import shape_of_picture
from fieldcalib.images.shape.enlarged import LARGEST_SOFTNESS, softness
from fieldcalib.images.shape.shape_of_picture import may_be_enlarged

TRUTH = camera(-22, 78, 1400, (0, 68, -17), k=(0.06, 0.0))
VIEW = View(cv2.GaussianBlur(picture(TRUTH), (0, 0), 0.8), TRUTH, FIELD)
WHOLE, PART = (arranged([VIEW], WAYS[way], np.random.default_rng(0)) for way in ("as it is", "zoom 1.33 upper left"))


def calibrated(shown, **how):
    (found,) = calibrate_from_images(FIELD, [shown.image], KnownCameras([shown.windows[0][1]]), **how)
    return found


def test_an_enlarged_part_is_not_good_with_a_wrong_camera():
    as_whole = calibrated(PART, may_be_enlarged=False)
    assert as_whole.verdict is Verdict.GOOD
    assert is_wrong(as_whole.camera, PART)
    found = calibrated(PART)
    assert "part of a frame" in found.reason
    assert not (found.verdict is Verdict.GOOD and is_wrong(found.camera, PART))


@pytest.mark.slow
def test_a_part_that_was_cut_out_undeclared_is_found_with_its_principal_point():
    whole = Camera.from_angles(np.radians(-20), np.radians(78), 0.0, 1400.0, (0.0, 68.0, -17.0), (1280, 720))
    truth, part = whole.cropped((0, 180), (960, 540)), np.ascontiguousarray(picture(whole)[180:, :960])
    (as_whole,), (found,) = (
        calibrate_from_images(FIELD, [part], KnownCameras([truth]), may_be_enlarged=freed) for freed in (False, True)
    )
    assert CUT in as_whole.findings
    assert largest_true_error(as_whole.camera, truth, FIELD) > 1.0
    assert found.verdict is Verdict.GOOD
    assert largest_true_error(found.camera, truth, FIELD) < 1.0
    assert "its principal point was found at" in found.reason


def test_a_camera_that_is_not_sure_without_the_middle_is_kept_with_a_doubt(monkeypatch):
    monkeypatch.setattr(shape_of_picture, "SURE_ANYWHERE", 1.1)
    as_whole, found = calibrated(PART, may_be_enlarged=False), calibrated(PART)
    assert found.verdict is Verdict.CHECK
    assert found.findings == (ENLARGED,)
    assert found.remedy == WHICH_PART.text
    np.testing.assert_array_equal(found.K, as_whole.K)
    assert Calibration.from_dict(found.to_dict()).reason == found.reason


def test_a_whole_frame_keeps_its_camera_however_soft_it_is():
    found = calibrated(WHOLE)
    assert found.verdict is Verdict.GOOD
    soft = cv2.GaussianBlur(WHOLE.image, (0, 0), 0.9)
    assert softness(soft) == LARGEST_SOFTNESS
    assert not may_be_enlarged(soft, found)


def test_detail_in_one_direction_is_enough():
    sharp = WHOLE.image
    assert softness(sharp) == 0.0
    assert softness(cv2.resize(sharp[:, :480], (960, 540))) == 0.0
    assert softness(cv2.resize(sharp[:270, :480], (960, 540))) == LARGEST_SOFTNESS
    assert softness(sharp[:40, :40]) == 0.0  # too small to tell


def test_a_small_picture_that_was_stretched_is_no_enlarged_part():
    small = cv2.resize(WHOLE.image, (200, 112), interpolation=cv2.INTER_AREA)
    assert softness(cv2.resize(small, (960, 540), interpolation=cv2.INTER_CUBIC)) == 0.0


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ([], True),
        (["--aspect", "square"], True),
        (["--aspect", "16:9"], False),
        (["--display-size", "1920x1080"], False),
        (["--crop-of", "960x540+0+0"], False),
    ],
)
def test_pictures_that_are_placed_or_resized_are_not_doubted(options, expected):
    parser = argparse.ArgumentParser()
    add_options(parser, KnownCamera)
    assert KnownCamera("k1", **vars(parser.parse_args(options))).may_be_enlarged is expected
