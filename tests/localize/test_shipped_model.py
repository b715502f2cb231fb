"""The network that comes with the package, on frames that it was not trained on."""

import json
from dataclasses import replace

import numpy as np
import pytest

from data_tools import score_images
from data_tools.nonsense import nonsense
from data_tools.synthetic import CLASSES, frame
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.images.from_images import calibrate_from_images
from fieldcalib.localize import BACKGROUND, SegmentationNetwork
from fieldcalib.localize.network import SHIPPED, Padded

CLEAR = (5005, 5025, 5035)  # seeds of synthetic frames with many markings in view
MEGABYTE = 1 << 20


@pytest.fixture(scope="module")
def network():
    return SegmentationNetwork.load()


def test_it_is_small_and_knows_all_segments(network):
    assert len(SHIPPED.read_bytes()) < 10 * MEGABYTE
    assert network.classes == (BACKGROUND, *CLASSES)


@pytest.mark.parametrize("seed", [CLEAR[0], *(pytest.param(seed, marks=pytest.mark.slow) for seed in CLEAR[1:])])
def test_synthetic_frames_get_their_cameras(network, seed):
    made = frame(seed, (1280, 720))
    (calibration,) = calibrate_from_images(made.field, [made.image], network)
    assert calibration.accepted
    X = np.concatenate([segment.sample(2.0) for segment in made.field.markings.values()])
    seen, found = made.camera.project(X), calibration.camera.project(X)
    inside = np.all((seen >= 0.0) & (seen < (1280, 720)), axis=1)
    # about a pixel of the network's input, 4 px
    assert np.median(np.linalg.norm(found - seen, axis=1)[inside]) < 4.5


def test_upright_parts_are_seen_better_at_their_own_size(network):
    """As against padded, and against stretched, by the share of the markings' pixels that get their class."""
    stretched = replace(network, description=replace(network.description, upright_size=None))
    rng, right = np.random.default_rng(0), []
    for seed in CLEAR:
        made = frame(seed)
        for x in rng.integers(512 - 180, size=3):
            image, mask = (np.ascontiguousarray(one[:, x : x + 180]) for one in (made.image, made.mask))
            found = [one([image])[0].argmax(axis=0) for one in (network, Padded(stretched), stretched)]
            where = np.argwhere(mask > 0)
            cells = [tuple((where * classes.shape // mask.shape).T) for classes in found]
            right.append([np.mean(one[at] == mask[tuple(where.T)]) for one, at in zip(found, cells, strict=True)])
    own_size, padded, as_stretched = np.mean(right, axis=0)
    assert own_size > max(padded, as_stretched) + 0.03


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (0, *range(2, 14)))])
def test_no_field_no_camera(network, seed):
    (calibration,) = calibrate_from_images(soccer(), [nonsense(seed)], network)
    assert not calibration.accepted


@pytest.mark.slow
def test_real_frames_agree_with_their_labelled_points(network, shared_data, capsys):
    assert score_images.main(["keypoints", str(shared_data / "pitch-keypoints" / "valid")]) == 0
    row = json.loads(capsys.readouterr().out)
    assert row["lost"] <= 4
    assert row["50_percent_px"] < 5.0
    assert row["95_percent_px"] < 10.0
    assert row["100_percent_px"] < 50.0
