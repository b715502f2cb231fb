"""Hypothesis draws the same examples on every run; data shared beside the checkout is a fixture that skips."""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile(
    "deterministic",
    derandomize=True,
    deadline=None,
    max_examples=60,
    suppress_health_check=[HealthCheck.too_slow],  # a busy machine is no property of the code
)
settings.load_profile("deterministic")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    path = Path(__file__).parents[2] / "shared" / "data"
    if not path.is_dir():
        pytest.skip(f"needs the annotated frames in {path}, a folder beside the checkout that is absent here")
    return path
