"""Parts of videos: the same frames as of the whole, whatever the way to them."""

import re

import cv2
import numpy as np
import pytest
from commands import run
from networks import Blind

from fieldcalib import calibrate
from fieldcalib.io import decoders
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.frame_range import Cut, Position
from fieldcalib.io.videos import VideoReader, VideoWriter
from fieldcalib.results.frames import Pictures

COUNT, RATE = 260, 25.0


@pytest.fixture(scope="module", params=["mp4", "avi", "ts"])  # the last one has no index: jumps arrive elsewhere
def film(request, tmp_path_factory):
    """A video whose frames show their numbers in the brightness of eight squares."""
    path = tmp_path_factory.mktemp("film") / f"film.{request.param}"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), RATE, (128, 16))
    for number in range(COUNT):
        bits = np.array([number >> bit & 1 for bit in range(9)], np.uint8)
        image = np.zeros((16, 128, 3), np.uint8)
        image[:, :] = np.repeat(np.resize(np.append(bits, 0), 16), 8)[None, :128, None] * 255
        writer.write(image)
    writer.release()
    return path


def shown(image):
    bits = image[8, 4 : 9 * 8 : 8, 0] > 127
    return int(np.sum(bits << np.arange(9)))


def read(path, *cut, **options):
    with VideoReader(path, cut=Cut(*cut), **options) as video:
        images = list(video)
        assert video.loss() == ""
        return list(video.numbers[: len(images)]), [shown(image) for image in images], video


@pytest.mark.parametrize(
    ("start", "end", "step", "expected"),
    [
        ("0", None, 1, range(COUNT)),
        ("3f", "7f", 1, range(3, 7)),
        ("1", "3", 10, range(25, 75, 10)),
        ("210f", None, 1, range(210, COUNT)),  # far enough for a jump
        ("5", "240f", 7, range(125, 240, 7)),
        ("0f", None, 120, range(0, COUNT, 120)),
    ],
)
def test_a_cut_has_the_frames_that_the_whole_has_there(film, start, end, step, expected):
    numbers, frames, video = read(film, Position.parse(start), None if end is None else Position.parse(end), step)
    assert numbers == frames == list(expected)
    assert video.frames_per_second == pytest.approx(RATE / step)
    assert video.count == len(expected)


def test_images_that_were_read_stay_as_they_are(film):
    with VideoReader(film) as video:
        assert [shown(image) for image in list(video)] == list(range(COUNT))


def test_threads_change_nothing(film):
    assert read(film, threads=1)[1] == read(film, threads=2)[1] == list(range(COUNT))


def test_a_start_after_the_end(film):
    said = (
        rf"film.* (has no frame {COUNT}, the first that is asked for|ends after {COUNT} frames, before frame {COUNT})"
    )
    with pytest.raises(BrokenFileError, match=said):
        read(film, Position(frame=COUNT))
    said = rf"film.*: ends at 10.4 s \({COUNT} frames\), before 60 s: times are in seconds, and 60f is a frame"
    with pytest.raises(BrokenFileError, match=said):
        read(film, Position(seconds=60.0))


def test_an_end_beyond_that_of_the_video(film):
    _, _, video = read(film, Position(frame=0), Position(seconds=60.0))
    assert (
        video.beyond == f"{film} ends at 10.4 s ({COUNT} frames), before 60 s: times are in seconds, and 60f is a frame"
    )
    _, _, video = read(film, Position(frame=0), Position(frame=400))
    assert video.beyond == f"{film} ends after {COUNT} frames, before frame 400"
    for end in (None, Position(frame=COUNT), Position(seconds=COUNT / RATE)):
        assert read(film, Position(frame=0), end)[2].beyond == ""


def test_pictures_of_results_are_read_at_any_place(film, monkeypatch):
    """In any order, by one reader that jumps: it begins anew for the first frames alone."""
    opened, real = [], decoders._opened
    monkeypatch.setattr(decoders, "_opened", lambda *given, **more: opened.append(given) or real(*given, **more))
    decoders.index_of.cache_clear()
    pictures = Pictures((film,))
    for number in (COUNT - 1, 30, 200, 201, 130):
        assert shown(pictures.image(f"{number:06d}")) == number
    assert len(opened) == 2  # once for its index
    assert shown(pictures.image(f"{0:06d}")) == 0
    with pytest.raises(BrokenFileError, match="film"):
        pictures.image(f"{COUNT + 50:06d}")


@pytest.mark.parametrize("way", ["video", "one by one", "folder", "arrays"])
def test_an_end_beyond_is_said_by_calibrate(way, tmp_path):
    image = np.zeros((270, 480, 3), np.uint8)
    source, end, said = [image] * 3, "60f", "the input ends after 3 frames, before frame 60"
    if way in ("video", "one by one"):
        source, end, said = tmp_path / "a.mp4", 60, "a.mp4 ends at 0.12 s (3 frames), before 60 s: times are in seconds"
        with VideoWriter(source, RATE) as video:
            for _ in range(3):
                video.write(image)
    elif way == "folder":
        source = tmp_path
        for name in "abc":
            cv2.imwrite(str(tmp_path / f"{name}.png"), image)
    clip = False if way == "one by one" else None
    with pytest.warns(UserWarning, match=re.escape(said)):
        found = calibrate(source, end=end, clip=clip, network=Blind(), progress=False)
    assert len(found) == 3
    with pytest.raises(ValueError, match=r"ends (after 3 frames, before frame 70|at 0.12 s \(3 frames\), before 70 s)"):
        calibrate(source, start="70f" if end == "60f" else 70, clip=clip, network=Blind(), progress=False)


def test_an_end_beyond_is_said_by_run(tmp_path, capsys):
    path = tmp_path / "a.mp4"
    with VideoWriter(path, RATE) as video:
        for _ in range(3):
            video.write(np.zeros((270, 480, 3), np.uint8))
    for options in ([], ["--independent"]):
        assert run("run", path, "--out", tmp_path / "out", "--end", 60, "--overwrite", *options) == 0
        said = f"fieldcalib: {path} ends at 0.12 s (3 frames), before 60 s: times are in seconds, and 60f is a frame\n"
        assert capsys.readouterr().err.count(said) == 1
    assert run("run", path, "--out", tmp_path / "other", "--start", 60) == 2
    assert f"{path}: ends at 0.12 s (3 frames), before 60 s" in capsys.readouterr().err
    assert not (tmp_path / "other").exists()


def test_no_frame_between_start_and_end(film):
    with pytest.raises(ValueError, match="there is no frame from 8 to 200f"):
        read(film, Position.parse("8"), Position.parse("200f"))


def test_times_of_images():
    with pytest.raises(ValueError, match="images have no times: give the number of one, as 750f, not 90"):
        Cut(Position.parse("1:30")).numbers()


@pytest.mark.parametrize("text", ["", "f", "-1", "1:", "1:2:3:4", "1.5f", "nan", "１"])
def test_what_is_no_position(text):
    with pytest.raises(ValueError, match="expected a time, as 90"):
        Position.parse(text)
