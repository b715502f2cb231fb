"""Advice on cameras: in words of no tool, and how each tool follows it."""

import argparse
import re
from pathlib import Path

import numpy as np
import pytest
from networks import Blind

from fieldcalib import calibrate, soccer
from fieldcalib.assess import advice
from fieldcalib.assess.advice import (
    CAUSE_REMEDIES,
    HOW,
    NOT_SOCCER,
    NOTHING,
    OF_LABELS,
    OTHER_SPORT,
    REMEDIES,
    Advice,
    Remedy,
    Tool,
    how,
)
from fieldcalib.assess.estimate import in_words
from fieldcalib.assess.findings import CUT, SENTENCES, SHAPE, UNUSUAL, Finding, Status, What
from fieldcalib.assess.result import Calibration
from fieldcalib.cli.run import add_arguments
from fieldcalib.images.clip.from_video import calibrate_video
from fieldcalib.images.from_images import calibrate_from_images
from fieldcalib.run_folder.record import ToLookAt

SIZES = [in_words(np.diag(one), np.array([2.5, 2.8])) for one in ([0.5, 0.5], [0.5, 0.0], [0.0, -0.5])]
ALL = [one for one in vars(advice).values() if isinstance(one, Remedy) and one != NOTHING]
ALL += [*REMEDIES.values(), *OF_LABELS.values(), *CAUSE_REMEDIES.values()]
REASONS = [str(one) for one in (CUT, SHAPE, Finding(What.TOO_FEW_LABELS, "segment", (2, 4, 7)))]


@pytest.mark.parametrize("remedy", [*(one.text for one in ALL), *SIZES, *REASONS])
def test_a_remedy_names_no_tool_and_none_of_another_frame(remedy):
    assert "--" not in remedy
    assert "clip" not in remedy
    assert "flag" not in remedy


@pytest.mark.parametrize("tool", Tool)
def test_each_tool_says_how(tool):
    said = {remedy: how(remedy.advice, tool) for remedy in ALL}
    assert all(said[remedy] for remedy in ALL if remedy.advice)
    for one in Advice:
        assert any(one in remedy.advice for remedy in ALL)
        assert HOW[one][tool]
    assert ("--" in how([Advice.FIELD_SIZE], tool)) == (tool is Tool.COMMAND)


def test_an_option_that_was_given_is_not_advised():
    every = {*how(Advice, Tool.COMMAND).split("; ")}
    assert every - {*how(Advice, Tool.COMMAND, ["show_paint", "crown"]).split("; ")} == {
        HOW[one][Tool.COMMAND] for one in (Advice.LOOK, Advice.GROUND)
    }
    assert how([Advice.PICTURE, Advice.PART], Tool.COMMAND, ["crop_of"]) == ""
    seen = ToLookAt()
    remedy = {"remedy": "more", "advice": [str(Advice.LOOK)]}
    seen.add({"id": "a", "status": "accepted", "verdict": "check", "reason": "why", **remedy})
    assert ["run --show-paint" in seen.message("here", given=given) for given in ((), ["show_paint"])] == [True, False]


def test_the_command_line_has_the_options_that_are_named():
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    options = {name for action in parser._actions for name in action.option_strings}
    named = {
        word.strip(",;()") for said in HOW.values() for word in said[Tool.COMMAND].split() if word.startswith("--")
    }
    assert named <= options


PROJECT = Path(__file__).parents[2]
REFUSED = (PROJECT / "docs" / "refused.md").read_text(encoding="utf-8")
PHRASES = [
    phrase
    for row in REFUSED.splitlines()
    if row.startswith('| "')
    for phrase in re.findall(r'"([^"]+)"', row.split("|")[1])
]
OF_NO_PICTURE = {What.SAID, What.EXPLAINED, What.SEARCHED, What.RECOGNISED, What.TO_SEARCH, What.MOVED}
OF_NO_PICTURE |= {What.FRAMES_BESIDE_CLIP, What.CUTS_BESIDE_CLIP}  # said of a run, not of a camera


def test_the_docs_say_where_they_are():
    assert "`fieldcalib.assess.how(calibration.advice)`" in REFUSED


@pytest.mark.parametrize("what", [what for what in What if what not in OF_NO_PICTURE])
def test_the_docs_have_words_of_every_reason(what):
    sentences = SENTENCES.get(what) or {
        What.UNUSUAL: " ".join(UNUSUAL.values()),
        What.CONTRADICTED: str(Finding(What.CONTRADICTED, "cx", (3.0,))),
        What.INACCURATE: str(Finding(What.INACCURATE, numbers=(1.0,))),
        What.TOO_FEW_LABELS: str(Finding(What.TOO_FEW_LABELS, "point", (3, 6, 7))),
    }.get(what, "")
    assert any(phrase in sentences for phrase in PHRASES)


def test_the_docs_have_no_words_that_no_reason_has():
    files = [*(PROJECT / "fieldcalib").rglob("*.py"), PROJECT / "fieldcalib/assess/sentences.json"]
    code = "".join(path.read_text(encoding="utf-8") for path in files)
    code = re.sub(r'"\n\s*f?"', "", code)  # of sentences that go on in the next line
    assert [phrase for phrase in PHRASES if phrase not in code] == []


def test_a_picture_in_which_next_to_nothing_is_seen_may_be_of_another_sport():
    noise = np.random.default_rng(0).integers(0, 255, (270, 480, 3), np.uint8)
    (found,) = calibrate_from_images(soccer(), [noise], Blind())
    assert found.reason.endswith("; is this soccer?")
    assert found.remedy.endswith(NOT_SOCCER.text)
    assert "--field NAME (--help has the names), or auto" in how(found.advice, Tool.COMMAND)


def test_a_court_that_was_searched_in_vain_may_be_another_one():
    found = Calibration.without_camera(Status.IMPROBABLE, "right with a probability of 0.00", Finding(What.SEARCHED))
    assert found.remedy.endswith(OTHER_SPORT.text)
    assert "--field NAME (--help has the names), or auto" in how(found.advice, Tool.COMMAND)
    assert "leave out what you gave" in found.remedy  # a wrong position is never told from a wrong picture


def test_a_clip_without_any_camera_may_be_of_another_sport():
    noise = np.random.default_rng(0).integers(0, 255, (2, 270, 480, 3), np.uint8)
    found = calibrate_video(soccer(), list(noise), Blind())
    assert found.notes == (f"no frame has a camera that can be used: is this soccer? {NOT_SOCCER.text.capitalize()}",)


def test_a_clip_of_tiny_frames_is_said_to_be_too_small():
    noise = np.random.default_rng(0).integers(0, 255, (2, 90, 160, 3), np.uint8)
    found = calibrate_video(soccer(), list(noise), Blind())
    (note,) = found.notes
    assert note.startswith("no frame has a camera that can be used: too small: 160 x 90 pixels")
    assert "soccer" not in note


def test_a_small_picture_without_a_camera_is_said_to_be_too_small():
    noise = np.random.default_rng(0).integers(0, 255, (90, 160, 3), np.uint8)
    (found,) = calibrate_from_images(soccer(), [noise], Blind())
    assert found.reason.startswith("too small: 160 x 90 pixels")
    assert "soccer?" not in found.reason


def test_one_label_is_and_several_are():
    assert str(Finding(What.SUSPECTS, numbers=(1.0, 11.0))) == "1 of 11 labels is suspect"
    assert str(Finding(What.SUSPECTS, numbers=(2.0, 11.0))) == "2 of 11 labels are suspect"
    assert str(Finding(What.MISSED, numbers=(1.0, 11.0))) == "1 of 11 labels lies far off"


@pytest.mark.parametrize("size", [(2, 3), (31, 480), (270, 31)])
def test_a_picture_that_is_too_small_says_so(size):
    results = calibrate(np.zeros((*size, 3), np.uint8), progress=False)
    found = results["000000"]
    height, width = size
    assert found.camera is None
    assert found.verdict == "reject"
    assert found.reason.startswith(f"too small: the picture has only {width} x {height} pixels")


@pytest.mark.parametrize("level", [0, 90, 255])
def test_a_picture_of_one_colour_has_no_camera(level):
    found = calibrate(np.full((270, 480, 3), level, np.uint8), progress=False)["000000"]
    assert (found.camera, found.verdict) == (None, "reject")
    assert found.reason.startswith("the picture shows nothing")
    assert not found.suspect_labels
