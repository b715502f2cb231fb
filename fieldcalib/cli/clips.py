"""`fieldcalib run` of a clip: its frames are calibrated together.

`fieldcalib run` of a stream: each frame is calibrated as it arrives, from those before it.

Several videos: each is a run of its own, and what fails does not stop the others.

Clips are worked on by one process each, with `--jobs` several of them side by side, a long one by several processes.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from functools import partial
from io import StringIO
from pathlib import Path
from typing import TypeAlias, cast

import numpy as np

from fieldcalib._json import texts_from_json
from fieldcalib._progress import counted, progress_bar, say, show, solving
from fieldcalib._whole_files import write_text
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.video import VideoCalibration
from fieldcalib.cli.run_options import TRIPOD, RunRequest
from fieldcalib.console.arguments import digest_of, load_network, or_search
from fieldcalib.images.clip.from_video import PART, Clip, FinishedPart
from fieldcalib.images.clip.tracker import Tracker
from fieldcalib.io.clips import SOLVING, ClipInput, Reading
from fieldcalib.io.files import WRONG_RECORD, BrokenFileError, parse_json_object, read_regular_file
from fieldcalib.io.formats import VIDEOS
from fieldcalib.io.frame_source import Frame
from fieldcalib.io.streams import Receiver, Stream, StreamReader
from fieldcalib.processes.jobs import Processes, in_order
from fieldcalib.processes.other_process import ProcessEndedError
from fieldcalib.run_folder.clip_results import write_clip_results
from fieldcalib.run_folder.engine import frames_of_files, live_tracker, tracked
from fieldcalib.run_folder.record import Outcome, RunRecord
from fieldcalib.run_folder.results import OVERLAY, PART_OF_CLIP, ResultsWriter, is_finished, open_camera_folder
from fieldcalib.run_folder.work_units import executor_of
from fieldcalib.solve.request import check_of_clip

RunFunction: TypeAlias = Callable[[RunRequest], int]


class KeptParts:
    """Calibrations of parts of a clip, each kept in a file until the run is finished.

    Parameters
    ----------
    out : Path
        Folder of the run.
    shards : sequence of Path
        Folders of shards of the run, which have parts too.
    """

    def __init__(self, out: Path, shards: Sequence[Path] = ()) -> None:
        self._out, self._folders = out, (out, *shards)

    def get(self, index: int) -> FinishedPart | None:
        """A part, None if it is not done yet."""
        for path in (folder / _part(index) for folder in self._folders):
            if path.exists():
                try:
                    record = parse_json_object(read_regular_file(path, most_bytes=np.inf), "a part")
                    reading = Reading(texts_from_json(record["ids"]), dict(record["broken"]), str(record["loss"]))
                    return FinishedPart(VideoCalibration.from_dict(record), reading)
                except WRONG_RECORD as error:
                    problem = f"is no part of a clip: {error}; remove it, for it is made again"
                    raise BrokenFileError(f"{path}: {problem}") from None
        return None

    def __setitem__(self, index: int, part: FinishedPart) -> None:
        write_text(self._out / _part(index), json.dumps(part.calibration.to_dict() | part.reading._asdict()))

    def remove(self) -> None:
        """Remove the files in the folder of the run."""
        for path in self._out.glob(f"{PART_OF_CLIP}*"):
            path.unlink()


def _part(index: int) -> str:
    return f"{PART_OF_CLIP}{index:04d}.json"


@dataclass(frozen=True)
class Shards:
    """Shards of a run on a clip, whose parts are to be joined."""

    record: RunRecord
    """Record of the run."""
    folders: Sequence[Path]


def run_clip(request: RunRequest, shards: Shards | None = None) -> int:
    """Calibrate a clip, or a shard of its parts, or join the parts in `shards`; returns the exit code."""
    run = request.run
    if run.shard is not None:
        run = run.changed(run.out, arguments=run.arguments)  # the shards are joined as the command line says
    if not request.refine:
        raise ValueError("--clip calibrates frames together from the lines in them: leave --no-refinement out")
    began = time.perf_counter()
    check_of_clip(request.known.flags(request.prior))
    network, threads = or_search(lambda: load_network(request.network)), request.network.video_threads
    source = frames_of_files(request.paths, request.cut, request.read, threads, is_clip=True)
    input = ClipInput(source, request.placement)
    if request.known.intrinsics is not None:
        input.frame_size()  # an error before anything is written
    record = RunRecord.of(run, source.files, unit=PART, network=digest_of(network))
    if shards is not None and (other := replace(shards.record, options=record.options).differences(record)):
        raise ValueError(f"the shards cannot be joined: {other}")
    with open_camera_folder(run, record, began, source.files) as results:
        if is_finished(run.out):
            return results.exit_code
        parts = KeptParts(run.out, () if shards is None else shards.folders)
        with solving(SOLVING, True), executor_of(run.jobs) as executor:
            clip = Clip.of(request.how(network), input)
            every = range(len(clip.parts))
            some = every if run.shard is None else every[run.shard.number - 1 :: run.shard.of]
            done = list(clip.calibrated(some, parts, executor))
            if run.shard is not None:
                show(f"{len(some)} of {counted(len(every), 'part')} in {run.out}: fieldcalib join puts them together")
                return 0
            found = clip.joined(done)
        results.calibrating = time.perf_counter() - began
        for note in found.notes:
            say(note)
        write_clip_results(results, input, found, request, threads)
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
    record = RunRecord.of(request.run, [], unit=1)
    path = request.run.out / OVERLAY
    end: Exception | KeyboardInterrupt | None = None
    check_of_clip(request.known.flags(request.prior))
    with ExitStack() as opened:
        receivers = [opened.enter_context(Receiver(address)) for address in request.send or ()]
        opened.enter_context(reader)
        results = opened.enter_context(open_camera_folder(request.run, record, began))
        video = opened.enter_context(VIDEOS.write(path, reader.frames_per_second, threads=threads))
        results.notes = request.notes
        with live_tracker(request.how(network), stream, reader, request.placement) as (frames, tracker):
            try:
                for frame in frames:
                    calibration, outcome = _calibrated(request, frame, tracker, results)
                    usable = calibration.camera if calibration or request.keep_rejected else None
                    for receiver in receivers:
                        receiver.send(outcome.line, usable)
                    results.add(outcome)
                    if request.draws and frame.image is not None:
                        video.write(request.drawn(frame.image, calibration))
            except (KeyboardInterrupt, ValueError, RuntimeError) as error:  # of a frame that is not as those before
                end = error
    if lateness := frames.lateness():
        say(lateness)
    if isinstance(end, KeyboardInterrupt):
        raise end
    loss = reader.loss()
    for said in filter(None, (loss, *(receiver.loss for receiver in receivers))):
        say(said)
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
        (request.same_camera is not None, "--same-camera"),
        (not request.refine, "--no-refinement"),
        (request.run.shard is not None, "--shard"),
    ):
        if given:
            raise ValueError(f"{name} is not of streams: each frame of {stream} is calibrated from those before it")


def _calibrated(
    request: RunRequest, frame: Frame, tracker: Tracker, results: ResultsWriter
) -> tuple[Calibration, Outcome]:
    """Calibrate the next frame."""
    start = time.perf_counter()
    calibration = tracked(tracker, frame, request.placement)
    results.calibrating += time.perf_counter() - start
    details = {"basis": str(tracker.basis), "time_s": frame.seconds}
    return calibration, request.outcome(frame.id, calibration, details=details)


@dataclass(frozen=True)
class Ended:
    """The end of a run in another process."""

    code: int
    out: str
    """Text for stdout."""
    err: str
    """Text for stderr."""


def run_several(requests: Sequence[RunRequest], run: RunFunction) -> int:
    """Run all requests; returns the largest exit code.

    Clips are worked on by ``--jobs`` processes side by side; if there are fewer clips than that, by several each.
    """
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
        more, left = divmod(jobs, len(requests))
        own = [one.in_one_thread(max(more + (k < left), 1)) for k, one in enumerate(requests)]
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
