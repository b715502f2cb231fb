"""Narrow pictures, continued for a network that knows broadcasts only."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fieldcalib.localize.network import SHAPE, Padded


class Echo:
    """A network that says how bright columns are."""

    classes = ("background", "Middle line")

    def __init__(self):
        self.seen = None

    def __call__(self, images):
        self.seen = images[0].shape
        share = (np.arange(160) + 0.5) / 160.0
        bright = [np.interp(share * i.shape[1] - 0.5, np.arange(i.shape[1]), i[0, :, 0] / 255.0) for i in images]
        maps = np.broadcast_to(np.array(bright)[:, None], (len(images), 90, 160))
        return np.stack([1.0 - maps, maps], axis=1).astype(np.float32)


@given(st.integers(100, 480), st.floats(0.1, 0.9))
def test_what_a_network_sees_stays_at_its_place(width, place):
    """An edge in a narrow picture is at the same share of its width as in the grid, to a cell."""
    image = np.zeros((360, width, 3), np.uint8)
    image[:, : round(place * width)] = 255
    network = Echo()
    found = Padded(network)([image])[0, 1, 0]
    assert network.seen[1] == max(round(SHAPE * 360), width)
    edge = np.sum(found) / len(found)
    assert edge == pytest.approx(round(place * width) / width, abs=1.0 / len(found))


def test_wide_pictures_stay_as_they_are():
    image = np.random.default_rng(0).integers(0, 255, (270, 480, 3), np.uint8)
    np.testing.assert_array_equal(Padded(Echo())([image]), Echo()([image]))
