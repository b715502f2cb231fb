"""The files of a clip that show its cameras, drawn again after these have changed."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path

from fieldcalib.assess.result import Calibration
from fieldcalib.assess.video import VideoCalibration
from fieldcalib.draw.clip_plot import plot_sequence
from fieldcalib.draw.overlays import draw_calibration
from fieldcalib.draw.sheet import contact_sheet, worst_frames
from fieldcalib.editor.clip import Progress
from fieldcalib.fields.field import Field
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.formats import VIDEOS
from fieldcalib.io.image import Image
from fieldcalib.io.image_files import write_image
from fieldcalib.io.videos import DEFAULT_RATE
from fieldcalib.run_folder.clip_results import SHEET_FRAMES, caption
from fieldcalib.run_folder.frame_source import FrameSource
from fieldcalib.run_folder.results import MOTION, OVERLAY, WORST

AGAIN = (OVERLAY, WORST, MOTION)
"""Files that can be drawn again."""


def draw_again(
    folder: Path,
    frames: FrameSource,
    calibrations: Sequence[Calibration | None],
    clip: VideoCalibration | None,
    field: Field,
    names: Collection[str],
    progress: Progress,
) -> None:
    """Draw files of `AGAIN` as a run draws them; the progress may raise an error to end the work.

    A frame that cannot be read is left out, and all after it: the file is cut off there.
    """
    rate = frames.rate or DEFAULT_RATE
    if {OVERLAY, WORST} & set(names):
        _draw_frames(folder, frames, calibrations, field, rate, progress)
    if MOTION in names and clip is not None:
        write_image(folder / MOTION, plot_sequence(clip, frames_per_second=rate))


def _draw_frames(
    folder: Path,
    frames: FrameSource,
    calibrations: Sequence[Calibration | None],
    field: Field,
    rate: float,
    progress: Progress,
) -> None:
    """Write the overlay video and the sheet of the worst frames."""
    worst = worst_frames(calibrations, SHEET_FRAMES)
    pictures: dict[int, Image] = {}
    with VIDEOS.write(folder / OVERLAY, rate) as video:
        images = frames.each(0, len(frames))
        for number, calibration in enumerate(calibrations):
            progress(number, len(frames), f"drawing {OVERLAY}")
            try:
                image = next(images)
            except (StopIteration, BrokenFileError):
                break
            if calibration is not None:
                image = draw_calibration(image, calibration, calibration.field or field)
            video.write(image)
            if number in worst:
                pictures[number] = image
    shown = [number for number in worst if number in pictures]
    if shown:
        captions = [caption(frames.ids[number], calibrations[number]) for number in shown]
        write_image(folder / WORST, contact_sheet([pictures[number] for number in shown], captions))
