"""The command line as a whole: wrong usage, output folders, interrupts, and the module itself."""

import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from commands import calibrate, run

import fieldcalib
from fieldcalib._progress import progress_bar
from fieldcalib._whole_files import write_bytes
from fieldcalib.fields.traits import DISTRIBUTIONS
from fieldcalib.io.image_files import write_image
from fieldcalib.io.output_folder import output_folder

# --- wrong usage ---


def test_what_a_missing_option_takes_is_said(capsys):
    assert run("export", "results") == 2
    assert "\n  --format opencv, colmap, nerfstudio, " in capsys.readouterr().err


@pytest.mark.parametrize("size", ["960", "960x", "960x540x3", "960,540", "axb", "0x540", "960x-540", "960.0x540"])
def test_wrong_sizes(annotated_folder, tmp_path, capsys, size):
    assert run("calibrate", annotated_folder, "--size", size, "--out", tmp_path) == 2
    assert "argument --size: expected " in capsys.readouterr().err


def test_an_unknown_prior(annotated_folder, tmp_path, capsys):
    assert calibrate(tmp_path / "out", annotated_folder, options=["--prior", "main centre"]) == 2
    message = capsys.readouterr().err
    assert "main centre" in message
    for name in (*DISTRIBUTIONS, "all", "none"):
        assert name in message
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        (["run", "a.jpg", "--out", "o", "--feild-size", "known"], "--feild-size known; did you mean --field-size?"),
        (["run", "a.jpg", "--out", "o", "--feild-size=known"], "; did you mean --field-size?"),
        (["run", "a.jpg", "--ot", "o"], "required: --out; there is no --ot; did you mean --out?"),
        (["run", "a.jpg", "--out", "o", "--field-size", "estimatd"], "; did you mean estimated?"),
        (["calibrate", "a.json", "--out", "o", "--lens", "opencw"], "; did you mean opencv?"),
        (["run", "a.jpg", "--out", "o", "--field", "socer"], "got 'socer'; did you mean soccer?"),
        (["run", "a.jpg", "--out", "o", "--aspect", "squar"], "got 'squar'; did you mean square?"),
        (["calibrate", "a.json", "--out", "o", "--prior", "main centre"], "or none; did you mean main center?"),
        (["topview", "a", "--outt", "o"], "did you mean --out?"),
        (["calibrat", "a.json"], "; did you mean calibrate?"),
        (["run", "a.jpg", "--out", "o", "--size", "960x540"], "--size 960x540; pictures and videos have a size"),
        ([], "required: COMMAND, one of run, open, "),
        (["--versoin"], "there is no --versoin; did you mean --version?"),
    ],
)
def test_what_is_mistyped_is_asked_about(arguments, hint, capsys):
    assert run(*arguments) == 2
    assert hint in capsys.readouterr().err


@pytest.mark.parametrize("option", ["--zzz", "--", "-3", "--frames", "--gpu", "--verbose"])
def test_what_is_like_no_option_is_not_guessed(option, capsys):
    assert run("run", "a.jpg", "--out", "o", "--field-size", "x", option) == 2
    assert "did you mean" not in capsys.readouterr().err


SAME_FIELD = ["--field-size", "estimated", "--same-field"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--field-length", "40"], "no room for its penalty areas"),
        (["--field-width", "10"], "no room for its penalty areas"),
        (["--field-length", "long"], "argument --field-length: expected a positive number, got 'long'"),
        (["--tau", "0"], "argument --tau: expected a positive number, got '0'"),
        (["--tau", "low"], "argument --tau: expected a positive number, got 'low'"),
        (["--least-probability", "90"], "argument --least-probability: expected a number from 0 to 1, got '90'"),
        (["--lens", "mirror"], "argument --lens: invalid choice"),
        ([*SAME_FIELD, "--field-length", "85"], "90 to 120 x 45 to 90 m (law 1)"),
        (["--field-size", "unknown"], "argument --field-size: invalid choice"),
        (["--display-size", "16:9"], "argument --display-size: expected WIDTHxHEIGHT, as 960x540, got '16:9'"),
        (["--crop-of", "1920x1080"], "argument --crop-of: expected WIDTHxHEIGHT+X+Y, as 1920x1080+960+0, got '19"),
        (["--crop-of", "0x1080+0+0"], "argument --crop-of: expected WIDTHxHEIGHT+X+Y"),
        (["--crop-of", "1280x720+330+0"], "--size does not fit, with 960 x 540 pixels, into the frame of 12"),
        ([*SAME_FIELD, "--prior", "stacked"], "--prior stacked has a prior for each frame"),
        (["--same-field"], "give --field-size estimated with it"),
    ],
)
def test_wrong_options(annotated_folder, tmp_path, capsys, options, message):
    assert calibrate(tmp_path / "out", annotated_folder, options=options) == 2
    printed = capsys.readouterr()
    assert message in printed.err
    assert printed.out == ""


def test_pictures_have_no_labels_to_calibrate(tmp_path, capsys):
    (tmp_path / "a.jpg").write_bytes(b"")
    assert run("calibrate", tmp_path / "a.jpg", "--size", "960x540", "--out", tmp_path / "out") == 2
    assert "a.jpg has no labels: fieldcalib run finds cameras in pictures" in capsys.readouterr().err


def test_a_video_is_no_folder_of_cameras(tmp_path, capsys):
    (tmp_path / "a.mp4").write_bytes(b"\x00\x00\x00\x20ftypisom\n")
    assert run("export", tmp_path / "a.mp4", "--format", "csv", "--out", tmp_path / "out") == 2
    assert "expected the folder that a run wrote, or its cameras.jsonl" in capsys.readouterr().err


def test_wrong_inputs(tmp_path, capsys):
    (tmp_path / "none.zip").write_bytes(b"no zip")
    for path, message in (
        (tmp_path / "missing", "does not exist"),
        (tmp_path, "holds no annotation"),
        (tmp_path / "none.zip", "not a zip file"),
    ):
        assert calibrate(tmp_path / "out", path) == 2
        error = capsys.readouterr().err
        assert error.startswith(f"fieldcalib: {path}")
        assert message in error


def test_an_output_folder_that_cannot_be(annotated_folder, tmp_path, monkeypatch, capsys):
    """It is known before the work, not after it."""
    monkeypatch.setattr("fieldcalib.cli.calibrate.calibrate_labels", lambda *_, **__: pytest.fail("has worked"))
    (tmp_path / "file").write_text("in the way")
    file, below = tmp_path / "file", tmp_path / "file" / "below"
    for out, message in ((file, f"{file} is a file"), (below, f"{below}: not a directory")):
        assert calibrate(out, annotated_folder / "a.json") == 2
        assert capsys.readouterr().err.startswith(f"fieldcalib: {message}")
    assert (tmp_path / "file").read_text() == "in the way"


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="needs a folder that not even root can write to")
def test_an_output_folder_that_cannot_be_written_to(annotated_folder, monkeypatch, capsys):
    monkeypatch.setattr("fieldcalib.cli.calibrate.calibrate_labels", lambda *_, **__: pytest.fail("has worked"))
    assert calibrate("/proc/self", annotated_folder / "a.json") == 2
    assert "/proc/self" in capsys.readouterr().err


def test_an_output_folder_that_another_run_writes_to(annotated_folder, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("fieldcalib.cli.calibrate.calibrate_labels", lambda *_, **__: pytest.fail("has worked"))
    with output_folder(tmp_path):
        assert calibrate(tmp_path, annotated_folder / "a.json") == 2
    assert capsys.readouterr().err.startswith(f"fieldcalib: another run or page writes to {tmp_path}: wait for its end")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("arguments", [[], ["calibrate"], ["calibrate", "x"], ["demo"], ["guess"]])
def test_missing_arguments(capsys, arguments):
    assert run(*arguments) == 2
    written = capsys.readouterr().err
    assert "usage: fieldcalib" in written
    usage, error, *explained = written.splitlines()
    found = re.fullmatch(r"usage: (fieldcalib( calibrate| demo)?) \.\.\., all options: \1 --help", usage)
    assert error.startswith(f"{found[1]}: error: ")
    assert all(re.fullmatch(r"  --[a-z-]+ [A-Z]+: .+", line) for line in explained)
    assert len(explained) == error.count("--")


def test_the_folder_of_a_file_to_write_is_not_there(tmp_path, capsys):
    with pytest.raises(FileNotFoundError, match="there is no such folder"):
        write_bytes(tmp_path / "none" / "a.csv", b"")


def test_what_was_given_is_named_where_frames_are_refused(tmp_path, capsys):
    picture = tmp_path / "a.png"
    write_image(picture, np.zeros((540, 960, 3), np.uint8))
    assert run("run", str(picture), "--position", "66,0,-16", "--no-pictures", "--out", str(tmp_path / "out")) == 0
    error = capsys.readouterr().err
    assert "leave out what you gave and may be wrong: --position" in error


def test_a_wide_picture_that_is_said_to_be_shown_upright(tmp_path, capsys):
    picture = tmp_path / "a.png"
    write_image(picture, np.zeros((54, 96, 3), np.uint8))
    assert run("run", str(picture), "--display-size", "1080x1920", "--out", str(tmp_path / "out")) == 2
    assert "is wide, 96x54, and --display-size upright, 1080x1920: it is width x height" in capsys.readouterr().err


def test_help(capsys):
    assert run("calibrate", "--help") == 0
    printed = capsys.readouterr().out
    for word in ("--size", "--prior", "main center", "--tau", "0.019", "cameras.jsonl"):
        assert word in printed


# --- the other command, and the module itself ---


def test_it_runs_as_a_module():
    command = [sys.executable, "-m", "fieldcalib.cli.main", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == (f"fieldcalib {fieldcalib.__version__}\n", "")


def in_a_process(code, *arguments, **environment):
    """A fresh interpreter that runs some code, and the command line after it."""
    command = [sys.executable, "-c", f"{code}\nfrom fieldcalib.cli.main import main\nraise SystemExit(main())"]
    return subprocess.run(
        [*command, *map(str, arguments)],
        capture_output=True,
        text=True,
        encoding="latin-1",
        env=os.environ | environment,
        cwd=Path(fieldcalib.__file__).parents[1],
    )


INTERRUPTED_IMPORT = """
import os, signal, sys
class Interrupting:
    def find_spec(name, path, target=None):
        if name == {name!r}:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupting)
"""


@pytest.mark.skipif(os.name != "posix", reason="needs POSIX signals")
@pytest.mark.parametrize("name", ["numpy", "numpy.linalg", "fieldcalib.cli.calibrate"])
def test_an_interrupt_during_the_start_leaves_no_traceback(name):
    # in the background of a shell this test itself ignores interrupts
    code = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)" + INTERRUPTED_IMPORT.format(
        name=name
    )
    done = in_a_process(code, "calibrate", "--help")
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGINT, "", "")


@pytest.mark.skipif(os.name != "posix", reason="needs POSIX signals")
@pytest.mark.parametrize("name", ["numpy", "onnxruntime", "cv2"])
def test_so_does_a_request_to_end(annotated_folder, tmp_path, name):
    (tmp_path / "a.png").write_bytes(cv2.imencode(".png", np.zeros((54, 96, 3), np.uint8))[1].tobytes())
    code = INTERRUPTED_IMPORT.format(name=name).replace("SIGINT", "SIGTERM")
    done = in_a_process(code, "run", tmp_path / "a.png", "--out", tmp_path / "out")
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGTERM, "", "")
    assert not (tmp_path / "out").exists()


REQUESTED = """
import os, signal, fieldcalib.run_folder.work_units as units
def work(*arguments):
    os.kill(os.getpid(), signal.SIGTERM)
units.work = work
"""


@pytest.mark.skipif(os.name != "posix", reason="needs POSIX signals")
def test_a_request_to_end_tidies_up(annotated_folder, tmp_path):
    done = in_a_process(REQUESTED, "calibrate", annotated_folder / "a.json", "--size", "960x540", "--out", tmp_path)
    ends = "fieldcalib: no frame was done: run it again\nfieldcalib: terminated, nothing more is written\n"
    assert (done.returncode, done.stderr) == (143, ends)
    assert list(tmp_path.iterdir()) == []


LATE = """
import atexit, os, signal
signal.signal(signal.SIGINT, signal.default_int_handler)
atexit.register(lambda: os.kill(os.getpid(), signal.{signal}))
"""


@pytest.mark.skipif(os.name != "posix", reason="needs POSIX signals")
@pytest.mark.parametrize("number", ["SIGINT", pytest.param("SIGTERM", marks=pytest.mark.slow)])
def test_an_interrupt_after_the_work_changes_nothing(annotated_folder, tmp_path, number):
    code, out = LATE.format(signal=number), tmp_path / "out"
    done = in_a_process(code, "calibrate", annotated_folder / "a.json", "--size", "960x540", "--out", out)
    assert (done.returncode, done.stderr) == (0, "")
    assert (out / "summary.json").is_file()


INTERRUPTED_FINALIZER = """
import os, signal, time, fieldcalib.run_folder.work_units as units
signal.signal(signal.SIGINT, signal.default_int_handler)
class Interrupting:
    def __del__(self):
        os.kill(os.getpid(), signal.{signal})
def work(*arguments):
    Interrupting()
    for _ in range(1000):
        time.sleep(0.01)
units.work = work
"""


@pytest.mark.skipif(os.name != "posix", reason="needs POSIX signals")
@pytest.mark.parametrize(("number", "code", "word"), [("SIGINT", 130, "interrupted"), ("SIGTERM", 143, "terminated")])
def test_an_interrupt_of_a_finalizer_is_not_lost(annotated_folder, tmp_path, number, code, word):
    """Python prints what a finalizer raises, and goes on."""
    program = INTERRUPTED_FINALIZER.format(signal=number)
    done = in_a_process(program, "calibrate", annotated_folder / "a.json", "--size", "960x540", "--out", tmp_path)
    ends = f"fieldcalib: no frame was done: run it again\nfieldcalib: {word}, nothing more is written\n"
    assert (done.returncode, done.stderr) == (code, ends)


@pytest.mark.skipif(os.name != "posix", reason="needs POSIX signals")
def test_what_is_warned_of_is_told_without_the_line_of_code(calibrated_folder, tmp_path):
    """As of results that are cut off."""
    shutil.copytree(calibrated_folder, tmp_path / "cut")
    lines = (tmp_path / "cut" / "cameras.jsonl").read_text()
    (tmp_path / "cut" / "cameras.jsonl").write_text(lines[: 9 * len(lines) // 10])
    done = in_a_process("", "export", tmp_path / "cut", "--format", "homography")
    (told,) = [line for line in done.stderr.splitlines() if "incomplete" in line]
    assert told.startswith(f"fieldcalib: {tmp_path / 'cut' / 'cameras.jsonl'}: its last line is incomplete")
    assert ".py" not in done.stderr


def test_an_interrupt_that_is_ignored_stays_so():
    """As for a job in the background of a shell."""
    code = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)" + INTERRUPTED_IMPORT.format(name="numpy")
    done = in_a_process(code, "calibrate", "--help")
    assert (done.returncode, done.stderr) == (0, "")


def test_a_terminal_without_unicode(annotated_folder, tmp_path):
    options = ("--size", "960x540", "--field-size", "estimated", "--same-field", "--out", tmp_path / "out")
    done = in_a_process("", "calibrate", annotated_folder / "a.json", *options, PYTHONIOENCODING="ascii")
    assert done.returncode == 0
    assert done.stderr.isascii()
    assert r" \xb1 " in done.stdout  # ±


def test_no_memory_left_is_one_line(annotated_folder, tmp_path, monkeypatch, capsys):
    def exhausted(*arguments, **options):
        raise MemoryError

    monkeypatch.setattr("fieldcalib.cli.calibrate.calibrate_labels", exhausted)
    assert calibrate(tmp_path, annotated_folder / "a.json") == 2
    assert capsys.readouterr().err == "fieldcalib: there is not enough memory\n"
    assert list(tmp_path.iterdir()) == []


def test_no_memory_for_a_library_is_said(annotated_folder, tmp_path, monkeypatch, capsys):
    """Where memory is limited, as by ulimit -v, there is no room for libraries; llvmlite hides it in a cause."""

    def unloaded(*arguments, **options):
        try:
            raise OSError("libllvmlite.so: failed to map segment from shared object")
        except OSError as error:
            raise OSError("Could not find/load shared object file") from error

    monkeypatch.setattr("fieldcalib.cli.calibrate.calibrate_labels", unloaded)
    assert calibrate(tmp_path, annotated_folder / "a.json") == 2
    assert capsys.readouterr().err.startswith("fieldcalib: there is not enough memory: libllvmlite.so: failed")


@pytest.mark.parametrize("command", ["calibrate", "run", "localize"])
def test_an_unset_variable_is_no_input(command, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run(command, "", *(["--size", "960x540"] if command == "calibrate" else []), "--out", "out") == 2
    assert "expected a path, got nothing; . is this folder" in capsys.readouterr().err
    with pytest.raises(ValueError, match="the path is empty"):
        fieldcalib.calibrate("")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", ["calibrate", "run", "localize", "join", "demo"])
def test_an_unset_variable_is_no_folder(command, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    inputs = [] if command == "demo" else ["in"]
    assert run(command, *inputs, *(["--size", "960x540"] if command == "calibrate" else []), "--out", "") == 2
    assert "expected the name of a folder, got nothing" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_bar_whose_making_is_interrupted_is_closed_without_a_word(monkeypatch):
    """The interpreter closes it, whatever it has and has not."""
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    with progress_bar(unit="frame") as made:
        pass
    half = type(made).__new__(type(made))
    half.__del__()
