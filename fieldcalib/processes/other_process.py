"""Functions that run in another Python process, so that they take no time from the threads of this one.

multiprocessing runs the caller's script again in what it starts, unless the script is written for it. This process
runs nothing but what it is asked for. Loky does not run it either, but its pool ends with any process that dies.
Requests and answers are pickles, each after its length.

Standard streams of a process that was started without one of them, as by ``2>&-``.
"""

from __future__ import annotations

import os
import pickle
import signal
import struct
import subprocess
import sys
import traceback
import weakref
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
from typing import Any, BinaryIO, ParamSpec, TypeVar

from fieldcalib.processes.threads import ONE_THREAD

MODES = {"stdin": "r", "stdout": "w", "stderr": "w"}  # in the order of their descriptors

P = ParamSpec("P")
T = TypeVar("T")

LENGTH = struct.Struct("<Q")


def open_closed_streams() -> None:
    """Open the null device for each of stdin, stdout and stderr that is closed.

    Without that the next file that is opened, or the pipe to another process, gets its number: what is printed would
    be written there.
    """
    for handle, (name, mode) in enumerate(MODES.items()):
        if getattr(sys, name) is not None:
            continue
        if not _is_open(handle):
            null = os.open(os.devnull, os.O_RDWR)
            if null != handle:
                os.dup2(null, handle)
                os.close(null)
            os.set_inheritable(handle, True)
        setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115  # until the process ends


def _is_open(handle: int) -> bool:
    try:
        os.fstat(handle)
    except OSError:
        return False
    return True


class ProcessEndedError(RuntimeError):
    """The process that ran a function has ended, for instance since no memory was left."""

    def __init__(self, exit_code: int) -> None:
        super().__init__(f"the other process has ended, with exit code {exit_code}")
        self.exit_code = exit_code


class OtherProcess:
    """A process that runs functions of importable modules, one at a time; it ends with this object.

    Its libraries use one thread each. Interrupts (Ctrl-C) and requests to end (SIGTERM), which often go to all
    processes of a group, are for the one that started it.

    Parameters
    ----------
    niceness : int
        How much the process yields to others where cores are few, from 0 to 19.
    imports : sequence of str
        Modules that it imports when it starts.

    Raises
    ------
    RuntimeError
        If it cannot be started.

    Examples
    --------
    >>> other = OtherProcess()
    >>> other.run(sum, [1, 2, 3])
    6
    >>> try:
    ...     other.run(int, "three")
    ... except ValueError as error:
    ...     print(error)
    invalid literal for int() with base 10: 'three'
    >>> other.close()
    """

    def __init__(self, niceness: int = 0, imports: Sequence[str] = ()) -> None:
        if not sys.executable or hasattr(sys, "frozen"):  # of a frozen program that is the program itself
            raise RuntimeError(f"no Python to start another process with: sys.executable is {sys.executable!r}")
        path = os.pathsep.join(str(folder) or os.getcwd() for folder in sys.path)
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", __name__, str(niceness), *imports],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env={**os.environ, **ONE_THREAD, "PYTHONPATH": path},
            )
        except OSError as error:
            raise RuntimeError(f"another process cannot be started: {error}") from error
        self._end = weakref.finalize(self, _end, self._process)  # at the end of the program at the latest

    def run(self, function: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> T:
        """Call a function in the process and return its result, or raise its exception.

        Raises
        ------
        ValueError
            If the function or an argument is defined in the script, which is not run there.
        ProcessEndedError
            If the process has ended.
        """
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        request = pickle.dumps((function, args, kwargs), pickle.HIGHEST_PROTOCOL)
        try:
            _send(self._process.stdin, request)
            answer = _received(self._process.stdout)
        except (OSError, EOFError, ValueError):  # of a broken pipe, of one with nothing in it, of a closed one
            raise ProcessEndedError(self._process.wait()) from None
        done, value = pickle.loads(answer)
        if done:
            return value  # type: ignore[no-any-return]
        raise value

    @property
    def has_ended(self) -> bool:
        """Whether the process has ended."""
        return self._process.poll() is not None

    def close(self) -> None:
        """End the process at once."""
        self._end()


def _end(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    process.wait()
    for pipe in (process.stdin, process.stdout):
        with suppress(OSError):  # what could not be sent any more
            assert pipe is not None
            pipe.close()


def _send(pipe: BinaryIO | Any, content: bytes) -> None:
    pipe.write(LENGTH.pack(len(content)))
    pipe.write(content)
    pipe.flush()


def _received(pipe: BinaryIO | Any) -> bytes:
    """The next message.

    Raises
    ------
    EOFError
        If there is none any more, or it is cut off.
    """
    (size,) = LENGTH.unpack(_exactly(pipe, LENGTH.size))
    return _exactly(pipe, size)


def _exactly(pipe: BinaryIO | Any, size: int) -> bytes:
    content = bytes(pipe.read(size))
    if len(content) < size:
        raise EOFError
    return content


def _answer(request: bytes) -> bytes:
    try:
        try:
            function, args, kwargs = pickle.loads(request)
        except (AttributeError, ImportError) as error:
            raise ValueError(f"{error}: classes and functions must be those of modules, not of the script") from None
        return pickle.dumps((True, function(*args, **kwargs)), pickle.HIGHEST_PROTOCOL)
    except Exception as error:
        error.add_note("in another process:\n" + "".join(traceback.format_tb(error.__traceback__)))
        return pickle.dumps((False, error), pickle.HIGHEST_PROTOCOL)


def main() -> None:
    """Answer requests until there are no more."""
    open_closed_streams()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    if hasattr(os, "nice"):
        os.nice(int(sys.argv[1]))
    for module in sys.argv[2:]:
        import_module(module)
    with suppress(EOFError, BrokenPipeError), os.fdopen(os.dup(1), "wb") as answers:
        os.dup2(2, 1)  # what libraries print is no answer
        while True:
            _send(answers, _answer(_received(sys.stdin.buffer)))


if __name__ == "__main__":
    main()
    os._exit(0)  # nothing is left to do, and what libraries do at their end may hang
