"""`fieldcalib run`: images or a video to cameras and overlays."""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

from fieldcalib._progress import counted, say
from fieldcalib.assess.result import Calibration
from fieldcalib.cli.camera_options import KnownCamera
from fieldcalib.cli.clips import run_clip, run_several, run_stream
from fieldcalib.cli.open import check_page, open_at_first_doubt
from fieldcalib.cli.run_options import RunRequest, split_request
from fieldcalib.console.arguments import (
    NetworkOptions,
    add_camera,
    add_camera_files,
    add_cut,
    add_field,
    add_format,
    add_image_limits,
    add_inputs,
    add_run_options,
    cut_of,
    digest_of,
    folder_name,
    load_network,
    or_search,
)
from fieldcalib.console.options import add_options
from fieldcalib.fields.catalogue import AUTO
from fieldcalib.fields.field import Field
from fieldcalib.images.from_images import How, calibrate_pictures
from fieldcalib.images.search.place_search import MOST, pooled_place
from fieldcalib.images.search.stored_cameras import StoredCameras
from fieldcalib.io.decoders import check_av
from fieldcalib.io.files import FrameFile, check_utf8
from fieldcalib.io.formats import OVERLAYS, VIDEOS
from fieldcalib.io.frame_source import Frame, FrameSource, videos_in
from fieldcalib.io.image_files import IMAGES_AT_ONCE, Image, in_parts, size_of, spread
from fieldcalib.io.results import Texts, joined_line, whole_line_pairs
from fieldcalib.io.streams import Stream
from fieldcalib.results.entry import read
from fieldcalib.results.frames import Pictures, auto_field
from fieldcalib.run_folder.engine import calibrate_images, frames_of_files, outcomes_of
from fieldcalib.run_folder.record import ESTIMATED, Outcome, RunRecord
from fieldcalib.run_folder.results import OVERLAY, REPORT, ResultsWriter, is_finished, open_camera_folder
from fieldcalib.run_folder.work_units import UnitResult, grouped, joined, work
from fieldcalib.solve.field_size import shared_size

SAMPLE = 40  # images of one field from which its size is estimated
ROUNDS = 2  # of calibrating these images and estimating the size


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command and add its arguments, which `run` takes."""
    parser.description = (
        "Find the markings in images or in a video, calibrate a camera for every frame and refine it on its image; the "
        "frames of a video are calibrated together. Annotated frames take the options of fieldcalib calibrate --help, "
        "as --size. Writes cameras.jsonl with one line a frame, summary.json, and overlays: overlay_<id>.jpg of "
        "images, overlay.mp4 of a video, whose ids are numbers of frames. Of a clip also tripods.json with its shots "
        "and what their frames share, motion.png with the cameras over time, and worst_frames.jpg."
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
    add_camera_files(parser)
    add_cut(parser)
    add_options(parser, NetworkOptions)
    add_field(parser, ESTIMATED, auto=True)
    add_camera(parser)
    add_options(parser, KnownCamera)
    add_options(parser, RunRequest)
    add_image_limits(parser)
    add_run_options(parser)
    parser.add_argument(
        "--open",
        action="store_true",
        help="then open the results in the browser, at the first frame that is not good, as fieldcalib open does",
    )


def run(options: argparse.Namespace) -> int:
    """Calibrate; returns the exit code."""
    if options.field == AUTO:
        options.field = _field_shown(options)
    requests = split_request(RunRequest.of(options))
    if not options.open:
        return _run(requests[0]) if len(requests) == 1 else run_several(requests, _run)
    check_page("fieldcalib run --open")
    if len(requests) > 1:
        raise ValueError(f"--open is of one clip or of images, not of {len(requests)} inputs: fieldcalib open DIR/NAME")
    code = _run(requests[0])
    open_at_first_doubt(requests[0].run.out)
    return code


def _field_shown(options: argparse.Namespace) -> str:
    """Name of the field that the first input shows."""
    first = options.input[0]
    if isinstance(first, Stream):
        raise ValueError(f"--field {AUTO} is of files: a stream cannot be read twice")
    paths = [one for one in videos_in(first)[:1] if isinstance(one, Path)]
    return auto_field(Pictures(paths, cut=cut_of(options), is_clip=options.clip), say)


def _run(request: RunRequest) -> int:
    """Calibrate one video or stream, or images, and write the report."""
    code = _calibrate(request)
    if request.report:
        from fieldcalib.web.report import write_report  # a slow import

        write_report(read(request.run.out), request.run.out / REPORT)
    return code


def _calibrate(request: RunRequest) -> int:
    if request.is_clip or request.is_video or request.is_stream:
        check_utf8(request.run.out)  # of the overlay, before the work
        if request.draws:
            check_av("overlays (--no-pictures leaves them out) are written")
    if request.is_stream:
        return run_stream(request)
    request.check()
    return run_clip(request) if request.is_clip else _run_one_by_one(request)


def _run_one_by_one(request: RunRequest) -> int:
    """Calibrate images, or the frames of a video, one by one."""
    began = time.perf_counter()
    run, network = request.run, or_search(lambda: load_network(request.network))
    how = request.how(network)
    if request.same_camera:
        stored = StoredCameras.of(read(request.same_camera), request.field, how.side)
        say(f"images are compared with {counted(len(stored.cameras), 'camera')} of {request.same_camera}")
        how = replace(how, stored=stored)
    method = ImageCalibrator(request, how)
    request.check_place(is_searched=network is None)
    source = frames_of_files(request.paths, request.cut, request.read, request.network.video_threads)
    if source.rate is not None and run.shard is not None:
        raise ValueError("--shard is of images: give every machine some of the videos")
    writes = [OVERLAYS.file_name("<id>")] * request.draws
    record = RunRecord.of(run, source.files, unit=IMAGES_AT_ONCE, writes=writes, network=digest_of(network))
    with open_camera_folder(run, record, began, source.files) as results:
        results.notes = request.notes
        if is_finished(run.out):
            return results.exit_code
        if request.same_field:
            method = method.on_one_field(source.files, results)
        if request.same_camera == "":
            method = method.on_one_tripod(source.files)
        if source.rate is None:
            work(run, results, source.files, IMAGES_AT_ONCE, method, source.count)
        else:
            _run_video(request, results, source, method)
    return 1 if source.loss else results.exit_code


def _run_video(request: RunRequest, results: ResultsWriter, source: FrameSource, method: ImageCalibrator) -> None:
    """Calibrate each frame on its own; frames of an earlier part of the run are only drawn again."""
    run = request.run
    lines = islice(whole_line_pairs(run.out), results.done)
    frames = (replace(frame, line=_whole(next(lines, None))) for frame in source)
    path = run.out / OVERLAY

    with VIDEOS.write(path, source.frames_per_second, threads=request.network.video_threads) as video:

        def write(outcome: Outcome) -> None:
            if not outcome.is_written:
                results.add(outcome)
            if outcome.picture is not None:
                video.write(outcome.picture)

        work(run, results, frames, IMAGES_AT_ONCE, method, source.count, write)


def _whole(texts: Texts | None) -> dict[str, Any] | None:
    """The line of a frame from both files, None if there is none."""
    return None if texts is None else joined_line(*map(json.loads, texts))


@dataclass(frozen=True)
class ImageCalibrator:
    """Calibrates images one by one."""

    request: RunRequest
    how: How

    def __call__(self, items: tuple[FrameFile | Frame, ...]) -> UnitResult:
        """Read the images and calibrate."""

        def pixels_in_frame(frame: Frame) -> int:
            return 0 if frame.image is None else math.prod(self.request.placement(frame.image).frame_size)

        frames = map(self.request.read, items)
        return joined([self._of_part(part) for part in in_parts(frames, IMAGES_AT_ONCE, pixels_in_frame)])

    def _of_part(self, frames: Sequence[Frame]) -> UnitResult:
        start = time.perf_counter()
        if all(frame.line is not None for frame in frames):
            calibrations = [Calibration.from_dict(frame.line) for frame in frames if frame.line is not None]
        else:
            images = [frame.image for frame in frames if frame.image is not None]
            calibrations = calibrate_images(self.how, images, self.request.placement)
        seconds = time.perf_counter() - start
        return UnitResult(outcomes_of(frames, calibrations, self._outcome), seconds)

    def on_one_field(self, files: Sequence[FrameFile], results: ResultsWriter) -> ImageCalibrator:
        """Estimate the size of the field from some images together: evenly spread ones of the most common size.

        It becomes a note of the results.
        """
        alike = max(grouped(self._some_in_frame(files, SAMPLE), size_of).values(), key=len, default=[])
        given, how = self.request.field, self.how

        def on(field: Field, *, size_known: bool = True) -> How:
            return replace(how, task=replace(how.task, object_segments=replace(field, size_known=size_known)))

        found = shared_size(given, [])
        for _ in range(ROUNDS if alike else 0):
            found = shared_size(given, calibrate_pictures(on(found.field), alike))
        note = f"the images show a field of {found.length:.1f} x {found.width:.1f} m ({found})"
        say(note)
        results.notes = (*results.notes, note)
        how = on(found.field, size_known=found.is_told)  # a size that no image shows is not known
        return replace(self, how=replace(how, estimate_size=False))

    def on_one_tripod(self, files: Sequence[FrameFile]) -> ImageCalibrator:
        """Find the place of the camera from some images together."""
        given, task, images = self.request.field, self.how.task, self._some_in_frame(files, MOST)
        place = pooled_place(
            given, images, flags=self.request.known.flags(task.prior), prior=task.prior, side=self.how.side
        )
        if place is None:
            say("the images tell no common place of their camera: each is searched by itself")
        else:
            say(f"the camera stands at ({place.C[0]:.1f}, {place.C[1]:.1f}, {place.C[2]:.1f}) m")
        return replace(self, how=replace(self.how, place=place))

    def _some_in_frame(self, files: Sequence[FrameFile], most: int) -> list[Image]:
        """Read evenly spread images, and place them in their frames."""
        read = (self.request.read(files[k]).image for k in spread(len(files), most))
        return [self.request.placement(image).image_in_frame(image) for image in read if image is not None]

    def _outcome(self, frame: Frame, image: Image, calibration: Calibration) -> Outcome:
        picture = self.request.drawn(image, calibration) if self.request.draws else None
        if frame.line is not None:
            return Outcome(frame.line, picture=picture, is_written=True)
        if frame.is_of_video:
            return self.request.outcome(frame.id, calibration, picture=picture)
        files = {} if picture is None else {OVERLAYS.file_name(frame.id): OVERLAYS.write(picture)}
        return self.request.outcome(frame.id, calibration, files=files)
