"""What lies in `conftest.py`: without an extra its tests are skipped, and any other failing import is an error."""

from pathlib import Path

import pytest

pytest_plugins = "pytester"

ROOT = Path(__file__).parents[2]


@pytest.fixture
def run(pytester, monkeypatch):
    """Runs pytest with this project's settings on modules given by their text; returns the counts of outcomes."""
    monkeypatch.delenv("FIELDCALIB_ALL_EXTRAS", raising=False)
    for name in ("conftest.py", "pyproject.toml"):
        (pytester.path / name).write_text((ROOT / name).read_text(encoding="utf-8"), encoding="utf-8")

    def outcomes(**modules):
        pytester.makepyfile(**modules)
        result = pytester.runpytest_inprocess("-n0", "--assert=plain", pytester.path)  # as whichever this one does
        return result.parseoutcomes(), result.stdout.str()

    return outcomes


def absent(package):
    """A module that imports a package where it is not installed."""
    return f"raise ModuleNotFoundError(name={package!r})"


def inside(test):
    return f"def test_it():\n    {test}"


def test_examples_that_need_an_extra_are_skipped_with_the_reason(run):
    example = [">>> try:", f"...     {absent('torch')}", "... except ImportError as error:"]
    example += ["...     raise ImportError('as fieldcalib._extras says it') from error"]
    counts, text = run(shown="\n".join(['"""', *example, '"""']))
    assert counts == {"skipped": 1}, text
    assert "shown.py: needs torch: pip install 'fieldcalib[train]'" in text


def test_modules_and_tests_that_need_an_extra_are_skipped_with_the_reason(run):
    counts, text = run(learner=absent("torch"), test_learner="import learner", test_referee=inside(absent("SoccerNet")))
    assert counts == {"skipped": 4}, text  # a test module is asked for its doctests too
    assert "learner.py: needs torch: pip install 'fieldcalib[train]'" in text
    assert "test_referee.py: needs SoccerNet: pip install 'fieldcalib[soccernet]'" in text


def test_a_property_test_that_needs_an_extra_ends_at_its_first_example(run, pytester, monkeypatch):
    """Hypothesis would look for a simpler example that fails."""
    head = "from hypothesis import given, strategies\n\n@given(strategies.integers())\ndef test_it(number):\n"
    count = "    with open('tried', 'a') as file:\n        print(number, file=file)\n"
    counts, text = run(test_any=f"{head}{count}    {absent('SoccerNet')}")
    assert counts == {"skipped": 1}, text
    assert "test_any.py: needs SoccerNet: pip install 'fieldcalib[soccernet]'" in text
    assert len((pytester.path / "tried").read_text().splitlines()) == 1
    monkeypatch.setenv("FIELDCALIB_ALL_EXTRAS", "1")
    counts, text = run(test_any=f"{head}    {absent('SoccerNet')}")
    assert counts == {"failed": 1}, text


@pytest.mark.parametrize(
    "package",
    [
        "torch.nowhere",
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("fieldcalib.nowhere", "pandas_of_nobody")),
    ],
)
def test_what_no_extra_brings_is_an_error(run, package):
    counts, text = run(broken=absent(package), test_broken=inside(absent(package)))
    assert counts == {"errors": 1}, text
    counts, text = run(broken="", test_broken=inside(absent(package)))
    assert counts == {"failed": 1}, text


def test_nothing_is_skipped_where_every_extra_is_said_to_be_there(run, monkeypatch):
    monkeypatch.setenv("FIELDCALIB_ALL_EXTRAS", "1")
    counts, text = run(learner=absent("torch"))
    assert counts == {"errors": 1}, text
    counts, text = run(learner="", test_referee=inside(absent("SoccerNet")))
    assert counts == {"failed": 1}, text
