"""Random frames with wrong labels, and how these are found."""

import json

import numpy as np
import pytest
from hypothesis import given
from strategies import examples, generators

from data_tools import wrong_labels
from data_tools.random_frames import SIZE, confused_labels, mislabelled, random_frame
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.io.soccernet import format_annotation
from fieldcalib.problem.simulated import observe, pan_over_field

FIELD = soccer()


@examples(30)
@given(generators())
def test_pixels_are_near_the_segments_that_they_should_be_labelled_with(rng):
    frame = random_frame(FIELD, rng)
    assert frame.camera.image_size == SIZE
    assert len(frame.pixels) >= 3
    for label, xy in frame.pixels.items():
        seen = frame.camera.project(FIELD[frame.wrong.get(label, label)].sample(0.1))
        distance = np.nanmin(np.linalg.norm(xy[:, None] - seen, axis=-1), axis=1)
        assert np.max(distance) < 25.0  # five sigma of the noisiest frames


def test_the_same_seed_gives_the_same_frame():
    a, b = (random_frame(FIELD, np.random.default_rng(3)) for _ in range(2))
    assert a.camera == b.camera
    assert list(a.pixels) == list(b.pixels)


@given(generators())
def test_labels_are_exchanged_not_lost(rng):
    (camera,) = pan_over_field(1)
    pixels = observe(camera, FIELD, rng, noise=0.0)
    changed, wrong = mislabelled(pixels, FIELD, 2, rng)
    assert len(wrong) == 2
    assert [wrong.get(label, label) for label in changed] == list(pixels)
    assert not set(wrong) & set(pixels)
    assert all(lie in confused_labels(label, FIELD) for lie, label in wrong.items())


@pytest.mark.parametrize(
    ("label", "confused"),
    [
        ("Goal left post left", {"Goal left post right", "Goal right post left", "Goal right post right"}),
        ("Big rect. left top", {"Big rect. right bottom", "Big rect. left bottom", "Small rect. left top"}),
    ],
)
def test_what_is_confused(label, confused):
    assert confused <= set(confused_labels(label, FIELD))
    assert label not in confused_labels(label, FIELD)


def test_replaced_labels_are_found_on_annotations(tmp_path, capsys):
    for index, camera in enumerate(pan_over_field(12)):
        pixels = observe(camera, FIELD, np.random.default_rng(index), noise=0.5)
        (tmp_path / f"{index:05d}.json").write_text(format_annotation(pixels, camera.image_size))
    size = "x".join(map(str, camera.image_size))
    assert wrong_labels.main([str(tmp_path), "--size", size]) == 0
    row = json.loads(capsys.readouterr().out)
    assert row["frames"] == row["replaced"] > 3
    assert row["recall"] == row["precision"] == 100.0
    assert row["accused_as_they_are"] == [0, 12]
