"""Second pass over a part of a video: lines are found in every frame, and all frames of each tripod solved from them.

Lines are looked for near the markings that the cameras of the first pass project.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.assess.findings import CUT, Finding, What
from fieldcalib.assess.paint_in_view import MarkingInView, paint_share
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.sequence_calibration import SequenceCalibration, with_doubts
from fieldcalib.assess.video import NO_TRIPOD, Shot, VideoCalibration
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.clip.clip_models import CUT_OUT, CameraModel, Pieces
from fieldcalib.images.clip.clip_problem import calibrate_frames_alone
from fieldcalib.images.clip.clip_shape import OFF_MIDDLE, better_of_enlarged, may_be_enlarged, off_middle
from fieldcalib.images.clip.solved_shots import SolvedTripods, Tripod
from fieldcalib.images.from_images import How
from fieldcalib.images.paint.detected_lines import detected_lines, with_replaced
from fieldcalib.images.paint.line_profiles import Markings, Profiles, profiles_along
from fieldcalib.images.paint.paint_evidence import Ridges, evidence_of, paint_past_ends, widths_by_marking, with_extents
from fieldcalib.io.image_files import Image
from fieldcalib.problem.labelled_pixels import NO_PIXELS, PixelTable
from fieldcalib.problem.layout import PRINCIPAL_POINT
from fieldcalib.problem.picture_shape import Declared, is_whole_shape
from fieldcalib.problem.projection import Projection
from fieldcalib.solve.from_segments import NOTHING_LABELLED
from fieldcalib.solve.sequence.joint_solution import LARGEST_SIZE_SIGMA, OTHER_SIZE

PAINT_EVERY = 5  # in one frame of so many, and in keyframes, paint beside the markings is looked for
LEAST_LINES = 0.2  # share of the profiles across the projected markings of a shot that must show a line
LONGEST_GAP = 25  # frames without a camera in a row that are interpolated: a second
# Share of the markings in view that shows paint, median over a shot: in right ones of eleven broadcasts 0.86 to 1, in a
# rendered one with faint lines 0.52; 0.40 in a rendered one whose camera was 19 m off.
LEAST_PAINT = 0.47
LEAST_ENDS = 3  # frames that must show the end of a line before paint past it counts
MIXED = Finding(What.MIXED)
UNTIED = (  # the message claims nothing about the picture: without a camera no lines are looked for
    "nothing ties this picture to those around it, as in a dissolve, a flash or a pan too fast to follow, and it has "
    "no camera of its own"
)


@dataclass(frozen=True, eq=False)
class ClipLines:
    """The lines in the frames of a clip, near the markings that the cameras of its tripods project."""

    solved: SolvedTripods
    members: tuple[tuple[int, ...], ...]
    """Pieces of each tripod whose frames show its lines."""
    labels: Mapping[int, PixelTable]
    """Lines by frame."""
    paint: Mapping[int, FramePaint]
    """Paint around the markings, by frame; of some frames only."""


class FramePaint(NamedTuple):
    """Paint around the markings that a camera projects into a frame."""

    ridges: Ridges
    past: Ridges
    """Lines past the ends of the markings."""
    widths: Mapping[str, Array]
    """Widths of the paint of the markings, as `widths_by_marking` measures them."""

    @classmethod
    def of(cls, image: Image, camera: Camera, profiles: Profiles, markings: Markings) -> FramePaint:
        """Look for it in an image, given the `profiles` of its camera."""
        widths = widths_by_marking(image, profiles, markings)
        return cls(Ridges.of(image, profiles), Ridges.past_ends(image, camera, markings), widths)


def find_clip_lines(solved: SolvedTripods, images: Iterable[Image]) -> ClipLines:
    """Find the lines in all frames; in keyframes and in every fifth frame, look for paint beside the markings too.

    Only frames of pieces that are calibrated one by one are given to the network.
    """
    pieces, how = solved.pieces, solved.keyframes.how
    given = Markings.of(how.task.object_segments)
    cameras: dict[int, tuple[Calibration, Markings]] = {}
    for tripod in solved.tripods:
        field = tripod.calibration.field
        markings = given if field is None else Markings.of(field)
        frames = pieces.frames(tripod.pieces).tolist()
        cameras |= {t: (one, markings) for t, one in zip(frames, tripod.calibration, strict=True)}
    keys = {key for key, _ in solved.keyframes.shots.matches}
    labels: dict[int, PixelTable] = {}
    paint: dict[int, FramePaint] = {}
    counts = np.zeros((2, pieces.numbers[-1] + 1))  # profiles with a line, and all profiles, of each piece
    for t, image in enumerate(images):
        is_alone = pieces.model_of([int(pieces.number[t])]).is_alone
        calibration, markings = (None, given) if is_alone else cameras.pop(t, (None, given))
        if is_alone:
            (calibration,) = calibrate_frames_alone(how, [image])
        if calibration is None or calibration.camera is None:
            continue
        profiles = profiles_along(calibration.camera, markings)
        if is_alone and calibration.solved is not None:
            labels[t] = calibration.solved.pixels
        else:
            labels[t] = detected_lines(image, profiles, markings, picture_sigma(calibration))
        counts[:, pieces.number[t]] += (1, 1) if is_alone else (len(labels[t].frame), len(profiles))
        if is_alone or t in keys or t % PAINT_EVERY == 0:
            paint[t] = FramePaint.of(image, calibration.camera, profiles, markings)
            beside = NO_PIXELS if is_alone else evidence_of(paint[t].ridges, markings).beside
            labels[t] = with_replaced(labels[t], beside)
    shown = set(np.flatnonzero(counts[0] / np.maximum(counts[1], 1.0) >= LEAST_LINES).tolist())
    members = tuple(tuple(p for p in tripod.pieces if p in shown) for tripod in solved.tripods)
    return ClipLines(solved, members, labels, paint)


def picture_sigma(calibration: Calibration) -> float:
    """Standard deviation of the position of the picture as a whole, pixels.

    It is f times that of the camera's rotation. If frames have a principal point of their own, rotation and principal
    point are each much less certain than their joint effect, so the middle of the picture is propagated instead.
    """
    errors, f = calibration.uncertainty, calibration.required_camera.focal_length
    layout = errors.layout
    if not np.any(layout.free[PRINCIPAL_POINT]):
        return float(f * np.sqrt(np.max(np.diagonal(errors.covariance)[:2])))
    projection = Projection(errors.theta[None], layout)
    middle = np.divide(layout.image_size, 2.0).reshape(1, 1, 2).repeat(2, axis=1)
    s = projection.ideal_offset(projection.observed_offset(middle))
    (J,) = projection.derivatives(s, np.zeros((1, 2)), np.eye(2)[:, None], np.ones(layout.size, dtype=bool))
    return float(np.sqrt(np.max(np.diagonal(J.T @ errors.covariance @ J))))


def finish_clip(lines: ClipLines) -> VideoCalibration:
    """Calibrate all frames of every tripod from the lines; paint beside projected markings counts against a camera."""
    solved, pieces = lines.solved, lines.solved.pieces
    tripod_of, number = np.full(len(pieces.number), NO_TRIPOD), np.zeros(len(pieces.number), dtype=np.intp)
    calibrations: list[SequenceCalibration] = []
    notes = list(solved.notes)
    for tripod, members in zip(solved.tripods, lines.members, strict=True):
        if not members:
            continue
        frames = pieces.frames(members)
        tripod_of[frames], number[frames] = len(calibrations), np.arange(len(frames))
        finished, note = _finished_tripod(lines, tripod, members)
        calibrations.append(finished)
        notes.extend(note)
    calibrations = [_with_little_paint_doubted(one) for one in calibrations]
    doubts = {other for members in lines.members if members for other in _other_size(lines, members)}
    calibrations = [with_doubts(one, range(len(one)), *doubts) for one in calibrations] if doubts else calibrations
    for t in _mixed(solved.keyframes.shots.loose, tripod_of):
        if tripod_of[t] != NO_TRIPOD:
            calibrations[tripod_of[t]] = with_doubts(calibrations[tripod_of[t]], [int(number[t])], MIXED)
    shots = [pieces.frames([p]) for p in pieces.numbers]
    return VideoCalibration(
        tuple(calibrations),
        tuple(Shot(int(one[0]), int(one[-1]) + 1, int(tripod_of[one[0]])) for one in shots),
        tripod_of,
        number,
        tuple(notes),
    )


def _other_size(lines: ClipLines, members: tuple[int, ...]) -> tuple[Finding, ...]:
    """Evidence that the pitch is not of the size that was told, from the labels of the keyframes of some pieces.

    Lines do not tell it: they are looked for near the markings of the told size. A difference counts if it moves the
    ends or the sides by more than the field's tolerance.
    """
    keyframes, pitch = lines.solved.keyframes, lines.solved.keyframes.how.task.field
    if pitch is None or not pitch.size_known or pitch.size_model is None:
        return ()
    task = replace(keyframes.how.task, object_segments=replace(pitch, size_known=False))
    keyframes = replace(keyframes, how=replace(keyframes.how, task=task, estimate_size=True))
    found = keyframes.calibrate(lines.solved.pieces, members, keyframes.accepted)
    is_other = any(off > max(OTHER_SIZE * sigma, 2.0 * pitch.tolerance) for off, sigma in _sizes_off(found, pitch))
    size = pitch if found.field is None else found.field
    return (Finding(What.OTHER_SIZE, numbers=(size.length, size.width)),) if is_other else ()


def _sizes_off(found: SequenceCalibration, pitch: Field) -> list[tuple[float, float]]:
    """By how much length and width, as far as they were estimated, are off those of a pitch, and their deviations."""
    told = {"length": pitch.length, "width": pitch.width}
    return [(abs(value - told[name]), sigma) for name, (value, sigma) in found.shared.items() if name in told]


def _finished_tripod(
    lines: ClipLines, tripod: Tripod, members: tuple[int, ...]
) -> tuple[SequenceCalibration, list[str]]:
    """Calibrate the pieces `members` of a tripod, those whose frames show its lines; also returns notes for the user.

    If the frames may be enlarged parts of larger ones, they are calibrated with a free principal point too.
    """
    how, pieces = lines.solved.keyframes.how, lines.solved.pieces
    start = tripod.calibration if members == tripod.pieces else None
    found = _calibrated(lines, pieces, members, start)
    frames, model = pieces.frames(members), pieces.model_of(members)
    softness = lines.solved.keyframes.softness(frames)
    are_whole = all(one.may_be_part for one in pieces.models_of(members))
    if are_whole and np.any(found.accepted) and may_be_enlarged(found, how, softness):
        for piece in members:
            pieces = pieces.with_model(piece, CUT_OUT)
        freed = _calibrated(lines, pieces, members, None)
        if not freed.together or may_be_enlarged(freed, how, softness, is_free=True):
            return better_of_enlarged(found, freed, how, lines.solved.keyframes.shots.begin + frames)
    return _with_place_of_picture(found, how, model), []


def _calibrated(
    lines: ClipLines, pieces: Pieces, members: Sequence[int], start: SequenceCalibration | None
) -> SequenceCalibration:
    """Calibrate all frames of some pieces by their camera model, with the evidence of paint in their images."""
    frames = pieces.frames(members)
    found = lines.solved.keyframes.calibrate(pieces, members, lines.labels, start)
    if not pieces.model_of(members).is_alone:
        found = found.interpolated(pieces.number[frames], LONGEST_GAP)
    found = found.with_notes({NOTHING_LABELLED: UNTIED})
    return found.seen_in_images(_markings_seen(lines, found, frames))


def _with_place_of_picture(calibration: SequenceCalibration, how: How, model: CameraModel) -> SequenceCalibration:
    """Add a doubt to all frames if their principal point is far from the middle although its prior keeps it near.

    So is one if frames that may be parts of wider ones contradict the given size of the field, but hardly determine it:
    with the principal point open, one wrong line moves it by metres. (Of four such clips none had the right size.)
    Frames that are said to be whole ones, or which part of one, are not asked about.
    """
    pitch, layout = how.task.field, calibration.layout
    if how.declared is Declared.FRAME or how.task.given.camera_matrix is not None or layout is None:
        return calibration
    is_off = not model.is_window and off_middle(calibration, how) >= OFF_MIDDLE
    sizes = [] if pitch is None or is_whole_shape(layout.image_size) else _sizes_off(calibration, pitch)
    is_odd = any(off > OTHER_SIZE * sigma > OTHER_SIZE * LARGEST_SIZE_SIGMA for off, sigma in sizes)
    return with_doubts(calibration, range(len(calibration)), CUT) if is_off or is_odd else calibration


def finish_clip_again(first: VideoCalibration, lines: ClipLines, images: Iterable[Image]) -> VideoCalibration:
    """Find lines near the markings of finished cameras and solve again; keep this if more markings lie on paint."""
    kept = [members for members in lines.members if members]
    tripods = tuple(Tripod(*one) for one in zip(kept, first.tripods, strict=True))
    second = finish_clip(find_clip_lines(replace(lines.solved, tripods=tripods), images))
    return second if _cameras(second) >= _cameras(first) and off_paint(second) < off_paint(first) else first


def off_paint(video: VideoCalibration) -> float:
    """Share of the frames with a camera in which a marking lies beside its paint; 0 without any."""
    off = [any(one.is_beside for one in seen) for tripod in video.tripods for seen in tripod.frames.markings.values()]
    return sum(off) / max(_cameras(video), 1)


def _cameras(video: VideoCalibration) -> int:
    """Number of frames with a camera."""
    return sum(int(np.count_nonzero(tripod.usable)) for tripod in video.tripods)


def _with_little_paint_doubted(tripod: SequenceCalibration) -> SequenceCalibration:
    """Add evidence against all cameras of a tripod if most of the markings in their views show no paint."""
    share = float(np.median([paint_share(seen) for seen in tripod.frames.markings.values() if seen] or [1.0]))
    doubt = Finding(What.LITTLE_PAINT, numbers=(100.0 * share,))
    return with_doubts(tripod, range(len(tripod)), doubt) if share < LEAST_PAINT else tripod


def _mixed(loose: BoolArray, tripod: IntArray) -> list[int]:
    """Numbers of loose (untied) frames between frames of two different tripods; `loose` and `tripod` are (T,)."""
    edges = np.flatnonzero(np.diff(loose, prepend=False, append=False)).tolist()
    runs = [range(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True) if b < len(loose)]
    return [t for run in runs if tripod[run.start - 1] != tripod[run.stop] for t in run]


def _markings_seen(
    lines: ClipLines, calibration: SequenceCalibration, frames: IntArray
) -> dict[int, tuple[MarkingInView, ...]]:
    """Evidence of paint for frames of a tripod, by the numbers of the frames in it.

    A frame in which paint was not looked for takes the evidence of the nearest frame of its piece, if that is near
    enough. Widths of paint are pooled over all frames and markings: one size of the field makes all of them too wide.
    Paint past the end of a marking counts where most of the frames show it: a shadow or an old line does in some.
    """
    field, number = calibration.field, lines.solved.pieces.number[frames]
    markings = Markings.of(lines.solved.keyframes.how.task.object_segments if field is None else field)
    paint = {k: lines.paint[t] for k, t in enumerate(frames.tolist()) if t in lines.paint}
    cameras = {k: camera for k in paint if (camera := calibration[k].camera) is not None}
    seen = {
        k: evidence_of(
            paint[k].ridges.seen_by(camera, markings), markings, _motion(calibration, number, k, camera)
        ).markings
        for k, camera in cameras.items()
    }
    if not seen:
        return {}
    widths = pooled_widths([paint[k].widths for k in seen])
    ends = [paint[k].past.seen_by(camera, markings.past_ends, reach=0.0) for k, camera in cameras.items()]
    past = pooled_past_ends([paint_past_ends(one, markings) for one in ends])
    seen = {k: with_extents(one, widths, past) for k, one in seen.items()}
    looked_at = np.array(list(seen))
    nearest = looked_at[np.argmin(np.abs(frames[looked_at] - frames[:, None]), axis=1)]
    is_near = (np.abs(frames[nearest] - frames) < PAINT_EVERY) & (number[nearest] == number)
    return {k: seen[int(nearest[k])] for k in np.flatnonzero(is_near).tolist()}


def _motion(calibration: SequenceCalibration, piece: IntArray, k: int, camera: Camera) -> Array:
    """Motion (2,) of a picture to the next frame of its piece or to the one before, pixels."""
    around = (t for t in (k + 1, k - 1) if 0 <= t < len(piece) and piece[t] == piece[k])
    other = next((one for t in around if (one := calibration[t].camera) is not None), camera)
    return picture_motion(camera, other)


def picture_motion(camera: Camera, other: Camera) -> Array:
    """Motion (2,) of the lower part of a picture from one camera to another, pixels."""
    xy = np.multiply(camera.image_size, (0.5, 0.75))
    return np.nan_to_num(other.project(camera.image_to_field(xy)) - xy)


def pooled_widths(widths: Sequence[Mapping[str, Array]]) -> dict[str, Array]:
    """Pool the widths measured in several frames: those of all markings, for each marking."""
    every = np.concatenate([np.zeros(0), *(some for one in widths for some in one.values())])
    return {label: every for one in widths for label in one}


def pooled_past_ends(past: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Median of the lengths of paint past the ends of lines, by label, over the frames that show these ends, if many.

    Examples
    --------
    >>> pooled_past_ends([{"Middle line": 40.0, "Side line top": 50.0}, {"Middle line": 30.0}, {"Middle line": 0.0}])
    {'Middle line': 30.0}
    """
    every = {label: [one[label] for one in past if label in one] for label in set[str]().union(*past)}
    return {label: float(np.median(some)) for label, some in every.items() if len(some) >= LEAST_ENDS}
