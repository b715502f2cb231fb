"""`fieldcalib run` of a clip: its frames are calibrated together."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fieldcalib.assess.result import Calibration
from fieldcalib.assess.sequence_calibration import SequenceCalibration
from fieldcalib.assess.video import VideoCalibration
from fieldcalib.cli.run_options import RunRequest
from fieldcalib.console.network import load_network
from fieldcalib.console.program import say
from fieldcalib.console.progress import progress_bar
from fieldcalib.draw.clip_plot import plot_sequence
from fieldcalib.draw.sheet import contact_sheet, worst_frames
from fieldcalib.images.from_video import PART, calibrate_video
from fieldcalib.io.clips import OneSize, in_order
from fieldcalib.io.files import FrameFile, parse_json_object, read_regular_file, write_text
from fieldcalib.io.formats import VIDEOS
from fieldcalib.io.image import Image
from fieldcalib.io.images import write_image
from fieldcalib.io.videos import DEFAULT_RATE
from fieldcalib.run_folder.annotated import CAMERA_FILES
from fieldcalib.run_folder.images import Frame, checked_frames, image_files, in_cut, say_note
from fieldcalib.run_folder.outcome import Outcome
from fieldcalib.run_folder.record import RunRecord
from fieldcalib.run_folder.results import (
    MOTION,
    OVERLAY,
    PART_OF_CLIP,
    TRIPODS,
    WORST,
    ResultsWriter,
    is_finished,
    open_camera_folder,
)
from fieldcalib.solve.given_camera import check_of_clip

SHEET_FRAMES = 12  # in the contact sheet of the worst frames
PASSES = ("looking", "matching", "finding lines", "drawing")  # of the frames, in this order


class ClipInput:
    """The images of a clip as parts of their frames; they can be read several times."""

    def __init__(self, request: RunRequest) -> None:
        self._request, self._options = request, request.calibration
        self.ids: list[str] = []
        """Ids of all frames, in order; known after the first pass."""
        self.broken: dict[str, str] = {}
        """Problems of frames that cannot be read, by id."""
        self.loss = ""
        """Message about frames that the input announced and does not have."""
        self.frames_per_second = DEFAULT_RATE
        self._passes = iter(PASSES)
        if request.is_video:
            self.files = [FrameFile(request.path.stem, request.path)]
            next(self._from_video())  # what is wrong with it shows before anything is written
        else:
            self.files = in_cut(in_order(image_files(request.paths)), request.cut)

    def frame_size(self) -> tuple[int, int]:
        """Width and height of the frames, by the first one that can be read."""
        first = next((frame.image for frame in self._read() if frame.image is not None), None)
        return (0, 0) if first is None else self._options.placement(first).frame_size

    def __iter__(self) -> Iterator[Image]:
        """The images that can be read, as parts of their frames."""
        for frame in self.frames():
            if frame.image is not None:
                yield self._options.placement(frame.image).image_in_frame(frame.image)

    def frames(self) -> Iterator[Frame]:
        """The images as they are; what is wrong with one is said on stderr, once."""
        ids = []
        with progress_bar(desc=next(self._passes, ""), total=len(self.ids) or None, unit="frame") as progress:
            for frame in self._read():
                ids.append(frame.id)
                yield frame
                progress.update()
        self.ids = ids

    def _read(self) -> Iterator[Frame]:
        return self._from_video() if self._request.is_video else self._from_files()

    def _from_video(self) -> Iterator[Frame]:
        path, options = self._request.path, self._options
        threads = options.network.video_threads
        with VIDEOS.read(path, options.most_pixels, cut=self._request.cut, threads=threads) as video:
            self.frames_per_second = video.frames_per_second
            yield from checked_frames(path, video, options.placement)
            if not self.loss and (loss := video.loss()):
                self.loss = loss
                say(loss)

    def _from_files(self) -> Iterator[Frame]:
        one_size = OneSize()
        for file in self.files:
            if file.id in self.broken:
                yield Frame(file.id, None, self.broken[file.id], file.path)
                continue
            frame = self._options.read(file)
            if frame.image is None:
                self.broken[frame.id] = frame.problem
                say(f"{frame.path}: {frame.problem}")
            else:
                one_size.check(file, frame.image)
            yield frame


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
        return VideoCalibration.from_dict(parse_json_object(read_regular_file(path, most_bytes=np.inf), "a part"))

    def __setitem__(self, index: int, part: VideoCalibration) -> None:
        write_text(self._path(index), json.dumps(part.to_dict()))

    def remove(self) -> None:
        """Remove the files."""
        for path in self._out.glob(f"{PART_OF_CLIP}*"):
            path.unlink()


def run_clip(request: RunRequest) -> int:
    """Calibrate; returns the exit code."""
    run, options = request.run, request.calibration
    if not options.refine:
        raise ValueError("--clip calibrates frames together from the lines in them: leave --no-refinement out")
    if run.shard is not None:
        raise ValueError("--shard is of images that are calibrated one by one: give every machine some of the clips")
    began = time.perf_counter()
    check_of_clip(options.known.flags)
    network = load_network(options.network)
    clip = ClipInput(request)
    keywords = options.keywords((0, 0) if options.known.intrinsics is None else clip.frame_size())
    record = RunRecord.of(run, clip.files, unit=PART, writes=CAMERA_FILES)
    with open_camera_folder(run, record, began) as results:
        if is_finished(run.out):
            return results.exit_code
        parts = KeptParts(run.out)
        found = calibrate_video(options.field, clip, network, camera=options.camera, parts=parts, **keywords)
        results.calibrating = time.perf_counter() - began
        results.notes = found.notes
        for note in found.notes:
            say(note)
        worst = _write_frames(request, clip, found, results)
        write_text(run.out / TRIPODS, json.dumps(_tripods(found), indent=2) + "\n")
        if worst:
            write_image(run.out / MOTION, plot_sequence(found, frames_per_second=clip.frames_per_second))
            write_image(run.out / WORST, contact_sheet(list(worst.values()), list(worst)))
        parts.remove()
    return 1 if clip.broken or clip.loss else 0


def _write_frames(
    request: RunRequest, clip: ClipInput, found: VideoCalibration, results: ResultsWriter
) -> dict[str, Image]:
    """Write the results of all frames and the overlay video; returns pictures of the worst frames by caption."""
    options, path, done = request.calibration, request.run.out / OVERLAY, results.done
    calibrations = list(found)
    worst = worst_frames(calibrations, SHEET_FRAMES)
    pictures: dict[int, tuple[str, Image]] = {}
    readable = 0
    with VIDEOS.write(path, clip.frames_per_second, threads=options.network.video_threads) as video:
        for index, frame in enumerate(clip.frames()):
            if frame.image is None:
                if index >= done:  # its problem was printed when it was read first
                    results.add(replace(Outcome.broken(frame, frame.problem), complaint=""))
                continue
            calibration = options.placement(frame.image).from_frame(calibrations[readable])
            if index >= done:
                results.add(options.outcome(frame.id, calibration, details={"basis": str(found.basis[readable])}))
            picture = options.drawn(frame.image, calibration)
            video.write(picture)
            if readable in worst:
                pictures[readable] = _caption(frame.id, calibrations[readable]), picture
            readable += 1
    say_note(path, video)
    return dict(pictures[index] for index in worst if index in pictures)


def _tripods(found: VideoCalibration) -> dict[str, Any]:
    """Content of tripods.json: the shots, and the parameters that the frames of each tripod share."""
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
    """The focal length at which the shared principal point and lens hold; None if they do not depend on it."""
    law = None if tripod.layout is None else tripod.layout.zoom_law
    return None if law is None else float(np.exp(law.reference))


def _caption(id: str, calibration: Calibration) -> str:
    return f"{id}: {calibration.status}, {calibration.message}"
