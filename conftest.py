"""A test, or a module with doctests, that imports a package of an extra is skipped where that package is missing.

With FIELDCALIB_ALL_EXTRAS=1 nothing is skipped for that: the missing package is an error.
"""

import doctest
import functools
import os
import re
import tomllib
from pathlib import Path

import pytest

PROJECT = tomllib.loads((Path(__file__).parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]
MODULES = {"PyYAML": "yaml", "rerun-sdk": "rerun"}  # what is imported by another name than it is installed by
EXTRAS = {  # module -> the first extra that brings it
    MODULES.get(name := re.split(r"[^\w-]", requirement)[0], name): extra
    for extra, requirements in reversed(PROJECT["optional-dependencies"].items())
    for requirement in requirements
    if not requirement.startswith(PROJECT["name"])
}


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector: pytest.Collector):
    """Skip the modules that cannot be imported without an extra."""
    report = yield
    _skip_without_extra(report, getattr(report, "call", None))  # none where --lf passes a file over
    return report


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo):
    """Skip the tests that import a package of an extra when they run."""
    report = yield
    _skip_without_extra(report, call)
    return report


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]):
    """Let property tests end where a package is missing: Hypothesis would search for simpler examples of it."""
    handles = (getattr(getattr(item, "obj", None), "hypothesis", None) for item in items)
    for handle in {id(one): one for one in handles if one is not None}.values():  # cases of a test share theirs
        handle.inner_test = _ending_without_extra(handle.inner_test)


def _ending_without_extra(test):
    """Make a property test whose examples end at once where a package of an extra is missing."""

    @functools.wraps(test)
    def ending(*arguments, **named):
        try:
            return test(*arguments, **named)
        except ImportError as error:
            missing = error.__cause__ or error  # the package says which extra brings it
            if _lacks_extra(missing):
                raise pytest.skip.Exception(str(missing)) from missing
            raise

    return ending


def _lacks_extra(error: BaseException) -> bool:
    """Whether a package of an extra is missing and may be."""
    missing = isinstance(error, ModuleNotFoundError) and error.name in EXTRAS
    return missing and os.environ.get("FIELDCALIB_ALL_EXTRAS") != "1"


def _skip_without_extra(report: pytest.CollectReport | pytest.TestReport, call: pytest.CallInfo | None) -> None:
    """Turn a report that failed because a package of an extra is missing into a skip with its reason."""
    if call is None or call.excinfo is None:
        return
    error = call.excinfo.value
    error = error.exc_info[1] if isinstance(error, doctest.UnexpectedException) else error
    error = error.__cause__ or error  # pytest wraps what the import of a test module raises, property tests too
    if _lacks_extra(error):
        report.outcome = "skipped"
        reason = f"Skipped: needs {error.name}: pip install 'fieldcalib[{EXTRAS[error.name]}]'"
        report.longrepr = (report.fspath, None, reason)
