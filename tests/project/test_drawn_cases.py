"""Which cases property tests draw: the same on every run, whatever was imported before, or those of a seed."""

from pathlib import Path

import pytest

pytest_plugins = "pytester"

PROPERTY = """
{imported}
from hypothesis import given, strategies

@given(strategies.lists(strategies.integers()), strategies.floats())
def test_it(numbers, number):
    with open("drawn", "a") as file:
        print(numbers, number, file=file)
"""


@pytest.fixture
def drawn(pytester, monkeypatch):
    """Returns the cases that a property test draws with options of pytest, once it has imported a module."""
    monkeypatch.delenv("HYPOTHESIS_PROFILE", raising=False)
    pytester.makeconftest((Path(__file__).parents[1] / "conftest.py").read_text(encoding="utf-8"))
    pytester.makeini("[pytest]\nmarkers = property")
    pytester.makepyfile(numbers_of_the_checkout=f"NUMBERS = {[7.0 * i for i in range(100, 200)]}, {[*range(300, 400)]}")

    def cases(*options, imported=""):
        pytester.makepyfile(test_any=PROPERTY.format(imported=imported))
        result = pytester.runpytest_subprocess("-p", "no:cacheprovider", *options)
        assert result.parseoutcomes() == {"passed": 1}, result.stdout.str()
        file = pytester.path / "drawn"
        text = file.read_text()
        file.unlink()
        return text

    return cases


@pytest.mark.slow
def test_cases_are_the_same_each_time_whatever_is_imported(drawn):
    first = drawn()
    assert drawn() == first
    assert drawn(imported="import numbers_of_the_checkout") == first
    assert drawn("--hypothesis-seed=1") != first
    assert 5 <= len(first.splitlines()) < 20


@pytest.mark.slow
def test_a_seed_names_cases_that_it_repeats(drawn):
    first = drawn("--hypothesis-seed=1")
    assert len(first.splitlines()) >= 20
    assert drawn("--hypothesis-seed=1", imported="import numbers_of_the_checkout") == first
    assert first != drawn("--hypothesis-seed=2")


@pytest.mark.slow
def test_a_profile_draws_at_random(drawn, monkeypatch):
    monkeypatch.setenv("HYPOTHESIS_PROFILE", "random")
    assert drawn() != drawn()
