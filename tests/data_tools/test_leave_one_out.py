"""data_tools.leave_one_out: what is left out is not looked at, and the lens helps where there is one."""

import json

import numpy as np
import pytest
from synthetic import observe, random_frames, whole_circle_markings

from data_tools.leave_one_out import left_out_errors, main
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.soccernet import format_annotation

SIZE = (960, 540)
BENT = Camera.from_angles(-0.3, 1.35, 0.0, 1400.0, (0.0, 68.0, -17.0), SIZE, k=(0.3, 0.0))


def test_a_segment_out_of_place_is_far_from_what_the_others_say():
    frame = observe(whole_circle_markings(soccer()), BENT)
    moved = {**frame, "Circle left": frame["Circle left"] + (0.0, 30.0)}
    errors = dict(zip(frame, left_out_errors(soccer(), [moved], SIZE), strict=True))
    assert errors["Circle left"] > 20.0
    assert np.median(list(errors.values())) < 5.0


def test_frames_with_few_segments_are_left_alone():
    frame = dict(list(observe(whole_circle_markings(soccer()), BENT).items())[:5])
    assert len(left_out_errors(soccer(), [frame, {}], SIZE)) == 0
    assert len(left_out_errors(soccer(), [frame], SIZE, least=4)) == 5


@pytest.mark.slow
def test_a_free_field_size_fits_a_small_pitch_better():
    frame = observe(whole_circle_markings(soccer(100.0, 65.0)), BENT)
    fixed, free = (left_out_errors(soccer(), [frame], SIZE, free_field_size=free) for free in (False, True))
    assert len(free) == len(fixed) == len(frame)
    assert np.median(free) < 0.5 * np.median(fixed)


@pytest.mark.slow
def test_the_command(tmp_path, capsys):
    frames, _ = random_frames(2, seed=1, noise=0.5, least_segments=7, stands=("main center",))
    frames.append(observe(whole_circle_markings(soccer()), BENT, np.random.default_rng(0), noise=0.5))
    for index, frame in enumerate(frames):
        (tmp_path / f"{index}.json").write_text(format_annotation(frame, SIZE))
    assert main([str(tmp_path), "--size", "960x540"]) == 0
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [row["lens"] for row in rows] == ["none", "k1", "k1k2", "opencv", "fisheye", "auto"]
    assert {row["segments"] for row in rows} == {sum(len(frame) for frame in frames)}
    assert rows[1]["90_percent_px"] < rows[0]["90_percent_px"]
