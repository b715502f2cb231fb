"""The formats of files: their names, and the functions that find, read and write them.

Commands take the formats of files from here only.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, Generic, TypeAlias, TypeVar

from fieldcalib.io.annotations import Annotation
from fieldcalib.io.coco import format_coco, parse_coco
from fieldcalib.io.cvat import format_cvat, parse_cvat
from fieldcalib.io.decoders import is_animated_webp
from fieldcalib.io.files import HIDDEN, FrameFile, find_files, is_named
from fieldcalib.io.image import encode_image, parse_image
from fieldcalib.io.label_studio import format_label_studio, parse_label_studio
from fieldcalib.io.labelme import format_labelme, parse_labelme
from fieldcalib.io.pnlcalib import parse_detections
from fieldcalib.io.soccernet import format_annotation, format_camera, parse_annotation, parse_camera
from fieldcalib.io.tvcalib import format_per_sample_output, parse_per_sample_output
from fieldcalib.io.videos import VideoReader, VideoWriter
from fieldcalib.io.wc14 import format_homography, parse_homography

Read = TypeVar("Read", bound=Callable[..., Any])
Write = TypeVar("Write", bound=Callable[..., Any] | None)


@dataclass(frozen=True)
class Format(Generic[Read, Write]):
    """Files named ``<prefix><id><suffix>``, or files of any name with one of the suffixes.

    Examples
    --------
    >>> CAMERAS.recognises(Path("out/camera_00001.json")), ANNOTATIONS.recognises(Path("out/camera_00001.json"))
    (True, False)
    >>> CAMERAS.file_name("00001")
    'camera_00001.json'
    """

    name: str
    """Content of a file, for messages."""
    suffixes: tuple[str, ...]
    """Endings, in lower or upper case; files that are written have the first."""
    read: Read
    """Reads the content of a file; for a video, its path."""
    write: Write
    """Makes the content of a file; for a video, writes to its path. None if the format is not written."""
    prefix: str = ""
    others: re.Pattern[str] = HIDDEN
    """Matches the beginning of the names of files that are something else."""
    apart: bool = False
    """Whether files that differ in their ending only are different frames (`fieldcalib.io.files.find_files`)."""
    by_content: Callable[[Path], bool] | None = None
    """Tells files with other names by their content; None if there are none."""

    def recognises(self, path: Path) -> bool:
        """Whether a file is of this format by its name or, where names do not tell, by its content."""
        by_name = is_named(path.name, self.prefix, self.suffixes, self.others)
        return by_name or (self.by_content is not None and self.by_content(path))

    def find(self, inputs: Iterable[Path]) -> list[FrameFile]:
        """The files of frames in folders and zips, and single files, see `fieldcalib.io.files.find_files`."""
        around = partial(find_files, prefix=self.prefix, suffix=self.suffixes, others=self.others)
        return around(inputs, self.name, apart=self.apart)

    def file_name(self, id: str) -> str:
        """The name of a frame's file."""
        return f"{self.prefix}{id}{self.suffixes[0]}"


# Excluded files beside annotations: match_info_cam_gt.json, test_match_info_cam_gt.json, results of this package.
ANNOTATIONS = Format(
    "annotation",
    (".json", ".xml"),
    parse_annotation,
    format_annotation,
    others=re.compile(r".*match_info|camera_|summary|run\.json$|tripods|per_sample_output|\."),
)
"""SoccerNet's labelled points, normalised: ``<id>.json``. Files of `OTHER_ANNOTATIONS` may lie beside them."""

OtherAnnotations: TypeAlias = Format[Callable[[bytes | str], list[Annotation]], Callable[[Iterable[Annotation]], str]]
OTHER_ANNOTATIONS: Mapping[str, OtherAnnotations] = MappingProxyType(
    {
        "cvat": Format("CVAT annotations", (".xml",), parse_cvat, format_cvat),
        "labelme": Format("labelme annotation", (".json",), parse_labelme, format_labelme),
        "labelstudio": Format("Label Studio annotations", (".json",), parse_label_studio, format_label_studio),
        "coco": Format("COCO annotations", (".json",), parse_coco, format_coco),
    }
)
"""Labelled pixels in the files of other tools, by the name of the tool; labelme has a file for each image."""

CAMERAS = Format("camera", (".json",), parse_camera, format_camera, prefix="camera_")
"""SoccerNet's cameras: ``camera_<id>.json``."""

HOMOGRAPHIES = Format("homography", (".homographyMatrix",), parse_homography, format_homography)
"""Homographies as in WC14: ``<id>.homographyMatrix``."""

DETECTIONS = Format("detections", (".json",), parse_detections, None)
"""Points and lines that PnLCalib's networks found: ``<id>.json``."""

RECORDS = Format(
    "TVCalib output",
    (".json", ".jsonl"),
    parse_per_sample_output,
    format_per_sample_output,
    others=re.compile(r"camera_|\."),
)
"""Cameras and homographies of many frames: TVCalib's ``per_sample_output.json``."""

OVERLAYS = Format("overlay", (".jpg",), parse_image, encode_image, prefix="overlay_")
"""Images with the calibrated markings: ``overlay_<id>.jpg``."""

IMAGES = Format(
    "image",
    (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp"),
    parse_image,
    encode_image,
    others=re.compile(rf"\.|{OVERLAYS.prefix}"),
    apart=True,
)
"""Images: ``<id>.jpg`` and others that OpenCV reads."""

VIDEOS = Format(
    "video",
    (".mp4", ".m4v", ".mov", ".mkv", ".avi", ".webm", ".ts", ".mpg", ".mpeg", ".mjpeg", ".mjpg", ".gif"),
    VideoReader,
    VideoWriter,
    by_content=is_animated_webp,
)
"""Videos that FFmpeg reads, animated GIF and WebP among them; what is written is MP4."""
