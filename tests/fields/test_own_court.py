"""The court of docs/how-to/own-court.md: what is in its file is found in a picture."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from fieldcalib import Camera, read
from fieldcalib.cli.main import main
from fieldcalib.draw.scene import render_field
from fieldcalib.io.field_files import read_field

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "own-court.md"
TRUTH = Camera.from_angles(0.1, 1.2, 0.0, 1000.0, (-1.0, 13.0, -5.0), (960, 540))


@pytest.fixture(scope="module")
def court(tmp_path_factory):
    text, *_ = re.findall(r"```yaml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert len(text.splitlines()) == 10
    path = tmp_path_factory.mktemp("court") / "court.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_court_in_ten_lines_is_found_by_run(court, tmp_path):
    field = read_field(court)
    cv2.imwrite(str(tmp_path / "yard.png"), render_field(TRUTH, field))
    out = tmp_path / "out"
    assert main(["run", "--field", str(court), "--out", str(out), str(tmp_path / "yard.png")]) == 0
    found = read(out)["yard"]
    assert found.accepted, found.reason
    corners = [(x, y, 0.0) for x in (-5.0, 2.0, 5.0) for y in (-3.0, 3.0)]
    np.testing.assert_allclose(found.camera.project(corners), TRUTH.project(corners), atol=2.0)
