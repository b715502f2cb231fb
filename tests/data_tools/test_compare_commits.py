"""What a comparison of two commits lets pass, and what it does not."""

import json

import numpy as np
import pytest

from data_tools.compare_commits import compare, record
from fieldcalib import Camera, calibrate_from_segments, soccer

SIZE = (960, 540)
CAMERA = Camera.from_angles(0.2, 1.35, 0.0, 1400.0, (1.0, 65.0, -16.0), SIZE)
LABELS = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top", "Circle right")


@pytest.fixture(scope="module")
def found():
    pixels = {label: CAMERA.project(soccer()[label].sample(9.0)) for label in LABELS}
    return record(calibrate_from_segments(soccer(), pixels, SIZE))


def focal_length_times(one, factor):
    K = np.array(one["camera"][:3])
    K[:2, :2] *= factor
    return {**one, "camera": [*K.tolist(), *one["camera"][3:]]}


def error_times(one, factor):
    return {**one, "covariance": (factor * np.array(one["covariance"])).tolist()}


def said(one, *words):
    return {**one, "said": [*words, *one["said"][len(words) :]]}


@pytest.mark.parametrize(
    ("change", "agrees"),
    [
        (lambda one: one, True),
        (lambda one: focal_length_times(one, 1.0 + 1e-7), True),  # 1e-4 px at the border
        (lambda one: focal_length_times(one, 1.0 + 1e-5), False),
        (lambda one: error_times(one, 1.0 + 1e-6), True),
        (lambda one: error_times(one, 1.0 + 1e-4), False),
        (lambda one: {**one, "probability": one["probability"] - 1e-3}, False),
        (lambda one: {**one, "covariance": None}, False),
        (lambda one: said(one, "check"), False),
    ],
)
def test_what_a_comparison_lets_pass(tmp_path, capsys, found, change, agrees):
    files = [tmp_path / "old.jsonl", tmp_path / "new.jsonl"]
    for path, one in zip(files, (found, change(found)), strict=True):
        path.write_text(json.dumps({"part": "one_by_one", "seconds": 1.0, "found": [one]}) + "\n")
    assert compare(*files, show=3) is agrees
    assert ("agree" if agrees else "DIFFER") in capsys.readouterr().out
