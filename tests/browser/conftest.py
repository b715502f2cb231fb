"""The page in a real browser: Chromium from the PATH, without a window, driven by Playwright.

All tests here have the marker `browser`, which the default run leaves out. They are skipped where there is no Chromium
or no Playwright; nothing is downloaded.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from browser.driving import ROOT, closing_windows, ending_servers, render

LARGEST = 200_000  # bytes of a picture in the docs
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
# without what a browser asks its maker for
ARGUMENTS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
COMPILE = """
import numpy as np
from fieldcalib import calibrate_batch, soccer
from data_tools.simulated import IMAGE_SIZE, observe, pan_over_field
rng = np.random.default_rng(0)
calibrate_batch(soccer(), [observe(camera, soccer(), rng, 1.0) for camera in pan_over_field(2)], IMAGE_SIZE)
"""


def pytest_collection_modifyitems(items):
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker("browser")


@pytest.fixture(scope="session")
def chromium():
    from playwright.sync_api import sync_playwright

    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    if path is None:
        pytest.skip("needs Chromium: no chromium, chromium-browser or google-chrome is on the PATH")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=ARGUMENTS)
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def compiled():
    """Numba has compiled the solver, which may take longer than a test waits."""
    subprocess.run([sys.executable, "-c", COMPILE], check=True, capture_output=True, cwd=ROOT)


@pytest.fixture
def serve(tmp_path, compiled):
    """Start servers, `serve(source, *arguments)`."""
    with ending_servers(tmp_path) as start:
        yield start


@pytest.fixture
def window(chromium):
    """Open windows of the page, `window(server)`."""
    with closing_windows(chromium) as open_window:
        yield open_window


@pytest.fixture(scope="session")
def picture(tmp_path_factory):
    """The file of a rendered frame."""
    path = tmp_path_factory.mktemp("pictures") / "frame.jpg"
    cv2.imwrite(str(path), render())
    return path


@pytest.fixture
def shoot(tmp_path):
    """Take a picture of a window: `shoot(window, name)`."""

    def take(one, name):
        for_docs = one.page.viewport_size["width"] == 1280
        folder = Path(os.environ.get("FIELDCALIB_SCREENSHOTS", tmp_path)) if for_docs else tmp_path
        one.page.mouse.move(3, 3)
        one.page.wait_for_timeout(400)  # tips go, crops come
        path = folder / f"{name}.jpg"
        one.page.screenshot(path=path, type="jpeg", quality=80)
        if for_docs:
            assert path.stat().st_size < LARGEST
        image = cv2.imread(str(path))
        assert image.std() > 10.0  # not empty

    return take


@pytest.fixture
def rng():
    return np.random.default_rng(0)
