"""Parts of videos: the same frames as of the whole, whatever the way to them."""

import cv2
import numpy as np
import pytest

from fieldcalib.io.cuts import Cut, Position
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.videos import VideoReader

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
    if film.suffix != ".ts":
        assert video.count == len(expected)


def test_images_that_were_read_stay_as_they_are(film):
    with VideoReader(film) as video:
        assert [shown(image) for image in list(video)] == list(range(COUNT))


def test_threads_change_nothing(film):
    assert read(film, threads=1)[1] == read(film, threads=2)[1] == list(range(COUNT))


def test_a_start_after_the_end(film):
    with pytest.raises(BrokenFileError, match=rf"film.* has no frame {COUNT}, the first that is asked for"):
        read(film, Position(frame=COUNT))


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
