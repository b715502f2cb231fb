"""What many tests share: settings of Hypothesis, data beside the checkout, known networks, a calibrated folder.

Property tests have the marker `property`. They draw the same few cases on every run, unless `--hypothesis-seed` names
others or HYPOTHESIS_PROFILE=random leaves them to chance: those are more than twice as many.
"""

import os
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# Read when NumPy, PyTorch and OpenCV are imported: tests run side by side, and small matrices gain nothing.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENCV_FOR_THREADS_NUM", "1")

# Where nothing may be written beside the sources, processes that tests start would compile them again and again.
if os.environ.pop("PYTHONDONTWRITEBYTECODE", ""):
    os.environ["PYTHONPYCACHEPREFIX"] = str(Path(__file__).parents[1] / ".pytest_cache" / "compiled")

settings.register_profile(
    "random",  # cases that failed are kept in .hypothesis and tried first
    derandomize=False,  # which Hypothesis would do by itself where CI is set
    deadline=None,
    max_examples=20,
    suppress_health_check=[HealthCheck.too_slow],  # a busy machine is no property of the code
    print_blob=True,
)
settings.register_profile("same", parent=settings.get_profile("random"), derandomize=True, max_examples=5)

# Hypothesis also draws numbers that it reads in the modules of the checkout imported so far: the cases of a test would
# depend on the tests before it, and a seed would not repeat them. There is no setting for it; older versions read none.
with suppress(ImportError):
    from hypothesis.internal.conjecture import providers

    providers._get_local_constants = lambda: providers._local_constants


def pytest_configure(config):
    """Load the profile, before the modules of the tests are imported."""
    seeded = config.getoption("--hypothesis-seed") is not None
    profile = settings.get_profile(os.environ.get("HYPOTHESIS_PROFILE", "random" if seeded else "same"))
    if seeded:  # which Hypothesis ignores where cases are the same each time
        profile = settings(profile, derandomize=False, database=None)
    settings.register_profile("chosen", parent=profile)
    settings.load_profile("chosen")


@pytest.hookimpl(tryfirst=True)  # before -m selects
def pytest_collection_modifyitems(items):
    for item in items:
        if getattr(getattr(item, "obj", None), "is_hypothesis_test", False):
            item.add_marker("property")


@pytest.fixture
def one_thread():
    """OpenCV on one thread, as in each of several processes."""
    import cv2  # slow, and most tests draw nothing

    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    yield
    cv2.setNumThreads(before)


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


@pytest.fixture(scope="session")
def annotated_frames():
    """Frames and their true cameras by name, not in the order of the files."""
    from synthetic import random_frames

    frames, cameras = random_frames(4, seed=1, noise=0.5, stands=("main center",))
    return {name: (frame, camera) for name, frame, camera in zip("cadb", frames, cameras, strict=True)}


@pytest.fixture(scope="session")
def annotated_folder(annotated_frames, tmp_path_factory):
    """Annotations of the four frames, and what else lies beside annotations."""
    from commands import SIZE

    from fieldcalib.io.soccernet import format_annotation

    path = tmp_path_factory.mktemp("annotations")
    for name, (frame, _) in annotated_frames.items():
        (path / f"{name}.json").write_text(format_annotation(frame, SIZE))
    (path / "match_info.json").write_text("{}")
    (path / "a.jpg").write_bytes(b"")
    return path


@pytest.fixture(scope="session")
def calibrated_folder(annotated_folder, tmp_path_factory):
    """The output of a plain run."""
    from commands import calibrate

    out = tmp_path_factory.mktemp("result") / "new" / "folder"
    assert calibrate(out, annotated_folder) == 0
    return out
