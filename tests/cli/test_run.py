"""From images and videos to cameras on the command line, with a network that knows the cameras."""

import json
import re
import sys
import zipfile
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import cv2
import numpy as np
import pytest
from commands import calibrate, lines_of, run
from networks import FIELD, KnownCameras, band_maps, probabilities
from pictures import picture
from views import camera

from fieldcalib.assess.findings import Status
from fieldcalib.draw.overlays import draw_calibration
from fieldcalib.images.from_images import calibrate_from_images, calibrate_pictures
from fieldcalib.io import frame_source, image_files
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.formats import IMAGES, VIDEOS
from fieldcalib.io.frame_source import Frame
from fieldcalib.io.image_files import IMAGES_AT_ONCE, NO_IMAGE, parse_image
from fieldcalib.io.output_folder import output_folder
from fieldcalib.io.soccernet import camera_from_record
from fieldcalib.io.videos import VideoReader, VideoWriter
from fieldcalib.metrics.cameras import camera_difference
from fieldcalib.run_folder.engine import frames_of_files

SIZE = (960, 540)
TRUTHS = [camera(pan, 78, 1400, (0, 68, -17), k=(0.06, 0.0)) for pan in (24, -22)]


def encoded(image, suffix=".png"):
    return cv2.imencode(suffix, image)[1].tobytes()


# --- from Python ---


def test_images_of_several_sizes_become_cameras():
    truths = [TRUTHS[0], TRUTHS[1].scaled((1280, 720))]
    found = calibrate_from_images(FIELD, [picture(truth) for truth in truths], KnownCameras(truths))
    for truth, calibration in zip(truths, found, strict=True):
        assert calibration.accepted
        assert camera_difference(calibration.camera, truth, FIELD).reprojection < 1.5


def test_a_picture_that_is_not_calibrated_is_not_drawn_on():
    image = np.zeros((540, 960, 3), np.uint8)
    (calibration,) = calibrate_from_images(FIELD, [image], KnownCameras([None]))
    assert str(calibration.status) == "too few segments"
    drawn = draw_calibration(image, calibration, FIELD)
    assert not drawn[:500].any()
    assert drawn[500:].any()


def test_a_network_that_mistakes_other_lines_for_penalty_areas_is_corrected():
    truth, elsewhere = (camera(pan, 75, 1000, (-2, 66, -16)) for pan in (3, 12))
    network = KnownCameras([truth])
    maps, mistaken = band_maps(truth), band_maps(elsewhere)
    for index, label in enumerate(network.classes):
        if label.startswith(("Big rect.", "Small rect.", "Circle right")):
            maps[index] = mistaken[index]
    network.maps = [probabilities(maps)]
    (calibration,) = calibrate_from_images(FIELD, [picture(truth)], network)
    assert calibration.accepted
    assert camera_difference(calibration.camera, truth, FIELD).reprojection < 1.5


# --- squashed and cropped pictures ---


@pytest.mark.parametrize(
    ("true_camera", "declaration"),
    [
        (TRUTHS[0].scaled((640, 640)), ["--display-size", "960x540"]),
        (TRUTHS[0].cropped((320, 0), (640, 540)), ["--crop-of", "960x540+320+0"]),
    ],
    ids=["squashed", "cropped"],
)
def test_declared_pictures(know, tmp_path, true_camera, declaration, capsys):
    image = picture(true_camera)
    (tmp_path / "a.png").write_bytes(encoded(image))
    know(
        [true_camera.scaled(SIZE) if true_camera.image_size == (640, 640) else true_camera]
    )  # a part is seen by itself
    assert run("run", tmp_path / "a.png", "--camera-files", "--out", tmp_path / "out", *declaration) == 0
    assert "nearly square" not in capsys.readouterr().err
    (line,) = lines_of(tmp_path / "out")
    assert line["verdict"] in ("good", "check")
    record = json.loads((tmp_path / "out" / "camera_a.json").read_text())
    found = camera_from_record(record, true_camera.image_size)
    assert camera_difference(found, true_camera, FIELD).reprojection < 1.5
    overlay = parse_image((tmp_path / "out" / "overlay_a.jpg").read_bytes())
    assert overlay.shape == image.shape


def test_pictures_that_are_nearly_square_are_asked_about(know, tmp_path, capsys):
    truth = TRUTHS[0].cropped((160, -50), (640, 640))
    (tmp_path / "a.png").write_bytes(encoded(picture(truth)))
    know([truth, None])  # nothing is found in it if it is taken for squashed
    assert run("run", tmp_path / "a.png", "--out", tmp_path / "out") == 0
    said = capsys.readouterr().err
    assert "1 of 1 frame is nearly square" in said
    assert "squashed, which --aspect declares, or cropped, which --crop-of does" in said


def test_a_squashed_picture_has_the_camera_of_its_pixels(know, tmp_path, capsys):
    truth = TRUTHS[0].scaled((640, 640))
    (tmp_path / "a.png").write_bytes(encoded(picture(truth)))
    know([truth, TRUTHS[0].scaled((1138, 640))])
    assert run("run", tmp_path / "a.png", "--camera-files", "--out", tmp_path / "out") == 0
    assert "nearly square" not in capsys.readouterr().err
    (line,) = lines_of(tmp_path / "out")
    assert "was squashed from 16:9" in line["message"]
    found = camera_from_record(json.loads((tmp_path / "out" / "camera_a.json").read_text()), (640, 640))
    assert found.K[1, 1] / found.K[0, 0] == pytest.approx(16 / 9, rel=1e-3)
    assert camera_difference(found, truth, FIELD).reprojection < 1.5


def test_black_borders_are_left_out(know, tmp_path):
    image = np.zeros((720, 960, 3), np.uint8)
    image[90:630] = picture(TRUTHS[0])
    (tmp_path / "a.png").write_bytes(encoded(image))
    know([TRUTHS[0]])
    assert run("run", tmp_path / "a.png", "--camera-files", "--out", tmp_path / "out") == 0
    (line,) = lines_of(tmp_path / "out")
    assert "the picture is in 960 x 540 at 0, 90" in line["message"]
    found = camera_from_record(json.loads((tmp_path / "out" / "camera_a.json").read_text()), (960, 720))
    assert camera_difference(found, TRUTHS[0].cropped((0, -90), (960, 720)), FIELD).reprojection < 2.0


def test_pictures_that_do_not_fit_are_broken(know, tmp_path, capsys):
    for name, size in (("a", (540, 480)), ("b", (540, 500))):
        (tmp_path / f"{name}.png").write_bytes(encoded(np.zeros((*size, 3), np.uint8)))
    know(3 * [None])  # once more padded, and once more as a whole picture
    assert run("run", tmp_path, "--out", tmp_path / "out", "--crop-of", "960x540+480+0") == 1
    problem = "does not fit, with 500 x 540 pixels, into the frame of 960x540+480+0"
    assert capsys.readouterr().err.startswith(
        f"fieldcalib: {tmp_path / 'b.png'}: {problem}\nfieldcalib: 1 frame to look"
    )
    assert [line["status"] for line in lines_of(tmp_path / "out")] == ["too few segments", "broken file"]


def test_frames_that_are_too_large_are_refused(know, tmp_path, capsys):
    (tmp_path / "a.png").write_bytes(encoded(np.zeros((54, 96, 3), np.uint8)))
    know([])
    assert run("run", tmp_path / "a.png", "--out", tmp_path / "out", "--display-size", "30000x30000") == 2
    assert "has 30000 x 30000 pixels, more than 50 million" in capsys.readouterr().err


def test_a_video_that_does_not_fit_is_one_line(know, tmp_path, capfd):
    write_video(tmp_path / "a.mp4", [np.zeros((54, 96, 3), np.uint8)] * 3)
    know([])
    assert run("run", tmp_path / "a.mp4", "--out", tmp_path / "out", "--crop-of", "100x100+10+0") == 2
    assert f"fieldcalib: {tmp_path / 'a.mp4'}: does not fit, with 96 x 54" in capfd.readouterr().err


# --- verdict ---


def test_rejected_cameras_are_written_on_request_only(know, tmp_path, capsys):
    """The network has the lines of a camera, the image has none."""
    grass = picture(TRUTHS[1])
    grass[:] = np.median(grass, axis=(0, 1))
    (tmp_path / "a.png").write_bytes(encoded(grass))
    cameras = {}
    for options in (["--keep-rejected"], []):  # the camera of the run before is removed
        know([TRUTHS[0]])
        assert run("run", tmp_path / "a.png", "--out", tmp_path, "--camera-files", "--overwrite", *options) == 0
        (line,) = lines_of(tmp_path)
        assert line["verdict"] == "reject"
        assert line["reason"] == line["message"]
        summary = json.loads((tmp_path / "summary.json").read_text())
        assert summary["verdict"] == {"good": 0, "check": 0, "reject": 1}
        assert summary["completeness"] == 100.0 * summary["cameras"]
        cameras[tuple(options)] = summary["cameras"], (tmp_path / "camera_a.json").exists()
    assert cameras == {("--keep-rejected",): (1, True), (): (0, False)}
    assert "0 cameras of 1 frame" in capsys.readouterr().out


def test_an_implausible_camera_has_no_file(know, tmp_path, monkeypatch):
    def implausible(*arguments, **options):
        (found,) = calibrate_pictures(*arguments, **options)
        return [replace(found, status=Status.IMPLAUSIBLE)]

    monkeypatch.setattr("fieldcalib.run_folder.engine.calibrate_pictures", implausible)
    (tmp_path / "a.png").write_bytes(encoded(picture(TRUTHS[0])))
    know([TRUTHS[0]])
    assert run("run", tmp_path / "a.png", "--camera-files", "--out", tmp_path) == 0
    assert not (tmp_path / "camera_a.json").exists()


# --- images ---


def test_a_folder_of_images(know, tmp_path, capsys):
    good = encoded(picture(TRUTHS[0]), ".jpg")
    folder, out = tmp_path / "in", tmp_path / "out"
    folder.mkdir()
    (folder / "a.jpg").write_bytes(good)
    (folder / "b.png").write_bytes(encoded(np.zeros((540, 960, 3), np.uint8)))
    (folder / "c.jpg").write_bytes(good[: len(good) // 2])
    (folder / "d.PNG").write_bytes(encoded(picture(TRUTHS[1])))
    (folder / "overlay_a.jpg").write_bytes(b"of an earlier run")
    (folder / "notes.txt").write_bytes(b"")
    know([TRUTHS[0], None, TRUTHS[1]])
    assert run("run", folder, "--camera-files", "--out", out) == 1
    output = capsys.readouterr()
    assert "c.jpg: is cut off: the end of the JPEG is missing" in output.err
    assert output.out == f"2 cameras of 4 frames in {out}: 2 good, 1 reject, 1 broken file\n"
    lines = lines_of(out)
    assert [line["id"] for line in lines] == ["a", "b", "c", "d"]
    assert [line["status"] for line in lines] == ["accepted", "too few segments", "broken file", "accepted"]
    assert {path.name for path in out.iterdir()} == {
        *("camera_a.json", "camera_d.json", "cameras.jsonl", "solver.jsonl", "run.json", "summary.json"),
        *("overlay_a.jpg", "overlay_b.jpg", "overlay_d.jpg"),
    }
    for id, truth in (("a", TRUTHS[0]), ("d", TRUTHS[1])):
        estimated = camera_from_record(json.loads((out / f"camera_{id}.json").read_text()))
        assert camera_difference(estimated, truth, FIELD).reprojection < 1.5
    summary = json.loads((out / "summary.json").read_text())
    assert summary["frames"] == 4
    assert summary["options"]["input"] == [str(folder)]
    overlay = parse_image((out / "overlay_a.jpg").read_bytes())
    assert np.mean(overlay[:, :, 1] < 0.6 * overlay[:, :, 2].astype(float)) > 0.005  # magenta


def test_a_zip_and_a_single_image(know, tmp_path):
    content = encoded(picture(TRUTHS[0]))
    with zipfile.ZipFile(tmp_path / "in.zip", "w") as archive:
        archive.writestr("frames/7.png", content)
    (tmp_path / "8.png").write_bytes(content)
    know([TRUTHS[0], TRUTHS[0]])
    assert run("run", tmp_path / "in.zip", tmp_path / "8.png", "--out", tmp_path / "out") == 0
    assert [line["id"] for line in lines_of(tmp_path / "out")] == ["7", "8"]


@pytest.mark.parametrize(
    "convert",
    [
        lambda image: image.astype(np.uint16) * 257,
        lambda image: cv2.cvtColor(image, cv2.COLOR_BGR2GRAY),
        lambda image: cv2.cvtColor(image, cv2.COLOR_BGR2BGRA),
    ],
    ids=["16 bits", "grey", "with alpha"],
)
def test_kinds_of_images(know, tmp_path, convert):
    (tmp_path / "a.png").write_bytes(encoded(convert(picture(TRUTHS[0]))))
    know([TRUTHS[0]])
    assert run("run", tmp_path / "a.png", "--out", tmp_path) == 0
    (line,) = lines_of(tmp_path)
    assert line["status"] == "accepted"


@pytest.mark.parametrize("size", [(1, 1), (7, 300), (2000, 3), (90, 160)])
def test_odd_images_have_a_verdict(know, tmp_path, size):
    (tmp_path / "a.png").write_bytes(encoded(np.full((*size, 3), 90, np.uint8)))
    know(2 * [TRUTHS[0]])  # one of 1 x 1 may be squashed
    assert run("run", tmp_path / "a.png", "--out", tmp_path) == 0
    (line,) = lines_of(tmp_path)
    assert line["status"] != "broken file"


def test_one_bad_image_does_not_end_the_run(know, tmp_path, capsys):
    folder, out = tmp_path / "in", tmp_path / "out"
    folder.mkdir()
    (folder / "a.png").write_bytes(encoded(picture(TRUTHS[0])))
    (folder / "b.png").write_bytes(encoded(np.zeros((2, 32767, 3), np.uint8)))
    (folder / "c.bmp").write_bytes(encoded(np.zeros((900, 1100, 3), np.uint8), ".bmp"))
    (folder / "d.png").write_bytes(encoded(np.zeros((900, 1100, 3), np.uint8)))
    (folder / "e.jpg").symlink_to("/dev/zero")
    for name in ("f.gif", "g.HEIC", "h.gif"):
        (folder / name).write_bytes(b"")
    know([TRUTHS[0]])
    assert run("run", folder, "--out", out, "--max-megabytes", 2, "--max-megapixels", 0.6) == 1
    assert capsys.readouterr().err.splitlines() == [
        "fieldcalib: skipped 2 .gif (f.gif, h.gif), 1 .HEIC (g.HEIC)",
        f"fieldcalib: {folder / 'b.png'}: has 32767 x 2 pixels: OpenCV's functions take up to 32766 a side",
        f"fieldcalib: {folder / 'c.bmp'}: has more than 2 MB; --max-megabytes of a command allows more",
        f"fieldcalib: {folder / 'd.png'}: has 1100 x 900 pixels, more than 0.6 million; "
        f"--max-megapixels of a command allows more",
        f"fieldcalib: {folder / 'e.jpg'}: cannot be read: it is no regular file",
    ]
    assert [line["status"] for line in lines_of(out)] == ["accepted", *["broken file"] * 4]
    assert "most_pixels" not in json.loads((out / "summary.json").read_text())["options"]


def test_large_images_are_not_in_memory_together(know, tmp_path, monkeypatch):
    monkeypatch.setattr(image_files, "PIXELS_AT_ONCE", 30_000)
    for name in "abcde":
        (tmp_path / f"{name}.png").write_bytes(encoded(np.zeros((100, 200, 3), np.uint8)))
    network, at_once = know([None] * 5), []

    class Watching:
        classes = network.classes

        def __call__(self, images):
            at_once.append(len(images))
            return network(images)

    monkeypatch.setattr("fieldcalib.cli.run.load_network", lambda options: Watching())
    assert run("run", tmp_path, "--out", tmp_path / "out") == 0
    assert at_once == [2, 2, 1]


def test_a_jpeg_with_a_thumbnail_is_not_cut_off():
    content = encoded(picture(TRUTHS[0]), ".jpg")
    thumbnail = encoded(np.zeros((16, 16, 3), np.uint8), ".jpg")
    exif = b"\xff\xe1" + (len(thumbnail) + 2).to_bytes(2, "big") + thumbnail
    assert parse_image(content[:2] + exif + content[2:]).shape == (540, 960, 3)
    with pytest.raises(BrokenFileError, match="is cut off"):
        parse_image((content[:2] + exif + content[2:])[:-1000])


@pytest.mark.parametrize("content", [b"", b"\xff\xd8\xff\xd9", b"BM" + bytes(60), b"\x89PNG\r\n\x1a\n" + bytes(30)])
def test_what_is_no_image(content):
    with pytest.raises(BrokenFileError, match="is no image that OpenCV can read"):
        parse_image(content)


def test_upper_case_names_are_found(tmp_path):
    (tmp_path / "1.JPG").write_bytes(b"")
    assert [file.id for file in IMAGES.find([tmp_path])] == ["1"]


# --- videos ---


def write_video(path, images, fps=25.0):
    with VideoWriter(path, fps) as video:
        for image in images:
            video.write(image)


def test_a_video(know, tmp_path):
    truths = [camera(pan, 78, 1400, (0, 68, -17), k=(0.06, 0.0)) for pan in (22, 23)]
    write_video(tmp_path / "match.mp4", [picture(truth) for truth in truths], fps=50.0)
    know(truths)
    out = tmp_path / "out"
    assert run("run", tmp_path / "match.mp4", "--out", out, "--line-width", "0") == 0  # as the pictures are drawn
    lines = lines_of(out)
    assert [line["id"] for line in lines] == ["000000", "000001"]
    for line, truth in zip(lines, truths, strict=True):
        assert line["status"] == "accepted"
        np.testing.assert_allclose(line["angles_degrees"]["pan"], np.degrees(truth.angles[0]), atol=0.1)
    assert {path.name for path in out.iterdir()} == {
        *("cameras.jsonl", "solver.jsonl", "run.json", "summary.json"),
        *("overlay.mp4", "clip.jsonl", "tripods.json", "motion.png", "worst_frames.jpg"),
    }
    assert all(line["basis"].startswith("lines") for line in lines)
    with VideoReader(out / "overlay.mp4") as overlay:
        assert overlay.frames_per_second == 50.0
        assert [image.shape for image in overlay] == [(540, 960, 3)] * 2


@pytest.mark.slow
def test_a_video_without_pictures_has_the_same_cameras(know, tmp_path):
    truths = [camera(pan, 78, 1400, (0, 68, -17)) for pan in (22, 23)]
    write_video(tmp_path / "match.mp4", [picture(truth) for truth in truths])
    contents = []
    for name, *options in (("drawn",), ("one thread", "--threads", "1"), ("bare", "--no-pictures", "--report")):
        know(truths)
        assert run("run", tmp_path / "match.mp4", "--out", tmp_path / name, *options) == 0
        contents.append({path.name: path.read_bytes() for path in (tmp_path / name).iterdir()})
    drawn, alone, bare = contents
    assert set(drawn) - set(bare) == {"overlay.mp4", "motion.png", "worst_frames.jpg"}
    assert set(bare) - set(drawn) == {"report.html"}
    for name in ("cameras.jsonl", "solver.jsonl", "clip.jsonl"):
        assert drawn[name] == bare[name] == alone[name]
    assert drawn["worst_frames.jpg"] == alone["worst_frames.jpg"]


def test_open_shows_the_first_frame_that_is_not_good(know, tmp_path, monkeypatch, capsys):
    import_module("starlette"), import_module("uvicorn")
    opened = []
    monkeypatch.setattr("fieldcalib.web.server.serve", lambda editor, frame: opened.append((list(editor.ids), frame)))
    for name, truth in zip("ac", TRUTHS, strict=True):
        (tmp_path / f"{name}.png").write_bytes(encoded(picture(truth)))
    (tmp_path / "b.png").write_bytes(encoded(np.zeros((540, 960, 3), np.uint8)))
    know([TRUTHS[0], None, TRUTHS[1]])
    run("run", *(tmp_path / f"{name}.png" for name in "abc"), "--out", tmp_path / "three", "--open")
    know(TRUTHS)
    run("run", tmp_path / "a.png", tmp_path / "c.png", "--out", tmp_path / "two", "--open")
    assert opened == [(["a", "b", "c"], 1), (["a", "c"], 0)]
    write_video(tmp_path / "one.mp4", [picture(TRUTHS[0])] * 2)
    assert run("run", tmp_path / "one.mp4", tmp_path / "a.png", "--out", tmp_path / "several", "--open") != 0
    assert "--open is of one clip or of images, not of 2 inputs" in capsys.readouterr().err
    assert not (tmp_path / "several").exists()


@pytest.mark.slow
def test_a_frame_that_cannot_be_read_is_told_without_pictures_too(know, tmp_path, capsys):
    truths = [camera(pan, 78, 1400, (0, 68, -17)) for pan in (22, 23)]
    for name, truth in zip("ac", truths, strict=True):
        (tmp_path / f"{name}.png").write_bytes(encoded(picture(truth)))
    (tmp_path / "b.png").write_bytes(b"none")
    for out, *options in (("drawn",), ("bare", "--no-pictures")):
        know(truths)
        assert (
            run("run", *(tmp_path / f"{name}.png" for name in "abc"), "--clip", "--out", tmp_path / out, *options) == 1
        )
        assert "b.png: " in capsys.readouterr().err
    assert lines_of(tmp_path / "bare") == lines_of(tmp_path / "drawn")


def test_images_without_pictures(know, tmp_path):
    (tmp_path / "a.png").write_bytes(encoded(picture(TRUTHS[0])))
    know(TRUTHS[:1])
    assert run("run", tmp_path / "a.png", "--out", tmp_path / "out", "--no-pictures") == 0
    names = {"cameras.jsonl", "solver.jsonl", "run.json", "summary.json"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == names


def test_a_portrait_video_has_verdicts(know, tmp_path):
    write_video(tmp_path / "phone.mp4", [np.full((640, 360, 3), 80, np.uint8)] * 3)
    know([None] * 12)  # some frames are looked at before, for the shape of the picture
    assert run("run", tmp_path / "phone.mp4", "--out", tmp_path / "out") == 0
    assert [line["status"] for line in lines_of(tmp_path / "out")] == ["too few segments"] * 3


def test_a_video_that_loses_frames_is_named(know, tmp_path, capfd):
    path = tmp_path / "a.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (64, 36))
    for image in np.random.default_rng(0).integers(0, 255, (12, 36, 64, 3), dtype=np.uint8):
        writer.write(image)
    writer.release()
    know([None] * 12)
    assert run("run", path, "--out", tmp_path / "whole") == 0
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    know([None] * 12)
    assert run("run", path, "--out", tmp_path / "out") == 1
    lines = lines_of(tmp_path / "out")
    assert 0 < len(lines) < 12
    assert f"fieldcalib: {path}: announces 12 frames, {len(lines)} can be read\n" in capfd.readouterr().err


@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX limits")
def test_an_overlay_that_cannot_be_written_is_an_error(know, tmp_path, capfd):
    import resource

    rng = np.random.default_rng(0)
    write_video(tmp_path / "a.mp4", rng.integers(0, 255, (16, 180, 320, 3), dtype=np.uint8))
    know([None] * 16)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, hard))
    try:
        assert run("run", tmp_path / "a.mp4", "--out", tmp_path / "out") == 2
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert re.search(r"overlay\.mp4: \d+ of 16 frames were written: is the disk full\?", capfd.readouterr().err)
    assert not (tmp_path / "out" / "overlay.mp4").exists()
    assert not (tmp_path / "out" / "summary.json").exists()


@pytest.mark.parametrize("command", [("run",), ("localize",), ("calibrate", "--size", "960x540")])
def test_an_input_of_which_nothing_can_be_read(command, know, tmp_path, capsys):
    """One sentence and a count, and no folder."""
    for name in "abc":
        (tmp_path / f"{name}.{'json' if 'calibrate' in command else 'png'}").write_bytes(b"none")
    know([])
    assert run(*command, tmp_path, "--out", tmp_path / "out") == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert said.startswith(f"fieldcalib: {tmp_path / 'a'}.")
    assert said.endswith("; nor can 2 others be read; nothing is written")
    assert not (tmp_path / "out").exists()


def test_a_clip_of_which_nothing_can_be_read(know, tmp_path, capsys):
    for name in "abc":
        (tmp_path / f"{name}.png").write_bytes(b"none")
    know([])
    assert run("run", "--clip", tmp_path, "--out", tmp_path / "out") == 2
    assert capsys.readouterr().err.endswith("TIFF or WebP\nfieldcalib: no frame can be read; nothing is written\n")
    assert not (tmp_path / "out").exists()


def test_a_folder_that_another_run_writes_to(know, tmp_path, capsys):
    (tmp_path / "a.png").write_bytes(encoded(np.zeros((54, 96, 3), np.uint8)))
    for command in ("run", "localize"):
        know([])  # is not asked
        with output_folder(tmp_path / "out"):
            assert run(command, tmp_path / "a.png", "--out", tmp_path / "out") == 2
        assert f"another run or page writes to {tmp_path / 'out'}" in capsys.readouterr().err
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="needs a folder that not even root can write to")
def test_a_folder_that_cannot_be_written_to(know, tmp_path, capsys):
    (tmp_path / "a.png").write_bytes(encoded(np.zeros((54, 96, 3), np.uint8)))
    for command in ("run", "localize"):
        know([])  # is not asked
        assert run(command, tmp_path / "a.png", "--out", "/proc/self") == 2
        assert "/proc/self" in capsys.readouterr().err


@pytest.mark.slow
def test_only_a_few_images_are_in_memory(know, tmp_path, monkeypatch):
    write_video(tmp_path / "long.mp4", [np.zeros((36, 64, 3), np.uint8)] * (2 * IMAGES_AT_ONCE + 1))
    network = know([None] * (2 * IMAGES_AT_ONCE + 1))
    read, seen, ahead = [], [], []

    class Watched(VideoReader):
        def numbered(self):
            read.clear()  # the first frame is read once before, to see whether it can be
            for number, image in super().numbered():
                read.append(number)
                yield number, image

    class Watching:
        classes = network.classes

        def __call__(self, images):
            ahead.append(len(read) - len(seen))
            seen.extend(images)
            return network(images)

    monkeypatch.setattr(frame_source, "VIDEOS", replace(VIDEOS, read=Watched))
    monkeypatch.setattr("fieldcalib.cli.run.load_network", lambda options: Watching())
    assert run("run", tmp_path / "long.mp4", "--out", tmp_path / "out", "--independent") == 0
    assert ahead == [IMAGES_AT_ONCE] * 2 + [1]
    assert len(lines_of(tmp_path / "out")) == 2 * IMAGES_AT_ONCE + 1


@pytest.mark.parametrize(
    "how", [(), pytest.param(("--independent",), marks=pytest.mark.slow)], ids=["together", "independent"]
)
def test_an_interrupted_video_leaves_nothing_half(know, tmp_path, monkeypatch, capsys, how):
    write_video(tmp_path / "a.mp4", [np.zeros((36, 64, 3), np.uint8)] * (IMAGES_AT_ONCE + 1))
    know([None] * (IMAGES_AT_ONCE + 1))
    calls = []

    def interrupt(*arguments, **_):
        calls.append(arguments)
        if len(calls) > 3:
            raise KeyboardInterrupt
        return arguments[0]

    monkeypatch.setattr("fieldcalib.cli.run_options.draw_calibration", interrupt)
    assert run("run", tmp_path / "a.mp4", "--out", tmp_path / "out", *how) == 130
    if how:  # its first unit was not done
        assert not (tmp_path / "out").exists()
        assert "no frame was done: run it again" in capsys.readouterr().err
    else:  # the clip is calibrated, and some of its frames are written
        left = {path.name for path in (tmp_path / "out").iterdir()}
        assert left == {
            "run.json",
            "cameras.jsonl",
            "solver.jsonl",
            ".part-0000.json",
        }
        assert re.search("[1-3] frames? done", capsys.readouterr().err)  # others are drawn beside them


def test_a_broken_video_is_one_line(know, tmp_path, capfd):
    (tmp_path / "a.mp4").write_bytes(b"no video")
    know([])
    assert run("run", tmp_path / "a.mp4", "--out", tmp_path / "out") == 2
    assert "a.mp4: is no video that FFmpeg can read" in capfd.readouterr().err
    assert not (tmp_path / "out").exists()


# --- localize ---


def test_localized_images_can_be_calibrated(know, tmp_path, capsys):
    for name, truth in zip("ab", TRUTHS, strict=True):
        (tmp_path / f"{name}.png").write_bytes(encoded(picture(truth)))
    know(TRUTHS)
    assert run("localize", tmp_path, "--out", tmp_path / "labels") == 0
    assert "segments a frame in 2 frames" in capsys.readouterr().out
    assert calibrate(tmp_path / "cameras", tmp_path / "labels") == 0
    for name, truth in zip("ab", TRUTHS, strict=True):
        estimated = camera_from_record(json.loads((tmp_path / "cameras" / f"camera_{name}.json").read_text()))
        assert camera_difference(estimated, truth, FIELD).reprojection < 6.0


def test_broken_images_are_named_by_localize(know, tmp_path, capsys):
    (tmp_path / "a.png").write_bytes(b"no image")
    (tmp_path / "b.png").write_bytes(encoded(np.zeros((54, 96, 3), np.uint8)))
    know([None])
    assert run("localize", tmp_path, "--out", tmp_path / "out") == 1
    assert "a.png: is no image that OpenCV can read" in capsys.readouterr().err
    assert {path.name: path.read_text() for path in (tmp_path / "out").glob("?.json")} == {"b.json": "{}\n"}


def test_an_image_one_pixel_wide_has_no_annotation(know, tmp_path, capsys):
    (tmp_path / "a.png").write_bytes(encoded(np.full((300, 1, 3), 90, np.uint8)))
    (tmp_path / "b.png").write_bytes(encoded(np.zeros((300, 1, 3), np.uint8)))
    know([TRUTHS[0], None])  # in the second one nothing is seen
    assert run("localize", tmp_path, "--out", tmp_path / "out") == 1
    assert (
        f"fieldcalib: {tmp_path / 'a.png'}: pixels of an image of 1 x 300 cannot be normalised"
        in capsys.readouterr().err
    )
    assert {path.name: path.read_text() for path in (tmp_path / "out").glob("?.json")} == {"b.json": "{}\n"}


# --- wrong usage ---


def test_what_cannot_be_run(know, tmp_path, capsys):
    know([])
    (tmp_path / "empty").mkdir()
    for command, inputs, complaint in (
        ("run", ["missing"], "missing does not exist"),
        ("run", ["missing.mp4"], "missing.mp4 does not exist: expected a video"),
        ("run", ["empty"], "empty holds no image: expected files named <id>.jpg or "),
        ("localize", ["a.mp4"], "expected images: fieldcalib run takes videos"),
    ):
        assert run(command, *[tmp_path / name for name in inputs], "--out", tmp_path / "out") == 2
        error = capsys.readouterr().err
        assert complaint in error
        assert len(error.splitlines()) == 1


def test_networks_that_are_not_there(tmp_path, capsys):
    (tmp_path / "a.png").write_bytes(encoded(np.zeros((54, 96, 3), np.uint8)))
    for command in ("run", "localize"):
        assert run(command, tmp_path / "a.png", "--out", tmp_path / "out", "--model", tmp_path / "none.onnx") == 2
        assert "none.onnx does not exist: expected a network in ONNX" in capsys.readouterr().err


def test_frames_are_read_when_they_are_asked_for(tmp_path):
    (tmp_path / "a.png").write_bytes(encoded(np.zeros((54, 96, 3), np.uint8)))
    (tmp_path / "b.png").write_bytes(b"")
    source = frames_of_files([tmp_path])
    assert (source.count, source.rate, source.ids) == (2, None, ["a", "b"])
    (tmp_path / "a.png").unlink()
    first, second = source
    assert source.broken == {"a": first.problem, "b": second.problem}
    assert first == Frame("a", None, first.problem, tmp_path / "a.png")
    assert "cannot be read" in first.problem
    assert second.problem == NO_IMAGE
