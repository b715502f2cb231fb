"""What `import fieldcalib` costs. That imports go down is held by import-linter: see `pyproject.toml`."""

import ast
import subprocess
import sys
from pathlib import Path

import fieldcalib

HEAVY = ("cv2", "skimage", "onnxruntime", "scipy.optimize")  # imported by what needs them, when it runs


def loaded_by(statement):
    """Which of the heavy modules a fresh interpreter has loaded after a statement."""
    code = f"import sys\n{statement}\nprint([name for name in {HEAVY!r} if name in sys.modules])"
    folder = Path(fieldcalib.__file__).parents[1]
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=folder)
    return ast.literal_eval(run.stdout.splitlines()[-1])


def test_importing_every_public_name_loads_nothing_heavy():
    assert loaded_by("import fieldcalib\nfor name in fieldcalib.__all__: getattr(fieldcalib, name)") == []


def test_what_is_loaded_would_be_seen():
    assert loaded_by("import cv2, scipy.optimize") == ["cv2", "scipy.optimize"]


def test_public_names_are_all_there():
    assert all(getattr(fieldcalib, name) is not None for name in fieldcalib.__all__)
