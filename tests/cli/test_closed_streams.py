"""Commands that are started without a standard stream, or whose output nobody takes."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from commands import run, write_two_annotations

import fieldcalib
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.videos import VideoReader, VideoWriter

ROOT = Path(fieldcalib.__file__).parents[1]
RUN = "import sys; from fieldcalib.cli.main import main; raise SystemExit(main(sys.argv[1:]))"
NOT_UTF8 = "a\udcff"  # the byte 255


def in_shell(redirection, *arguments, cwd):
    """Exit code and stderr of the command line with a redirection of its streams."""
    command = ["bash", "-c", f'"$@" {redirection}', "bash", sys.executable, "-c", RUN, *map(str, arguments)]
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=100, env={"PYTHONPATH": str(ROOT)})
    return done.returncode, done.stderr


@pytest.fixture
def frames(tmp_path):
    return write_two_annotations(tmp_path / "frames")


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
@pytest.mark.parametrize(
    "redirection", ["<&- >&- 2>&-", *(pytest.param(one, marks=pytest.mark.slow) for one in ("2>&-", ">&-"))]
)
def test_closed_streams_are_no_fault(frames, tmp_path, redirection):
    out = tmp_path / "out"
    arguments = ("calibrate", frames, "--size", "960x540", "--out", out, "--jobs", 2)  # its processes inherit them
    code, error = in_shell(redirection, *arguments, cwd=tmp_path)
    assert (code, error) == (0, "")
    assert (out / "summary.json").is_file()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize("redirection", [pytest.param(">/dev/full", marks=pytest.mark.slow), "| true"])
def test_a_finished_run_is_not_to_be_resumed(frames, tmp_path, redirection):
    out = tmp_path / "out"
    _, error = in_shell(redirection, "calibrate", frames, "--size", "960x540", "--out", out, cwd=tmp_path)
    assert (out / "summary.json").is_file()
    said = {
        ">/dev/full": "standard output: no space left on device",
        "| true": "no reader any more: it closed the pipe",
    }
    assert error.splitlines()[-1].endswith(said[redirection])
    assert "--resume" not in error
    assert "Traceback" not in error


def test_a_variable_that_numpy_cannot_read_is_named(monkeypatch, capsys):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "x")
    assert run("evaluate", "a") == 2
    assert "the environment variable SOURCE_DATE_EPOCH must be a number of seconds, got 'x'" in capsys.readouterr().err


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such names")
def test_names_that_are_not_utf8_are_refused_by_name(tmp_path, capsys):
    video, bad = tmp_path / "clip.mp4", tmp_path / f"{NOT_UTF8}.mp4"
    with VideoWriter(video, 25.0) as writer:
        writer.write(np.zeros((90, 160, 3), dtype=np.uint8))
    shutil.copy(video, bad)
    for fails in (VideoReader, lambda path: VideoWriter(path, 25.0)):
        with pytest.raises(BrokenFileError, match="videos need names in UTF-8"):
            fails(bad)
    assert run("run", bad, "--out", tmp_path / "out") == 2
    assert run("run", video, "--out", tmp_path / NOT_UTF8) == 2
    assert not (tmp_path / NOT_UTF8).exists()
    assert "videos need names in UTF-8" in capsys.readouterr().err
