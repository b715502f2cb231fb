"""Files of a clip's results: its frames, overlay and plots, the whole calibration, and its tripods in words."""

from __future__ import annotations

import json
import os
from collections.abc import Generator, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from fieldcalib._types import number
from fieldcalib._whole_files import whole_file, write_text
from fieldcalib.assess.result import Calibration, in_picture
from fieldcalib.assess.sequence_calibration import SequenceCalibration
from fieldcalib.assess.video import VideoCalibration
from fieldcalib.draw.clip_plot import plot_sequence
from fieldcalib.draw.sheet import contact_sheet, worst_frames
from fieldcalib.io.clips import ClipInput
from fieldcalib.io.decoders import DEFAULT_RATE
from fieldcalib.io.files import WRONG_RECORD, BrokenFileError, open_regular_file, parse_json_object
from fieldcalib.io.formats import VIDEOS
from fieldcalib.io.frame_source import Frame
from fieldcalib.io.image_files import Image, read_ahead, write_image
from fieldcalib.io.results import FORMAT
from fieldcalib.problem.picture_shape import Placement
from fieldcalib.processes.jobs import in_order
from fieldcalib.run_folder.record import Outcome
from fieldcalib.run_folder.results import CLIP, MOTION, OVERLAY, TRIPODS, WORST, ResultsWriter
from fieldcalib.solve.batch import compute_errors

SHEET_FRAMES = 12  # frames in the contact sheet of the worst ones

# Names in tripods.json by those in `fieldcalib.problem.layout`; others are coefficients of the lens
WORDS: Mapping[str, str] = json.loads(Path(__file__).with_name("tripod_names.json").read_text("utf-8"))


_Written = tuple[Frame, Calibration | None, Image | None]  # no calibration: cannot be read; no image: not drawn


class FrameOptions(Protocol):
    """Options for writing and drawing frames."""

    @property
    def draws(self) -> bool:
        """Whether pictures are drawn."""

    def placement(self, image: Image) -> Placement:
        """Placement of an image in its frame."""

    def outcome(self, id: str, calibration: Calibration, **more: Any) -> Outcome:
        """The outcome of a frame; `more` are keywords of `Outcome.of`."""

    def drawn(self, image: Image, calibration: Calibration) -> Image:
        """Draw a calibration over its image."""


def write_clip_results(
    results: ResultsWriter, clip: ClipInput, found: VideoCalibration, options: FrameOptions, threads: int | None = None
) -> None:
    """Write all results of a calibrated clip.

    `threads` is the number of threads for drawing, and again for decoding and encoding; by default the number of cores.
    """
    out, rate = results.out, clip.source.frames_per_second
    results.notes = found.remarks
    worst = _write_frames(results, clip, found, options, threads)
    write_clip(out, found, rate)
    if options.draws and worst:
        write_image(out / MOTION, plot_sequence(found, frames_per_second=rate))
        write_image(out / WORST, contact_sheet(list(worst.values()), list(worst)))


def _write_frames(
    results: ResultsWriter, clip: ClipInput, found: VideoCalibration, options: FrameOptions, threads: int | None
) -> dict[str, Image]:
    """Write the results of all frames and the overlay video; returns pictures of the worst frames by caption."""
    path, done = results.out / OVERLAY, results.done
    calibrations, basis = compute_errors(list(found)), found.basis
    worst = worst_frames(calibrations, SHEET_FRAMES)
    pictures: dict[int, tuple[str, Image]] = {}
    frames = _drawn(clip, calibrations, options, threads) if options.draws else _listed(clip, calibrations, options)
    readable = 0
    with VIDEOS.write(path, clip.source.frames_per_second, threads=threads) as video, closing(frames):
        for index, (frame, calibration, picture) in enumerate(frames):
            results.check_restored(index, frame.id)
            if calibration is None:
                if index >= done:  # its problem was reported when it was first read
                    results.add(replace(Outcome.broken(frame, frame.problem), complaint=""))
                continue
            if index >= done:
                results.add(options.outcome(frame.id, calibration, details={"basis": str(basis[readable])}))
            if picture is not None:
                video.write(picture)
                if readable in worst:
                    pictures[readable] = caption(frame.id, calibrations[readable]), picture
            readable += 1
    return dict(pictures[index] for index in worst if index in pictures)


def _drawn(
    clip: ClipInput, calibrations: Sequence[Calibration], options: FrameOptions, threads: int | None
) -> Generator[_Written, None, None]:
    """Yield all frames in order with their overlays; reading, drawing and encoding run in parallel threads."""
    rest = iter(calibrations)

    def draw(item: tuple[Frame, Calibration | None]) -> _Written:
        frame, calibration = item
        if frame.image is None or calibration is None:
            return frame, None, None
        return frame, calibration, options.drawn(frame.image, calibration)

    def placed(frame: Frame) -> tuple[Frame, Calibration | None]:
        return frame, None if frame.image is None else in_picture(next(rest), options.placement(frame.image))

    count = threads or os.cpu_count() or 1
    if count == 1:  # frames are drawn in this thread
        yield from map(draw, map(placed, read_ahead(clip.frames())))
        return
    with ThreadPoolExecutor(count, "drawing") as pool:
        yield from in_order(pool, draw, map(placed, read_ahead(clip.frames())), ahead=count)


def _listed(
    clip: ClipInput, calibrations: Sequence[Calibration], options: FrameOptions
) -> Generator[_Written, None, None]:
    """Yield all frames in order without overlays, and without reading them again."""
    placement, broken = clip.placement(), clip.source.broken
    rest = iter(calibrations)
    for id in clip.ids:
        if id in broken or placement is None:
            yield Frame(id, None, broken.get(id, "")), None, None
        else:
            yield Frame(id, None), in_picture(next(rest), placement), None


def caption(id: str, calibration: Calibration | None) -> str:
    """Caption of a frame in the sheet of the worst frames."""
    return id if calibration is None else f"{id}: {calibration.status}, {calibration.message}"


def write_clip(out: Path, found: VideoCalibration, frames_per_second: float) -> None:
    """Write ``clip.jsonl``, from which `read_clip` reads the calibration, and ``tripods.json``.

    The first line has the data common to all frames, and each other line a tripod, so that only one is in memory as
    text.
    """
    record = found.to_dict()
    tripods = record.pop("tripods")
    with whole_file(out / CLIP) as file:
        head = {"format": FORMAT, "frames_per_second": frames_per_second, **record}
        for part in (head, *tripods):
            file.write(json.dumps(part).encode() + b"\n")
    write_text(out / TRIPODS, json.dumps(tripods_in_words(found, frames_per_second), indent=2) + "\n")


def read_clip(path: Path) -> tuple[VideoCalibration, float]:
    """Read the calibration in a ``clip.jsonl``, and its frames per second.

    Raises
    ------
    BrokenFileError
        If the file is not valid; the message begins with its path.
    """
    try:
        with open_regular_file(path) as file:
            head, *tripods = (parse_json_object(line, "a clip") for line in file)
        return VideoCalibration.from_dict({**head, "tripods": tripods}), _rate(head)
    except WRONG_RECORD as error:
        raise BrokenFileError(f"{path}: is no calibration of a clip: {error}") from error


def _rate(head: Mapping[str, Any]) -> float:
    rate = number(head["frames_per_second"], "frames_per_second")
    if not 0.0 <= rate < np.inf:
        raise ValueError(f"frames_per_second must be a number of at least 0, got {rate}")
    return float(rate)


def tripods_in_words(found: VideoCalibration, frames_per_second: float = DEFAULT_RATE) -> dict[str, Any]:
    """Content of ``tripods.json``: shots, and the shared parameters of each tripod, with units in their names."""
    return {
        "format": FORMAT,
        "frames_per_second": frames_per_second,
        "shots": [
            {"first_frame": shot.start, "last_frame": shot.stop - 1, "tripod": None if shot.tripod < 0 else shot.tripod}
            for shot in found.shots
        ],
        "notes": [*found.notes, *map(str, found.findings)],
        "tripods": [dict(_in_words(tripod)) for tripod in found.tripods],
    }


def _in_words(tripod: SequenceCalibration) -> Iterator[tuple[str, Any]]:
    yield "frames", len(tripod)
    law = None if tripod.layout is None else tripod.layout.zoom_law
    # that at which the shared principal point and lens hold; None if they do not depend on it
    yield "reference_focal_length_px", None if law is None else float(np.exp(law.reference))
    yield "crown_m", tripod.crown
    for name, (value, deviation) in tripod.shared.items():
        yield WORDS.get(name, f"lens_{name}"), {"value": value, "standard_deviation": deviation}
