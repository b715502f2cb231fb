"""Labels of very many pixels: thinned, and their losses computed in little memory."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from fieldcalib.assess.ndc import ndc_loss
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.labelled_pixels import MOST_PIXELS, check_weights, thinned

FIELD = soccer()


def numbered(count):
    """Pixels whose x counts them."""
    return np.column_stack([np.arange(count, dtype=float), np.zeros(count)])


@given(count=st.integers(1, 3000))
@example(count=400)  # whose places all lie between two pixels
def test_a_label_is_thinned_evenly(count):
    thin = thinned({"Middle line": numbered(count)})["Middle line"][:, 0]
    assert len(thin) == min(count, MOST_PIXELS)
    gaps = np.diff(thin)
    assert gaps.size == 0 or gaps.max() - gaps.min() <= 1.0
    assert thin[0] <= 0.5 * count / MOST_PIXELS + 1.0
    assert count - 1 - thin[-1] <= 0.5 * count / MOST_PIXELS + 1.0


@given(
    weights=arrays(float, st.integers(1, 3000), elements=st.floats(0.01, 1.0)),
    scale=st.sampled_from([1e-300, 1.0, 1e8]),
)
def test_a_thinned_label_weighs_as_much_as_before(weights, scale):
    frame = {"Middle line": numbered(len(weights)), "CENTER_MARK": np.array([(480.0, 250.0)])}
    pixels, shares = check_weights(FIELD, frame, {"Middle line": scale * weights, "CENTER_MARK": 2.0})
    assert {label: len(share) for label, share in shares.items()} == {label: len(xy) for label, xy in pixels.items()}
    assert len(pixels["Middle line"]) <= MOST_PIXELS
    assert np.sum(shares["Middle line"]) == pytest.approx(scale * np.mean(weights), rel=1e-9)
    assert shares["CENTER_MARK"] == [2.0]
    if len(weights) <= MOST_PIXELS:
        np.testing.assert_array_equal(pixels["Middle line"], frame["Middle line"])


def test_a_thinned_label_keeps_the_pixels_that_weigh():
    weights = np.full(1000, 1e-6)
    weights[700] = 1.0
    pixels, shares = check_weights(FIELD, {"Middle line": numbered(1000)}, {"Middle line": weights})
    heavy = pixels["Middle line"][:, 0] == 700.0
    assert shares["Middle line"][heavy] == pytest.approx(1e-3, rel=0.01)


def test_frames_without_weights_are_thinned_too():
    assert len(check_weights(FIELD, {"Middle line": numbered(5000)}, None)[0]["Middle line"]) == MOST_PIXELS


@pytest.mark.parametrize("kind", ["tvcalib", "eq3"])
def test_one_dense_label_does_not_take_the_memory_of_all_frames(kind):
    camera = Camera.from_angles(0.0, 1.35, 0.0, 1000.0, (0.0, 65.0, -16.0), (960, 540))
    circle = camera.project(FIELD["Circle central"].sample(0.02))
    dense = {"Circle central": np.resize(circle, (2000, 2)) + 0.5}
    ordinary = {"Circle central": dense["Circle central"][:9]}
    tracemalloc.start()
    losses = ndc_loss([camera] * 100, FIELD, [ordinary] * 99 + [dense], kind)
    assert tracemalloc.get_traced_memory()[1] < 150e6  # 2 GB when all are padded to the longest
    tracemalloc.stop()
    for frame, loss in ((ordinary, losses[:99]), (dense, losses[99])):
        np.testing.assert_allclose(loss, ndc_loss([camera], FIELD, [frame], kind)[0], rtol=1e-12)
