"""Repeated solution of a clip, given the lines of some frames for sure ("anchors"), as where a person labelled them.

The stages are those of `fieldcalib.images.clip.from_video`. Matches and the labels of the network take longest, and do
not depend on the anchors, so the `Keyframes` of an earlier solution are used again.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as attribute

import numpy as np

from fieldcalib.assess.result import Calibration
from fieldcalib.assess.video import VideoCalibration
from fieldcalib.images.clip.clip_models import Pieces
from fieldcalib.images.clip.finished_clip import LONGEST_GAP, ClipLines, find_clip_lines, finish_clip, picture_sigma
from fieldcalib.images.clip.keyframes import KeyframeLabels, Keyframes
from fieldcalib.images.clip.solved_shots import solve_shots, solve_tripods
from fieldcalib.images.paint.detected_lines import with_replaced
from fieldcalib.images.refinement import near_labels
from fieldcalib.io.image_files import Image
from fieldcalib.problem.labelled_pixels import NO_PIXELS
from fieldcalib.solve.solver_options import pixel_unit

FAR, SIGMAS = 12.0, 3.0  # px of 960 x 540 plus standard deviations of the projection: labels farther off are wrong
ROUNDS = 3  # rounds of leaving labels out
GRID = (7, 5)  # places across and down the picture at which errors are computed
STEP = 0.01  # m by which ground points are moved for derivatives of their pixels
WEIGHT = 8.0  # weight of a segment in an anchor; a segment that a network found has 1


@dataclass(frozen=True, eq=False)
class Anchors:
    """Lines of some frames, and cuts, that are known for sure."""

    labels: Mapping[int, KeyframeLabels] = attribute(default_factory=dict)
    """Lines by frame; `accepted` if they determine a camera by themselves."""
    cuts: Sequence[int] | None = None
    """First frames of the shots; None to find the shots by matches."""


def solve_around(keyframes: Keyframes, anchors: Anchors, images: Callable[[], Iterable[Image]]) -> VideoCalibration:
    """Calibrate the frames of a part of a clip, given anchors.

    Parameters
    ----------
    keyframes : Keyframes
        Matches and labels of the part.
    anchors : Anchors
        Frames are numbered from the first one of the part.
    images : callable
        Returns the images of the part, from the first one on.
    """
    keyframes = _with_cuts(keyframes, anchors.cuts)
    weights = {t: WEIGHT * one.labels.weight for t, one in anchors.labels.items()}
    held = {t: replace(one, labels=replace(one.labels, weight=weights[t])) for t, one in anchors.labels.items()}
    known = _without_contradicted(keyframes, held)
    return finish_clip(_with_lines(find_clip_lines(solve_tripods(solve_shots(known)), images()), held))


def _without_contradicted(keyframes: Keyframes, held: Mapping[int, KeyframeLabels]) -> Keyframes:
    """Put the labels of anchors into keyframes, and leave out labels that contradict anchors, matches and the tripod.

    Labels that are far from what cameras project are left out, and all labels of a keyframe if most of them are far.
    The remaining labels make the cameras surer, so that more labels may turn out to be far in the next round.
    """
    number = keyframes.shots.pieces.number
    anchored = {int(number[t]) for t in held} or set(number.tolist())
    others = {t: one for t, one in keyframes.labels.items() if int(number[t]) in anchored and t not in held}
    rest = {t: one for t, one in keyframes.labels.items() if t not in others and t not in held}
    cameras, kept = _first_cameras(keyframes, rest, others, held, anchored), others
    for _ in range(ROUNDS):
        before = kept
        near = {t: _near(keyframes, one, cameras.get(t)) for t, one in others.items()}
        kept = {t: one for t, one in near.items() if one is not None}
        if _pixel_counts(kept) == _pixel_counts(before):
            break
        cameras = _cameras(replace(keyframes, labels={**rest, **kept, **held}), anchored)
    labels = rest | kept
    told = {int(number[t]) for t, one in labels.items() if one.accepted}
    sure = {t: replace(one, accepted=one.accepted or int(number[t]) in told) for t, one in held.items()}
    return replace(keyframes, labels=labels | sure)


def _first_cameras(
    keyframes: Keyframes,
    rest: Mapping[int, KeyframeLabels],
    others: Mapping[int, KeyframeLabels],
    held: Mapping[int, KeyframeLabels],
    anchored: Collection[int],
) -> dict[int, Calibration]:
    """Cameras to begin with, by frame: from anchors alone if these determine them, else from all labels together.

    Labels of frames that no match ties are not used: the camera of such a frame would follow from its own labels and
    could not contradict them, while cameras interpolated from the frames around it can.
    """
    tied = {t for pair in keyframes.shots.matches for t in pair}
    labels = {**rest, **{t: one for t, one in others.items() if t in tied}, **held}
    found = _cameras(replace(keyframes, labels=labels), anchored)
    if held:
        far = FAR * pixel_unit(keyframes.shots.image_size)
        by_anchors = _cameras(replace(keyframes, labels={**rest, **held}), anchored)
        found |= {t: one for t, one in by_anchors.items() if one.camera is not None and _sigma(one) < far}
    return found


def _pixel_counts(labels: Mapping[int, KeyframeLabels]) -> dict[int, int]:
    return {t: len(one.labels.label) for t, one in labels.items()}


def _cameras(keyframes: Keyframes, anchored: Collection[int]) -> dict[int, Calibration]:
    """Calibrate the frames that have a tripod, by frame; untied frames are interpolated.

    Doubtful labels are of use in pieces with anchors only.
    """
    solved = solve_tripods(solve_shots(keyframes, only_tripods=True), anchored)
    found: dict[int, Calibration] = {}
    for tripod in solved.tripods:
        frames = solved.pieces.frames(tripod.pieces)
        found |= zip(
            frames.tolist(), tripod.calibration.interpolated(solved.pieces.number[frames], LONGEST_GAP), strict=True
        )
    return found


def _near(keyframes: Keyframes, labels: KeyframeLabels, calibration: Calibration | None) -> KeyframeLabels | None:
    """Keep the labels of a keyframe that are near their projections by its camera; None if most are far."""
    if calibration is None or calibration.camera is None:
        return labels
    objects = keyframes.how.task.object_segments if calibration.field is None else calibration.field
    unit = pixel_unit(keyframes.shots.image_size)
    table, reach = labels.labels, FAR + SIGMAS * _sigma(calibration) / unit
    (is_near,) = near_labels(objects, [calibration.camera], [table], reach)
    near = table.take(is_near[table.label])
    if 2 * len(np.unique(near.label)) < len(np.unique(table.label)):
        return None
    return replace(labels, labels=near)


def _sigma(calibration: Calibration) -> float:
    """Standard deviation of projected ground points in view, pixels: the median over the picture.

    It is smaller than that of the picture as a whole (`picture_sigma`), as errors of the camera's rotation and of its
    position compensate one another on the ground.
    """
    camera, field = calibration.required_camera, calibration.field
    x, y = (np.linspace(0.0, size - 1.0, count) for size, count in zip(camera.image_size, GRID, strict=True))
    X = camera.image_to_field(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))
    with np.errstate(invalid="ignore"):
        inside = np.isfinite(X).all(axis=1) if field is None else np.all(np.abs(X[:, :2]) < field.half_extent, axis=1)
    X, errors = X[inside], calibration.uncertainty
    if not len(X):
        return picture_sigma(calibration)
    derivative, _ = errors.ground_jacobian(X)
    steps = STEP * np.eye(3)[:2]
    A = np.stack([(camera.project(X + step) - camera.project(X - step)) / (2.0 * STEP) for step in steps], axis=-1)
    V = A @ errors.propagated(derivative) @ np.swapaxes(A, 1, 2)
    return float(np.sqrt(np.median(np.linalg.eigvalsh(V)[:, -1])))


def _with_cuts(keyframes: Keyframes, cuts: Sequence[int] | None) -> Keyframes:
    """Replace the shots of keyframes by those between the given cuts; matches across a cut are left out."""
    if cuts is None:
        return keyframes
    shots = keyframes.shots
    count = len(shots.pieces.number)
    number = np.searchsorted(sorted({cut for cut in cuts if 0 < cut < count}), np.arange(count), side="right")
    matches = {(i, j): cells for (i, j), cells in shots.matches.items() if number[i] == number[j]}
    return replace(
        keyframes, shots=replace(shots, pieces=Pieces(number), loose=np.zeros(count, dtype=bool), matches=matches)
    )


def _with_lines(lines: ClipLines, held: Mapping[int, KeyframeLabels]) -> ClipLines:
    """Replace lines that were found by those of anchors at the same markings.

    If the labels of an anchor do not determine its camera, the lines that were found are more exact, and take
    precedence.
    """
    both = {}
    for t, one in held.items():
        found = lines.labels.get(t, NO_PIXELS)
        both[t] = with_replaced(found, one.labels) if one.accepted else with_replaced(one.labels, found)
    return replace(lines, labels={**lines.labels, **both})
