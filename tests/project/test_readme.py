"""What the README and the pages of `docs` show must run and print what they say; their links must lead somewhere."""

import contextlib
import doctest
import importlib
import inspect
import io
import re
from pathlib import Path

import pytest

import fieldcalib

ROOT = Path(__file__).parents[2]
PAGES = {path.relative_to(ROOT).as_posix(): path for path in (ROOT / "README.md", *sorted(ROOT.glob("docs/**/*.md")))}
MADE = {"docs/gallery/index"}  # when the site is built
RUNNABLE = "<!-- runnable -->\n"
LONGEST_README = 120  # lines

every_page = pytest.mark.parametrize("page", PAGES)


def text(page):
    return PAGES[page].read_text(encoding="utf-8")


def python_blocks(page, mark=""):
    return re.findall(rf"^{mark}```python\n(.*?)^```$", text(page), flags=re.DOTALL | re.MULTILINE)


def anchors(path):
    """The anchors that GitHub, MkDocs and MyST give to the headings of a page."""
    headings = re.findall(r"^#+ (.*)$", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


def promised_output(code):
    """The comments that follow calls of print, on lines of their own."""
    return "".join(line + "\n" for line in re.findall(r"^print\(.*\n# (.*)$", code, flags=re.MULTILINE))


@pytest.mark.parametrize("page", [page for page in PAGES if RUNNABLE in text(page)])
def test_the_examples_run_and_print_what_is_written_below(page):
    blocks = python_blocks(page, RUNNABLE)
    assert len(blocks) == text(page).count(RUNNABLE)
    names = {}
    for code in blocks:
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            exec(compile(code, page, "exec"), names)
        promised, came = promised_output(code), printed.getvalue()
        assert doctest.OutputChecker().check_output(promised, came, doctest.ELLIPSIS), f"{promised}\n{came}"


def test_the_first_thing_that_is_shown_runs():
    assert RUNNABLE in text("README.md")


@every_page
def test_the_other_python_is_python(page):
    for code in python_blocks(page):
        compile(code, page, "exec")


@every_page
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)]+)\)", text(page)):
        assert "://" not in target, "what is not checked here may be gone"
        name, _, anchor = target.partition("#")
        path = (PAGES[page].parent / name) if name else PAGES[page]
        if path.relative_to(ROOT).with_suffix("").as_posix() in MADE:
            continue
        assert path.is_file(), target
        assert not anchor or anchor in anchors(path), target


def test_the_readme_is_short():
    assert len(text("README.md").splitlines()) <= LONGEST_README


def test_the_citation_names_this_version():
    assert f"\nversion: {fieldcalib.__version__}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")


def listed(page):
    """The pages below a page of the site: what its tables of contents list."""
    blocks = re.findall(r"^```\{toctree\}\n(.*?)^```$", text(page), flags=re.DOTALL | re.MULTILINE)
    entries = [line for block in blocks for line in block.splitlines() if line and not line.startswith(":")]
    names = [re.sub(r"^.*<(.*)>$", r"\1", entry) for entry in entries]
    below = [(PAGES[page].parent / name).resolve().relative_to(ROOT).as_posix() for name in names]
    return [f"{name}.md" for name in below if name not in MADE]


def test_every_page_is_found_from_the_first_one():
    found, waiting = set(), ["docs/index.md"]
    while waiting:
        page = waiting.pop()
        found.add(page)
        waiting += listed(page)
    assert found == {name for name in PAGES if name.startswith("docs/")}


@pytest.mark.parametrize("module", ["", "draw.", "fields.", "metrics.", "plot.", "localize."])
def test_the_reference_explains_every_public_name(module):
    parent = importlib.import_module(f"fieldcalib.{module}".rstrip("."))
    defined = [name for name, value in vars(parent).items() if getattr(value, "__module__", "") == parent.__name__]
    public = {name for name in getattr(parent, "__all__", defined) if not name.startswith("_")}
    if module:  # what is inside modules of its own is explained there, and some names once for the whole package
        own = {name: getattr(parent, name) for name in public if not inspect.ismodule(getattr(parent, name))}
        public = {name for name, value in own.items() if getattr(fieldcalib, name, None) is not value}
    explained = set(re.findall(rf"^    {re.escape(module)}(\w+)$", text("docs/reference/api.md"), flags=re.MULTILINE))
    assert public
    assert explained == public


def test_the_checks_can_fail():
    assert promised_output("print(1)\n# 2\n") == "2\n"
    assert "of-an-image" not in anchors(PAGES["docs/explanation/method.md"])
    assert "the-size-of-the-pitch" in anchors(PAGES["docs/how-to/known-camera.md"])
