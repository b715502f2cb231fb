"""Cameras of images in which some of the labelled segments are something else."""

import numpy as np
import pytest
from pictures import picture
from synthetic import observe, whole_circle_markings
from views import camera

from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.images.from_images import calibrate_from_consensus
from fieldcalib.images.refinement import near_labels
from fieldcalib.metrics.cameras import camera_difference
from fieldcalib.problem.labelled_pixels import PixelTable
from fieldcalib.solve.from_segments import calibrate_from_segments
from fieldcalib.solve.request import Task
from fieldcalib.solve.solver_options import DEFAULT_FLAGS

FIELD = soccer()
TRUTH = camera(3, 75, 1000, (-2, 66, -16), k=(0.03, 0.0))
SEEN = ("Circle central", "Middle line", "Side line top", "Side line bottom")
MISTAKEN = ("Big rect. right main", "Big rect. right top", "Circle right")  # a mowing pattern, say


def labelled(mistaken_camera):
    """Right pixels of what is seen, with those of penalty areas where another camera would have them."""
    right, wrong = (observe(whole_circle_markings(FIELD), one) for one in (TRUTH, mistaken_camera))
    pixels = {label: right[label] for label in SEEN} | {label: wrong[label] for label in MISTAKEN if label in wrong}
    weights = {label: np.full(len(xy), (1.1 if label in SEEN else 1.0) / len(xy) ** 2) for label, xy in pixels.items()}
    return PixelTable.of(FIELD, [pixels], [weights])


def names(table, is_chosen):
    """The labels of a table that are chosen by their index."""
    return {label for label, chosen in zip(table.labels, is_chosen, strict=True) if chosen}


def consensus(found, image=None):
    image = picture(TRUTH, seed=None) if image is None else image
    return calibrate_from_consensus(Task(FIELD, flags=DEFAULT_FLAGS), [image], [found])[0]


@pytest.mark.parametrize("pan", [12, 20])
def test_segments_that_are_something_else_are_left_out(pan):
    labels = labelled(camera(pan, 75, 1000, (-2, 66, -16)))
    misled = calibrate_from_segments(FIELD, labels.by_label(0), TRUTH.image_size, trust_labels=True)
    found = consensus(labels)[0]
    assert camera_difference(misled.camera, TRUTH, FIELD).reprojection > 100.0
    assert camera_difference(found.camera, TRUTH, FIELD).reprojection < 8.0
    assert found.accepted
    assert set(found.per_segment_errors) == set(SEEN)


def test_segments_that_are_right_are_all_kept():
    labels = labelled(TRUTH)
    found = consensus(labels)[0]
    assert set(found.per_segment_errors) == set(labels.by_label(0))
    assert camera_difference(found.camera, TRUTH, FIELD).reprojection < 4.0


def test_three_segments_leave_no_choice():
    labels = labelled(TRUTH)
    assert consensus(labels.take(np.isin(labels.label, [labels.labels.index(name) for name in SEEN[:3]]))) == []


def test_without_lines_in_the_image_there_are_answers_all_the_same():
    labels = labelled(TRUTH)
    assert 1 <= len(consensus(labels, np.zeros((540, 960, 3), np.uint8))) <= 3


def test_near_labels_are_those_that_a_camera_explains():
    elsewhere = camera(12, 75, 1000, (-2, 66, -16))
    labels = labelled(elsewhere)
    found = near_labels(FIELD, [TRUTH, elsewhere, TRUTH], [labels, labels, labelled(TRUTH)], 12.0)
    near, far, every = (names(labels, is_near) for is_near in found)
    assert near >= set(SEEN)
    assert not near & {"Big rect. right main", "Circle right"}
    assert not far & {"Circle central", "Middle line"}
    assert every == set(labels.by_label(0))
    assert not len(near_labels(FIELD, [], [], 12.0))
