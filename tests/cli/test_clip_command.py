"""From a clip to files on the command line: a video, or a folder of images that is said to be one."""

import json

import cv2
import numpy as np
import pytest
from commands import lines_of, run
from networks import FIELD, looked_at
from other_tools import blender_data

from fieldcalib import Camera
from fieldcalib.draw.scene import render_field
from fieldcalib.io.image_files import parse_image
from fieldcalib.io.videos import VideoReader, VideoWriter

TRUTHS = [Camera.from_angles(pan, 1.32, 0.0, 950.0, (1.0, 66.0, -16.0), (960, 540)) for pan in np.linspace(0.1, 0.4, 4)]


@pytest.fixture(scope="module")
def rendered():
    return [render_field(camera, FIELD, rng=np.random.default_rng(0)) for camera in TRUTHS]


def write_video(path, images):
    with VideoWriter(path, 25.0) as video:
        for image in images:
            video.write(image)


@pytest.fixture
def folder(tmp_path, rendered):
    """A clip as images whose names sort otherwise than their numbers, one of which is broken."""
    folder = tmp_path / "clip"
    folder.mkdir()
    for name, picture in zip(("part1_8", "part1_9", "part1_10", "part2_1"), rendered, strict=True):
        cv2.imwrite(str(folder / f"{name}.png"), picture)
    content = (folder / "part1_9.png").read_bytes()
    (folder / "part1_11.png").write_bytes(content[:100])
    return folder


def test_a_folder_is_a_clip_if_it_is_said(know, folder, rendered, tmp_path, capsys):
    know([TRUTHS[t] for t in looked_at(rendered)])
    out = tmp_path / "out"
    assert run("run", folder, "--clip", "--camera-files", "--out", out) == 1
    lines = lines_of(out)
    assert [line["id"] for line in lines] == ["part1_8", "part1_9", "part1_10", "part1_11", "part2_1"]
    assert [line["status"] for line in lines] == ["accepted"] * 3 + ["broken file", "accepted"]
    for line, truth in zip([*lines[:3], lines[4]], TRUTHS, strict=True):
        np.testing.assert_allclose(line["angles_degrees"]["pan"], np.degrees(truth.angles[0]), atol=0.1)
        assert line["basis"].startswith("lines")
    (problem,) = [line for line in capsys.readouterr().err.splitlines() if "part1_11.png" in line]  # once
    assert problem.startswith(f"fieldcalib: {folder / 'part1_11.png'}: ")
    written = {path.name for path in out.iterdir()}
    assert {
        "tripods.json",
        "clip.jsonl",
        "motion.png",
        "worst_frames.jpg",
        "overlay.mp4",
        "camera_part1_10.json",
    } <= written
    assert "camera_part1_11.json" not in written
    assert not any(name.startswith("overlay_") for name in written)
    with VideoReader(out / "overlay.mp4") as overlay:
        assert len(list(overlay)) == 4
    assert parse_image((out / "worst_frames.jpg").read_bytes()).size
    record = json.loads((out / "tripods.json").read_text())
    assert record["shots"] == [{"first_frame": 0, "last_frame": 3, "tripod": 0}]
    (tripod,) = record["tripods"]
    assert tripod["frames"] == 4
    for name, value in zip("xyz", (1.0, 66.0, -16.0), strict=True):
        found = tripod[f"position_{name}_m"]
        assert abs(found["value"] - value) < 3.0 * found["standard_deviation"] + 0.1
    clip = out / "clip.jsonl"
    clip.write_text(clip.read_text().replace('"frames_per_second": 25.0', '"frames_per_second": 30.0'))
    for options, rate in (((), 30), (("--fps", 50, "--overwrite"), 50)):
        assert run("export", out, "--format", "blender", *options) == 0
        settings, _ = blender_data({"camera.py": (out / "blender" / "camera.py").read_bytes()})
        assert settings["fps"] == rate


def test_names_come_before_numbers(know, tmp_path):
    folder = tmp_path / "clip"
    folder.mkdir()
    for name in ("b2", "a10", "a9", "b1"):
        cv2.imwrite(str(folder / f"{name}.png"), np.zeros((54, 96, 3), np.uint8))
    know([None] * 4)
    assert run("run", folder, "--clip", "--out", tmp_path / "out") == 0
    assert [line["id"] for line in lines_of(tmp_path / "out")] == ["a9", "a10", "b1", "b2"]


def test_a_folder_is_no_clip_otherwise(know, folder, tmp_path):
    know([TRUTHS[2], TRUTHS[0], TRUTHS[1], TRUTHS[3]])
    out = tmp_path / "out"
    assert run("run", folder, "--out", out) == 1
    lines = lines_of(out)
    assert [line["id"] for line in lines] == ["part1_10", "part1_11", "part1_8", "part1_9", "part2_1"]
    assert not any("basis" in line for line in lines)
    assert not (out / "tripods.json").exists()


@pytest.mark.parametrize("how", ["--independent", "--no-refinement"])
def test_the_frames_of_a_video_by_themselves(know, rendered, tmp_path, how):
    write_video(tmp_path / "a.mp4", rendered[:2])
    network = know(TRUTHS[:2])
    out = tmp_path / "out"
    assert run("run", tmp_path / "a.mp4", how, "--out", out) == 0
    assert len(network.maps) == 0  # it saw every frame
    lines = lines_of(out)
    assert [line["id"] for line in lines] == ["000000", "000001"]
    assert not any("basis" in line for line in lines)
    assert not (out / "tripods.json").exists()
    with VideoReader(out / "overlay.mp4") as overlay:
        assert len(list(overlay)) == 2


def test_clip_and_independent_exclude_each_other(know, tmp_path, capsys):
    know([])
    assert run("run", tmp_path, "--clip", "--independent", "--out", tmp_path / "out") == 2
    assert "not allowed with argument" in capsys.readouterr().err


def test_each_video_is_a_clip(know, rendered, tmp_path):
    write_video(tmp_path / "a.mp4", rendered[:1])
    write_video(tmp_path / "b.mp4", rendered[1:2])
    know(TRUTHS[:2])
    assert run("run", tmp_path / "a.mp4", tmp_path / "b.mp4", "--out", tmp_path / "out") == 0
    for name, truth in zip("ab", TRUTHS, strict=False):
        (line,) = lines_of(tmp_path / "out" / name)
        np.testing.assert_allclose(line["angles_degrees"]["pan"], np.degrees(truth.angles[0]), atol=0.1)


def test_images_of_several_sizes_are_no_clip(know, folder, tmp_path, capsys):
    cv2.imwrite(str(folder / "part1_10.png"), np.zeros((270, 480, 3), np.uint8))
    know([TRUTHS[0]] * 4)
    assert run("run", folder, "--clip", "--out", tmp_path / "out") != 0
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "480 x 270" in line]
    assert f"{folder / 'part1_10.png'} has 480 x 270 pixels, {folder / 'part1_8.png'} 960 x 540" in line
    assert not (tmp_path / "out" / "cameras.jsonl").exists()


def test_a_video_may_have_any_number_of_bytes(know, rendered, tmp_path):
    """It is not read as a whole, as an image is."""
    write_video(tmp_path / "a.mp4", rendered[:1])
    know([TRUTHS[0]])
    assert run("run", tmp_path / "a.mp4", "--max-megabytes", "0.0001", "--out", tmp_path / "out") == 0
    assert [line["status"] for line in lines_of(tmp_path / "out")] == ["accepted"]


def test_a_clip_without_a_pitch(know, tmp_path):
    write_video(tmp_path / "a.mp4", [np.full((270, 480, 3), 80, np.uint8)] * 3)
    know([None] * 3)
    out = tmp_path / "out"
    assert run("run", tmp_path / "a.mp4", "--out", out) == 0
    assert [line["status"] for line in lines_of(out)] == ["too few segments"] * 3
    tripods = json.loads((out / "tripods.json").read_text())
    (note,) = tripods.pop("notes")
    assert "is this soccer?" in note
    assert tripods == {
        "format": 3,
        "frames_per_second": 25.0,
        "shots": [{"first_frame": 0, "last_frame": 2, "tripod": None}],
        "tripods": [],
    }


@pytest.mark.parametrize("how", [["--independent"], ["--no-refinement"]])
def test_what_a_clip_is_taken_by_is_of_clips(know, rendered, tmp_path, capsys, how):
    write_video(tmp_path / "a.mp4", rendered[:1])
    know([TRUTHS[0]])
    assert run("run", tmp_path / "a.mp4", "--camera", "moving", *how, "--out", tmp_path / "out") == 2
    assert "--camera is of clips" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
