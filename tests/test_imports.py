"""What `import fieldcalib` and `fieldcalib --help` cost. Imports go down: import-linter, `pyproject.toml`."""

import ast
import subprocess
import sys
from pathlib import Path

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


def test_public_names_are_all_there():
    """Each is what its module defines under that name, and nothing else is public."""
    assert set(fieldcalib.__all__) <= set(dir(fieldcalib))
    for name in fieldcalib.__all__:
        found = getattr(fieldcalib, name)
        assert getattr(found, "__name__", name).rsplit(".", 1)[-1] == name
