"""The table of formats: names, and what reads what was written."""

from pathlib import Path

import numpy as np
import pytest
from views import camera

from fieldcalib.io import formats
from fieldcalib.io.formats import ANNOTATIONS, CAMERAS, HOMOGRAPHIES, IMAGES, OVERLAYS, RECORDS, VIDEOS, Format
from fieldcalib.io.tvcalib import TVCalibRecord

SIZE = (960, 540)
CAMERA = camera(10, 78, 1400, (0, 68, -17))
FORMATS = {name: value for name, value in vars(formats).items() if isinstance(value, Format)}


@pytest.mark.parametrize("format", FORMATS.values(), ids=FORMATS)
def test_a_format_recognises_the_files_that_it_writes(format, tmp_path):
    names = [format.file_name("7"), format.file_name("a.b").upper().replace(format.prefix.upper(), format.prefix)]
    for name in names:
        assert format.recognises(tmp_path / name)
        (tmp_path / name).touch()
    (tmp_path / f".{names[0]}").touch()
    assert sorted(file.id for file in format.find([tmp_path])) == ["7", "A.B"]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("00001.json", {"ANNOTATIONS", "RECORDS"}),
        ("camera_00001.json", {"CAMERAS"}),
        ("per_sample_output.json", {"RECORDS"}),
        ("test_match_info_cam_gt.json", {"RECORDS"}),
        ("summary.json", {"RECORDS"}),
        ("records.jsonl", {"RECORDS"}),
        ("00001.homographyMatrix", {"HOMOGRAPHIES"}),
        ("00001.WEBP", {"IMAGES"}),
        ("frame.jpg", {"IMAGES"}),
        ("overlay_frame.jpg", {"OVERLAYS"}),
        ("match.MP4", {"VIDEOS"}),
        ("frame.heic", set()),
        (".00001.json", set()),
    ],
)
def test_whose_file_it_is(name, expected):
    assert {key for key, format in FORMATS.items() if format.recognises(Path("folder") / name)} == expected


def test_what_is_written_is_read_again(tmp_path):
    pixels = {"Middle line": np.array([[12.0, 3.0], [480.0, 500.0]])}
    again = ANNOTATIONS.read(ANNOTATIONS.write(pixels, SIZE), SIZE)
    np.testing.assert_allclose(again["Middle line"], pixels["Middle line"])
    np.testing.assert_allclose(CAMERAS.read(CAMERAS.write(CAMERA), SIZE).K, CAMERA.K)
    H = HOMOGRAPHIES.read(HOMOGRAPHIES.write(CAMERA.homography))
    np.testing.assert_allclose(H / H[2, 2], CAMERA.homography / CAMERA.homography[2, 2])
    (record,) = RECORDS.read(RECORDS.write([TVCalibRecord("1", CAMERA)]))
    np.testing.assert_allclose(record.camera.C, CAMERA.C)
    picture = np.full((64, 96, 3), 90, np.uint8)
    np.testing.assert_array_equal(IMAGES.read(IMAGES.write(picture, ".png")), picture)
    np.testing.assert_allclose(OVERLAYS.read(OVERLAYS.write(picture)), picture, atol=2)
    with VIDEOS.write(tmp_path / VIDEOS.file_name("a"), 25.0) as video:
        video.write(picture)
    with VIDEOS.read(tmp_path / "a.mp4") as video:
        assert [image.shape for image in video] == [picture.shape]
