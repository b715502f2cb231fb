"""`fieldcalib run` of a clip: its frames are calibrated together."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fieldcalib.assess.placement import Placement
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.sequence_calibration import SequenceCalibration
from fieldcalib.assess.video import VideoCalibration
from fieldcalib.cli.arguments import cut_of
from fieldcalib.cli.declared import is_aspect_estimated
from fieldcalib.cli.fields import ESTIMATED, field_of, prior_of
from fieldcalib.cli.frames import (
    Frame,
    ReadImage,
    checked_frames,
    image_files,
    in_cut,
    load_network,
    lost,
    say_note,
    video_threads,
)
from fieldcalib.cli.known_camera import KnownCamera
from fieldcalib.cli.progress import progress_bar
from fieldcalib.cli.results import (
    MOTION,
    OVERLAY,
    PART_OF_CLIP,
    TRIPODS,
    WORST,
    Outcome,
    calibration_line,
    is_finished,
    result_folder,
)
from fieldcalib.cli.run_record import RunRecord
from fieldcalib.draw.clip_plot import plot_sequence
from fieldcalib.draw.contact_sheet import contact_sheet, worst_frames
from fieldcalib.draw.overlays import draw_calibration
from fieldcalib.images.from_video import PART, calibrate_video
from fieldcalib.io.clips import OneSize, in_order
from fieldcalib.io.files import FrameFile, parse_json_object, read_regular_file, write_text
from fieldcalib.io.formats import CAMERAS, VIDEOS
from fieldcalib.io.image import Image
from fieldcalib.io.images import write_image
from fieldcalib.io.videos import VideoReader
from fieldcalib.solve.given_camera import check_of_clip

IN_SHEET = 12  # frames
USUAL_RATE = 25.0  # frames per second of the overlay of images
PASSES = ("looking", "matching", "finding lines", "drawing")  # what the frames are read for


def is_clip(options: argparse.Namespace) -> bool:
    """Whether the input is a clip: a video unless it is said otherwise, images if it is said."""
    return bool(options.clip or (VIDEOS.recognises(options.input[0]) and not options.independent and options.refine))


class ClipInput:
    """The frames of a clip in their frames, which can be read again and again."""

    def __init__(self, options: argparse.Namespace, place: Callable[[Image], Placement]) -> None:
        self.options, self.place = options, place
        self.ids: list[str] = []
        """Of all frames, in order; known when they were read once."""
        self.broken: dict[str, str] = {}
        """What is wrong with those that cannot be read."""
        self.loss = ""
        """What to say of frames that the input announced and does not have."""
        self.frames_per_second = USUAL_RATE
        self._passes = iter(PASSES)
        self._files = None
        self.files = [FrameFile(options.input[0].stem, options.input[0])]
        """What they are read from."""
        if VIDEOS.recognises(options.input[0]):
            with self._opened() as video:
                next(checked_frames(options.input[0], video, place))  # before anything is written
        else:
            files = in_order(image_files(options.input))
            self._files = self.files = in_cut(files, cut_of(options))

    def frame_size(self) -> tuple[int, int]:
        """Width and height of the frames, by the first one that can be read."""
        if self._files is None:
            with self._opened() as video:
                images: Iterator[Image | None] = iter(video)
                first = next(images)
        else:
            read = ReadImage(self.options.most_bytes, self.options.most_pixels, self.place)
            images = (read(file).image for file in self._files)
            first = next((image for image in images if image is not None), None)
        return (0, 0) if first is None else self.place(first).frame_size

    def _opened(self) -> VideoReader:
        options = self.options
        return VIDEOS.read(options.input[0], options.most_pixels, cut=cut_of(options), threads=video_threads(options))

    def __iter__(self) -> Iterator[Image]:
        """The images that can be read, as parts of their frames."""
        for frame in self.frames():
            if frame.image is not None:
                yield self.place(frame.image).image_in_frame(frame.image)

    def frames(self) -> Iterator[Frame]:
        """The images as they are; what is wrong with one is said on stderr, once."""
        ids = []
        with progress_bar(desc=next(self._passes, ""), total=len(self.ids) or None, unit="frame") as progress:
            for frame in self._from_video() if self._files is None else self._from_files():
                ids.append(frame.id)
                if frame.image is None:
                    self.broken[frame.id] = frame.problem
                yield frame
                progress.update()
        self.ids = ids

    def _from_video(self) -> Iterator[Frame]:
        with self._opened() as video:
            self.frames_per_second = video.frames_per_second
            yield from checked_frames(self.options.input[0], video, self.place)
            if not self.loss and (loss := video.loss()):
                self.loss = loss
                print(f"fieldcalib: {loss}", file=sys.stderr)

    def _from_files(self) -> Iterator[Frame]:
        one_size = OneSize()
        read = ReadImage(self.options.most_bytes, self.options.most_pixels, self.place)
        for file in self._files or ():
            if file.id in self.broken:
                yield Frame(file.id, None, self.broken[file.id], file.path)
                continue
            frame = read(file)
            if frame.image is None:
                print(f"fieldcalib: {frame.path}: {frame.problem}", file=sys.stderr)
            else:
                one_size.check(file, frame.image)
            yield frame


class KeptParts:
    """Calibrations of parts of a clip, each in a file, for a run that goes on."""

    def __init__(self, out: Path) -> None:
        self._out = out

    def _path(self, index: int) -> Path:
        return self._out / f"{PART_OF_CLIP}{index:04d}.json"

    def get(self, index: int) -> VideoCalibration | None:
        """That of a part, None if it is not calibrated yet."""
        path = self._path(index)
        if not path.exists():
            return None
        return VideoCalibration.from_dict(parse_json_object(read_regular_file(path, most_bytes=np.inf), "a part"))

    def __setitem__(self, index: int, part: VideoCalibration) -> None:
        write_text(self._path(index), json.dumps(part.to_dict()))

    def remove(self) -> None:
        """Remove the files."""
        for path in self._out.glob(f"{PART_OF_CLIP}*"):
            path.unlink()


def run_clip(options: argparse.Namespace, place: Callable[[Image], Placement]) -> int:
    """Calibrate; returns the exit code."""
    if not options.refine:
        raise ValueError("--clip calibrates frames together from the lines in them: leave --no-refinement out")
    if options.shard is not None:
        raise ValueError("--shard is of images that are calibrated one by one: give every machine some of the clips")
    began = time.perf_counter()
    known = KnownCamera.of(options)
    check_of_clip(known.flags)
    field, network = field_of(options), load_network(options)
    clip = ClipInput(options, place)
    given = known.given((0, 0) if known.intrinsics is None else clip.frame_size())
    record = RunRecord.of(options, clip.files, unit=PART, writes=[CAMERAS.file_name("<id>")])
    with result_folder(options, record, began) as results:
        if is_finished(options.out):
            return results.exit_code
        parts = KeptParts(options.out)
        found = calibrate_video(
            field,
            clip,
            network,
            *given,
            flags=known.flags,
            prior=prior_of(options),
            take_off_borders=options.crop_of is None,
            estimate_aspect=is_aspect_estimated(options),
            estimate_size=options.field_size == ESTIMATED,
            camera=options.camera,
            parts=parts,
        )
        results.calibrating = time.perf_counter() - began
        results.notes = found.notes
        for note in found.notes:
            print(f"fieldcalib: {note}", file=sys.stderr)
        calibrations, basis = list(found), found.basis
        worst = worst_frames(calibrations, IN_SHEET)
        pictures: dict[int, Image] = {}
        readable, done = 0, results.done
        path = options.out / OVERLAY
        with VIDEOS.write(path, clip.frames_per_second, threads=video_threads(options)) as video:
            for index, frame in enumerate(clip.frames()):
                if frame.image is None:
                    if index >= done:  # what is wrong with it was said when it was read first
                        results.add(replace(lost(frame, frame.problem), complaint=""))
                    continue
                calibration = place(frame.image).from_frame(calibrations[readable])
                if index >= done:
                    line = calibration_line(frame.id, calibration, None) | {"basis": str(basis[readable])}
                    keeps = options.keep_rejected or bool(calibration)
                    results.add(Outcome.of(frame.id, calibration, line, keeps=keeps))
                shown = calibration.field or field
                picture = draw_calibration(frame.image, calibration, shown, show_paint=options.show_paint)
                video.write(picture)
                if readable in worst:
                    pictures[readable] = picture
                readable += 1
        say_note(path, video)
        write_text(options.out / TRIPODS, json.dumps(_tripods(found), indent=2) + "\n")
        if pictures:
            write_image(options.out / MOTION, plot_sequence(found, frames_per_second=clip.frames_per_second))
            ids = [id for id in clip.ids if id not in clip.broken]
            captions = [_caption(ids[index], calibrations[index]) for index in worst]
            write_image(options.out / WORST, contact_sheet([pictures[index] for index in worst], captions))
        parts.remove()
    return 1 if clip.broken or clip.loss else 0


def _tripods(found: VideoCalibration) -> dict[str, Any]:
    """What the frames of each tripod share, and which frames these are."""
    return {
        "shots": [shot._asdict() for shot in found.shots],
        "notes": list(found.notes),
        "tripods": [
            {
                "frames": len(tripod),
                "reference_focal_length_px": _reference(tripod),
                "crown": tripod.crown,
                "shared": {name: {"value": v, "standard_deviation": s} for name, (v, s) in tripod.shared.items()},
            }
            for tripod in found.tripods
        ],
    }


def _reference(tripod: SequenceCalibration) -> float | None:
    """The focal length at which principal point and lens are those that are shared; None if they do not follow it."""
    law = None if tripod.layout is None else tripod.layout.zoom_law
    return None if law is None else float(np.exp(law.reference))


def _caption(id: str, calibration: Calibration) -> str:
    return f"{id}: {calibration.status}, {calibration.message}"
