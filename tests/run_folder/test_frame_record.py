"""What `run` and `calibrate` say on stderr of frames that are not good."""

import json
import re

import numpy as np
import pytest
from commands import run
from synthetic import observe, whole_circle_markings

from fieldcalib import Camera, soccer
from fieldcalib.io.soccernet import format_annotation
from fieldcalib.run_folder.record import NAMED, ToLookAt


def seen(*frames):
    found = ToLookAt()
    for number, (verdict, reason) in enumerate(frames):
        found.add(f"{number:03d}", verdict, reason, kind=re.sub(r"[0-9.]+", "#", reason.partition("; ")[0]))
    return found


def test_nothing_is_said_of_good_frames_and_broken_files():
    assert seen(("good", "rms 0.5 px"), ("", "")).message("here") == ""


def test_frames_in_a_row_of_one_reason_are_one_line():
    beside = [("check", f"'Middle line' lies {px} px beside its paint; rms 0.5 px") for px in (9, 8, 7.5)]
    said = seen(beside[0], ("good", ""), *beside[1:], ("reject", "too few")).message("cameras.jsonl").splitlines()
    assert said == [
        "4 frames to look at (all reasons and remedies: cameras.jsonl):",
        "  000: check, 'Middle line' lies 9 px beside its paint",
        "  002 to 003, 2 frames: check, 'Middle line' lies 7.5 to 8 px beside its paint",
        "  004: reject, too few",
    ]


def test_what_would_help_is_said_of_the_frames_that_it_helps():
    found = ToLookAt()
    remedies = ("cut", "cut", "size", "cut", "", "cut")
    for number, remedy in enumerate(remedies):
        found.add(f"{number:03d}", "check", "a shape", remedy, kind="shape")
    found.add("006", "good", "")
    found.add("007", "check", "a shape", "cut", kind="shape")
    assert found.message("there").splitlines()[1:] == [
        "  000 to 005, 6 frames: check, a shape",
        "  007: check, a shape",
        "  what would help 000 to 001, 003, 005, 007: cut",
        "  what would help 002: size",
    ]


@pytest.mark.parametrize("more", [0, 1, 7])
def test_the_first_few_are_named_and_the_others_counted(more):
    reasons = ("one", "two")
    found = seen(*(("check", reasons[k % 2]) for k in range(NAMED + more)))
    lines = found.message("there").splitlines()
    assert found.count == NAMED + more
    assert len(lines) == 1 + NAMED + bool(more)
    assert (lines[-1] == f"  and {more} more") is bool(more)


def test_a_run_names_its_frames_and_where_to_look(tmp_path, capsys):
    camera = Camera.from_angles(0.3, 1.35, 0.0, 1300.0, (0.0, 62.0, -15.0), (960, 540))
    pixels = observe(whole_circle_markings(soccer()), camera, np.random.default_rng(0), 0.3)
    (tmp_path / "a.json").write_text(format_annotation(pixels, (960, 540)))
    (tmp_path / "b.json").write_text(json.dumps({}))
    command = ["calibrate", tmp_path / "a.json", tmp_path / "b.json", "--size", "960x540", "--out", tmp_path / "out"]
    where = tmp_path / "out" / "cameras.jsonl"
    said = f"1 frame to look at (all reasons and remedies: {where}):\n  b: reject, no labelled pixels"
    assert run(*command) == 0
    assert said in capsys.readouterr().err
    assert run(*command, "--resume") == 0
    assert said in capsys.readouterr().err
