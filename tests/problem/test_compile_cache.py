"""Numba's cache where it cannot be kept, or where it is torn."""

import importlib.util
import logging
import os
import subprocess
import sys
from pathlib import Path

import numba  # noqa: F401 (skipped where it is not installed)
import pytest

import fieldcalib

MODULE = """
from fieldcalib.problem.compile_cache import cached

@cached(error_model="numpy")
def twice(x):
    return 2.0 * x
"""
WITHOUT_FOLDER = """
import logging
logging.basicConfig(level=logging.INFO, format="%(message)s")
from numba.core import caching
caching.CacheImpl._locator_classes = caching.CompileResultCacheImpl._locator_classes = []
from fieldcalib.problem.compilation import compiled_module
print(compiled_module(), compiled_module())
"""
INTERRUPTED = """
import os, signal
signal.signal(signal.SIGINT, signal.default_int_handler)
from numba.core.codegen import JITCodeLibrary
load, signals = JITCodeLibrary._object_getbuffer_hook, [signal.SIGINT]
def interrupted(*arguments):
    if signals:
        os.kill(os.getpid(), signals.pop())
    return load(*arguments)
JITCodeLibrary._object_getbuffer_hook = interrupted
from fieldcalib.cli.main import main
raise SystemExit(main())
"""


def imported(path):
    spec = importlib.util.spec_from_file_location("of_test", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("ending", ["nbi", "nbc"])
@pytest.mark.parametrize("content", [b"", b"\x80\x04torn"])
def test_a_torn_file_is_compiled_again(tmp_path, caplog, ending, content):
    path = tmp_path / "module.py"
    path.write_text(MODULE)
    assert imported(path).twice(1.5) == 3.0
    (file,) = (tmp_path / "__pycache__").glob(f"*.{ending}")
    file.write_bytes(content)
    with caplog.at_level(logging.INFO):
        assert imported(path).twice(1.5) == 3.0
    assert "cannot be read: it is compiled again" in caplog.text
    caplog.clear()
    with caplog.at_level(logging.INFO):
        assert imported(path).twice(1.5) == 3.0  # the file is whole again
    assert not caplog.text


def test_without_a_folder_numpy_solves():
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_FOLDER],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(fieldcalib.__file__).parents[1],
    )
    assert done.stdout == "None None\n"
    assert len(done.stderr.splitlines()) == 1
    assert "NUMBA_CACHE_DIR names one" in done.stderr


@pytest.mark.skipif(os.name != "posix", reason="needs POSIX signals")
def test_an_interrupt_while_llvm_calls_back_is_not_lost(annotated_folder, tmp_path):
    """Python prints what such a function raises, and goes on."""
    command = ["calibrate", annotated_folder / "a.json", "--size", "960x540", "--out", tmp_path / "out"]
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED, *map(str, command)],
        capture_output=True,
        text=True,
        cwd=Path(fieldcalib.__file__).parents[1],
    )
    assert (done.returncode, done.stdout) == (130, "")
    assert done.stderr.splitlines()[-1] == "fieldcalib: interrupted, nothing more is written"
    assert "Traceback" not in done.stderr
