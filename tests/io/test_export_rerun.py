"""Recordings of Rerun, read back by its own command line."""

import os
import re
import subprocess
import sys

import numpy as np
import pytest

from fieldcalib import Camera, soccer
from fieldcalib.cli.main import main
from fieldcalib.draw.scene import image_curves
from fieldcalib.fields.catalogue import tennis
from fieldcalib.io.exports.rerun import bent_lines, rerun_files

FIELD = soccer()
CAMERA = Camera.from_angles(0.3, 1.3, 0.0, 1200.0, (2.0, 61.5, -15.25), (960, 540), k=(0.2, 0.0))


def printed(content, folder):
    """The chunks of a recording by entity, as the SDK prints them."""
    (folder / "a.rrd").write_bytes(content)
    command = [sys.executable, "-m", "rerun", "rrd", "print", "-vvv", str(folder / "a.rrd")]
    environment = os.environ | {"HOME": str(folder), "XDG_CONFIG_HOME": str(folder), "COLUMNS": "100000"}
    run = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    found = {}
    for chunk in re.split(r"^Chunk\(", run.stdout, flags=re.MULTILINE)[1:]:
        entity = re.search(r"entity_path: (\S+)", chunk).group(1)
        found[entity] = found.get(entity, "") + chunk
    return found


def rows_of(chunks, entity):
    """The lines of an entity by the frame on the timeline."""
    rows = [row for row in chunks[entity].splitlines() if "row_" in row]
    return dict(sorted((int(re.search(r"┆ (\d+) ", row).group(1)), row) for row in rows))


def numbers(text):
    return np.array(re.findall(r"-?\d+\.\d+(?:e-?\d+)?", text), dtype=float)


def test_a_recording_read_back_has_the_cameras_on_the_timeline(tmp_path):
    import rerun  # noqa: F401

    moved = Camera(CAMERA.K, CAMERA.R, CAMERA.C + [0.5, 0.0, 0.0], CAMERA.image_size, CAMERA.dist)
    frames = {"000010": CAMERA, "000011": None, "000012": moved}
    (content,) = rerun_files(frames, dict.fromkeys(frames, FIELD)).values()
    chunks = printed(content, tmp_path)
    assert {"/field", "/field/markings", "/field/camera", "/field/camera/image"} <= set(chunks)
    rows = rows_of(chunks, "/field/camera")
    assert list(rows) == [10, 11, 12]
    for number, camera in ((10, CAMERA), (12, moved)):
        values = numbers(rows[number])
        assert any(np.allclose(values[k : k + 3], camera.C, atol=1e-4) for k in range(len(values) - 2))
    assert "LineStrips2D" in chunks["/field/camera/image/markings"]


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
    assert list(rows_of(printed(content, tmp_path), "/field/camera")) == [0, 1]


def test_the_command_writes_a_recording(calibrated_folder, tmp_path):
    import rerun  # noqa: F401

    command = ["export", calibrated_folder, "--format", "rerun", "--out", tmp_path / "out", "--keep-rejected"]
    assert main([str(one) for one in command]) == 0
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["cameras.rrd"]
