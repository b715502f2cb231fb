"""The flat table of labelled pixels: what goes in comes out, frame by frame and label by label."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import pixel_arrays

from fieldcalib.problem.labelled_pixels import NO_PIXELS, PixelTable

LABELS = ("a", "b", "c")
frames_of_labels = st.lists(
    st.dictionaries(st.sampled_from(LABELS), pixel_arrays((0.0, 0.0), (960.0, 540.0), 4)), min_size=1, max_size=5
)


def assert_holds(table, frames):
    """The pixels are those of the frames, in their order, and those of a label share a weight of 1."""
    assert table.count == len(frames)
    assert np.all(np.diff(table.frame) >= 0)
    for t, frame in enumerate(frames):
        pixels = table.by_label(t)
        assert list(pixels) == list(frame)
        for label, xy in frame.items():
            np.testing.assert_array_equal(pixels[label], xy)
            own = (table.frame == t) & (table.label == table.labels.index(label))
            np.testing.assert_array_equal(table.weight[own], np.full(len(xy), 1.0 / len(xy)))


@given(frames_of_labels)
def test_frames_come_back(frames):
    table = PixelTable.of(LABELS, frames)
    assert_holds(table, frames)
    np.testing.assert_array_equal(table.has_pixels, [bool(frame) for frame in frames])


@given(frames_of_labels, st.lists(st.integers(0, 10), max_size=6))
def test_some_frames_in_any_order(frames, index):
    index = [i % len(frames) for i in index]
    assert_holds(PixelTable.of(LABELS, frames).of_frames(index), [frames[i] for i in index])


@given(st.lists(frames_of_labels, max_size=3), st.permutations(LABELS))
def test_joined_tables_have_the_frames_of_all(parts, order):
    """Also where each numbers its labels in its own way, and only knows those that it has."""
    tables = [PixelTable.of(sorted(set().union(*part)), part) for part in parts]
    joined = PixelTable.joined(order, [*tables, NO_PIXELS])
    assert joined.labels == tuple(order)
    assert_holds(joined, [*(frame for part in parts for frame in part), {}])


def test_labels_that_an_object_lacks_are_named():
    table = PixelTable.of(LABELS, [{"b": np.zeros((2, 2))}])
    assert table.numbered(("c", "b")).label.tolist() == [1, 1]  # labels without pixels may be missing
    with pytest.raises(ValueError, match="has no label 'b': are the pixels of another field"):
        table.numbered(("a", "c"))


@given(frames_of_labels)
def test_pixels_of_an_enlarged_picture(frames):
    enlarged = [{label: xy * (2.0, 0.5) for label, xy in frame.items()} for frame in frames]
    assert_holds(PixelTable.of(LABELS, frames).scaled(np.array([2.0, 0.5])), enlarged)


def test_weights_are_kept():
    weights = [None, {"b": np.array([0.1, 0.3])}]
    table = PixelTable.of(LABELS, [{"a": np.zeros((2, 2))}, {"b": np.ones((2, 2))}], weights)
    np.testing.assert_array_equal(table.weight, [0.5, 0.5, 0.1, 0.3])
