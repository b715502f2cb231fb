"""Functions in another process: what they return and raise, and how the process ends."""

import gc
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fieldcalib.processes.other_process import LENGTH, OtherProcess


@pytest.fixture
def other():
    process = OtherProcess()
    yield process
    process.close()


def has_ended(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return False


def test_what_is_returned_and_raised(other):
    image = np.arange(300_000, dtype=np.uint8).reshape(-1, 100, 3)  # more than a pipe holds
    assert other.run(os.getpid) != os.getpid()
    np.testing.assert_array_equal(other.run(np.flip, image, axis=0), image[::-1])
    with pytest.raises(ValueError, match="invalid literal") as raised:
        other.run(int, "three")
    assert "in another process" in raised.value.__notes__[0]
    assert other.run(abs, -1) == 1  # and it goes on


def test_what_it_prints_is_no_answer(other):
    assert other.run(print, "noise") is None
    assert other.run(abs, -1) == 1


def test_it_ends_when_it_is_closed_and_says_so(other):
    pid = other.run(os.getpid)
    other.close()
    other.close()
    assert has_ended(pid)
    with pytest.raises(RuntimeError, match="has ended"):
        other.run(os.getpid)


def test_it_ends_with_its_object():
    other = OtherProcess()
    pid = other.run(os.getpid)
    del other
    gc.collect()
    assert has_ended(pid)


def test_what_is_of_the_script_is_not_known_there(other, monkeypatch):
    class OfTheScript:
        __module__, __qualname__ = "__main__", "OfTheScript"

    monkeypatch.setattr(sys.modules["__main__"], "OfTheScript", OfTheScript, raising=False)
    with pytest.raises(ValueError, match=r"OfTheScript.*must be those of modules, not of the script"):
        other.run(repr, OfTheScript())


def test_a_process_that_dies_is_an_error(other):
    with pytest.raises(RuntimeError, match="has ended, with exit code 3"):
        other.run(os._exit, 3)


def cut_off():
    """Ends the process in the middle of an answer."""
    os.write(1, b"not here")  # where its answers go is the highest descriptor
    answers = max(int(name) for name in os.listdir("/proc/self/fd") if os.path.exists(f"/proc/self/fd/{name}"))
    os.write(answers, LENGTH.pack(1000) + b"half")
    os._exit(4)


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="finds the pipe as Linux has it")
def test_half_an_answer_is_none(other):
    with pytest.raises(RuntimeError, match="has ended, with exit code 4"):
        other.run(cut_off)


class NotToBePickled:
    def __reduce__(self):
        raise ValueError("cannot be pickled")


def test_what_cannot_be_sent_is_said_and_it_goes_on(other):
    with pytest.raises(ValueError, match="cannot be pickled"):
        other.run(repr, NotToBePickled())
    with pytest.raises(ValueError, match="cannot be pickled"):
        other.run(NotToBePickled)  # it cannot be sent back either
    assert other.run(abs, -1) == 1


def test_it_ends_with_a_script_that_does_not_close_it(tmp_path):
    """Such a script needs no guard, and is not run again."""
    script = tmp_path / "script.py"
    script.write_text(
        "import os\nfrom fieldcalib.processes.other_process import OtherProcess\n"
        "other = OtherProcess()\nprint(other.run(os.getpid))\n"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    run = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True, env=environment)
    assert len(run.stdout.split()) == 1
    assert has_ended(int(run.stdout))


def test_where_there_is_no_python(monkeypatch):
    monkeypatch.setattr(sys, "executable", "")
    with pytest.raises(RuntimeError, match="no Python to start another process with"):
        OtherProcess()
    monkeypatch.setattr(sys, "executable", "/no/python")
    with pytest.raises(RuntimeError, match="cannot be started"):
        OtherProcess()
