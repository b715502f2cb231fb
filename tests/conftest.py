"""Hypothesis draws the same examples on every run of CI; data shared beside the checkout is a fixture that skips."""

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# of NumPy's BLAS and of PyTorch, read when they are imported: tests run side by side, and small matrices gain nothing
os.environ.setdefault("OMP_NUM_THREADS", "1")

settings.register_profile(
    "local",
    deadline=None,
    max_examples=60,
    suppress_health_check=[HealthCheck.too_slow],  # a busy machine is no property of the code
    print_blob=True,
)
# elsewhere examples are random, and those that failed are kept in .hypothesis and tried first
settings.register_profile("ci", parent=settings.get_profile("local"), derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "local")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    path = Path(__file__).parents[2] / "shared" / "data"
    if not path.is_dir():
        pytest.skip(f"needs the annotated frames in {path}, a folder beside the checkout that is absent here")
    return path


@pytest.fixture
def know(monkeypatch):
    """Let the commands use a network that knows the cameras of the images to come."""
    from networks import KnownCameras  # slow, and most tests need no network

    def install(cameras):
        network = KnownCameras(cameras)
        for command in ("run", "clips", "localize"):
            monkeypatch.setattr(f"fieldcalib.cli.{command}.load_network", lambda options: network)
        return network

    return install
