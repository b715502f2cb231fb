"""What `calibrate_video` reads: videos, folders and zips of images, and what is none of these."""

import zipfile

import cv2
import numpy as np
import pytest
from networks import FIELD, KnownCameras

from fieldcalib import calibrate_from_images, calibrate_video
from fieldcalib.io.clips import clip_reader
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.videos import VideoWriter

NAMES = ("b1", "a9", "a10")
BLACK = np.zeros((54, 96, 3), np.uint8)


@pytest.fixture
def folder(tmp_path):
    """Images as bright as they come late in the clip."""
    folder = tmp_path / "clip"
    folder.mkdir()
    for name, value in zip(NAMES, (120, 40, 80), strict=True):
        cv2.imwrite(str(folder / f"{name}.png"), np.full((54, 96, 3), value, np.uint8))
    (folder / "notes.txt").write_text("no image")
    return folder


def read(source):
    reader = clip_reader(source)
    with reader() as images, reader() as again:
        first, second = ([round(image.mean() / 40.0) for image in some] for some in (images, again))
    assert first == second
    return first


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
