"""JPEGs: whole ones with whatever follows them, and those whose coded pixels end too early."""

import struct
from itertools import pairwise

import cv2
import numpy as np
import pytest
from PIL import Image

from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.image_files import parse_image

RNG = np.random.default_rng(0)
SCENE = cv2.GaussianBlur(RNG.integers(0, 255, (270, 481, 3), dtype=np.uint8), (0, 0), 2.0)
TABLES, SCAN, END = b"\xff\xdb", b"\xff\xda", b"\xff\xd9"
KINDS = {
    "baseline": [],
    "grey": [],
    "colours not halved": [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444],
    "restarts": [cv2.IMWRITE_JPEG_RST_INTERVAL, 7],
    "progressive": [cv2.IMWRITE_JPEG_PROGRESSIVE, 1],
    "progressive with restarts": [cv2.IMWRITE_JPEG_PROGRESSIVE, 1, cv2.IMWRITE_JPEG_RST_INTERVAL, 7],
}


def coded(image, *options):
    return cv2.imencode(".jpg", image, options)[1].tobytes()


def segment(kind, content):
    return bytes([0xFF, kind]) + struct.pack(">H", len(content) + 2) + content


@pytest.fixture(params=KINDS)
def jpeg(request):
    return coded(SCENE[..., 0] if request.param == "grey" else SCENE, *KINDS[request.param])


def inserted(jpeg, before, content):
    at = jpeg.index(before) if before != END else jpeg.rindex(END)
    return jpeg[:at] + content + jpeg[at:]


@pytest.mark.parametrize(
    "behind",
    [
        RNG.integers(0, 255, 2_000_000, dtype=np.uint8).tobytes(),
        struct.pack(">I", 24) + b"ftypmp42" + bytes(12) + bytes.fromhex("ffda000cffda"),
        bytes(100),
        coded(SCENE)[:5000],
    ],
    ids=["noise", "MP4", "zeros", "half a JPEG"],
)
def test_whatever_follows_a_whole_picture(jpeg, behind):
    np.testing.assert_array_equal(parse_image(jpeg + behind), parse_image(jpeg))


@pytest.mark.parametrize(
    ("before", "content"),
    [
        (TABLES, segment(0xE1, b"Exif\0\0" + coded(SCENE))),
        (TABLES, segment(0xE1, b"Exif\0\0" + coded(SCENE)[:3000])),
        (TABLES, segment(0xFE, b"a comment with an end \xff\xd9 and a scan \xff\xda")),
        (TABLES, b"\xff\xff\xff"),
        (SCAN, segment(0xFE, b"\xff\xd9")),
        (END, b"\xff\xff\xff"),
        (END, segment(0xFE, b"\xff\xda")),
    ],
    ids=["thumbnail", "half a thumbnail", "comment", "fill bytes", "between scans", "fill bytes at the end", "tail"],
)
def test_what_may_stand_between_the_segments(jpeg, before, content):
    np.testing.assert_array_equal(parse_image(inserted(jpeg, before, content)), parse_image(jpeg))


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.999])
def test_a_picture_without_its_end(jpeg, share):
    for behind in (b"", bytes(3000)):
        with pytest.raises(BrokenFileError, match="is cut off"):
            parse_image(jpeg[: int(share * len(jpeg))].rstrip(b"\xff") + behind)


@pytest.mark.parametrize("share", [0.2, 0.5, 0.6])
@pytest.mark.parametrize("turned", [1, 3, 6, 8])
def test_a_part_of_a_picture_with_an_end_put_on_it(jpeg, share, turned):
    orientation = segment(0xE1, b"Exif\0\0" + struct.pack("<2sHIHHHIHHI", b"II", 42, 8, 1, 0x112, 3, 1, turned, 0, 0))
    scan = jpeg.index(SCAN) + 14
    part = jpeg[: scan + int(share * (len(jpeg) - scan))].rstrip(b"\xff") + END
    with pytest.raises(BrokenFileError, match="is damaged: the JPEG has an end, but not all pixels"):
        parse_image(inserted(part, TABLES, orientation))


def test_a_progressive_picture_that_ends_within_any_scan_but_the_last():
    """The last one only adds the last bit of some coefficients: nobody can see it."""
    jpeg = coded(SCENE, *KINDS["progressive"])
    scans = [at for at in range(len(jpeg)) if jpeg.startswith(SCAN, at)]
    assert len(scans) > 5
    for begin, behind in pairwise(scans):
        with pytest.raises(BrokenFileError, match="not all pixels"):
            parse_image(jpeg[: (begin + 14 + behind) // 2].rstrip(b"\xff") + END)


def test_a_picture_cut_off_between_two_restarts():
    jpeg = coded(SCENE, *KINDS["restarts"])
    with pytest.raises(BrokenFileError, match="not all pixels"):
        parse_image(jpeg[: jpeg.index(b"\xff\xd3", len(jpeg) // 2)] + END)


def test_grey_pictures_are_whole(jpeg, capfd):
    grey = np.full((64, 83, 3), 128, np.uint8)
    for image in (grey, np.concatenate([SCENE, np.full_like(SCENE, 128)])):
        for options in KINDS.values():
            assert np.all(parse_image(coded(image, *options))[-1] == 128)
    whole = parse_image(jpeg)
    assert capfd.readouterr().err.count("extraneous") <= 2 * len(KINDS)
    assert whole.shape == SCENE.shape


def test_pictures_without_the_last_bits_of_some_coefficients(tmp_path):
    """As `cjpeg -scans` may write them: the standard asks for none of them."""
    jpeg = coded(SCENE, *KINDS["progressive"])
    scans = [at for at in range(len(jpeg)) if jpeg.startswith(SCAN, at)]
    tables = [at for at in range(len(jpeg)) if jpeg.startswith(b"\xff\xc4", at)]
    fewer = min(at for at in tables if at > scans[3])  # the tables of the next scan come before it
    assert parse_image(jpeg[:fewer] + END).shape == SCENE.shape


def test_pictures_of_another_writer(tmp_path):
    for options in ({}, {"progressive": True}, {"subsampling": 0}, {"optimize": True}, {"quality": 5}):
        Image.fromarray(SCENE).save(tmp_path / "a.jpg", **options)
        assert parse_image((tmp_path / "a.jpg").read_bytes()).shape == SCENE.shape
    Image.fromarray(SCENE).convert("CMYK").save(tmp_path / "a.jpg")
    assert parse_image((tmp_path / "a.jpg").read_bytes()).shape == SCENE.shape
