"""What is installed: no method that is for comparison only, and no weights that were trained on others' pictures."""

import tomllib
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path

import pytest

PROJECT = Path(__file__).parents[2]


def test_a_method_for_comparison_only_is_left_out_of_the_wheel():
    wheel = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["hatch"]["build"][
        "targets"
    ]["wheel"]
    assert "baselines" in wheel["packages"]
    assert {"/baselines/jiang", "*.pt"} <= set(wheel["exclude"])


def test_it_is_not_among_the_installed_files():
    try:
        installed = [str(path) for path in files("fieldcalib") or ()]
    except PackageNotFoundError:
        pytest.skip("fieldcalib is not installed: there is no wheel to look into")
    modules = [path for path in installed if path.endswith(".py")]
    if not any(path.startswith("baselines/") for path in modules):
        pytest.skip("fieldcalib is installed in place: there is no wheel to look into")
    assert not [path for path in installed if "jiang" in path]
    assert not [path for path in installed if path.endswith((".pt", ".pth"))]
