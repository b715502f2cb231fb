"""`fieldcalib run` of a stream: each frame is calibrated as it arrives, from those before it."""

from __future__ import annotations

import time
from itertools import chain, islice
from typing import cast

from fieldcalib._messages import say
from fieldcalib.cli.run_options import TRIPOD, CalibrationOptions, RunRequest
from fieldcalib.console.network import load_network
from fieldcalib.images.clip.tracker import Tracker
from fieldcalib.io.formats import VIDEOS
from fieldcalib.io.streams import Stream, StreamReader
from fieldcalib.io.videos import VideoWriter
from fieldcalib.run_folder.annotated import CAMERA_FILES
from fieldcalib.run_folder.images import Frame, checked_frames, say_note
from fieldcalib.run_folder.record import RunRecord
from fieldcalib.run_folder.results import OVERLAY, ResultsWriter, open_camera_folder
from fieldcalib.solve.task import check_of_clip


def run_stream(request: RunRequest) -> int:
    """Calibrate until the stream ends or is interrupted; returns the exit code."""
    stream, options = cast(Stream, request.input[0]), request.calibration
    _check(request, stream)
    began = time.perf_counter()
    network, threads = load_network(options.network), options.network.video_threads
    reader = StreamReader(stream, options.most_pixels, cut=request.cut, threads=threads)
    record = RunRecord.of(request.run, [], unit=1, writes=CAMERA_FILES)
    path = request.run.out / OVERLAY
    end: Exception | KeyboardInterrupt | None = None
    size = (0, 0)
    check_of_clip(options.known.flags)
    with (
        reader,
        open_camera_folder(request.run, record, began) as results,
        VIDEOS.write(path, reader.frames_per_second, threads=threads) as video,
    ):
        results.notes = options.notes
        frames = checked_frames(stream, reader, options.placement)
        if options.known.intrinsics is not None:  # these are for the size of the frames, which the first one tells
            first = list(islice(frames, 1))
            size = next((options.placement(frame.image).frame_size for frame in first if frame.image is not None), size)
            frames = chain(first, frames)
        with Tracker(options.field, network, wait=not stream.is_live, **options.keywords(size)) as tracker:
            try:
                for frame in frames:
                    _add(options, frame, tracker, results, video)
            except (KeyboardInterrupt, ValueError, RuntimeError) as error:  # of a frame that is not as those before
                end = error
    say_note(path, video)
    if isinstance(end, KeyboardInterrupt):
        raise end
    if loss := reader.loss():
        say(loss)
    if end or reader.end():
        say(str(end or reader.end()))
    return 1 if end or loss else 0


def _check(request: RunRequest, stream: Stream) -> None:
    """Raise a ValueError for options that do not apply to streams."""
    if request.run.resume:
        raise ValueError(f"--resume is of files: {stream} cannot be read again")
    for given, name in (
        (request.calibration.camera != TRIPOD, "--camera"),
        (request.calibration.clip, "--clip"),
        (request.calibration.independent, "--independent"),
        (not request.calibration.refine, "--no-refinement"),
        (request.run.shard is not None, "--shard"),
    ):
        if given:
            raise ValueError(f"{name} is not of streams: each frame of {stream} is calibrated from those before it")


def _add(
    options: CalibrationOptions, frame: Frame, tracker: Tracker, results: ResultsWriter, video: VideoWriter
) -> None:
    """Calibrate the next frame, and write its results."""
    assert frame.image is not None
    start = time.perf_counter()
    placement = options.placement(frame.image)
    calibration = placement.from_frame(tracker.update(placement.image_in_frame(frame.image)))
    results.calibrating += time.perf_counter() - start
    results.add(options.outcome(frame.id, calibration, details={"basis": str(tracker.basis)}))
    if options.draws:
        video.write(options.drawn(frame.image, calibration))
