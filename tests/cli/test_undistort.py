"""`fieldcalib undistort`: pixels of the pictures that it writes are those of the pinhole."""

import json
from functools import cache

import cv2
import numpy as np
import pytest

from fieldcalib import Calibration, Camera, Status, soccer
from fieldcalib.cli.main import main
from fieldcalib.draw import render_field
from fieldcalib.io.videos import VideoReader, VideoWriter
from fieldcalib.run_folder.record import RunRecord

FIELD = soccer()
SIZE = (640, 360)
BENT = Camera.from_angles(0.1, np.radians(78), 0.01, 700.0, (0.0, 62.0, -18.0), SIZE, k=(-0.3, 0.0))
PINHOLE = Camera(BENT.K, BENT.R, BENT.C, BENT.image_size)


def results(folder, cameras):
    folder.mkdir()
    lines = []
    for id, camera in cameras.items():
        status = Status.TOO_FEW_SEGMENTS if camera is None else Status.ACCEPTED
        found = (
            Calibration.without_camera(status, "") if camera is None else Calibration(camera, status, "", 0.0, 0.0, {})
        )
        lines.append({"id": id, **found.to_dict()})
    (folder / "cameras.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    return str(folder)


@cache
def _rendered(is_bent):
    return render_field(BENT if is_bent else PINHOLE, FIELD)


def rendered(camera):
    """The picture of one of both cameras, rendered once."""
    return _rendered(camera is BENT)


def difference(picture, other):
    """Share of the pixels that differ by more than a mark of paint does."""
    return float(np.mean(np.abs(picture.astype(int) - other.astype(int)).max(axis=-1) > 60))


def test_a_picture_becomes_that_of_the_pinhole(tmp_path, capsys):
    for id in ("a", "b"):
        cv2.imwrite(str(tmp_path / f"{id}.png"), rendered(BENT))
    inputs = [str(tmp_path / "a.png"), str(tmp_path / "b.png")]
    command = ["undistort", *inputs, "--cameras", results(tmp_path / "out", {"a": BENT, "b": None}), "--out"]
    assert main([*command, str(tmp_path / "flat")]) == 0
    assert "1 frame without distortion, 1 image without an accepted camera left out" in capsys.readouterr().out
    assert [path.name for path in (tmp_path / "flat").iterdir()] == ["a.png"]
    picture = cv2.imread(str(tmp_path / "flat" / "a.png"))
    inside = picture.any(axis=-1)
    picture[~inside] = rendered(PINHOLE)[~inside]
    assert difference(picture, rendered(PINHOLE)) < 0.25 * difference(picture, rendered(BENT))
    assert main([*command, str(tmp_path / "flat")]) == 2
    assert (
        "a.png is there already: remove the folder, if a run of this command was interrupted" in capsys.readouterr().err
    )


def test_a_single_picture_is_written_as_one(tmp_path, capsys):
    for id in ("a", "b"):
        cv2.imwrite(str(tmp_path / f"{id}.png"), rendered(BENT))
    cameras = ["--cameras", results(tmp_path / "out", {"a": BENT, "b": BENT})]
    flat = tmp_path / "new" / "flat.jpg"
    assert main(["undistort", str(tmp_path / "a.png"), *cameras, "--out", str(flat)]) == 0
    assert cv2.imread(str(flat)).shape == (360, 640, 3)
    assert main(["undistort", str(tmp_path / "a.png"), *cameras, "--out", str(tmp_path / "flat.txt")]) == 2
    assert "as .txt" in capsys.readouterr().err
    both = [str(tmp_path / "a.png"), str(tmp_path / "b.png")]
    assert main(["undistort", *both, *cameras, "--out", str(tmp_path / "flat.png")]) == 2
    assert "expected a folder, for 2 pictures are written as <id>.png" in capsys.readouterr().err


def test_a_fisheye_picture_becomes_that_of_the_pinhole(tmp_path):
    bent = Camera.from_angles(
        0.1, np.radians(75), 0.01, 330.0, (0.0, 50.0, -18.0), SIZE, k=(0.05, 0.0, 0.0, 0.0), fisheye=True
    )
    pinhole = Camera(bent.K, bent.R, bent.C, SIZE)
    seen, straight = render_field(bent, FIELD), render_field(pinhole, FIELD)
    cv2.imwrite(str(tmp_path / "a.png"), seen)
    folder = results(tmp_path / "out", {"a": bent})
    command = ["undistort", str(tmp_path / "a.png"), "--cameras", folder, "--out", str(tmp_path / "flat")]
    assert main(command) == 0
    picture = cv2.imread(str(tmp_path / "flat" / "a.png"))
    inside = picture.any(axis=-1)
    picture[~inside] = straight[~inside]
    assert difference(picture, straight) < 0.25 * difference(picture, seen)


def test_a_video_keeps_its_frames(tmp_path, capsys):
    with VideoWriter(tmp_path / "clip.mp4", 25.0) as video:
        for _ in range(6):
            video.write(rendered(BENT))
    cameras = {f"{n:06d}": BENT if n != 3 else None for n in range(1, 5)}
    command = ["undistort", str(tmp_path / "clip.mp4"), "--cameras", results(tmp_path / "out", cameras), "--out"]
    assert main([*command, str(tmp_path / "flat.mp4")]) == 0
    assert "3 frames without distortion, 1 frame without an accepted camera left as they are" in capsys.readouterr().out
    with VideoReader(tmp_path / "flat.mp4") as reader:
        frames = list(reader)
    assert len(frames) == 4
    assert difference(frames[0], rendered(PINHOLE)) < difference(frames[2], rendered(PINHOLE))
    assert main([*command, str(tmp_path / "clip.mp4")]) == 2
    assert main([*command, str(tmp_path / "flat")]) == 2


@pytest.mark.parametrize("command", ["undistort", "topview"])
def test_cameras_of_another_video_are_told_of(tmp_path, capsys, command):
    with VideoWriter(tmp_path / "other.mp4", 25.0) as video:
        for _ in range(2):
            video.write(rendered(BENT))
    out = results(tmp_path / "out", {"000000": BENT, "000001": BENT})
    for name in ("other", "clip"):
        RunRecord("run", {}, 1, "", "", 1, None, (), source=[f"/somewhere/{name}.mp4"]).write(tmp_path / "out")
        to = tmp_path / (f"{name}.png" if command == "topview" else f"flat_{name}.mp4")
        assert main([command, str(tmp_path / "other.mp4"), "--cameras", out, "--out", str(to)]) == 0
        said = capsys.readouterr().err
        assert (f"{out} has cameras of clip.mp4: is {tmp_path / 'other.mp4'} the same" in said) == (name == "clip")


def test_a_damaged_frame_of_a_video_is_left_out(tmp_path, capsys):
    path = tmp_path / "clip.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, SIZE)
    for _ in range(6):
        writer.write(rendered(BENT))
    writer.release()
    content = bytearray(path.read_bytes())
    second = [at for at in range(len(content) - 2) if content[at : at + 3] == b"\xff\xd8\xff"][1]
    content[second : second + 600] = bytes(600)
    path.write_bytes(content)
    cameras = {f"{n:06d}": BENT for n in (0, 2, 3, 4, 5)}  # as `run` writes them
    out = tmp_path / "a.mp4"
    command = ["undistort", str(path), "--cameras", results(tmp_path / "out", cameras), "--out", str(out)]
    assert main(command) == 1
    said = capsys.readouterr()
    assert "5 frames without distortion\n" in said.out
    assert f"{path}: announces 6 frames, 5 can be read" in said.err
    with VideoReader(out) as reader:
        assert len(list(reader)) == 5


def test_a_picture_of_another_size_is_refused(tmp_path, capsys):
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((90, 160, 3), np.uint8))
    command = ["undistort", str(tmp_path / "a.png"), "--cameras", results(tmp_path / "out", {"a": BENT})]
    assert main([*command, "--out", str(tmp_path / "flat")]) == 2
    assert "160x90 pixels, and its camera is of 640x360" in capsys.readouterr().err


def test_what_is_missing_is_explained(capsys):
    with pytest.raises(SystemExit):
        main(["undistort", "clip.mp4", "--out", "flat.mp4"])
    said = capsys.readouterr().err
    assert said.endswith("arguments are required: --cameras\n  --cameras DIR: results of run or calibrate\n")
