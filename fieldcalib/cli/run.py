"""`fieldcalib run`: images or a video to cameras and overlays."""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice

import numpy as np

from fieldcalib.assess.placement import Placement
from fieldcalib.assess.result import Calibration
from fieldcalib.cli.clips import is_clip, run_clip
from fieldcalib.cli.declared import add_declarations, declared, declared_placement, is_aspect_estimated
from fieldcalib.cli.known_camera import KnownCamera, add_known_camera
from fieldcalib.cli.live import is_stream, run_stream
from fieldcalib.cli.several import run_several, runs_of
from fieldcalib.console.arguments import (
    ESTIMATED,
    add_camera,
    add_cut,
    add_format,
    add_limits,
    cut_of,
    folder_name,
)
from fieldcalib.console.field_options import KNOWN, NOMINAL, add_field, field_of, prior_of
from fieldcalib.console.inputs import add_inputs
from fieldcalib.console.network import add_network, add_refinement, load_network, network_in_process
from fieldcalib.draw.overlays import draw_calibration
from fieldcalib.fields.field import Field
from fieldcalib.images.from_images import calibrate_from_images
from fieldcalib.io.files import FrameFile
from fieldcalib.io.formats import CAMERAS, OVERLAYS, VIDEOS
from fieldcalib.io.image import Image
from fieldcalib.io.images import IMAGES_AT_ONCE, check_pixels, in_parts
from fieldcalib.io.line_log import whole_lines
from fieldcalib.io.results import LINES
from fieldcalib.localize import Network
from fieldcalib.run_folder.images import Frame, ReadImage, Source, frames_lost, lost, opened, say_note, video_threads
from fieldcalib.run_folder.results import OVERLAY, Outcome, Results, calibration_line, is_finished, result_folder
from fieldcalib.run_folder.run_record import RunRecord
from fieldcalib.run_folder.units import Made, add_jobs, work
from fieldcalib.solve.field_size import shared_size

TOGETHER = 40  # images of one field that tell its size,
ROUNDS = 2  # of calibrating them, and estimating it


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command, add its arguments and set ``run``, a function of them that gives the exit code."""
    parser.description = (
        "Find the markings in images or in a video, calibrate a camera for every frame and refine it on "
        "its image; the frames of a video are calibrated together. Writes camera_<id>.json in SoccerNet's format, "
        "cameras.jsonl with one line a frame, summary.json, and overlays: overlay_<id>.jpg of images, overlay.mp4 of a "
        "video, whose ids are numbers of frames. Of a clip also tripods.json with its shots and what their frames "
        "share, motion.png with the cameras over time, and worst_frames.jpg."
    )
    add_inputs(
        parser,
        "images, folders and zips of them, videos, folders of them, -: a video on standard input, URLs of streams",
        streams=True,
    )
    parser.add_argument(
        "--out",
        required=True,
        type=folder_name,
        metavar="DIR",
        help="where the results go; those of several videos into folders in it, by their names",
    )
    add_format(parser)
    add_cut(parser)
    add_network(parser)
    add_declarations(parser)
    add_field(parser, ESTIMATED)
    add_camera(parser)
    add_known_camera(parser)
    add_refinement(parser)
    together = parser.add_mutually_exclusive_group()
    together.add_argument(
        "--clip", action="store_true", help="the images are a clip, in the order of the numbers in their names"
    )
    together.add_argument(
        "--independent",
        action="store_true",
        help="calibrate each frame of a video by itself, as --no-refinement does too",
    )
    parser.add_argument(
        "--camera",
        choices=("tripod", "moving"),
        default="tripod",
        help="what a clip is taken by: one on a tripod, whose place is fixed (default), or a drone, one on wires or a "
        "hand, whose path is smooth",
    )
    parser.add_argument(
        "--keep-rejected", action="store_true", help="write the best camera of every frame, whatever the verdict says"
    )
    parser.add_argument(
        "--show-paint",
        action="store_true",
        help="draw markings that lie beside their paint in orange, and those without any in grey",
    )
    add_limits(parser)
    add_jobs(parser)
    parser.set_defaults(run=run, command="run")


def run(options: argparse.Namespace) -> int:
    """Calibrate; returns the exit code."""
    prior_of(options)  # what is wrong with field and prior is said before the network is loaded
    runs = runs_of(options)
    return _run(runs[0]) if len(runs) == 1 else run_several(runs, _run, lambda one: not is_stream(one) and is_clip(one))


def _run(options: argparse.Namespace) -> int:
    """One video or stream, or images."""
    began = time.perf_counter()
    KnownCamera.of(options)  # a ValueError if that cannot be
    place = partial(placed, options)
    if is_stream(options):
        return run_stream(options, place)
    if options.camera != "tripod" and not is_clip(options):
        raise ValueError("--camera is of clips: give a video, or images with --clip, without --independent")
    if options.same_field and (options.field_size != ESTIMATED or VIDEOS.recognises(options.input[0])):
        raise ValueError(f"--same-field is of images, with --field-size {ESTIMATED}: a clip shows one field anyway")
    if is_clip(options):
        return run_clip(options, place)
    function, cut = FromImages(options, load_network(options)), cut_of(options)
    with opened(options.input, options.most_pixels, check=place, cut=cut, threads=video_threads(options)) as source:
        if source.frames_per_second is not None and options.shard is not None:
            raise ValueError("--shard is of images: give every machine some of the videos")
        writes = [form.file_name("<id>") for form in (CAMERAS, OVERLAYS)]
        record = RunRecord.of(options, source.files, unit=IMAGES_AT_ONCE, writes=writes)
        with result_folder(options, record, began) as results:
            if is_finished(options.out):
                return results.exit_code
            if options.same_field:
                function = function.on_one_field(source.files)
            if source.frames_per_second is None:
                work(options, results, source.files, IMAGES_AT_ONCE, function, lost, source.count)
            else:
                _run_video(options, results, source, source.frames_per_second, function)
        is_cut = frames_lost(source)
    return 1 if is_cut else results.exit_code


def _run_video(
    options: argparse.Namespace, results: Results, source: Source, rate: float, function: FromImages
) -> None:
    """Calibrate each frame by itself. The overlay has all frames: those that are written already are drawn again."""
    lines = islice(whole_lines(options.out / LINES), results.done)
    frames = (replace(frame, line=next(lines, b"").decode()) for frame in source.frames)
    path = options.out / OVERLAY

    with VIDEOS.write(path, rate, threads=video_threads(options)) as video:

        def write(outcome: Outcome) -> None:
            if not outcome.is_written:
                results.add(outcome)
            if outcome.picture is not None:
                video.write(outcome.picture)

        work(options, results, frames, IMAGES_AT_ONCE, function, lost, source.count, write)
    say_note(path, video)


@dataclass(frozen=True)
class FromImages:
    """What is written of some images."""

    options: argparse.Namespace
    network: Network
    """Other processes load their own."""

    def __reduce__(self) -> tuple[object, ...]:
        return _in_process, (self.options,)

    def __call__(self, items: tuple[FrameFile | Frame, ...]) -> Made:
        """Read the images and calibrate."""
        place = partial(placed, self.options)
        read = ReadImage(self.options.most_bytes, self.options.most_pixels, place)

        def pixels_in_frame(frame: Frame) -> int:
            return 0 if frame.image is None else math.prod(place(frame.image).frame_size)

        parts = [self._of_part(part) for part in in_parts(map(read, items), IMAGES_AT_ONCE, pixels_in_frame)]
        return Made([outcome for part in parts for outcome in part.outcomes], sum(part.seconds for part in parts))

    def _of_part(self, frames: Sequence[Frame]) -> Made:
        options, field = self.options, field_of(self.options)
        start = time.perf_counter()
        if all(frame.line for frame in frames):
            calibrations = [Calibration.from_dict(json.loads(frame.line)) for frame in frames]
        else:
            seen = [(frame.image, placed(options, frame.image)) for frame in frames if frame.image is not None]
            images = [placement.image_in_frame(image) for image, placement in seen]
            found = self._calibrated(field, images)
            calibrations = [placement.from_frame(one) for one, (_, placement) in zip(found, seen, strict=True)]
        seconds = time.perf_counter() - start
        rest = iter(calibrations)
        outcomes = [
            lost(frame, frame.problem) if frame.image is None else self._outcome(frame, frame.image, next(rest), field)
            for frame in frames
        ]
        return Made(outcomes, seconds)

    def on_one_field(self, files: Sequence[FrameFile]) -> FromImages:
        """Take the field that some of the images tell together, evenly spread ones of the commonest size."""
        read = ReadImage(self.options.most_bytes, self.options.most_pixels, partial(placed, self.options))
        some = [files[k] for k in np.linspace(0, len(files) - 1, min(len(files), TOGETHER)).round().astype(int)]
        images = [image for image in (read(file).image for file in some) if image is not None]
        by_size: dict[tuple[int, ...], list[Image]] = {}
        for image in images:
            by_size.setdefault(image.shape, []).append(placed(self.options, image).image_in_frame(image))
        alike = max(by_size.values(), key=len, default=[])
        given = field_of(self.options)
        found = shared_size(given, [])
        for _ in range(ROUNDS if alike else 0):
            found = shared_size(given, self._calibrated(replace(found.field, size_known=True), alike))
        kind = KNOWN if found.is_told else NOMINAL  # what no image shows is not known
        sizes = {"field_length": found.length, "field_width": found.width, "field_size": kind}
        print(
            f"fieldcalib: the images show a field of {found.length:.1f} x {found.width:.1f} m ({found})",
            file=sys.stderr,
        )
        return replace(self, options=argparse.Namespace(**vars(self.options) | sizes))

    def _calibrated(self, field: Field, images: Sequence[Image]) -> list[Calibration]:
        known, prior = KnownCamera.of(self.options), prior_of(self.options)
        refine, has_borders = self.options.refine, self.options.crop_of is None
        by_size: dict[tuple[int, int], list[int]] = {}
        for index, image in enumerate(images):  # known intrinsics are of one size, nothing else depends on it
            size = (image.shape[1], image.shape[0]) if known.intrinsics is not None else (0, 0)
            by_size.setdefault(size, []).append(index)
        found: dict[int, Calibration] = {}
        for size, members in by_size.items():
            of_size = [images[index] for index in members]
            given = known.given(size)
            calibrations = calibrate_from_images(
                field,
                of_size,
                self.network,
                *given,
                flags=known.flags,
                prior=prior,
                refine=refine,
                take_off_borders=has_borders,
                estimate_aspect=is_aspect_estimated(self.options),
                estimate_size=self.options.field_size == ESTIMATED,
            )
            found.update(zip(members, calibrations, strict=True))
        said = declared(self.options)
        return [replace(found[index], declared=said) for index in range(len(images))]

    def _outcome(self, frame: Frame, image: Image, calibration: Calibration, field: Field) -> Outcome:
        shown = calibration.field or field
        picture = draw_calibration(image, calibration, shown, show_paint=self.options.show_paint)
        if frame.line:
            return Outcome(frame.id, frame.line, str(calibration.status), picture=picture, is_written=True)
        keeps = self.options.keep_rejected or bool(calibration)
        line = calibration_line(frame.id, calibration, None)
        if frame.is_of_video:
            return Outcome.of(frame.id, calibration, line, keeps=keeps, picture=picture)
        files = {OVERLAYS.file_name(frame.id): OVERLAYS.write(picture)}
        return Outcome.of(frame.id, calibration, line, keeps=keeps, files=files)


def _in_process(options: argparse.Namespace) -> FromImages:
    return FromImages(options, network_in_process(options))


def placed(options: argparse.Namespace, image: Image) -> Placement:
    """Where an image lies in its frame."""
    placement = declared_placement(options, (image.shape[1], image.shape[0]))
    check_pixels(placement.frame_size, options.most_pixels)
    KnownCamera.of(options).given(placement.frame_size)  # a BrokenFileError if it is of other images
    return placement
