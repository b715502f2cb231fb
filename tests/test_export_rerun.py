"""Recordings of Rerun, read back by its own command line."""

import os
import re
import subprocess
import sys

import numpy as np
import pytest

from fieldcalib import Camera, soccer
from fieldcalib.draw.scene import image_curves
from fieldcalib.fields.sports.tennis import tennis
from fieldcalib.io.exports.rerun import bent_lines, rerun_files

FIELD = soccer()
CAMERA = Camera.from_angles(0.3, 1.3, 0.0, 1200.0, (2.0, 61.5, -15.25), (960, 540), k=(0.2, 0.0))


def printed(content, folder):
    """The chunks of a recording by entity, as the SDK prints them."""
    (folder / "a.rrd").write_bytes(content)
    command = [sys.executable, "-m", "rerun", "rrd", "print", "-vvv", str(folder / "a.rrd")]
    environment = os.environ | {"HOME": str(folder), "XDG_CONFIG_HOME": str(folder), "COLUMNS": "100000"}
    run = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    chunks = re.split(r"^Chunk\(", run.stdout, flags=re.MULTILINE)[1:]
    return {re.search(r"entity_path: (\S+)", chunk).group(1): chunk for chunk in chunks}


def numbers(text):
    return np.array(re.findall(r"-?\d+\.\d+(?:e-?\d+)?", text), dtype=float)


def test_a_recording_read_back_has_the_cameras_on_the_timeline(tmp_path):
    import rerun  # noqa: F401

    moved = Camera(CAMERA.K, CAMERA.R, CAMERA.C + [0.5, 0.0, 0.0], CAMERA.image_size, CAMERA.dist)
    frames = {"000010": CAMERA, "000011": None, "000012": moved}
    (content,) = rerun_files(frames, dict.fromkeys(frames, FIELD)).values()
    chunks = printed(content, tmp_path)
    assert {"/field", "/field/markings", "/field/camera", "/field/camera/image"} <= set(chunks)
    (tmp_path / "text").write_text(chunks["/field/camera"])
    rows = [row for row in chunks["/field/camera"].splitlines() if "row_" in row]
    assert [int(re.search(r"┆ (\d+) ", row).group(1)) for row in rows] == [10, 11, 12]
    for row, camera in ((rows[0], CAMERA), (rows[2], moved)):
        values = numbers(row)
        assert any(np.allclose(values[k : k + 3], camera.C, atol=1e-4) for k in range(len(values) - 2))
    markings = chunks["/field/camera/image/markings"]
    assert "Middle line" in markings or "Circle central" in markings


def test_lines_are_bent_by_the_lens():
    straight = Camera(CAMERA.K, CAMERA.R, CAMERA.C, CAMERA.image_size)
    found = dict(bent_lines(CAMERA, FIELD))
    assert (
        max(
            np.abs(xy[:1] - pinhole[:1]).max()
            for xy, pinhole in zip(
                found.values(), (straight.project(FIELD[label].polyline(0.25)) for label in found), strict=True
            )
        )
        > 1.0
    )
    for label, xy in found.items():
        drawn = np.concatenate(image_curves(CAMERA, FIELD[label]))
        inside = np.all((xy >= 0) & (xy < CAMERA.image_size), axis=1)
        for pixel in xy[inside]:
            a, b = drawn[:-1], drawn[1:]
            along = np.clip(np.sum((pixel - a) * (b - a), axis=1) / np.sum((b - a) ** 2, axis=1).clip(1e-9), 0.0, 1.0)
            assert np.linalg.norm(a + along[:, None] * (b - a) - pixel, axis=1).min() < 0.5


def test_nothing_behind_the_camera_is_drawn():
    camera = Camera.from_angles(0.0, 1.4, 0.0, 900.0, (0.0, 5.0, -3.0), (960, 540))
    for _, xy in bent_lines(camera, FIELD):
        assert np.isfinite(xy).all()
        assert np.abs(xy).max() < 1100.0


def test_without_cameras_or_fields_there_is_no_recording():
    with pytest.raises(ValueError, match="no camera to export"):
        rerun_files({"a": None}, {})
    with pytest.raises(ValueError, match="no frame has a field"):
        rerun_files({"a": CAMERA}, {"a": None})


def test_names_that_are_no_numbers_are_in_order(tmp_path):
    import rerun  # noqa: F401

    court = tennis()
    camera = Camera.from_angles(0.0, 1.2, 0.0, 900.0, (0.0, 25.0, -9.0), (960, 540))
    (content,) = rerun_files({"b": camera, "a": camera}, {"b": court, "a": court}).values()
    rows = [row for row in printed(content, tmp_path)["/field/camera"].splitlines() if "row_" in row]
    assert [int(re.search(r"┆ (\d+) ", row).group(1)) for row in rows] == [0, 1]
