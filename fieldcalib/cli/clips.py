"""`fieldcalib run` of a clip: its frames are calibrated together.

`fieldcalib run` of a stream: each frame is calibrated as it arrives, from those before it.

Several videos: each is a run of its own, and what fails does not stop the others.

Clips are worked on by one process each, with `--jobs` several of them side by side.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import partial
from io import StringIO
from pathlib import Path
from typing import TypeAlias, cast

import numpy as np

from fieldcalib._progress import progress_bar, say, solving
from fieldcalib.assess.video import VideoCalibration
from fieldcalib.cli.run_options import TRIPOD, RunRequest
from fieldcalib.console.arguments import digest_of, load_network, or_search
from fieldcalib.images.clip.from_video import PART, calibrate_clip
from fieldcalib.images.clip.tracker import Tracker
from fieldcalib.io.files import WRONG_RECORD, BrokenFileError, parse_json_object, read_regular_file, write_text
from fieldcalib.io.formats import VIDEOS
from fieldcalib.io.streams import Stream, StreamReader
from fieldcalib.io.videos import VideoWriter
from fieldcalib.processes.jobs import Processes, in_order
from fieldcalib.processes.other_process import ProcessEndedError
from fieldcalib.run_folder.clip_results import write_clip_results
from fieldcalib.run_folder.engine import live_tracker, tracked
from fieldcalib.run_folder.frame_source import SOLVING, ClipInput, Frame, frames_of_files
from fieldcalib.run_folder.labelled_frames import CAMERA_FILES
from fieldcalib.run_folder.record import RunRecord
from fieldcalib.run_folder.results import OVERLAY, PART_OF_CLIP, ResultsWriter, is_finished, open_camera_folder
from fieldcalib.solve.request import check_of_clip

RunFunction: TypeAlias = Callable[[RunRequest], int]


class KeptParts:
    """Calibrations of parts of a clip, each kept in a file until the run is finished."""

    def __init__(self, out: Path) -> None:
        self._out = out

    def _path(self, index: int) -> Path:
        return self._out / f"{PART_OF_CLIP}{index:04d}.json"

    def get(self, index: int) -> VideoCalibration | None:
        """The calibration of a part, None if there is none yet."""
        path = self._path(index)
        if not path.exists():
            return None
        try:
            return VideoCalibration.from_dict(parse_json_object(read_regular_file(path, most_bytes=np.inf), "a part"))
        except WRONG_RECORD as error:
            raise BrokenFileError(f"{path}: is no part of a clip: {error}; remove it, for it is made again") from None

    def __setitem__(self, index: int, part: VideoCalibration) -> None:
        write_text(self._path(index), json.dumps(part.to_dict()))

    def remove(self) -> None:
        """Remove the files."""
        for path in self._out.glob(f"{PART_OF_CLIP}*"):
            path.unlink()


def run_clip(request: RunRequest) -> int:
    """Calibrate; returns the exit code."""
    run = request.run
    if not request.refine:
        raise ValueError("--clip calibrates frames together from the lines in them: leave --no-refinement out")
    if run.shard is not None:
        raise ValueError("--shard is of images that are calibrated one by one: give every machine some of the clips")
    began = time.perf_counter()
    check_of_clip(request.known.flags)
    network, threads = or_search(lambda: load_network(request.network)), request.network.video_threads
    source = frames_of_files(request.paths, request.cut, request.read, threads, is_clip=True)
    clip = ClipInput(source, request.placement)
    if request.known.intrinsics is not None:
        clip.frame_size()  # an error before anything is written
    record = RunRecord.of(run, source.files, unit=PART, writes=CAMERA_FILES, network=digest_of(network))
    with open_camera_folder(run, record, began, source.files) as results:
        if is_finished(run.out):
            return results.exit_code
        parts = KeptParts(run.out)
        with solving(SOLVING, True):
            found = calibrate_clip(request.how(network), clip, parts)
        results.calibrating = time.perf_counter() - began
        for note in found.notes:
            say(note)
        write_clip_results(results, clip, found, request, threads)
        parts.remove()
    return 1 if source.broken or source.loss else 0


def run_stream(request: RunRequest) -> int:
    """Calibrate until the stream ends or is interrupted; returns the exit code."""
    stream = cast(Stream, request.input[0])
    _check(request, stream)
    began = time.perf_counter()
    network, threads = load_network(request.network), request.network.video_threads
    reader = StreamReader(stream, request.most_pixels, cut=request.cut, threads=threads)
    if reader.remark:
        say(reader.remark)
    record = RunRecord.of(request.run, [], unit=1, writes=CAMERA_FILES)
    path = request.run.out / OVERLAY
    end: Exception | KeyboardInterrupt | None = None
    check_of_clip(request.known.flags)
    with (
        reader,
        open_camera_folder(request.run, record, began) as results,
        VIDEOS.write(path, reader.frames_per_second, threads=threads) as video,
    ):
        results.notes = request.notes
        with live_tracker(request.how(network), stream, reader, request.placement) as (frames, tracker):
            try:
                for frame in frames:
                    _add(request, frame, tracker, results, video)
            except (KeyboardInterrupt, ValueError, RuntimeError) as error:  # of a frame that is not as those before
                end = error
    if lateness := frames.lateness():
        say(lateness)
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
        (request.camera != TRIPOD, "--camera"),
        (request.clip, "--clip"),
        (request.independent, "--independent"),
        (not request.refine, "--no-refinement"),
        (request.run.shard is not None, "--shard"),
    ):
        if given:
            raise ValueError(f"{name} is not of streams: each frame of {stream} is calibrated from those before it")


def _add(request: RunRequest, frame: Frame, tracker: Tracker, results: ResultsWriter, video: VideoWriter) -> None:
    """Calibrate the next frame, and write its results."""
    assert frame.image is not None
    start = time.perf_counter()
    calibration = tracked(tracker, frame, request.placement)
    results.calibrating += time.perf_counter() - start
    results.add(request.outcome(frame.id, calibration, details={"basis": str(tracker.basis)}))
    if request.draws:
        video.write(request.drawn(frame.image, calibration))


@dataclass(frozen=True)
class Ended:
    """The end of a run in another process."""

    code: int
    out: str
    """Text for stdout."""
    err: str
    """Text for stderr."""


def run_several(requests: Sequence[RunRequest], run: RunFunction) -> int:
    """Run all requests, clips by ``--jobs`` processes side by side; returns the largest exit code."""
    jobs = requests[0].run.jobs
    alone: list[RunRequest] = []
    side_by_side: list[RunRequest] = []
    for one in requests:
        (side_by_side if jobs > 1 and one.is_clip and not one.is_stream else alone).append(one)
    codes = [_code(run, one) for one in alone]
    if side_by_side:
        codes += _by_processes(side_by_side, run, jobs)
    return max(codes)


def _by_processes(requests: Sequence[RunRequest], run: RunFunction, jobs: int) -> list[int]:
    codes = []
    with Processes(min(jobs, len(requests))) as executor, progress_bar(total=len(requests), unit="video") as progress:
        own = [one.in_one_thread() for one in requests]
        for ended in in_order(executor, partial(_ended, run), own, ahead=jobs, rescue=_lost):
            sys.stdout.write(ended.out)
            sys.stderr.write(ended.err)
            codes.append(ended.code)
            progress.update()
    return codes


def _ended(run: RunFunction, request: RunRequest) -> Ended:
    out, err = StringIO(), StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        code = _code(run, request)
    return Ended(code, out.getvalue(), err.getvalue())


def _code(run: RunFunction, request: RunRequest) -> int:
    """The exit code of a run; an error that ends it is said on stderr."""
    try:
        return run(request)
    except BrokenPipeError:
        raise
    except (OSError, ValueError) as error:
        say(str(error))
        return 1 if isinstance(error, BrokenFileError) else 2


def _lost(request: RunRequest, error: ProcessEndedError) -> Ended:
    problem = f"the process that worked on it ended with exit code {error.exit_code}"
    return Ended(1, "", f"fieldcalib: {request.input[0]}: {problem}: --resume goes on with it\n")
