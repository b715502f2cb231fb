"""All frames of every tripod of a clip, from the lines in them and the matches that tie them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from fieldcalib._types import BoolArray, IntArray
from fieldcalib.assess.markings import MarkingInView
from fieldcalib.assess.sequence_calibration import SequenceCalibration
from fieldcalib.assess.video import NO_TRIPOD, Shot, VideoCalibration
from fieldcalib.images.clip_lines import PAINT_EVERY, ClipLines, find_clip_lines
from fieldcalib.images.field_markings import Markings
from fieldcalib.images.hypotheses import NO_MARKING
from fieldcalib.images.paint_evidence import evidence_of
from fieldcalib.images.pieces import CameraModel
from fieldcalib.images.solved_tripods import Tripod
from fieldcalib.io.image import Image
from fieldcalib.localize import Network
from fieldcalib.solve.from_segments import NO_PIXELS

LONGEST_GAP = 25  # frames without a camera in a row that are interpolated: a second
MIXED = "the picture may be mixed with that of another camera"


def finish(lines: ClipLines) -> VideoCalibration:
    """Calibrate all frames of every tripod; paint beside projected markings counts against a camera."""
    solved, pieces = lines.solved, lines.solved.pieces
    tripod_of, number = np.full(len(pieces.number), NO_TRIPOD), np.zeros(len(pieces.number), dtype=np.intp)
    calibrations: list[SequenceCalibration] = []
    for tripod, members in zip(solved.tripods, lines.members, strict=True):
        if not members:
            continue
        frames = pieces.frames(members)
        tripod_of[frames], number[frames] = len(calibrations), np.arange(len(frames))
        start = tripod.calibration if members == tripod.pieces else None
        calibration = solved.keyframes.calibrate(pieces, members, lines.labels, start)
        if pieces.models_of(members) != {CameraModel.ALONE}:
            calibration = calibration.interpolated(pieces.number[frames], LONGEST_GAP)
        calibration = calibration.with_notes({NO_PIXELS: f"{NO_MARKING}, and no frame around it tells its camera"})
        calibrations.append(calibration.seen_in_images(_markings_seen(lines, calibration, frames)))
    for t in _mixed(solved.keyframes.shots.loose, tripod_of):
        if tripod_of[t] != NO_TRIPOD:
            calibrations[tripod_of[t]] = calibrations[tripod_of[t]].doubted({int(number[t]): MIXED})
    shots = [pieces.frames([p]) for p in pieces.numbers]
    return VideoCalibration(
        tuple(calibrations),
        tuple(Shot(int(one[0]), int(one[-1]) + 1, int(tripod_of[one[0]])) for one in shots),
        tripod_of,
        number,
        solved.notes,
    )


def finish_again(
    first: VideoCalibration, lines: ClipLines, images: Iterable[Image], network: Network
) -> VideoCalibration:
    """Find lines near the markings of finished cameras, and finish again if more markings lie on paint then."""
    kept = [members for members in lines.members if members]
    tripods = tuple(Tripod(*one) for one in zip(kept, first.tripods, strict=True))
    second = finish(find_clip_lines(replace(lines.solved, tripods=tripods), images, network))
    return second if _cameras(second) >= _cameras(first) and off_paint(second) < off_paint(first) else first


def off_paint(video: VideoCalibration) -> float:
    """Share of the frames with a camera in which a marking lies beside its paint; 0 without any."""
    off = [any(one.is_beside for one in seen) for tripod in video.tripods for seen in tripod.frames.markings.values()]
    return sum(off) / max(_cameras(video), 1)


def _cameras(video: VideoCalibration) -> int:
    """Number of frames with a camera."""
    return sum(int(np.count_nonzero(tripod.usable)) for tripod in video.tripods)


def _mixed(loose: BoolArray, tripod: IntArray) -> list[int]:
    """Numbers of loose frames between frames of two tripods; `loose` and `tripod` are (T,)."""
    edges = np.flatnonzero(np.diff(loose, prepend=False, append=False)).tolist()
    runs = [range(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True) if b < len(loose)]
    return [t for run in runs if tripod[run.start - 1] != tripod[run.stop] for t in run]


def _markings_seen(
    lines: ClipLines, calibration: SequenceCalibration, frames: IntArray
) -> dict[int, tuple[MarkingInView, ...]]:
    """The markings that frames of a tripod show, by the numbers of the frames in it.

    A frame in which none were looked for takes those of the nearest other frame, if that is near and of the same piece.
    """
    field, number = calibration.field, lines.solved.pieces.number[frames]
    markings = Markings.of(lines.solved.keyframes.options.object_segments if field is None else field)
    cameras = {k: calibration[k].camera for k, t in enumerate(frames.tolist()) if t in lines.ridges}
    seen = {
        k: evidence_of(lines.ridges[int(frames[k])].seen_by(camera, markings), markings).markings
        for k, camera in cameras.items()
        if camera is not None
    }
    if not seen:
        return {}
    looked_at = np.array(list(seen))
    nearest = looked_at[np.argmin(np.abs(frames[looked_at] - frames[:, None]), axis=1)]
    is_near = (np.abs(frames[nearest] - frames) < PAINT_EVERY) & (number[nearest] == number)
    return {k: seen[int(nearest[k])] for k in np.flatnonzero(is_near).tolist()}
