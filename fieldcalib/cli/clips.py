"""`fieldcalib run` of a clip: its frames are calibrated together."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import numpy as np

from fieldcalib.assess.result import Calibration
from fieldcalib.assess.sequence import SequenceCalibration
from fieldcalib.assess.video import VideoCalibration
from fieldcalib.cli.arguments import LENSES, field_of, prior_of
from fieldcalib.cli.declared import Placement
from fieldcalib.cli.folder import broken_line, calibration_line, name_skipped, result_folder
from fieldcalib.cli.frames import Frame, checked_frames, load_network, read_image, say_note
from fieldcalib.draw.clip_plot import plot_sequence
from fieldcalib.draw.contact_sheet import contact_sheet, worst_frames
from fieldcalib.draw.overlays import draw_calibration
from fieldcalib.images.from_video import calibrate_video
from fieldcalib.io.clips import OneSize, in_order
from fieldcalib.io.files import write_text
from fieldcalib.io.formats import IMAGES, VIDEOS
from fieldcalib.io.image import Image
from fieldcalib.io.images import write_image

MOTION, WORST, TRIPODS = "motion.png", "worst_frames.jpg", "tripods.json"
OF_CLIPS = (MOTION, WORST, TRIPODS)  # files that only clips have
IN_SHEET = 12  # frames
USUAL_RATE = 25.0  # frames per second of the overlay of images
PASSES = ("matching", "finding lines", "drawing")  # what the frames are read for


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
        if VIDEOS.recognises(options.input[0]):
            with VIDEOS.read(options.input[0], options.most_pixels) as video:
                next(checked_frames(options.input[0], video, place))  # before anything is written
        else:
            files = IMAGES.find(options.input)
            name_skipped(options.input, files)
            self._files = in_order(files)

    def __iter__(self) -> Iterator[Image]:
        """The images that can be read, as parts of their frames."""
        for frame in self.frames():
            if frame.image is not None:
                yield self.place(frame.image).image_in_frame(frame.image)

    def frames(self) -> Iterator[Frame]:
        """The images as they are; what is wrong with one is said on stderr, once."""
        from tqdm import tqdm

        first = not self.ids
        with tqdm(desc=next(self._passes, ""), total=len(self.ids) or None, unit="frame", disable=None) as progress:
            for frame in self._from_video() if self._files is None else self._from_files():
                if first:
                    self.ids.append(frame.id)
                    if frame.image is None:
                        self.broken[frame.id] = frame.problem
                yield frame
                progress.update()

    def _from_video(self) -> Iterator[Frame]:
        (path,) = self.options.input
        with VIDEOS.read(path, self.options.most_pixels) as video:
            self.frames_per_second = video.frames_per_second
            for index, image in enumerate(checked_frames(path, video, self.place)):
                yield Frame(f"{index:06d}", image)
            if not self.loss and (loss := video.loss()):
                self.loss = loss
                print(f"fieldcalib: {loss}", file=sys.stderr)

    def _from_files(self) -> Iterator[Frame]:
        one_size = OneSize()
        for file in self._files or ():
            if file.id in self.broken:
                yield Frame(file.id, None, self.broken[file.id])
                continue
            frame = read_image(file, self.options.most_bytes, self.options.most_pixels, self.place)
            if frame.image is not None:
                one_size.check(file, frame.image)
            yield frame


def run_clip(options: argparse.Namespace, place: Callable[[Image], Placement]) -> int:
    """Calibrate; returns the exit code."""
    if len(options.input) > 1 and any(map(VIDEOS.recognises, options.input)):
        raise ValueError("expected one video, or images and folders of them, got a video and more: run them one by one")
    if not options.refine:
        raise ValueError("--clip calibrates frames together from the lines in them: leave --no-refinement out")
    began = time.perf_counter()
    field, network = field_of(options), load_network(options)
    clip = ClipInput(options, place)
    with result_folder(options, began, lambda c: options.keep_rejected or bool(c)) as results:
        found = calibrate_video(
            field, clip, network, flags=LENSES[options.lens], prior=prior_of(options), camera=options.camera
        )
        results.calibrating = time.perf_counter() - began
        calibrations, basis = list(found), found.basis
        worst = worst_frames(calibrations, IN_SHEET)
        pictures: dict[int, Image] = {}
        readable = 0
        with ExitStack() as stack:
            video = stack.enter_context(VIDEOS.write(options.out / VIDEOS.file_name("overlay"), clip.frames_per_second))
            for frame in clip.frames():
                if frame.image is None:
                    results.add(broken_line(frame.id, frame.problem), None)
                    continue
                calibration = place(frame.image).from_frame(calibrations[readable])
                line = calibration_line(frame.id, calibration, None) | {"basis": str(basis[readable])}
                results.add(line, calibration)
                picture = draw_calibration(frame.image, calibration, calibration.field or field)
                video.write(picture)
                if readable in worst:
                    pictures[readable] = picture
                readable += 1
        say_note(options.out / VIDEOS.file_name("overlay"), video)
        write_text(options.out / TRIPODS, json.dumps(_tripods(found), indent=2) + "\n")
        if pictures:
            write_image(options.out / MOTION, plot_sequence(found, frames_per_second=clip.frames_per_second))
            ids = [id for id in clip.ids if id not in clip.broken]
            captions = [_caption(ids[index], calibrations[index]) for index in worst]
            write_image(options.out / WORST, contact_sheet([pictures[index] for index in worst], captions))
    return 1 if clip.broken or clip.loss else 0


def _tripods(found: VideoCalibration) -> dict[str, Any]:
    """What the frames of each tripod share, and which frames these are."""
    return {
        "shots": [shot._asdict() for shot in found.shots],
        "tripods": [
            {
                "frames": len(tripod),
                "reference_focal_length_px": _reference(tripod),
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
