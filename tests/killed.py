"""Runs of the command line that are ended at a random line of their results, and resumed."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

from waiting import wait_until

import fieldcalib

SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
LONGEST = 300.0  # seconds of a run, on the busiest machine
EXIT_CODES = {signal.SIGKILL: {-9}, signal.SIGTERM: {143, -15}, signal.SIGINT: {130, -2}}
# The command line, which says that it has begun only where an interrupt no longer ends in a traceback.
PROGRAM = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
from fieldcalib.cli.main import main
from fieldcalib.console.program import exit_code
def begun():
    print("begun", flush=True)
    return main()
raise SystemExit(exit_code(begun))
"""


def started(*arguments):
    """A process of the command line; in the background of a shell interrupts are ignored, here they are not."""
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(Path(fieldcalib.__file__).parents[1]), "PYTHONFAULTHANDLER": "1"},
        start_new_session=True,
    )


def ended(run):
    """Exit code and stderr of a run; one that hangs fails the test, with the stacks of all its processes."""
    try:
        _, errors = run.communicate(timeout=LONGEST)
    except subprocess.TimeoutExpired:
        os.killpg(run.pid, signal.SIGABRT)
        raise AssertionError(f"it hangs: {run.communicate()[1]}") from None
    return run.returncode, errors


def finished(*arguments):
    """Exit code and stderr of the command line."""
    return ended(started(*arguments))


def lines_written(out):
    """Lines of results in a folder, which need not exist."""
    path = out / "cameras.jsonl"
    return path.read_bytes().count(b"\n") if path.exists() else 0


def killed(arguments, out, rng, count):
    """End a run that has begun, at a random one of the `count` lines that it writes into a folder."""
    number = SIGNALS[int(rng.integers(len(SIGNALS)))]
    before = lines_written(out)
    line = int(rng.integers(before, max(count, before + 1)))
    run = started(*arguments)
    assert run.stdout.readline() == "begun\n"
    written = (out / "run.json").exists
    wait_until(lambda: run.poll() is not None or (written() and lines_written(out) >= line), LONGEST)
    run.send_signal(number)
    code, errors = ended(run)
    assert code in EXIT_CODES[number] | {0, 1}, (number, errors)
    assert "Traceback" not in errors, errors


def content_of(folder):
    """What lies in a folder, but for the times in its summary."""
    found = {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    summary = json.loads(found.pop("summary.json"))
    for name in ("seconds", "milliseconds_per_frame"):
        summary.pop(name, None)
    return found, summary


def check_that_kills_change_nothing(command, whole, out, rng, kills=2, code=0):
    """A run that is killed and resumed until it is done gives what it gives at once."""
    count = lines_written(whole)
    for again in range(kills):
        options = ["--resume"] if again or rng.random() < 0.5 else []
        killed([*command, "--out", out, *options], out, rng, count)
        if not options and (out / "run.json").exists():
            refused, errors = finished(*command, "--out", out)
            assert refused == 2, errors
            assert "--resume goes on with it, --overwrite begins anew" in errors
    came, errors = finished(*command, "--out", out, "--resume")
    assert came == code, errors
    assert content_of(out) == content_of(whole)


def ends_on_dies(options):
    """A run that ends its process where the input says so."""
    if options.input[0].stem == "dies":
        os._exit(9)
    print(f"{options.input[0]} done")
    return 0
