"""`fieldcalib run` of a stream: each frame gets its camera as it comes, from those before it."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from itertools import chain, islice

from fieldcalib.assess.placement import Placement
from fieldcalib.cli.declared import is_aspect_estimated
from fieldcalib.cli.known_camera import KnownCamera
from fieldcalib.console.arguments import ESTIMATED, cut_of
from fieldcalib.console.field_options import field_of, prior_of
from fieldcalib.console.network import load_network
from fieldcalib.draw.overlays import draw_calibration
from fieldcalib.images.tracker import Tracker
from fieldcalib.io.formats import CAMERAS, VIDEOS
from fieldcalib.io.image import Image
from fieldcalib.io.streams import Stream, StreamReader
from fieldcalib.io.videos import VideoWriter
from fieldcalib.run_folder.images import Frame, checked_frames, say_note, video_threads
from fieldcalib.run_folder.results import OVERLAY, Outcome, Results, calibration_line, result_folder
from fieldcalib.run_folder.run_record import RunRecord
from fieldcalib.solve.given_camera import check_of_clip


def is_stream(options: argparse.Namespace) -> bool:
    """Whether the input is a stream."""
    return isinstance(options.input[0], Stream)


def run_stream(options: argparse.Namespace, place: Callable[[Image], Placement]) -> int:
    """Calibrate until nothing comes any more; returns the exit code. An interrupt is an end too."""
    stream: Stream = options.input[0]
    _check(options, stream)
    began = time.perf_counter()
    field, network = field_of(options), load_network(options)
    reader = StreamReader(stream, options.most_pixels, cut=cut_of(options), threads=video_threads(options))
    record = RunRecord.of(options, [], unit=1, writes=[CAMERAS.file_name("<id>")])
    path = options.out / OVERLAY
    end: Exception | KeyboardInterrupt | None = None
    known, size = KnownCamera.of(options), (0, 0)
    check_of_clip(known.flags)
    with (
        reader,
        result_folder(options, record, began) as results,
        VIDEOS.write(path, reader.frames_per_second, threads=video_threads(options)) as video,
    ):
        frames = checked_frames(stream, reader, place)
        if known.intrinsics is not None:  # these are for the size of the frames, which the first one tells
            first = list(islice(frames, 1))
            size = next((place(frame.image).frame_size for frame in first if frame.image is not None), size)
            frames = chain(first, frames)
        given, prior = known.given(size), prior_of(options)
        with Tracker(
            field,
            network,
            *given,
            flags=known.flags,
            prior=prior,
            take_off_borders=options.crop_of is None,
            estimate_aspect=is_aspect_estimated(options),
            estimate_size=options.field_size == ESTIMATED,
            wait=not stream.is_live,
        ) as tracker:
            try:
                for frame in frames:
                    _add(options, frame, place, tracker, results, video)
            except (KeyboardInterrupt, ValueError) as error:  # of a frame that is not as those before
                end = error
    say_note(path, video)
    if isinstance(end, KeyboardInterrupt):
        raise end
    if end or reader.end():
        print(f"fieldcalib: {end or reader.end()}", file=sys.stderr)
    return 1 if end else 0


def _check(options: argparse.Namespace, stream: Stream) -> None:
    """Refuse options that a stream has no use for."""
    if options.resume:
        raise ValueError(f"--resume is of files: {stream} cannot be read again")
    for given, name in (
        (options.camera != "tripod", "--camera"),
        (options.clip, "--clip"),
        (options.independent, "--independent"),
        (not options.refine, "--no-refinement"),
        (options.shard is not None, "--shard"),
    ):
        if given:
            raise ValueError(f"{name} is not of streams: each frame of {stream} is calibrated from those before it")


def _add(
    options: argparse.Namespace,
    frame: Frame,
    place: Callable[[Image], Placement],
    tracker: Tracker,
    results: Results,
    video: VideoWriter,
) -> None:
    """Calibrate the next frame, and write what is written of it."""
    assert frame.image is not None
    start = time.perf_counter()
    placement = place(frame.image)
    calibration = placement.from_frame(tracker.update(placement.image_in_frame(frame.image)))
    results.calibrating += time.perf_counter() - start
    line = calibration_line(frame.id, calibration, None) | {"basis": str(tracker.basis)}
    keeps = options.keep_rejected or bool(calibration)
    results.add(Outcome.of(frame.id, calibration, line, keeps=keeps))
    field = calibration.field or field_of(options)
    video.write(draw_calibration(frame.image, calibration, field, show_paint=options.show_paint))
