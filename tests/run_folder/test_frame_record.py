"""What `run` and `calibrate` say on stderr of frames that are not good."""

import json

import numpy as np
import pytest
from commands import run
from synthetic import observe, whole_circle_markings

from fieldcalib import Camera, soccer
from fieldcalib.assess.findings import Finding, What
from fieldcalib.io.results import broken_line
from fieldcalib.io.soccernet import format_annotation
from fieldcalib.run_folder.record import NAMED, ToLookAt


def line(number, verdict="check", *findings, **more):
    told = [one.to_dict() for one in findings]
    return {"id": f"{number:03d}", "status": "accepted", "verdict": verdict, "findings": told, **more}


def seen(*lines):
    found = ToLookAt()
    for one in lines:
        found.add(one)
    return found


def beside(px, label="Middle line"):
    return Finding(What.OFF_PAINT, label, (px,))


def test_nothing_is_said_of_good_frames_and_broken_files():
    assert seen(line(0, "good"), broken_line("001", "no picture")).message("here") == ""


def test_frames_in_a_row_of_one_reason_are_one_line():
    off = [line(number, "check", beside(px)) for number, px in ((0, 9.0), (2, 7.5), (3, 7.0), (4, 8.6))]
    reject = line(5, "reject", reason="too few; rms 0.5 px")
    said = seen(off[0], line(1, "good"), *off[1:], reject).message("cameras.jsonl").splitlines()
    assert said == [
        "5 frames to look at (all reasons and remedies: cameras.jsonl):",
        "  000: check, 'Middle line' lies 9 px beside its paint",
        "  002 to 004, 3 frames: check, 'Middle line' lies 7 to 9 px beside its paint",
        "  005: reject, too few",
    ]


def test_a_reason_of_another_marking_is_a_line_of_its_own():
    said = seen(*(line(number, "check", beside(9.0, label)) for number, label in enumerate("aab"))).message("there")
    assert [one.split(":")[0].strip() for one in said.splitlines()[1:]] == ["000 to 001, 2 frames", "002"]


@pytest.mark.parametrize(("words", "said"), [(("few", "few"), "few"), (("few", "fewer", "few"), "for example few")])
def test_reasons_in_other_words_are_told_by_one_of_them(words, said):
    lines = [line(number, "reject", reason=one) for number, one in enumerate(words)]
    assert seen(*lines).message("there").splitlines()[1].endswith(f" frames: reject, {said}")


def test_what_would_help_is_said_of_the_frames_that_it_helps():
    shape = Finding(What.SHAPE)
    remedies = ("cut", "cut", "size", "cut", "", "cut")
    lines = [line(number, "check", shape, remedy=remedy) for number, remedy in enumerate(remedies)]
    found = seen(*lines, line(6, "good"), line(7, "check", shape, remedy="cut"))
    assert found.message("there").splitlines()[1:] == [
        f"  000 to 005, 6 frames: check, {shape}",
        f"  007: check, {shape}",
        "  what would help 000 to 001, 003, 005, 007: cut",
        "  what would help 002: size",
    ]


@pytest.mark.parametrize("more", [0, 1, 7])
def test_the_first_few_are_named_and_the_others_counted(more):
    found = seen(*(line(k, "check", beside(9.0, "ab"[k % 2])) for k in range(NAMED + more)))
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
