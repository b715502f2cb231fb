"""Frames of annotation files, as the measurements read them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fieldcalib._progress import say
from fieldcalib.fields.field import Field
from fieldcalib.io.frame_source import read_each
from fieldcalib.problem.labelled_pixels import Pixels
from fieldcalib.run_folder.labelled_frames import AnnotationReader


def read_frames(inputs: Sequence[Path], field: Field, image_size: tuple[int, int]) -> dict[str, Pixels]:
    """Find, read and check annotations, by frame id; broken files are named on stderr."""
    reader = AnnotationReader(field, image_size)
    files = reader.find(inputs)
    frames, broken = read_each(files, reader.read)
    for file in files:
        if file.id in broken:
            say(f"{file.path}: {broken[file.id]}")
    return {id: pixels for id, (pixels, _) in frames.items()}
