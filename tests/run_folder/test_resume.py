"""Runs that end before their time: what is left of them, and how they go on."""

import errno
import json
import os
import shutil
import time
from functools import partial

import numpy as np
import pytest
from commands import calibrate, cameras_in, lines_of, run
from killed import check_that_kills_change_nothing, content_of
from synthetic import random_frames

from fieldcalib import _progress as waiting
from fieldcalib import read
from fieldcalib._whole_files import write_bytes
from fieldcalib.io.files import FrameFile
from fieldcalib.io.output_folder import LineLog
from fieldcalib.io.soccernet import format_annotation
from fieldcalib.run_folder import results as results_of_commands
from fieldcalib.run_folder import work_units
from fieldcalib.run_folder.record import Outcome, RunOptions, RunRecord
from fieldcalib.run_folder.results import ResultsWriter
from fieldcalib.run_folder.work_units import UnitResult, work

SIZE = (960, 540)


@pytest.fixture(scope="module")
def many(tmp_path_factory):
    """Frames for three units, one of them broken."""
    folder = tmp_path_factory.mktemp("many")
    frames, _ = random_frames(12, seed=5, noise=0.5)
    for number in range(150):
        (folder / f"{number:04d}.json").write_text(format_annotation(frames[number % 12], SIZE))
    return folder


@pytest.fixture(scope="module")
def whole(many, tmp_path_factory):
    """The output of an uninterrupted run."""
    out = tmp_path_factory.mktemp("whole") / "out"
    assert calibrate(out, many) == 0
    return out


def command(folder, *options):
    return ["calibrate", folder, "--size", "960x540", "--camera-files", *options]


@pytest.mark.slow
@pytest.mark.parametrize(("jobs", "seed"), [*((2, seed) for seed in range(100, 104)), (1, 106)])
def test_kills_change_nothing(many, whole, tmp_path, jobs, seed):
    rng = np.random.default_rng(seed)
    check_that_kills_change_nothing(command(many, "--jobs", jobs), whole, tmp_path / "out", rng, kills=3)


# --- any number of jobs ---


@pytest.mark.slow
def test_the_files_are_the_same_with_any_number_of_jobs(many, whole, tmp_path):
    assert calibrate(tmp_path / "out", many, options=["--jobs", 3]) == 0
    assert content_of(tmp_path / "out") == content_of(whole)


@pytest.mark.parametrize("jobs", ["0", "-1", "x", "1.5"])
def test_wrong_numbers_of_jobs(many, tmp_path, capsys, jobs):
    assert calibrate(tmp_path / "out", many, options=["--jobs", jobs]) == 2
    assert f"argument --jobs: expected a whole number from 1, got '{jobs}'" in capsys.readouterr().err


# --- an end at a known place ---


def with_small_units(patch):
    """Units of two frames."""
    patch.setattr(work_units, "SMALLEST_UNIT", 1)
    patch.setattr(work_units, "LARGEST_UNIT", 2)


@pytest.fixture
def small_units(monkeypatch):
    with_small_units(monkeypatch)


@pytest.fixture(scope="module")
def whole_in_small_units(annotated_folder, tmp_path_factory):
    """The output of a run that nothing ended."""
    out = tmp_path_factory.mktemp("small_units") / "out"
    with pytest.MonkeyPatch.context() as patch:
        with_small_units(patch)
        assert calibrate(out, annotated_folder) == 0
    return out


class Ending:
    """Lets the log fail at the n-th line."""

    def __init__(self, count, error):
        self.left, self.error, self.append = count, error, LineLog.append

    def __call__(self, log, line):
        if not self.left:
            raise self.error
        self.left -= 1
        self.append(log, line)


NO_SPACE = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize(("error", "code"), [(NO_SPACE, 2), (KeyboardInterrupt(), 130), (MemoryError(), 2)])
@pytest.mark.parametrize(
    ("count", "torn"), [(1, 0), (3, 1), *(pytest.param(*case, marks=pytest.mark.slow) for case in ((2, 1), (3, 0)))]
)
def test_what_was_done_is_not_lost(
    annotated_folder, small_units, whole_in_small_units, tmp_path, monkeypatch, capsys, error, code, count, torn
):
    """Each frame has two lines: the run ends before the first of a frame, or between both."""
    out = tmp_path / "out"
    ending = Ending(2 * count + torn, error)
    with monkeypatch.context() as patch:
        patch.setattr(LineLog, "append", lambda log, line: ending(log, line))
        assert calibrate(out, annotated_folder) == code
    assert f"{count} frame{'s' * (count > 1)} done in {out}: --resume goes on with it" in capsys.readouterr().err
    assert [line["id"] for line in lines_of(out)] == list("abcd")[:count]
    assert set(cameras_in(out)) == set("abcd"[:count])
    assert len(read(out)) == count
    assert not (out / "summary.json").exists()
    assert calibrate(out, annotated_folder, options=["--resume"]) == 0
    assert content_of(out) == content_of(whole_in_small_units)


def test_a_camera_that_has_no_room_is_written_later(annotated_folder, calibrated_folder, tmp_path, monkeypatch):
    """Its line is there already."""
    out = tmp_path / "out"
    with monkeypatch.context() as patch:

        def write(path, content):
            if path.name == "camera_c.json":
                raise NO_SPACE
            write_bytes(path, content)

        patch.setattr(results_of_commands, "write_bytes", write)
        assert calibrate(out, annotated_folder) == 2
    assert [line["id"] for line in lines_of(out)] == list("abc")
    assert set(cameras_in(out)) == {"a", "b"}
    assert calibrate(out, annotated_folder, options=["--resume"]) == 0
    assert content_of(out) == content_of(calibrated_folder)


def test_a_line_that_cannot_be_read_removes_nothing(annotated_folder, tmp_path, capsys):
    assert calibrate(tmp_path, annotated_folder) == 0
    lines = (tmp_path / "cameras.jsonl").read_text().splitlines()
    (tmp_path / "cameras.jsonl").write_text("\n".join(["no JSON", *lines[1:]]) + "\n")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert calibrate(tmp_path, annotated_folder, options=["--resume"]) == 2
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_run_that_did_nothing_leaves_nothing(annotated_folder, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(LineLog, "append", lambda log, line: Ending(0, NO_SPACE)(log, line))
    assert calibrate(tmp_path / "out", annotated_folder) == 2
    assert capsys.readouterr().err.splitlines()[-1] == "fieldcalib: no space left on device"
    assert not (tmp_path / "out").exists()


def test_what_a_kill_leaves_is_repaired(annotated_folder, calibrated_folder, tmp_path):
    """A torn line, a camera that is missing, temporary files."""
    out = tmp_path / "out"
    shutil.copytree(calibrated_folder, out)
    (out / "summary.json").unlink()
    lines = (out / "cameras.jsonl").read_bytes().splitlines(keepends=True)
    (out / "cameras.jsonl").write_bytes(b"".join(lines[:2]) + lines[2][:1000])
    (out / "camera_b.json").unlink()  # of the last whole line
    (out / ".unfinished-x.json").write_text("half")
    with pytest.warns(UserWarning, match="its last line is incomplete"):
        assert len(read(out)) == 2
    assert calibrate(out, annotated_folder, options=["--resume"]) == 0
    assert content_of(out) == content_of(calibrated_folder)


def test_a_run_that_is_not_finished_is_evaluated_and_said_to_be(annotated_folder, tmp_path, capsys):
    for finished_run in (True, False):
        out = tmp_path / str(finished_run)
        assert calibrate(out, annotated_folder) == 0
        if not finished_run:
            (out / "summary.json").unlink()
            with (out / "cameras.jsonl").open("a") as log:
                log.write('{"id": "torn')
        capsys.readouterr()
        assert run("evaluate", out, annotated_folder) == 0
        assert ("is not finished" in capsys.readouterr().err) is not finished_run


# --- used folders ---


def test_a_used_folder_is_refused(annotated_folder, tmp_path, capsys):
    out = tmp_path / "out"
    assert calibrate(out, annotated_folder / "a.json") == 0
    before = content_of(out)
    assert calibrate(out, annotated_folder) == 2
    message = f"fieldcalib: {out} holds the results of a run: --resume goes on with it, --overwrite begins anew\n"
    assert capsys.readouterr().err.endswith(message)
    assert content_of(out) == before


def test_results_of_earlier_versions_are_refused(annotated_folder, tmp_path, capsys):
    (tmp_path / "camera_x.json").write_text("{}")
    for options in ([], ["--resume"]):
        assert calibrate(tmp_path, annotated_folder, options=options) == 2
        assert "holds results of an earlier version or of others: --overwrite replaces them" in capsys.readouterr().err
    assert calibrate(tmp_path, annotated_folder, options=["--overwrite"]) == 0
    assert set(cameras_in(tmp_path)) == set("abcd")


def test_overwriting_removes_what_a_run_has_written_and_nothing_else(annotated_folder, tmp_path):
    out = tmp_path / "out"
    assert calibrate(out, annotated_folder) == 0
    for name in ("notes.txt", "a.json", "camera_a.txt", ".hidden"):
        (out / name).write_text("mine")
    (out / ".unfinished-1.json").write_text("half")
    assert calibrate(out, annotated_folder / "a.json", options=["--overwrite"]) == 0
    assert {path.name for path in out.iterdir()} == {
        *("notes.txt", "a.json", "camera_a.txt", ".hidden"),
        *("camera_a.json", "cameras.jsonl", "solver.jsonl", "run.json", "summary.json"),
    }


def test_a_log_that_names_other_files_removes_none(annotated_folder, tmp_path):
    out = tmp_path / "out"
    assert calibrate(out, annotated_folder) == 0
    (tmp_path / "camera_precious.json").write_text("mine")
    with (out / "cameras.jsonl").open("a") as log:
        log.write(json.dumps({"id": "x/../../camera_precious", "status": "accepted", "message": ""}) + "\n")
    record = json.loads((out / "run.json").read_text()) | {"writes": ["<id>.json"]}
    (out / "run.json").write_text(json.dumps(record))
    assert calibrate(out, annotated_folder, options=["--overwrite"]) == 0
    assert (tmp_path / "camera_precious.json").exists()


def test_resuming_a_folder_that_is_new_begins(annotated_folder, calibrated_folder, tmp_path):
    assert calibrate(tmp_path / "out", annotated_folder, options=["--resume"]) == 0
    assert content_of(tmp_path / "out") == content_of(calibrated_folder)


def test_resuming_a_finished_run_changes_nothing(annotated_folder, tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    assert calibrate(out, annotated_folder) == 0
    printed = capsys.readouterr().out
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    monkeypatch.setattr("fieldcalib.cli.calibrate.calibrate_labels", lambda *_, **__: pytest.fail("has worked"))
    assert calibrate(out, annotated_folder, options=["--resume"]) == 0
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
    assert capsys.readouterr().out == printed


def test_resume_and_overwrite_exclude_each_other(annotated_folder, tmp_path, capsys):
    assert calibrate(tmp_path / "out", annotated_folder, options=["--resume", "--overwrite"]) == 2
    assert "not allowed with argument" in capsys.readouterr().err


# --- another run ---


def touch(folder):
    content = (folder / "a.json").read_text()
    (folder / "a.json").write_text(content + " ")


CHANGES = {
    "options": ([], ["--tau", "0.5"], lambda folder: None, "--tau was None, is 0.5"),
    "field": (["--field-size", "known"], [], lambda folder: None, "--field-size was 'known', is 'nominal'"),
    "content": ([], [], touch, "the files of the input have other sizes or times"),
    "less": ([], [], lambda folder: (folder / "a.json").unlink(), "other frames: there were 4, there are 3"),
    "names": (
        [],
        [],
        lambda folder: (folder / "a.json").rename(folder / "z.json"),
        "the input has other frames: 4 as before, but of other names",
    ),
}


@pytest.mark.parametrize(("first", "then", "change", "message"), CHANGES.values(), ids=CHANGES)
def test_another_run_is_not_resumed(annotated_folder, tmp_path, capsys, first, then, change, message):
    folder, out = tmp_path / "in", tmp_path / "out"
    folder.mkdir()
    for path in annotated_folder.glob("?.json"):
        (folder / path.name).write_bytes(path.read_bytes())
    assert calibrate(out, folder, options=first) == 0
    (out / "summary.json").unlink()
    before = (out / "cameras.jsonl").read_bytes()
    change(folder)
    assert calibrate(out, folder, options=[*then, "--resume"]) == 2
    error = capsys.readouterr().err
    assert f"the run in {out} cannot be resumed: " in error
    assert message in error
    assert (out / "cameras.jsonl").read_bytes() == before


def test_another_command_or_version_is_not_resumed(annotated_folder, tmp_path, capsys):
    from baselines import dlt_lines

    assert calibrate(tmp_path, annotated_folder) == 0
    arguments = [str(annotated_folder), "--size", "960x540", "--out", str(tmp_path), "--resume"]
    assert dlt_lines.main(arguments) == 2
    assert "it is of calibrate, not of baselines.dlt_lines" in capsys.readouterr().err
    record = json.loads((tmp_path / "run.json").read_text()) | {"version": "0.0.1"}
    (tmp_path / "run.json").write_text(json.dumps(record))
    assert calibrate(tmp_path, annotated_folder, options=["--resume"]) == 2
    assert "it is of version 0.0.1, this is " in capsys.readouterr().err
    (tmp_path / "run.json").write_text("{}")
    assert calibrate(tmp_path, annotated_folder, options=["--resume"]) == 2
    assert f"{tmp_path / 'run.json'}: is no record of a run" in capsys.readouterr().err
    assert calibrate(tmp_path, annotated_folder, options=["--overwrite"]) == 0


def test_a_frame_that_vanishes_meanwhile_is_broken(annotated_folder, small_units, tmp_path, monkeypatch):
    folder = tmp_path / "in"
    folder.mkdir()
    for path in annotated_folder.glob("?.json"):
        (folder / path.name).write_bytes(path.read_bytes())
    add = results_of_commands.ResultsWriter.add

    def removing(results, outcome):
        (folder / "d.json").unlink(missing_ok=True)
        add(results, outcome)

    monkeypatch.setattr(results_of_commands.ResultsWriter, "add", removing)
    assert run("calibrate", folder, "--size", "960x540", "--out", tmp_path / "out") == 1
    assert [line["status"] for line in lines_of(tmp_path / "out")] == ["accepted"] * 3 + ["broken file"]


# --- processes that end ---


def ends_on_seven(unit):
    """Results of numbers; seven ends the process."""
    if any(item.id == "7" for item in unit):
        os._exit(9)
    return UnitResult([Outcome({"id": item.id, "status": "done"}) for item in unit])


def ends_once(path, unit):
    """The same, but the first time only."""
    if any(item.id == "7" for item in unit) and not path.exists():
        path.write_text("")
        os._exit(9)
    return UnitResult([Outcome({"id": item.id, "status": "done"}) for item in unit])


def worked(tmp_path, function):
    """What `work` writes of twelve numbers."""
    items = [FrameFile(str(number), f"file {number}") for number in range(12)]
    with LineLog(tmp_path / "log") as log:
        options = RunOptions(tmp_path, {}, jobs=2)
        results = ResultsWriter(tmp_path, RunRecord.of(options, [], unit=4), log)
        work(options, results, items, 4, function, 12)
    return results, [json.loads(line) for line in (tmp_path / "log").read_text().splitlines()]


@pytest.mark.slow
def test_only_the_frame_that_ends_its_process_is_lost(tmp_path, capsys):
    results, lines = worked(tmp_path, ends_on_seven)
    assert [line["id"] for line in lines] == [str(number) for number in range(12)]
    assert {line["id"] for line in lines if line["status"] == "broken file"} == {"7"}
    problem = "the process that worked on it ended with exit code 9"
    assert lines[7]["message"] == problem
    assert capsys.readouterr().err == f"fieldcalib: file 7: {problem}\n"
    assert results.exit_code == 1


def test_a_process_that_ends_once_loses_nothing(tmp_path):
    results, lines = worked(tmp_path, partial(ends_once, tmp_path / "ended"))
    assert (tmp_path / "ended").exists()
    assert [line["status"] for line in lines] == ["done"] * 12
    assert results.exit_code == 0


# --- reads that do not come back ---


def test_what_is_waited_for_is_said(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(waiting, "FIRST", 0.2)
    with waiting.waiting_for(tmp_path / "a.json"):
        time.sleep(2.5)
    with waiting.waiting_for(tmp_path / "b.json"):
        pass
    time.sleep(0.3)
    said = capsys.readouterr().err.splitlines()
    assert 2 <= len(said) <= 4  # after 0.2, 0.4, 0.8 and 1.6 s, or later if the watcher is asleep
    for line in said:
        assert line.startswith(f"fieldcalib: {tmp_path / 'a.json'}: waiting for it for ")
