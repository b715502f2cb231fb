"""Modules, functions and files that the docs, docstrings, comments and `pyproject.toml` name are there."""

import ast
import importlib
import re
import tokenize
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "pyproject.toml", ".ci/run")]
PAGES += sorted(ROOT.glob("docs/**/*.md")) + sorted(ROOT.glob("fieldcalib/**/*.md"))
PACKAGES = "fieldcalib|baselines|data_tools"
SOURCES = [path for folder in (*PACKAGES.split("|"), "tests") for path in sorted((ROOT / folder).rglob("*.py*"))]
SOURCES = [path for path in SOURCES if path.suffix in (".py", ".pyi")]
INNER = "|".join(sorted(path.parent.name for path in ROOT.glob("fieldcalib/*/__init__.py")))

DOTTED = re.compile(rf"(?<![\w/.])(?:{PACKAGES})(?:\.[A-Za-z_]\w*)+(?![\w(]*/)")
INSIDE = re.compile(rf"`((?:{INNER})(?:\.[A-Za-z_]\w*)+)`")  # `solve.search`, of fieldcalib
PATH = re.compile(rf"(?<![\w/.])(?:{PACKAGES}|tests|docs)/[\w./-]*\.(?:py|pyi|md)\b")
FILES = {"images.txt"}  # of COLMAP


def prose(path):
    """Docstrings and comments of a source file; the whole text of any other file."""
    if path.suffix not in (".py", ".pyi"):
        return path.read_text(encoding="utf-8")
    return "\n".join([*comments_of(path), *docstrings_in(ast.parse(path.read_text(encoding="utf-8")))])


def docstrings_in(node):
    """The docstrings of a statement and of those inside it; expressions, which have none, are not looked through."""
    if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
        yield ast.get_docstring(node, clean=False) or ""
    for inner in getattr(node, "body", ()):
        yield from docstrings_in(inner)


def comments_of(path):
    """The comments of a source file; none if no comment names anything, which is seen without its tokens."""
    with tokenize.open(path) as source:
        lines = source.readlines()
    after = [line[line.index("#") :] for line in lines if "#" in line]
    if not any(pattern.search(text) for text in after for pattern in (DOTTED, INSIDE, PATH)):
        return []
    tokens = tokenize.generate_tokens(iter(lines).__next__)
    return [token.string for token in tokens if token.type == tokenize.COMMENT]


def dotted_names(text):
    return {*DOTTED.findall(text), *(f"fieldcalib.{name}" for name in INSIDE.findall(text) if name not in FILES)}


def exists(name):
    """Whether a dotted name is a module, or an attribute or a field of a dataclass that is found from one."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        module = ".".join(parts[:count])
        try:
            value = importlib.import_module(module)
        except ModuleNotFoundError as error:
            if error.name is None or not f"{module}.".startswith(f"{error.name}."):
                raise  # a package of an extra
            continue
        for part in parts[count:]:
            if not hasattr(value, part):
                return part in getattr(value, "__dataclass_fields__", {})
            value = getattr(value, part)
        return True
    return False


@pytest.mark.parametrize("path", [*PAGES, *SOURCES], ids=lambda path: str(path.relative_to(ROOT)))
def test_what_a_file_names_is_there(path):
    text, wrong, extra = prose(path), [], None
    for name in sorted(dotted_names(text)):
        try:
            wrong += [] if exists(name) else [name]
        except ModuleNotFoundError as error:
            extra = error
    assert wrong == []
    assert [name for name in PATH.findall(text) if not (ROOT / name).is_file()] == []
    if extra is not None:
        raise extra  # conftest.py skips the test: this name alone could not be looked for


def test_wrong_names_are_seen():
    text = (
        "`fieldcalib.calibrate.batch`, fieldcalib.soccer, `solve.nothing`, fieldcalib/calibrate/batch.py (docs/no.md)."
    )
    assert {name: exists(name) for name in dotted_names(text)} == {
        "fieldcalib.calibrate.batch": False,
        "fieldcalib.soccer": True,
        "fieldcalib.solve.nothing": False,
    }
    assert PATH.findall(text) == ["fieldcalib/calibrate/batch.py", "docs/no.md"]


def test_fields_of_dataclasses_are_names():
    assert exists("fieldcalib.Calibration.status")
    assert not exists("fieldcalib.Calibration.nothing")


def test_names_are_looked_for_in_docstrings_and_comments():
    assert len(SOURCES) > 300
    assert "docs, docstrings, comments" in prose(Path(__file__))
    assert "of COLMAP" in prose(Path(__file__))
    assert "ROOT.glob" not in prose(Path(__file__))


def test_the_page_and_its_docs_say_the_same_number_of_clicks():
    words = "seven clicks on three or four markings are enough for a good camera of most"
    for path in (ROOT / "docs" / "how-to" / "page.md", ROOT / "fieldcalib" / "web" / "static" / "marks.js"):
        text = " ".join(path.read_text(encoding="utf-8").lower().split())
        assert words in text, path
        assert "five or six" not in text, path
