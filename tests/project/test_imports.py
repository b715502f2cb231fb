"""What `import fieldcalib` and `fieldcalib --help` cost. Imports go down: import-linter, `pyproject.toml`."""

import ast
import importlib
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

import pytest

import fieldcalib

HEAVY = ("cv2", "av", "PIL", "skimage", "onnxruntime", "scipy.optimize")  # imported by what needs them, when it runs
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


def test_what_is_loaded_would_be_seen():
    assert set(loaded_by("import cv2, scipy.optimize")) == {"numpy", "scipy", "cv2", "scipy.optimize"}


FOLDER = Path(fieldcalib.__file__).parent
API = FOLDER.parent / "docs" / "reference" / "api.md"
FOLDERS = sorted(init.parent.relative_to(FOLDER).parts for init in FOLDER.rglob("__init__.py"))
PACKAGES = [".".join(("fieldcalib", *parts)) for parts in FOLDERS]
NOT_INSTALLED = [] if find_spec("starlette") else ["fieldcalib.web"]  # a package whose names are of an extra
DEFINE_THEIR_NAMES = {"fieldcalib.fields.segments", "fieldcalib.geometry.lens"}  # without a stub, so with `__all__`
MOST_NAMES = 35  # at the top, beside packages
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


def test_importing_every_public_name_loads_nothing_heavy():
    packages = [name for name in PACKAGES if name != "fieldcalib.io.exports" and name not in NOT_INSTALLED]  # of OpenCV
    code = f"import importlib\nfor package in map(importlib.import_module, {packages!r}):\n"
    loaded = loaded_by(f"{code}    for name in package.__all__: getattr(package, name)")
    assert "numpy" in loaded
    assert set(loaded).isdisjoint(HEAVY)


@pytest.mark.parametrize("step", [4, pytest.param(1, marks=pytest.mark.slow)])
def test_every_public_name_is_there_on_a_fresh_import(step):
    """By default some of them: each takes a process."""
    assert missing(f"fieldcalib.{name}" for name in fieldcalib.__all__[::step]) == []


def in_stub(package):
    """The names of the stub of a package, as editors and type checkers read them."""
    stub = ast.parse(FOLDER.joinpath(*package.split(".")[1:], "__init__.pyi").read_text())
    return [alias.asname for node in stub.body if isinstance(node, ast.ImportFrom) for alias in node.names]


@pytest.mark.parametrize("package", PACKAGES)
def test_tab_shows_what_a_package_exports_and_nothing_else(package):
    module = importlib.import_module(package)
    assert sorted(dir(module)) == sorted(set(module.__all__))
    if package not in DEFINE_THEIR_NAMES:
        assert sorted(module.__all__) == sorted(in_stub(package))
    assert [name for name in module.__all__ if not hasattr(module, name)] == []


def test_tab_shows_no_modules_that_were_imported():
    shown = "import fieldcalib, fieldcalib.cli.main, fieldcalib.solve.search, fieldcalib.images.clip.from_video\n"
    shown += "names = dir(fieldcalib), dir(fieldcalib.cli), dir(fieldcalib.solve), dir(fieldcalib.images)\n"
    check = "assert not {name for each in names for name in each} & {'cli', 'main', 'search', 'clip', 'console'}"
    assert "numpy" in loaded_by(shown + check)


def test_few_names_are_at_the_top():
    names = [name for name in fieldcalib.__all__ if not isinstance(getattr(fieldcalib, name), ModuleType)]
    packages = {f"fieldcalib.{name}" for name in set(fieldcalib.__all__) - set(names)}
    assert len(names) <= MOST_NAMES
    assert packages - {"fieldcalib.plot"} <= set(PACKAGES)
    assert packages.isdisjoint({"fieldcalib.cli", "fieldcalib.console", "fieldcalib.run_folder"})


def test_the_reference_has_every_name_that_is_shown():
    listed = set(re.findall(r"^    ([\w.]+)$", API.read_text(), re.MULTILINE))
    for package in PACKAGES:
        module, inside = importlib.import_module(package), package.removeprefix("fieldcalib").removeprefix(".")
        for name in module.__all__:
            is_at_the_top = name in fieldcalib.__all__ and getattr(fieldcalib, name) is getattr(module, name)
            dotted = f"{inside}.{name}".removeprefix(".")
            assert dotted in listed or (is_at_the_top and name in listed), dotted


def is_module(name):
    """Whether a dotted name is that of a module or package, which is imported by its path."""
    path = FOLDER.joinpath(*name.split(".")[1:])
    return path.is_dir() or path.with_suffix(".py").is_file()


def test_every_name_in_the_docs_is_shown_on_a_fresh_import():
    texts = [path.read_text() for path in (FOLDER.parent / "README.md", *(FOLDER.parent / "docs").rglob("*.md"))]
    names = {name for text in texts for name in re.findall(r"\bfieldcalib(?:\.[A-Za-z_]\w*)+", text)}
    assert {"fieldcalib.plot", "fieldcalib.io.exports.opencv", "fieldcalib.processes.in_order"} <= names
    names = {name for name in names if not is_module(name) and name.rpartition(".")[0] not in NOT_INSTALLED}
    assert missing(names - {f"fieldcalib.{name}" for name in fieldcalib.__all__}) == []  # those are tested above


def test_what_is_missing_is_found():
    assert missing(["fieldcalib.io.nothing", "fieldcalib.soccer"]) == ["fieldcalib.io.nothing"]


def test_the_name_calibrate_is_free_for_a_function():
    """A folder of that name would take its place as soon as anything in it were imported."""
    for package in map(importlib.import_module, PACKAGES):
        for name in package.__all__:
            getattr(package, name)
    assert not isinstance(getattr(fieldcalib, "calibrate", None), ModuleType)
    assert "fieldcalib.calibrate" not in sys.modules
    assert not (FOLDER / "calibrate" / "__init__.py").exists()
