"""Programs that need an optional package say so in one line where it is not installed."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from fieldcalib._extras import missing

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    "program",
    [
        "baselines.jiang",
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("data_tools.train", "data_tools.export_onnx")),
    ],
)
def test_without_torch_programs_name_the_remedy(program, tmp_path):
    (tmp_path / "torch.py").write_text("raise ModuleNotFoundError(\"No module named 'torch'\", name='torch')")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join((str(tmp_path), str(ROOT)))}
    command = [sys.executable, "-m", program, "--help"]
    run = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=tmp_path)
    assert run.returncode == 1
    assert run.stdout == ""
    assert run.stderr == (
        f"{program} needs torch, which is not installed: pip install 'fieldcalib[train]', in a checkout pip install "
        "'.[train]'\n"
    )


def test_what_imports_such_a_module_gets_the_error_itself():
    error = ModuleNotFoundError("No module named 'torch'", name="torch")
    assert missing(error, "train") is error
