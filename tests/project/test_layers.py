"""The command line is no library: nothing but itself imports it, in code or in an example of a docstring."""

import ast
import doctest
import re
import tomllib
from pathlib import Path

import pytest

import fieldcalib

ROOT = Path(fieldcalib.__file__).parents[1]
CLI = "fieldcalib.cli"
MAY_IMPORT_IT = (ROOT / "fieldcalib/cli", ROOT / "fieldcalib/__main__.py")


def imported(code):
    """Modules that a piece of code imports, anywhere in it."""
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.ImportFrom) and node.module is not None:
            yield node.module
            yield from (f"{node.module}.{name.name}" for name in node.names)
        elif isinstance(node, ast.Import):
            yield from (name.name for name in node.names)


def examples(code):
    """Source of the examples in the docstrings of a module."""
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef)
    for node in ast.walk(ast.parse(code)):
        text = ast.get_docstring(node) if isinstance(node, documented) else None
        if text:
            yield from (example.source for example in doctest.DocTestParser().get_examples(text))


def imports_the_command_line(code):
    parts = [code, *examples(code)]
    return any(name == CLI or name.startswith(f"{CLI}.") for part in parts for name in imported(part))


@pytest.mark.parametrize("package", ["fieldcalib", "baselines", "data_tools"])
def test_nothing_imports_the_command_line(package):
    files = [path for path in (ROOT / package).rglob("*.py") if not any(map(path.is_relative_to, MAY_IMPORT_IT))]
    assert files
    texts = {path: path.read_text("utf-8") for path in files}
    named = {path: text for path, text in texts.items() if re.search(r"\bcli\b", text)}
    assert [path for path, text in named.items() if imports_the_command_line(text)] == []


@pytest.mark.parametrize(
    "code",
    [
        "from fieldcalib import cli",
        "import fieldcalib.cli.main",
        "def f():\n    from fieldcalib.cli.run import run",
        'def f():\n    """Do.\n\n    >>> from fieldcalib.cli.run import run\n    """',
        'class A:\n    """A.\n\n    >>> import fieldcalib.cli\n    """',
    ],
)
def test_such_an_import_would_be_seen(code):
    assert imports_the_command_line(code)


def test_others_are_allowed():
    assert not imports_the_command_line("from fieldcalib.client import cli\nimport fieldcalib.console")


def test_the_layout_that_is_described_is_that_of_the_layers():
    """The table of CONTRIBUTING.md has the packages in the order in which they may import one another."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]["contracts"]
    (layers,) = (one["layers"] for one in contracts if one["name"] == "imports go down")
    in_order = [name for layer in layers for name in layer.split(" | ") if not name.startswith("fieldcalib._")]
    table = re.findall(r"^\| (`[^|]*`) \|", (ROOT / "CONTRIBUTING.md").read_text("utf-8"), flags=re.MULTILINE)
    assert [name for row in table for name in re.findall(r"`([\w.]+)`", row)] == in_order
    packages = {f"fieldcalib.{path.parent.name}" for path in (ROOT / "fieldcalib").glob("*/__init__.py")}
    assert packages <= {*in_order, "fieldcalib.models"}
