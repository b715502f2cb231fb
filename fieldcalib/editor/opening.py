"""What an editor opens: the paths of its input, its folder of results, its frames and its field."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from fieldcalib._checks import expect, file_path, listed
from fieldcalib.editor.saved_files import Stored, source_of
from fieldcalib.fields.catalogue import FIELDS
from fieldcalib.fields.catalogue import field as field_by_name
from fieldcalib.fields.field import Field
from fieldcalib.io.field_files import is_field_file, read_field
from fieldcalib.io.files import FrameFile
from fieldcalib.io.formats import IMAGES, VIDEOS
from fieldcalib.io.image import Image, checked_image
from fieldcalib.run_folder.frame_source import ArrayFrames, FileFrames, FrameSource, VideoFrames, ignored


def places_of(
    source: str | os.PathLike[str] | Sequence[Image], out: str | os.PathLike[str] | None
) -> tuple[list[Path] | None, Path | None]:
    """The paths of the pictures or of the video, None for arrays; and the folder of results, if there is one."""
    folder = None if out is None else file_path(out, "a folder of results")
    if not isinstance(source, str | os.PathLike):
        return None, folder
    path = file_path(source, "a picture, a folder, a video or results of a run")
    if not path.exists():
        raise FileNotFoundError(f"{path} does not exist: expected a picture, a folder, a video or results of a run")
    if path.is_dir() and Stored.has_results(path):
        return source_of(path), path if folder is None else folder
    return [path], file_path(_beside(path), "a folder of results") if folder is None else folder


def _beside(path: Path) -> Path:
    """The folder of results beside a file or folder, named after it."""
    named = path if path.name not in ("", "..") else path.resolve()  # "." has no name
    if not named.name:
        raise ValueError(f"expected out, a folder of results: {path} has no name after which to call one beside it")
    return named.with_name(f"{named.stem if named.is_file() else named.name}-fieldcalib")


def frames_of(source: object, paths: list[Path] | None, stored: Stored | None) -> FrameSource:
    """The frames of arrays, of files, or of a video, of which a run may have a part."""
    if paths is None:
        return ArrayFrames([checked_image(image) for image in listed(source, "a path or pictures")])
    if VIDEOS.recognises(paths[0]):
        of_run = stored is not None and not stored.is_begun_here  # a run may be of a part of the video
        numbers = [int(id) for id in stored.ids if id.isdecimal()] if stored is not None and of_run else []
        return VideoFrames(paths[0], tell=ignored, numbers=numbers or None)
    files: list[FrameFile] = IMAGES.find(paths)
    pictures = FileFrames(files, tell=ignored)
    if len(files) == 1 and files[0].path == paths[0]:  # of a folder, the page says which are broken
        pictures.image(0)
    return pictures


def field_of(field: Field | str | None, stored: Stored | None) -> tuple[Field, str]:
    """The field, and what it is called."""
    if isinstance(field, Field):
        return field, "field"
    if field is not None:
        expect(field, str, '"soccer"')
    record = None if stored is None or field is not None else stored.record
    name = field or (record is not None and record.options.get("field")) or "soccer"
    if name in FIELDS or not is_field_file(name):
        return field_by_name(name), name
    return read_field(name), Path(name).stem
