"""data_tools.ground_errors: what is left out is as far from its marking as the standard deviations say."""

import json

import numpy as np
import pytest
from synthetic import random_frames

from data_tools.ground_errors import left_out_on_ground, main
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.io.soccernet import format_annotation

SIZE = (960, 540)


def frames(count, noise, seed=0):
    return random_frames(count, seed=seed, noise=noise, least_segments=7, stands=("main center",))[0]


@pytest.mark.slow
def test_errors_are_as_large_as_expected():
    found = list(left_out_on_ground(soccer(), frames(8, noise=1.0), SIZE))
    assert len(found) > 30
    z = np.concatenate([one.error / one.expected for one in found])
    assert 0.35 < np.median(np.abs(z)) < 0.95  # 0.67 of a normal distribution
    assert np.mean(np.abs(z) < 2.0) > 0.9
    located = np.concatenate([one.located for one in found])
    assert np.all(located > 0.0)


@pytest.mark.slow
def test_a_marking_out_of_place_is_far_off():
    (frame,) = frames(1, noise=0.5)
    label = next(label for label in frame if label.startswith("Side line"))
    moved = {**frame, label: frame[label] + (25.0, 25.0)}
    plain, off = (list(left_out_on_ground(soccer(), [one], SIZE)) for one in (frame, moved))
    assert max(np.median(np.abs(one.error)) for one in off) > 5.0 * max(np.median(np.abs(one.error)) for one in plain)


def test_the_command(tmp_path, capsys):
    for index, frame in enumerate(frames(2, noise=0.5)):
        (tmp_path / f"{index}.json").write_text(format_annotation(frame, SIZE))
    assert main([str(tmp_path), "--size", "960x540"]) == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [row["metres"] for row in rows] == [[0, 2], [2, 5], [5, 10], [10, 20], [20, 40], [40, None]]
    assert sum(row["pixels"] for row in rows) > 50
