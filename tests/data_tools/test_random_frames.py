"""Random frames with wrong labels, and how these are found."""

import json

import numpy as np
import pytest
from hypothesis import given
from strategies import examples, generators

from data_tools import spoiled_labels, wrong_labels
from data_tools.random_frames import SIZE, confused_labels, mislabelled, noisy_pixels, random_frame
from data_tools.simulated import observe, pan_over_field
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.io.soccernet import format_annotation

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


def test_spoiled_labels_are_compared_with_what_the_changed_picture_shows(tmp_path, capsys):
    """The true camera of an enlarged quarter is 0 m off; a focal length given 20 % wrong is not good."""
    (camera,) = pan_over_field(1)
    right, rng = observe(camera, FIELD, np.random.default_rng(0), noise=0.5), np.random.default_rng(1)
    frame = spoiled_labels.Frame("0", right, camera, right)
    quarter = spoiled_labels.WAYS["upper left quarter enlarged"](frame, rng)
    truth = camera.cropped((0, 0), (480, 270)).scaled((960, 540))
    assert max(spoiled_labels.metres_off(truth, frame, quarter.shown)) < 1e-6
    assert all(np.all((xy >= 0.0) & (xy <= (959.0, 539.0))) for xy in quarter.pixels.values())
    assert spoiled_labels.metres_off(camera, frame, quarter.shown)[0] > 5.0
    for k, one in enumerate(pan_over_field(9)):
        labels = noisy_pixels(one, FIELD, np.random.default_rng(k), 0.5, 1.0)
        (tmp_path / f"{k}.json").write_text(format_annotation(labels, SIZE))
    words = ["unchanged", "focal", "y swapped"]
    assert spoiled_labels.main([str(tmp_path), "--size", "960x540", "--frames", "1", "--ways", *words]) == 0
    lines = capsys.readouterr().out.splitlines()
    counts = {line[:38].strip(): list(map(int, line[38:].split()[:7])) for line in lines[1:]}
    assert counts["unchanged"] == [1, 0, 1, 0, 0, 0, 0]
    assert counts["x and y swapped"][2] == 0
    assert counts["focal length given 20 % too long"][2] == counts["focal length given 20 % too short"][2] == 0
    assert counts["all but 3"][0] == 3
