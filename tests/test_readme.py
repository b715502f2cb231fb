"""What the README and the pages of `docs` show must run and print what they say; their links must lead somewhere."""

import contextlib
import doctest
import io
import re
from pathlib import Path

import pytest

import fieldcalib

ROOT = Path(__file__).parents[1]
PAGES = {path.relative_to(ROOT).as_posix(): path for path in (ROOT / "README.md", *sorted(ROOT.glob("docs/*.md")))}
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
        assert path.is_file(), target
        assert not anchor or anchor in anchors(path), target


def test_the_readme_is_short():
    assert len(text("README.md").splitlines()) <= LONGEST_README


def test_the_citation_names_this_version():
    assert f"\nversion: {fieldcalib.__version__}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")


def test_every_page_is_found_from_the_first_one():
    linked = set(re.findall(r"\]\(([\w-]+\.md)", text("docs/index.md")))
    assert linked == {path.name for name, path in PAGES.items() if name.startswith("docs/")} - {"index.md"}


def test_the_api_page_names_all_that_is_public():
    named = set(re.findall(r"`(\w+)`", text("docs/api.md").partition("## All names")[2]))
    assert named == {*fieldcalib.__all__, "fieldcalib"}


def test_the_checks_can_fail():
    assert promised_output("print(1)\n# 2\n") == "2\n"
    assert "of-an-image" not in anchors(PAGES["docs/method.md"])
    assert "the-size-of-the-pitch" in anchors(PAGES["docs/command-line.md"])
