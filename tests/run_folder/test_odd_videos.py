"""Videos with varying frame rates, with names like addresses, without their end, or replaced while they are read."""

import os
import re
from fractions import Fraction
from itertools import islice
from pathlib import Path

import av
import numpy as np
import pytest

from fieldcalib.io.clips import ClipInput
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.frame_range import Cut, Position
from fieldcalib.io.frame_source import Frame, VideoFrames
from fieldcalib.io.videos import VideoReader, VideoWriter

MILLISECONDS = Fraction(1, 1000)
TIMES = {"regular": np.arange(60) * 40, "irregular": np.cumsum(np.random.default_rng(0).integers(20, 100, 60))}


def picture(number):
    return np.random.default_rng(number).integers(0, 255, (96, 160, 3), dtype=np.uint8)


def written(path, times, codec, pixels="yuv420p", damaged=()):
    """A video whose frames are shown at some times, in ms; of damaged ones the code is noise."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25)
        stream.width, stream.height, stream.pix_fmt = 160, 96, pixels
        stream.codec_context.time_base = MILLISECONDS
        for time in times.tolist():
            frame = av.VideoFrame.from_ndarray(picture(time), format="bgr24")
            frame.pts, frame.time_base = time, MILLISECONDS
            container.mux([_noise(one) if time in damaged else one for one in stream.encode(frame)])
        container.mux(stream.encode(None))
    return path


def _noise(packet):
    noise = av.Packet(np.random.default_rng(packet.size).integers(0, 255, packet.size, dtype=np.uint8).tobytes())
    noise.pts, noise.dts, noise.time_base, noise.stream = packet.pts, packet.dts, packet.time_base, packet.stream
    noise.is_keyframe = packet.is_keyframe
    return noise


def loss_of(path):
    with VideoReader(path) as reader:
        count = sum(1 for _ in reader)
        return count, reader.loss()


@pytest.mark.parametrize("times", TIMES.values(), ids=TIMES)
@pytest.mark.parametrize(
    ("name", "codec"), [("a.mkv", "libx264"), pytest.param("a.webm", "libvpx", marks=pytest.mark.slow)]
)
def test_matroska_files(tmp_path, name, codec, times):
    path = written(tmp_path / name, times, codec)
    assert loss_of(path) == (60, "")
    content = path.read_bytes()
    path.write_bytes(content[: int(0.8 * len(content))])  # less than a second is lost
    count, loss = loss_of(path)
    assert 40 < count < 60
    announced = int(re.fullmatch(rf"{path}: announces (\d+) frames, {count} can be read", loss)[1])
    assert abs(announced - 60) <= (0 if times is TIMES["regular"] else 5)


@pytest.mark.parametrize("first", [0, 10])
@pytest.mark.parametrize(("name", "codec", "pixels"), [("a.mp4", "mpeg4", "yuv420p"), ("a.mkv", "mjpeg", "yuvj420p")])
def test_damaged_frames_are_left_out_and_those_after_them_keep_their_numbers(tmp_path, name, codec, pixels, first):
    lost = [first, first + 1, 30]
    path = written(tmp_path / name, TIMES["regular"], codec, pixels, damaged=[40 * number for number in lost])
    left = [number for number in range(60) if number not in lost]
    with VideoReader(path) as reader:
        frames = dict(reader.numbered())
        assert list(frames) == left
        assert reader.loss() == f"{path}: announces 60 frames, 57 can be read"
    with VideoReader(path, cut=Cut(Position(frame=0), Position(frame=31), 5)) as reader:
        assert [number for number, _ in reader.numbered()] == [n for n in range(0, 31, 5) if n not in lost]
    with VideoReader(path) as by_number:
        for number in (2, 59, 30, 31, 0, 58, 10, 11, 12):
            image = by_number.image(number)
            assert (image is None) == (number in lost)
            assert image is None or np.array_equal(image, frames[number])


@pytest.mark.skipif(os.name == "nt", reason="no such names on Windows")
def test_names_that_look_like_addresses(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = Path("12:30.mp4")
    with VideoWriter(path, 25.0) as writer:
        for number in range(5):
            writer.write(picture(number))
    assert loss_of(path) == (5, "")
    os.mkdir("a:b")
    with VideoWriter(Path("a:b") / "c.mp4", 25.0) as writer:
        writer.write(picture(0))


@pytest.fixture
def without_memory(monkeypatch):
    monkeypatch.setattr("fieldcalib.io.clips.HELD_BYTES", 0)


@pytest.mark.parametrize("frames", [3, 5, 9])
def test_a_clip_that_is_replaced_while_it_is_read(tmp_path, frames, without_memory):
    path = tmp_path / "clip.mp4"

    def write(count):
        with VideoWriter(path, 25.0) as writer:
            for number in range(count):
                writer.write(picture(number))

    write(5)
    clip = ClipInput(VideoFrames(path), progress=False)
    assert len(list(clip)) == 5
    write(frames)
    os.utime(path, ns=(1, 1))
    with pytest.raises(BrokenFileError, match=r"clip\.mp4: was replaced while it was read"):
        list(clip.frames())


class Counted:
    """Frames that count how often each is read."""

    files, frames_per_second, count, broken, loss = (), 25.0, 0, {}, ""

    def __init__(self, numbers):
        self.numbers, self.read = numbers, []

    def __iter__(self):
        for number in self.numbers:
            self.read.append(number)
            yield Frame(str(number), picture(number))


@pytest.mark.parametrize(("held", "again"), [(5, []), (2, [0, 1, 2]), (0, [0, 1, 2, 3, 4])])
def test_the_last_frames_of_a_clip_are_read_once(monkeypatch, held, again):
    monkeypatch.setattr("fieldcalib.io.clips.HELD_BYTES", held * picture(0).nbytes)
    clip = ClipInput(source := Counted(range(5)), progress=False)
    for _ in range(2):
        frames = list(clip.frames())
        assert [frame.id for frame in frames] == [*"01234"]
        assert all(np.array_equal(frame.image, picture(number)) for number, frame in enumerate(frames))
    assert source.read == [*range(5), *again]


def test_a_reading_that_is_left_is_gone_on_with():
    clip = ClipInput(source := Counted(range(5)), progress=False)
    assert clip.placement() is not None
    assert len(list(islice(clip, 3))) == 3
    assert len(list(clip)) == 5
    assert source.read == [*range(5)]


@pytest.mark.parametrize("frames", [3, 9])
def test_images_that_come_and_go(frames, without_memory):
    source = Counted(range(5))
    clip = ClipInput(source, progress=False)
    assert len(list(clip)) == 5
    source.numbers = range(frames)
    with pytest.raises(BrokenFileError, match="was the input replaced"):
        list(clip.frames())
