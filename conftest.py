"""A test, or a module with doctests, that imports a package of an extra is skipped where that package is missing.

With FIELDCALIB_ALL_EXTRAS=1 nothing is skipped for that: the missing package is an error.
"""

import doctest
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


def _skip_without_extra(report: pytest.CollectReport | pytest.TestReport, call: pytest.CallInfo | None) -> None:
    """Turn a report that failed because a package of an extra is missing into a skip with its reason."""
    if call is None or call.excinfo is None or os.environ.get("FIELDCALIB_ALL_EXTRAS") == "1":
        return
    error = call.excinfo.value
    error = error.exc_info[1] if isinstance(error, doctest.UnexpectedException) else error
    error = error.__cause__ or error  # pytest wraps what the import of a test module raises
    if isinstance(error, ModuleNotFoundError) and error.name in EXTRAS:
        report.outcome = "skipped"
        reason = f"Skipped: needs {error.name}: pip install 'fieldcalib[{EXTRAS[error.name]}]'"
        report.longrepr = (report.fspath, None, reason)
