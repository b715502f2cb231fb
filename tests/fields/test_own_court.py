"""The courts of docs/how-to: what is in the file of one is found in a picture, labels of the others tell cameras."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from objects import relative_error
from synthetic import SIZE, random_frames

from fieldcalib import Camera, calibrate_batch, read
from fieldcalib.cli.main import main
from fieldcalib.draw.scene import render_field
from fieldcalib.io.field_files import read_field

PAGES = Path(__file__).parents[2] / "docs" / "how-to"
TRUTH = Camera.from_angles(0.1, 1.2, 0.0, 1000.0, (-1.0, 13.0, -5.0), (960, 540))


def files(page):
    """The files that a page of the docs has."""
    return re.findall(r"```yaml\n(.*?)```", (PAGES / f"{page}.md").read_text(encoding="utf-8"), re.DOTALL)


@pytest.fixture(scope="module")
def court(tmp_path_factory):
    text = files("own-court")[0]
    assert len(text.splitlines()) == 9
    path = tmp_path_factory.mktemp("court") / "court.yaml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "text",
    [
        pytest.param(text, id=name, marks=pytest.mark.slow if name == "track" else ())
        for name, text in zip(("squash", "table tennis", "netball", "track"), files("more-courts"), strict=True)
    ],
)
def test_further_courts_are_fields_whose_labels_give_back_their_cameras(tmp_path, text):
    path = tmp_path / "court.yaml"
    path.write_text(text, encoding="utf-8")
    field = read_field(path)
    least = 11 if "Lane" in text else 4  # two lines across the lanes
    frames, cameras = random_frames(4, seed=2, stands=("main center",), least_segments=least, field=field)
    found = calibrate_batch(field, frames, SIZE, prior=None)
    assert max(relative_error(one.camera, truth) for one, truth in zip(found, cameras, strict=True)) < 1e-5


def test_the_court_in_ten_lines_is_found_by_run(court, tmp_path):
    field = read_field(court)
    cv2.imwrite(str(tmp_path / "yard.png"), render_field(TRUTH, field))
    out = tmp_path / "out"
    assert main(["run", "--field", str(court), "--out", str(out), str(tmp_path / "yard.png")]) == 0
    found = read(out)["yard"]
    assert found.accepted, found.reason
    corners = [(x, y, 0.0) for x in (-5.0, 2.0, 5.0) for y in (-3.0, 3.0)]
    np.testing.assert_allclose(found.camera.project(corners), TRUTH.project(corners), atol=2.0)
