"""Videos: what they announce and what can be read, and what was written of one."""

import os
import struct
import sys
from fractions import Fraction

import av
import cv2
import numpy as np
import pytest

from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.formats import IMAGES, VIDEOS
from fieldcalib.io.videos import VideoReader, VideoWriter

SIZE = (160, 90)
CODECS = {".mp4": "mp4v", ".avi": "MJPG", ".mkv": "MJPG"}


def pictures(count, size=SIZE):
    rng = np.random.default_rng(0)  # noise: every frame has bytes of its own
    return [rng.integers(0, 255, (size[1], size[0], 3), dtype=np.uint8) for _ in range(count)]


def make_video(path, count=60):
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*CODECS[path.suffix]), 25.0, SIZE)
    for picture in pictures(count):
        writer.write(picture)
    writer.release()
    return path


def announced_read_and_lost(path):
    with VideoReader(path) as video:
        read = sum(1 for _ in video)
        return video.count, read, video.count - read if video.loss() else 0


def decoded(path):
    with VideoReader(path) as video:
        return list(video)


# --- reading ---


@pytest.mark.parametrize("suffix", CODECS)
def test_a_whole_video_loses_nothing(tmp_path, suffix):
    assert announced_read_and_lost(make_video(tmp_path / f"a{suffix}")) == (60, 60, 0)


@pytest.mark.parametrize("suffix", [".avi", ".mkv"])
def test_a_video_that_is_cut_off(tmp_path, suffix, capfd):
    path = make_video(tmp_path / f"a{suffix}")
    content = path.read_bytes()
    path.write_bytes(content[: len(content) * 3 // 10])
    announced, read, lost = announced_read_and_lost(path)
    assert announced == 60
    assert 10 < read < 20
    assert lost == 60 - read


def test_what_is_said_of_a_loss(tmp_path, capfd):
    path = make_video(tmp_path / "a.mkv")
    with VideoReader(path) as video:
        assert len(list(video)) == 60
        assert video.loss() == ""
    content = bytearray(path.read_bytes())
    content[len(content) // 4 : len(content) // 2] = bytes(len(content) // 2 - len(content) // 4)
    path.write_bytes(content[: len(content) * 7 // 10])
    with VideoReader(path) as video:
        read = len(list(video))
        assert 20 < read < 40
        assert video.loss() == f"{path}: announces 60 frames, {read} can be read"


@pytest.mark.parametrize("suffix", CODECS)
def test_a_video_with_damage_in_the_middle(tmp_path, suffix, capfd):
    path = make_video(tmp_path / f"a{suffix}")
    content = bytearray(path.read_bytes())
    content[len(content) // 2 : len(content) * 5 // 8] = bytes(len(content) * 5 // 8 - len(content) // 2)
    path.write_bytes(content)
    announced, read, lost = announced_read_and_lost(path)
    assert announced == 60
    assert 5 < 60 - read == lost


def test_a_video_that_is_cut_off_while_it_is_read(tmp_path, capfd):
    path = make_video(tmp_path / "a.avi", 400)
    with VideoReader(path) as video:
        frames = iter(video)
        next(frames)
        os.truncate(path, path.stat().st_size // 4)
        read = 1 + sum(1 for _ in frames)
        assert 50 < read < 150
        assert video.loss() == f"{path}: announces 400 frames, {read} can be read"


def test_frames_before_the_edit_list_are_no_frames(tmp_path):
    """As in a clip that was cut out of a longer video without encoding it again."""
    path = make_video(tmp_path / "a.mp4")
    whole = decoded(path)
    content = bytearray(path.read_bytes())
    edit = content.index(b"elst") + 4
    _, _, duration, start = struct.unpack(">IIIi", content[edit : edit + 16])
    assert (duration, start) == (2400, 0)  # milliseconds, and the media's own units: 512 a frame
    content[edit + 8 : edit + 16] = struct.pack(">Ii", 1600, 20 * 512)
    path.write_bytes(content)
    assert announced_read_and_lost(path) == (40, 40, 0)
    assert all(map(np.array_equal, decoded(path), whole[20:]))


def test_a_video_with_too_many_pixels(tmp_path):
    path = make_video(tmp_path / "a.mp4", 1)
    with VideoReader(path, 160 * 90) as video:
        assert len(list(video)) == 1
    with pytest.raises(BrokenFileError, match=r"a\.mp4: has 160 x 90 pixels, more than 0.014399 million"):
        VideoReader(path, 160 * 90 - 1)


# --- writing ---


def write_video(path, images):
    with VideoWriter(path, 25.0) as video:
        for image in images:
            video.write(image)


def test_what_was_written_is_there(tmp_path):
    write_video(tmp_path / "a.mp4", pictures(5))
    assert announced_read_and_lost(tmp_path / "a.mp4") == (5, 5, 0)
    assert list(tmp_path.iterdir()) == [tmp_path / "a.mp4"]


def test_images_of_another_size_are_not_left_out(tmp_path):
    write_video(tmp_path / "a.mp4", [*pictures(2), *pictures(1, (80, 50)), *pictures(1, (50, 80))])
    with VideoReader(tmp_path / "a.mp4") as video:
        assert [image.shape for image in video] == [(90, 160, 3)] * 4


@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX limits")
def test_a_full_disk_is_an_error(tmp_path, capfd):
    import resource

    (tmp_path / "a.mp4").write_bytes(b"of an earlier run")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
    try:
        with pytest.raises(OSError, match=r"a\.mp4: \d+ of 60 frames were written: is the disk full\?"):
            write_video(tmp_path / "a.mp4", pictures(60))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == {"a.mp4": b"of an earlier run"}


def test_links_are_not_followed(tmp_path):
    """Neither that of the video nor one of a name that the unfinished one might have."""
    outside, out = tmp_path / "outside", tmp_path / "out"
    outside.write_text("untouched")
    out.mkdir()
    for name in ("a.mp4", ".a.mp4"):
        (out / name).symlink_to(outside)
    write_video(out / "a.mp4", pictures(3))
    assert outside.read_text() == "untouched"
    assert announced_read_and_lost(out / "a.mp4") == (3, 3, 0)


def test_two_unfinished_videos_of_one_name_do_not_meet(tmp_path):
    with VideoWriter(tmp_path / "a.mp4", 25.0) as first, VideoWriter(tmp_path / "a.mp4", 25.0) as second:
        for picture in pictures(4):
            first.write(picture)
            second.write(picture)
    assert announced_read_and_lost(tmp_path / "a.mp4") == (4, 4, 0)


def test_an_interrupted_video_leaves_nothing(tmp_path):
    def interrupted():
        yield from pictures(2)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_video(tmp_path / "a.mp4", interrupted())
    assert list(tmp_path.iterdir()) == []


def test_what_browsers_play(tmp_path, capfd):
    """H.264 with half the columns and rows of colour, which plays while it loads; and nothing is said of it."""
    with VideoWriter(tmp_path / "a.mp4", 30000 / 1001) as video:
        for picture in pictures(3):
            video.write(picture)
    with av.open(str(tmp_path / "a.mp4")) as container:
        (stream,) = container.streams
        assert (stream.codec.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
        assert stream.average_rate == Fraction(30000, 1001)
    content = (tmp_path / "a.mp4").read_bytes()
    assert content.index(b"moov") < content.index(b"mdat")
    assert capfd.readouterr() == ("", "")


def smooth(size, colour=(0.0, 0.0, 0.0)):
    x, y = (np.linspace(0.0, 1.0, length) for length in size)
    return (60.0 + 60.0 * x[None, :, None] + 60.0 * y[:, None, None] + np.array(colour)).astype(np.uint8)


@pytest.mark.parametrize("size", [(160, 90), (161, 90), (160, 91), (161, 91)])
def test_odd_sizes(tmp_path, size):
    image = smooth(size, (40.0, 0.0, -40.0))
    write_video(tmp_path / "a.mp4", [image] * 3)
    even = tuple(length + length % 2 for length in size)
    with VideoReader(tmp_path / "a.mp4") as video:
        for read in video:
            assert read.shape[1::-1] == even
            difference = read[: size[1], : size[0]].astype(float) - image
            assert np.abs(difference).mean() < 2.5  # of 255; a wrong conversion of colours is off by 5
            assert read[-1].mean() > image[-1].mean() - 6.0  # no black border
            assert read[:, -1].mean() > image[:, -1].mean() - 6.0


def moving(count=12):
    """Pictures in which a bright square moves to the right, ten pixels a frame."""
    frames = []
    for number in range(count):
        image = np.full((96, 160, 3), 40, np.uint8)
        image[40:56, 10 * number : 10 * number + 16] = (30, 200, 240)
        frames.append(image)
    return frames


def column_of_square(image):
    return np.mean(np.nonzero(image[..., 2] > 150)[1])


@pytest.mark.skipif(not hasattr(cv2, "imwriteanimation"), reason="needs OpenCV 4.11, which writes animations")
@pytest.mark.parametrize("ending", [".gif", ".webp"])
def test_animations_are_clips(tmp_path, ending):
    path, animation = tmp_path / f"clip{ending}", cv2.Animation()
    animation.frames, animation.durations = moving(), np.full(12, 40)
    assert cv2.imwriteanimation(str(path), animation)
    assert VIDEOS.recognises(path)
    with VideoReader(path) as video:
        assert (video.count, video.frames_per_second) == (12, pytest.approx(25.0))
        found = list(video)
        assert video.loss() == ""
    assert len(found) == 12
    assert [column_of_square(image) for image in found] == pytest.approx(10.0 * np.arange(12) + 7.5, abs=1.0)
    with VideoReader(path) as frames:
        for number in (7, 2, 11):
            assert column_of_square(frames.image(number)) == pytest.approx(10.0 * number + 7.5, abs=1.0)
        assert frames.image(12) is None


def test_a_webp_of_one_picture_is_none(tmp_path):
    path = tmp_path / "picture.webp"
    assert cv2.imwrite(str(path), moving()[0])
    assert not VIDEOS.recognises(path)
    assert IMAGES.recognises(path)
    path.write_bytes(b"RIFF")
    assert not VIDEOS.recognises(path)
    assert not VIDEOS.recognises(tmp_path / "missing.webp")
