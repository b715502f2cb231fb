"""`fieldcalib run`: images or a video to cameras and overlays."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TypeAlias

from fieldcalib.assess.result import Calibration
from fieldcalib.cli.arguments import LENSES, add_camera, add_field, field_of, prior_of
from fieldcalib.cli.clips import OF_CLIPS, is_clip, run_clip
from fieldcalib.cli.declared import Placement, add_declarations
from fieldcalib.cli.folder import broken_line, calibration_line, result_folder
from fieldcalib.cli.frames import (
    Frame,
    add_limits,
    add_network,
    add_refinement,
    frames_lost,
    load_network,
    opened,
    say_note,
)
from fieldcalib.draw.overlays import draw_calibration
from fieldcalib.images.from_images import calibrate_from_images
from fieldcalib.io.formats import OVERLAYS, VIDEOS
from fieldcalib.io.image import Image
from fieldcalib.io.images import IMAGES_AT_ONCE, check_pixels, in_parts, write_image

Write: TypeAlias = Callable[[str, Image], None]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command, add its arguments and set ``run``, a function of them that gives the exit code."""
    parser.description = (
        "Find the markings in images or in a video, calibrate a camera for every frame and refine it on "
        "its image; the frames of a video are calibrated together. Writes camera_<id>.json in SoccerNet's format, "
        "cameras.jsonl with one line a frame, summary.json, and overlays: overlay_<id>.jpg of images, overlay.mp4 of a "
        "video, whose ids are numbers of frames. Of a clip also tripods.json with its shots and what their frames "
        "share, motion.png with the cameras over time, and worst_frames.jpg."
    )
    parser.add_argument(
        "input", nargs="+", type=Path, metavar="INPUT", help="images, a folder or a zip of them, or one video"
    )
    parser.add_argument("--out", required=True, type=Path, metavar="DIR", help="where the results go")
    add_network(parser)
    add_declarations(parser)
    add_field(parser)
    add_camera(parser)
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
    add_limits(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Calibrate; returns the exit code."""
    from tqdm import tqdm

    began = time.perf_counter()
    if options.camera != "tripod" and not is_clip(options):
        raise ValueError("--camera is of clips: give a video, or images with --clip, without --independent")
    if is_clip(options):
        return run_clip(options, partial(_place, options))
    field, network = field_of(options), load_network(options)
    how = {"flags": LENSES[options.lens], "prior": prior_of(options), "refine": options.refine}

    place = partial(_place, options)

    def pixels_in_frame(frame: Frame) -> int:
        return 0 if frame.image is None else math.prod(place(frame.image).frame_size)

    def keeps(calibration: Calibration) -> bool:
        return options.keep_rejected or bool(calibration)

    broken = False
    with (
        opened(options.input, options.most_bytes, options.most_pixels, check=place) as source,
        result_folder(options, began, keeps) as results,
        overlays(options.out, source.frames_per_second) as write_overlay,
        tqdm(total=source.count, unit="frame", disable=None) as progress,
    ):
        for name in OF_CLIPS:  # of an earlier run
            (options.out / name).unlink(missing_ok=True)
        for part in in_parts(source.frames, IMAGES_AT_ONCE, pixels_in_frame):
            images = [place(frame.image).image_in_frame(frame.image) for frame in part if frame.image is not None]
            start = time.perf_counter()
            calibrations = iter(calibrate_from_images(field, images, network, **how))
            results.calibrating += time.perf_counter() - start
            for frame in part:
                if frame.image is None:
                    results.add(broken_line(frame.id, frame.problem), None)
                    broken = True
                    continue
                calibration = place(frame.image).from_frame(next(calibrations))
                results.add(calibration_line(frame.id, calibration, None), calibration)
                write_overlay(frame.id, draw_calibration(frame.image, calibration, field))
            progress.update(len(part))
        broken |= frames_lost(source)
    return 1 if broken else 0


def _place(options: argparse.Namespace, image: Image) -> Placement:
    """Where an image lies in its frame."""
    placement = Placement.declared(options, (image.shape[1], image.shape[0]))
    check_pixels(placement.frame_size, options.most_pixels)
    return placement


@contextmanager
def overlays(out: Path, frames_per_second: float | None) -> Iterator[Write]:
    """Writes pictures by the ids of their frames: of a video, into one, otherwise each on its own."""
    if frames_per_second is None:
        yield lambda id, picture: write_image(out / OVERLAYS.file_name(id), picture)
        return
    path = out / VIDEOS.file_name("overlay")
    with VIDEOS.write(path, frames_per_second) as video:
        yield lambda id, picture: video.write(picture)
    say_note(path, video)
