"""What `import fieldcalib` and `fieldcalib --help` cost. Imports go down: import-linter, `pyproject.toml`."""

import ast
import importlib.util
import pkgutil
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import fieldcalib

HEAVY = ("cv2", "skimage", "onnxruntime", "scipy.optimize")  # imported by what needs them, when it runs
EXTENSIONS = ("numpy", "scipy", *HEAVY)  # each takes longer to import than Python to start
HELP = """
import contextlib
from fieldcalib.cli.main import main
with contextlib.suppress(SystemExit):
    main(["--help"])
"""


def loaded_by(statement):
    """Which of these modules a fresh interpreter has loaded after a statement."""
    code = f"import sys\n{statement}\nprint([name for name in {EXTENSIONS!r} if name in sys.modules])"
    folder = Path(fieldcalib.__file__).parents[1]
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=folder)
    return ast.literal_eval(run.stdout.splitlines()[-1])


@pytest.mark.parametrize("statement", ["import fieldcalib", HELP], ids=["import", "--help"])
def test_the_package_and_its_help_load_only_python(statement):
    assert loaded_by(statement) == []


def test_importing_every_public_name_loads_nothing_heavy():
    loaded = loaded_by("import fieldcalib\nfor name in fieldcalib.__all__: getattr(fieldcalib, name)")
    assert set(loaded).isdisjoint(HEAVY)


def test_what_is_loaded_would_be_seen():
    assert set(loaded_by("import cv2, scipy.optimize")) == {"numpy", "scipy", "cv2", "scipy.optimize"}


FOLDER = Path(fieldcalib.__file__).parent
STUBS = [".".join(("fieldcalib", *stub.relative_to(FOLDER).parts[:-1])) for stub in FOLDER.rglob("__init__.pyi")]
PACKAGES = [*STUBS, *(f"fieldcalib.{name}" for name in ("assess", "geometry", "images", "problem", "solve"))]
# Takes each name in a process of its own, in which only `fieldcalib` itself was imported, and prints those that are
# missing. The slow imports of NumPy, SciPy and OpenCV are made once, before the processes part.
TAKE_EACH = """
import functools, os, sys
import cv2, numpy, scipy.optimize, scipy.spatial.transform
import fieldcalib
for path in sys.stdin.read().split():
    child = os.fork()
    if not child:
        *parents, name = path.split(".")[1:]
        owner = functools.reduce(getattr, parents, fieldcalib)
        os._exit(0 if hasattr(owner, name) and (name in dir(owner)) else 1)
    if os.waitpid(child, 0)[1]:
        print(path)
"""


def missing(names):
    """The names that cannot be taken from a fresh import, or that Tab does not show."""
    run = subprocess.run(
        [sys.executable, "-c", TAKE_EACH], input="\n".join(names), capture_output=True, text=True, check=True
    )
    return run.stdout.split()


def test_every_public_name_is_there_on_a_fresh_import():
    assert missing(f"fieldcalib.{name}" for name in fieldcalib.__all__) == []


@pytest.mark.parametrize("package", PACKAGES)
def test_every_name_of_a_package_is_there(package):
    module = importlib.import_module(package)
    assert module.__all__
    assert [name for name in module.__all__ if not hasattr(module, name)] == []
    assert set(module.__all__) <= set(dir(module))


def test_every_name_in_the_docs_is_there_on_a_fresh_import():
    texts = [path.read_text() for path in (FOLDER.parent / "README.md", *(FOLDER.parent / "docs").rglob("*.md"))]
    names = {name for text in texts for name in re.findall(r"\bfieldcalib(?:\.[A-Za-z_]\w*)+", text)}
    assert {"fieldcalib.plot", "fieldcalib.io.exports.opencv", "fieldcalib.processes.jobs.in_order"} <= names
    if importlib.util.find_spec("numba") is None:
        names -= {"fieldcalib.problem.compile_cache", "fieldcalib.problem.compiled"}  # modules that import it
    assert missing(names - {f"fieldcalib.{name}" for name in fieldcalib.__all__}) == []  # those are tested above


def test_what_is_missing_is_found():
    assert missing(["fieldcalib.io.nothing", "fieldcalib.soccer"]) == ["fieldcalib.io.nothing"]


@pytest.mark.parametrize("package", [name for name in STUBS if name != "fieldcalib"])
def test_a_stub_lists_every_module_of_its_package(package):
    folder = FOLDER.joinpath(*package.split(".")[1:])
    modules = {module.name for module in pkgutil.iter_modules([str(folder)])}
    listed = set(re.findall(r"^from \. import (\w+)", (folder / "__init__.pyi").read_text(), re.MULTILINE))
    assert listed == modules  # otherwise: add or remove `from . import x as x` in __init__.pyi


def test_the_name_calibrate_is_free_for_a_function():
    """A folder of that name would take its place as soon as anything in it were imported."""
    for package in map(importlib.import_module, PACKAGES):
        for name in package.__all__:
            getattr(package, name)
    assert not isinstance(getattr(fieldcalib, "calibrate", None), ModuleType)
    assert "fieldcalib.calibrate" not in sys.modules
    assert not (FOLDER / "calibrate" / "__init__.py").exists()
