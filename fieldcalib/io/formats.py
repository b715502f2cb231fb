"""The formats of files: their names, and the functions that find, read and write them.

Commands take the formats of files from here only. Annotations of any tool: which one it is, their frames, their labels.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from dataclasses import field as attribute
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, Generic, TypeAlias, TypeVar

from fieldcalib._types import expect, file_path
from fieldcalib.fields.field import ObjectSegments
from fieldcalib.geometry.camera import checked_image_size
from fieldcalib.io.annotations import Annotation, Labels, LeftOut, renamed
from fieldcalib.io.coco import format_coco, parse_coco
from fieldcalib.io.cvat import format_cvat, parse_cvat
from fieldcalib.io.decoders import is_animated_webp
from fieldcalib.io.files import (
    HIDDEN,
    MOST_BYTES,
    BrokenFileError,
    FrameFile,
    error_message,
    find_files,
    is_named,
    named_in_errors,
    parse_json,
    parse_json_object,
    read_json_or_yaml,
)
from fieldcalib.io.image_files import encode_image, parse_image
from fieldcalib.io.label_studio import format_label_studio, parse_label_studio
from fieldcalib.io.labelme import format_labelme, parse_labelme
from fieldcalib.io.soccernet import UNKNOWN_LABELS, format_annotation, format_camera, parse_annotation, parse_camera
from fieldcalib.io.tvcalib import format_per_sample_output, parse_per_sample_output
from fieldcalib.io.videos import VideoReader, VideoWriter
from fieldcalib.io.wc14 import format_homography, parse_homography

Read = TypeVar("Read", bound=Callable[..., Any])
Write = TypeVar("Write", bound=Callable[..., Any] | None)
# Beginning of SoccerNet's annotations, which are read frame by frame: the first label, and a list of points.
SOCCERNET_BEGINNING = re.compile(rb'\s*\{\s*(\}|"[^"]*"\s*:\s*\[\s*(\]|\{\s*"[xy]"))')
BEGINNING_BYTES = 256
KEYS = {"labelme": {"shapes", "imagePath"}, "coco": {"images", "annotations"}, "labelstudio": {"data"}}
FILE_PER_IMAGE = "labelme"  # the tool that writes a file for each image
NO_SIZE = "SoccerNet's annotations do not say the size of their images: give it (image_size=, --size)"


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


@dataclass(frozen=True)
class AnnotatedFrame(FrameFile):
    """A frame that has been read; its file may hold several."""

    annotation: Annotation = attribute(default_factory=lambda: Annotation("", {}))

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle for other processes."""
        return AnnotatedFrame, (self.id, self.path, None, self.annotation)


@dataclass(frozen=True)
class FramesFound:
    """The frames of annotations, and what was left out of them."""

    frames: list[FrameFile]
    unknown: Counter[str]
    """Labels that the object does not have, with the number of frames that have them."""
    left_out: Counter[LeftOut]
    """Shapes other than points and lines, with the number of frames that have them."""


def frames_in(
    files: Iterable[FrameFile],
    labels: Labels = MappingProxyType({}),
    known: ObjectSegments | None = None,
    most_bytes: float = MOST_BYTES,
) -> FramesFound:
    """Find the frames of annotations; files of other tools than SoccerNet, which may hold several, are read.

    Parameters
    ----------
    files : iterable of FrameFile
        As `fieldcalib.io.formats.ANNOTATIONS` finds them.
    labels : mapping of str to str or None
        The field's labels by those in files of other tools; None leaves a label out.
    known : mapping of str to segment, optional
        The calibration object: other labels are left out, and counted; by default all are kept.
    most_bytes : float
        Larger files are broken. A file that is broken is one frame: `parse_frame` says what is wrong with it.

    Raises
    ------
    BrokenFileError
        If two files have the same frame.
    ImportError
        If there is XML, and no defusedxml.
    """
    found: dict[str, FrameFile] = {}
    unknown: Counter[str] = Counter()
    left_out: Counter[LeftOut] = Counter()
    for file in files:
        for frame in _frames_of(file, most_bytes):
            if frame.id in found:
                raise BrokenFileError(
                    f"{frame.path} and {found[frame.id].path} have the same frame {frame.id}: rename one of them"
                )
            if isinstance(frame, AnnotatedFrame):
                pixels = renamed(frame.annotation.pixels, labels)
                kept = {k: xy for k, xy in pixels.items() if known is None or k in known or k in UNKNOWN_LABELS}
                unknown.update(pixels.keys() - kept.keys())
                left_out.update(one for one in frame.annotation.left_out if labels.get(one.label, one.label))
                frame = replace(frame, annotation=replace(frame.annotation, pixels=kept))
            found[frame.id] = frame
    return FramesFound(list(found.values()), unknown, left_out)


def is_of_soccernet(file: FrameFile) -> bool:
    """Whether a file begins as SoccerNet's annotations do."""
    return SOCCERNET_BEGINNING.match(file.read_beginning(BEGINNING_BYTES)) is not None


def _frames_of(file: FrameFile, most_bytes: float) -> Iterator[FrameFile]:
    tool = ""
    if not is_of_soccernet(file):
        try:
            content = file.read(most_bytes)
            tool = tool_of(content, file.path)
        except (BrokenFileError, MemoryError):
            pass  # reading the frame says what is wrong with it
    if not tool:
        yield file
        return
    try:
        annotations = OTHER_ANNOTATIONS[tool].read(content)
    except (BrokenFileError, MemoryError) as error:
        annotations = [Annotation(file.id, {}, problem=error_message(error))]
    for annotation in annotations:
        id = file.id if tool == FILE_PER_IMAGE else annotation.id
        yield AnnotatedFrame(id, file.path, file.zipped, annotation)


def tool_of(content: bytes | str, path: Path) -> str:
    """The tool of `OTHER_ANNOTATIONS` that wrote a file; empty for SoccerNet's.

    Raises
    ------
    BrokenFileError
        If it is neither XML nor JSON.

    Examples
    --------
    >>> tool_of('{"shapes": [], "imagePath": "a.jpg"}', Path("a.json")), tool_of('{"Middle line": []}', Path("b.json"))
    ('labelme', '')
    """
    if OTHER_ANNOTATIONS["cvat"].recognises(path):
        return "cvat"
    value = parse_json(content)
    if isinstance(value, list):
        return "labelstudio"
    keys = value.keys() if isinstance(value, dict) else set()
    return next((tool for tool, needed in KEYS.items() if needed <= keys), "")


def parse_frame(
    file: FrameFile,
    image_size: tuple[int, int] | None,
    labels: Labels = MappingProxyType({}),
    most_bytes: float = MOST_BYTES,
    *,
    unknown: bool = False,
) -> Annotation:
    """The annotation of a frame, with the size of its image.

    Parameters
    ----------
    file : FrameFile
        As `frames_in` gives it.
    image_size : (int, int), optional
        Width and height, where they are known: SoccerNet's files do not say them.
    labels : mapping of str to str or None
        As for `frames_in`, which applies it to the files that it reads.
    most_bytes : float
        Larger files are broken.
    unknown : bool
        Whether to keep "Line unknown" and "Goal unknown", see `fieldcalib.io.soccernet.parse_annotation`.

    Raises
    ------
    BrokenFileError
        If it is broken, its size is not known, or is another than the file says.
    """
    if not isinstance(file, AnnotatedFrame):
        content = file.read(most_bytes)
        if image_size is None:
            parse_json_object(content, "labels")
            raise BrokenFileError(NO_SIZE)
        pixels = ANNOTATIONS.read(content, image_size, unknown=unknown)
        return Annotation(file.id, renamed(pixels, labels), image_size)
    annotation = file.annotation
    which = "" if file.id == file.path.stem else f"{file.id}: "
    if annotation.problem:
        raise BrokenFileError(f"{which}{annotation.problem}")
    size = annotation.image_size or image_size
    if size is None:
        raise BrokenFileError(
            f"{which}nothing is annotated that would say the size of the image: give it (image_size=, --size)"
        )
    if image_size not in (None, size):
        given, came = ("{} x {}".format(*one) for one in (image_size or size, size))
        raise BrokenFileError(f"{which}is of an image of {came}, not of {given}: leave the size out, or mend it")
    pixels = {name: xy for name, xy in annotation.pixels.items() if unknown or name not in UNKNOWN_LABELS}
    return replace(annotation, pixels=pixels, image_size=size)


def are_annotations(path: Path) -> bool:
    """Whether a path is annotations: a file of them, or a folder or zip of them without pictures and videos."""
    if path.is_file() and path.suffix.lower() != ".zip":
        return ANNOTATIONS.recognises(path)
    return _holds(path, ANNOTATIONS) and not (_holds(path, IMAGES) or _holds(path, VIDEOS))


def _holds(path: Path, form: Format[Any, Any]) -> bool:
    try:
        return bool(form.find([path]))
    except (OSError, ValueError):
        return False


def read_annotations(
    path: str | Path, image_size: tuple[int, int] | None = None, *, labels: Labels | str | Path = MappingProxyType({})
) -> dict[str, Annotation]:
    """Read labelled pixels from annotations of SoccerNet, CVAT, labelme, Label Studio or COCO.

    Parameters
    ----------
    path : str or Path
        A file, or a folder or a zip of files, whose formats are found out.
    image_size : (int, int), optional
        Width and height in pixels; only SoccerNet's files do not say them.
    labels : mapping of str to str or None, or path of one
        The field's labels by those in the files; None leaves a label out. A file of it is JSON or YAML.

    Returns
    -------
    dict of str to Annotation
        By the name of the image: `pixels`, label -> (N, 2), and `image_size`. Labels are not compared with a field's.

    Raises
    ------
    FileNotFoundError
        If there are no annotations.
    BrokenFileError
        If one is broken, of another size, or of an unknown size; the message begins with the path.

    Examples
    --------
    >>> import tempfile
    >>> of_labelme = '''{"imagePath": "7.jpg", "imageWidth": 960, "imageHeight": 540, "shapes": [
    ...     {"label": "halfway", "shape_type": "line", "points": [[480.5, 0.5], [470.5, 530.5]]}]}'''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "7.json"
    ...     _ = path.write_text(of_labelme)
    ...     found = read_annotations(path, labels={"halfway": "Middle line"})
    >>> found["7"].image_size, found["7"].pixels
    ((960, 540), {'Middle line': array([[480.,   0.],
           [470., 530.]])})
    """
    names = read_labels(file_path(labels, "labels")) if isinstance(labels, str | Path) else labels
    expect(names, Mapping, '{"half": "Middle line"}')
    image_size = None if image_size is None else checked_image_size(image_size)
    annotations = {}
    for frame in frames_in(ANNOTATIONS.find([file_path(path, "annotations")]), names).frames:
        with named_in_errors(frame.path):
            annotations[frame.id] = parse_frame(frame, image_size, names)
    return annotations


def read_labels(path: Path | str) -> dict[str, str | None]:
    """Read a mapping of the labels in files of other tools to those of the field, from JSON or YAML.

    Raises
    ------
    BrokenFileError
        If it is no such mapping; the message begins with its path.
    """
    with named_in_errors(path):
        value = read_json_or_yaml(Path(path))
    pairs: list[tuple[Any, Any]] = list(value.items()) if isinstance(value, dict) else [(None, None)]
    if not all(isinstance(theirs, str) and isinstance(ours, str | None) for theirs, ours in pairs):
        raise BrokenFileError(f"{path}: expected their labels, each with one of ours or null, as halfway: Middle line")
    return {theirs.strip(): ours.strip() if ours else None for theirs, ours in pairs}
