"""What `calibrate_video` reads: videos, folders and zips of images, and what is none of these."""

import pickle
import zipfile

import cv2
import numpy as np
import pytest
from networks import FIELD, KnownCameras

from fieldcalib import calibrate_from_images, calibrate_video
from fieldcalib.io.clips import Reading, clip_input
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.videos import VideoWriter

NAMES = ("b1", "a9", "a10")
BLACK = np.zeros((54, 96, 3), np.uint8)


class Read:
    """Images that can be iterated over, and no more."""

    def __init__(self, images):
        self.images = images

    def __iter__(self):
        return iter(self.images)


@pytest.fixture
def folder(tmp_path):
    """Images as bright as they come late in the clip."""
    folder = tmp_path / "clip"
    folder.mkdir()
    for name, value in zip(NAMES, (120, 40, 80), strict=True):
        cv2.imwrite(str(folder / f"{name}.png"), np.full((54, 96, 3), value, np.uint8))
    (folder / "notes.txt").write_text("no image")
    return folder


def brightness(frames):
    return [round(image.mean() / 40.0) for image in frames]


def read(source):
    """Brightness of the images of a clip, read twice; its parts read the same, here and in another process."""
    frames = clip_input(source)
    found = brightness(frames)
    assert brightness(frames) == found
    assert frames.count == len(found)
    parts = [frames.part(0, 1), frames.part(1, frames.count)]
    assert [value for part in parts for value in brightness(pickle.loads(pickle.dumps(part)))] == found
    assert brightness(parts[1].part(1, 2)) == found[2:3]
    return found


def test_images_are_in_the_order_of_their_numbers(folder, tmp_path):
    assert read(folder) == read(str(folder)) == [1, 2, 3]
    with zipfile.ZipFile(tmp_path / "clip.zip", "w") as archive:
        for name in NAMES:
            archive.write(folder / f"{name}.png", f"clip/{name}.png")
    assert read(tmp_path / "clip.zip") == [1, 2, 3]


def test_a_video_and_images(tmp_path):
    images = [np.full((54, 96, 3), 40 * k, np.uint8) for k in (1, 2, 3)]
    assert read(images) == read(np.array(images)) == [1, 2, 3]
    with VideoWriter(tmp_path / "clip.mp4", 25.0) as video:
        for image in images:
            video.write(image)
    assert read(tmp_path / "clip.mp4") == [1, 2, 3]
    assert read(Read(images)) == [1, 2, 3]


def test_a_part_of_a_video_that_is_cut_off_may_have_no_frame(tmp_path):
    """The file announces more frames than it has."""
    path = tmp_path / "clip.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (96, 54))
    for image in np.random.default_rng(0).integers(0, 255, (12, 54, 96, 3), np.uint8):
        writer.write(image)
    writer.release()
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    frames = clip_input(path)
    assert frames.count == 12
    parts = [frames.part(0, 4), frames.part(4, 8), frames.part(8, 12)]
    counts = [len(brightness(part)) for part in parts]
    assert counts[0] == 4 > counts[1] > counts[2] == 0
    told = Reading.joined([part.told() for part in parts])
    assert "announces 4 frames" in told.loss
    assert told.loss.endswith("others are missing in another part of it")


def test_a_broken_image_and_one_of_another_size_are_named(folder):
    cv2.imwrite(str(folder / "a11.png"), BLACK[::2, ::2])
    with pytest.raises(ValueError, match=r"of one size: \S*a11.png has 48 x 27 pixels, \S*a9.png 96 x 54"):
        read(folder)
    (folder / "a11.png").write_bytes(b"no image")
    with pytest.raises(BrokenFileError, match=r"a11.png: is no image that OpenCV can read"):
        read(folder)
    (folder / "empty").mkdir()
    with pytest.raises(FileNotFoundError, match="empty holds no image: expected files named"):
        calibrate_video(FIELD, folder / "empty", KnownCameras([]))


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (None, "expected the path of a video or of a folder of images, or a sequence of images, got None"),
        (3, "or a sequence of images, got 3"),
        (BLACK, r"got one array of shape \(54, 96, 3\): give \[image\]"),
        (iter([BLACK]), "expected a path or a sequence of images, got an iterator: the frames are read twice"),
    ],
    ids=["nothing", "number", "image", "iterator"],
)
def test_what_is_no_clip(source, message):
    with pytest.raises(ValueError, match=message):
        calibrate_video(FIELD, source, KnownCameras([]))


@pytest.mark.parametrize("network", ["network.onnx", KnownCameras, object()])
def test_what_is_no_network(network):
    with pytest.raises(ValueError, match=r"expected a network, as SegmentationNetwork.load\(path\) returns it, got"):
        calibrate_video(FIELD, [BLACK], network)
    with pytest.raises(ValueError, match="expected a network"):
        calibrate_from_images(FIELD, [BLACK], network)


def test_what_is_no_field():
    with pytest.raises(ValueError, match=r"expected a field, as soccer\(\), .* got 'soccer'"):
        calibrate_video("soccer", [BLACK])
    with pytest.raises(ValueError, match=r"expected a field, as soccer\(\)"):
        calibrate_from_images("soccer", [BLACK], KnownCameras([None]))
