"""The size that the header of an image file states, before anything is decoded."""

import struct
import tracemalloc
import zlib

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.image_files import LONGEST_SIDE, encode_image, parse_image, stored_size, write_image

SUFFIXES = (".jpg", ".png", ".bmp", ".tif", ".webp")


def noise(width, height, channels=3):
    return np.random.default_rng(0).integers(0, 255, (height, width, channels), dtype=np.uint8)


def png(width, height, rows=None):
    """A PNG of black pixels; with fewer rows than it states if wanted."""

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    pixels = zlib.compress(bytes((1 + 3 * width) * (height if rows is None else rows)))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")


@pytest.mark.parametrize("suffix", SUFFIXES)
@given(st.integers(1, 300), st.integers(1, 300), st.sampled_from([1, 3, 4]))
def test_it_is_that_of_the_decoded_image(suffix, width, height, channels):
    content = encode_image(noise(width, height, channels), suffix)
    assert stored_size(content) == (width, height)
    assert parse_image(content).shape == (height, width, 3)


@pytest.mark.parametrize(
    ("suffix", "options"),
    [
        (".jpg", [cv2.IMWRITE_JPEG_PROGRESSIVE, 1, cv2.IMWRITE_JPEG_RST_INTERVAL, 1]),
        (".webp", [cv2.IMWRITE_WEBP_QUALITY, 30]),  # lossy; without it OpenCV writes it lossless
        (".tif", [cv2.IMWRITE_TIFF_COMPRESSION, 5]),
    ],
)
def test_other_kinds_of_these_files(suffix, options):
    content = cv2.imencode(suffix, noise(123, 45), options)[1].tobytes()
    assert stored_size(content) == (123, 45)


def test_headers_that_opencv_does_not_write():
    extended = (
        b"RIFF" + bytes(4) + b"WEBPVP8X" + bytes(8) + (70_000).to_bytes(3, "little") + (299).to_bytes(3, "little")
    )
    assert stored_size(extended) == (70_001, 300)
    old_bitmap = b"BM" + bytes(12) + struct.pack("<IHH", 12, 640, 480)
    assert stored_size(old_bitmap) == (640, 480)
    entries = struct.pack(">HHQQ", 256, 4, 1, 640 << 32) + struct.pack(">HHQHHI", 257, 3, 1, 480, 0, 0)
    big_tiff = b"MM" + struct.pack(">HHHQQ", 43, 8, 0, 16, 2) + entries
    assert stored_size(big_tiff) == (640, 480)


def tiff(width, height, *directory):
    """A TIFF of grey pixels; `directory` has the tags, types and values that state its size."""
    pixels = zlib.compress(bytes(width * height))
    more = [(258, 3, 8), (259, 3, 8), (262, 3, 1), (273, 4, 516), (277, 3, 1), (278, 4, height), (279, 4, len(pixels))]
    entries = b"".join(struct.pack("<HHII", tag, kind, 1, value) for tag, kind, value in (*directory, *more))
    start = b"II*\0" + struct.pack("<IH", 8, len(entries) // 12) + entries
    return start.ljust(508, b"\0") + struct.pack("<Q", height) + pixels


@pytest.mark.parametrize("heights", [(2000, 8), (8, 2000)])
def test_a_tiff_that_states_its_height_twice_has_that_of_the_decoded_image(heights):
    content = tiff(100, 2000, (256, 4, 100), *((257, 4, height) for height in heights))
    assert stored_size(content) == (100, heights[0])
    assert parse_image(content).shape == (heights[0], 100, 3)


def test_a_tiff_that_states_its_height_elsewhere_is_not_decoded(monkeypatch):
    """OpenCV reads the 8 bytes at an offset; what stands in the directory is that offset, a small number."""
    content = tiff(30_000, 2000, (256, 4, 30_000), (257, 16, 508), (0, 0, 0))
    monkeypatch.setattr(cv2, "imdecode", lambda *arguments: pytest.fail("is decoded"))
    with pytest.raises(BrokenFileError, match="is no image that OpenCV can read"):
        parse_image(content)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_header_that_is_cut_off_states_nothing(suffix):
    content = encode_image(noise(64, 64), suffix)
    whole = next(length for length in range(len(content) + 1) if stored_size(content[:length]))
    assert all(stored_size(content[:length]) is None for length in range(whole))
    with pytest.raises(BrokenFileError):
        parse_image(content[: whole - 1])


@given(st.binary(max_size=200), st.sampled_from([b"", b"II*\0", b"MM\0+", b"\xff\xd8", b"BM", b"RIFF....WEBP"]))
def test_any_content_has_a_size_or_none(content, start):
    size = stored_size(start + content)
    assert size is None or min(size) >= 0


def test_an_image_with_too_many_pixels_is_not_decoded(monkeypatch):
    content = png(20_000, 20_000, rows=1)
    monkeypatch.setattr(cv2, "imdecode", lambda *arguments: pytest.fail("is decoded"))
    for most, number in ((50_000_000, "50"), (399_999_999, "400")):
        with pytest.raises(BrokenFileError, match=f"has 20000 x 20000 pixels, more than {number} million"):
            parse_image(content, most)


def test_an_image_with_as_many_pixels_as_allowed_is_read():
    assert parse_image(png(200, 100), 20_000).shape == (100, 200, 3)
    with pytest.raises(BrokenFileError, match="--max-megapixels of a command allows more"):
        parse_image(png(200, 100), 19_999)


def test_the_default_keeps_memory_low():
    content = png(20_000, 20_000, rows=1)
    tracemalloc.start()
    with pytest.raises(BrokenFileError):
        parse_image(content)
    assert tracemalloc.get_traced_memory()[1] < 10_000_000
    tracemalloc.stop()


@pytest.mark.parametrize(("width", "height"), [(LONGEST_SIDE + 1, 2), (2, LONGEST_SIDE + 1), (70_000, 1)])
def test_sides_that_are_too_long(width, height):
    with pytest.raises(BrokenFileError, match=f"has {width} x {height} pixels: OpenCV's functions take up to 32766"):
        parse_image(png(width, height))
    assert parse_image(png(LONGEST_SIDE, 2)).shape == (2, LONGEST_SIDE, 3)


def test_what_cannot_be_written_leaves_no_file(tmp_path):
    with pytest.raises(ValueError, match=r"OpenCV cannot write an image of shape \(1, 65501, 3\) as \.jpg"):
        write_image(tmp_path / "a.jpg", np.zeros((1, 65501, 3), np.uint8))
    assert list(tmp_path.iterdir()) == []
