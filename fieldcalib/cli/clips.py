"""`fieldcalib run` of a clip: its frames are calibrated together."""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np

from fieldcalib._messages import say
from fieldcalib._progress import solving
from fieldcalib.assess.video import VideoCalibration
from fieldcalib.cli.run_options import RunRequest
from fieldcalib.console.network import digest_of, load_network, or_search
from fieldcalib.images.clip.from_video import PART, calibrate_video
from fieldcalib.io.files import WRONG_RECORD, BrokenFileError, parse_json_object, read_regular_file, write_text
from fieldcalib.run_folder.annotated import CAMERA_FILES
from fieldcalib.run_folder.clip_input import SOLVING, ClipInput, clip_frames
from fieldcalib.run_folder.clip_results import write_clip_results
from fieldcalib.run_folder.record import RunRecord
from fieldcalib.run_folder.results import PART_OF_CLIP, is_finished, open_camera_folder
from fieldcalib.solve.task import check_of_clip


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
    run, options = request.run, request.calibration
    if not options.refine:
        raise ValueError("--clip calibrates frames together from the lines in them: leave --no-refinement out")
    if run.shard is not None:
        raise ValueError("--shard is of images that are calibrated one by one: give every machine some of the clips")
    began = time.perf_counter()
    check_of_clip(options.known.flags)
    network = or_search(lambda: load_network(options.network))
    source = clip_frames(request.paths, request.cut, options.read, options.network.video_threads)
    clip = ClipInput(source, options.placement)
    keywords = options.keywords((0, 0) if options.known.intrinsics is None else clip.frame_size())
    record = RunRecord.of(run, source.files, unit=PART, writes=CAMERA_FILES, network=digest_of(network))
    with open_camera_folder(run, record, began, source.files) as results:
        if is_finished(run.out):
            return results.exit_code
        parts = KeptParts(run.out)
        with solving(SOLVING):
            found = calibrate_video(
                options.field,
                clip,
                network,
                camera=options.camera,
                may_be_enlarged=options.pictures.may_be_enlarged,
                parts=parts,
                **keywords,
            )
        results.calibrating = time.perf_counter() - began
        for note in found.notes:
            say(note)
        said = write_clip_results(results, clip, found, options, options.network.video_threads)
        if said:
            say(said)
        parts.remove()
    return 1 if source.broken or source.loss else 0
