"""AC@t, precision, recall and reprojection errors of segments, as SoccerNet's evaluation defines them.

An annotated segment is a true positive if all its annotated points lie within t pixels of its projection. It is a
false positive if it is projected but further away, and a false negative if it is not projected. A segment that is
projected but not annotated is a false positive. ``AC@t = TP / (TP + FP + FN)`` for each frame. A frame is scored with
its labels and with those of the field turned by 180 degrees, and the better of the two counts.

The field is drawn as by SoccerNet's evaluation, one polyline for each segment that comes into the image. A segment is
sampled, samples outside the image are dropped, and the crossing with the border is added where it leaves or enters the
image. The points before an exit and after the next entry are joined by a straight piece.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Literal, NamedTuple, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import (
    FIELD,
    Array,
    BoolArray,
    IntArray,
    are_finite,
    expect,
    is_number,
    listed,
    number,
    one_of,
    real_array,
    truth,
)
from fieldcalib.fields.field import Field
from fieldcalib.fields.ground import Terrain
from fieldcalib.fields.segments import Segment
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.geometry.camera import checked_image_size
from fieldcalib.io.soccernet import UNKNOWN_LABELS
from fieldcalib.metrics.cameras import Prediction, checked_prediction, is_homography, project_as_soccernet
from fieldcalib.problem.labelled_pixels import ImageSegments, Pixels
from fieldcalib.processes.jobs import in_order

LINE_SPACING, CIRCLE_SPACING = 0.9, 0.2  # m, as in SoccerNet's evaluation
THRESHOLDS = (5.0, 10.0, 20.0)  # px
CHUNK = 64  # frames projected together
# Number of points that a projected segment without annotation counts for in the table by points.
LINE_POINTS, CIRCLE_POINTS = 2, 9
TP, FP, FN = 0, 1, 2
CompoundScore: TypeAlias = Literal["printed", "tables"]
WEIGHTS = (0.5, 0.35, 0.15)  # of AC@5, AC@10, AC@20


class Samples(NamedTuple):
    """Points of several segments, one after the other."""

    X: Array
    """(M, 3), metres."""
    label: IntArray
    """Index of each point's segment, (M,), ascending."""


def sample_segments(segments: Mapping[str, Segment], terrain: Terrain | None = None) -> Samples:
    """Points of segments as SoccerNet's evaluation samples them.

    Lines every 0.9 m from their start, with a longer last piece; arcs every 0.2 m, without closing whole circles. They
    are moved up with ground that is not level.

    Examples
    --------
    >>> from fieldcalib import Line
    >>> sample_segments({"post": Line((0, 0, -2.44), (0, 0, 0))}).X[:, 2].round(2) + 0.0
    array([-2.44, -1.54,  0.  ])
    """
    X = [segment.evaluated(LINE_SPACING, CIRCLE_SPACING) for segment in segments.values()]
    points, label = np.concatenate(X), np.repeat(np.arange(len(X)), [len(part) for part in X])
    return Samples(points if terrain is None else terrain.raised(points), label)


@dataclass(frozen=True)
class Polylines:
    """The polylines of F frames and L labels, their points one after the other."""

    xy: Array
    """(P, 2), pixels."""
    count: IntArray
    """Points of each polyline, (F, L); 0 where the segment is not in the image."""

    @property
    def begin(self) -> IntArray:
        """Index of the first point of each polyline, (F, L)."""
        return (np.cumsum(self.count) - self.count.ravel()).reshape(self.count.shape)


def project_segments(predictions: Sequence[Prediction], samples: Samples, image_size: tuple[int, int]) -> Polylines:
    """The sampled segments in the images of F predictions, as SoccerNet's evaluation draws them."""
    xy, visible = project_as_soccernet(predictions, samples.X)
    frame, sample = np.nonzero(visible)
    xy = xy[frame, sample]
    label = samples.label[sample]
    inside = np.all((xy >= 0.0) & (xy < image_size), axis=1)

    follows = np.zeros(len(xy), dtype=bool)  # whether the previous point belongs to the same polyline
    follows[1:] = (frame[1:] == frame[:-1]) & (label[1:] == label[:-1])
    was_inside = np.roll(inside, 1) & follows
    # an entry without a previous visible point has no crossing with the border
    entry = np.flatnonzero(inside & ~was_inside & follows)
    leave = np.flatnonzero(~inside & was_inside)

    # two points for each sample: the entry, and the sample itself or the exit
    points, kept = np.empty((len(xy), 2, 2)), np.zeros((len(xy), 2), dtype=bool)
    points[:, 1], kept[:, 1] = xy, inside
    for place, index in ((0, entry), (1, leave)):
        points[index, place], kept[index, place] = _border_crossings(xy[index], xy[index - 1], image_size)
    labels = int(samples.label[-1]) + 1
    polyline = np.repeat(frame * labels + label, 2)[kept.ravel()]
    count = np.bincount(polyline, minlength=len(predictions) * labels)
    return Polylines(points[kept], count.reshape(len(predictions), labels))


def _border_crossings(xy: Array, before: Array, image_size: tuple[int, int]) -> tuple[Array, BoolArray]:
    """Crossings of lines through two points (N, 2) with the image's border nearest to the first, and which exist."""
    width, height = image_size
    (x, y), (x0, y0) = xy.T, before.T
    a, b, c = y - y0, x0 - x, x * y0 - y * x0  # the line a x + b y + c = 0
    with np.errstate(all="ignore"):
        crossings = np.stack(
            [np.stack([np.full_like(x, side), -(a * side + c) / b], axis=-1) for side in (0.0, width - 1.0)]
            + [np.stack([-(b * side + c) / a, np.full_like(y, side)], axis=-1) for side in (0.0, height - 1.0)],
            axis=1,
        )
        distance = np.linalg.norm(crossings - xy[:, None], axis=-1)
        inside = np.all((crossings >= 0.0) & (crossings < image_size), axis=-1)
    nearest = np.argmin(np.where(inside, distance, np.inf), axis=1)
    return crossings[np.arange(len(xy)), nearest], inside.any(axis=1)


def distances_to_polylines(xy: Array, polylines: Polylines, index: IntArray) -> Array:
    """Distance of each pixel (N, 2) to one of the polylines.

    Parameters
    ----------
    xy : (N, 2) array
    polylines : Polylines
    index : (N,) int array
        Flat index of each pixel's polyline, frame * L + label; it must not be empty.

    Returns
    -------
    (N,) array
        Pixels.
    """
    if not len(xy):
        return np.zeros(0)
    count = polylines.count.ravel()[index]
    pieces = np.maximum(count - 1, 1)  # a single point is a piece of length zero
    first = np.cumsum(pieces) - pieces
    start = np.repeat(polylines.begin.ravel()[index] - first, pieces) + np.arange(pieces.sum())
    origin, end = polylines.xy[start], polylines.xy[start + np.repeat(count > 1, pieces)]
    offset, along = np.repeat(xy, pieces, axis=0) - origin, end - origin
    share = np.einsum("ij,ij->i", offset, along) / np.maximum(np.einsum("ij,ij->i", along, along), 1e-300)
    offset -= np.clip(share, 0.0, 1.0)[:, None] * along
    return np.sqrt(np.minimum.reduceat(np.einsum("ij,ij->i", offset, offset), first))


@dataclass(frozen=True)
class Confusion:
    """Counts of true positives, false positives and false negatives, and their ratios.

    Examples
    --------
    >>> Confusion(6, 1, 1).accuracy, round(Confusion(6, 1, 1).precision, 3)
    (0.75, 0.857)
    """

    tp: int
    fp: int
    fn: int

    @property
    def accuracy(self) -> float:
        """``TP / (TP + FP + FN)``; NaN without any."""
        return _ratio(self.tp, self.tp + self.fp + self.fn)

    @property
    def precision(self) -> float:
        """``TP / (TP + FP)``; NaN where nothing was projected."""
        return _ratio(self.tp, self.tp + self.fp)

    @property
    def recall(self) -> float:
        """``TP / (TP + FN)``; NaN if both are 0."""
        return _ratio(self.tp, self.tp + self.fn)


def _ratio(part: int, whole: int) -> float:
    return part / whole if whole else float("nan")


@dataclass(frozen=True, repr=False)
class SegmentEvaluation:
    """Evaluation of the reprojected segments of F frames at T thresholds. Ratios are 0..1."""

    thresholds: tuple[float, ...]
    """Pixels."""
    labels: tuple[str, ...]
    """Evaluated segments, then the labels of annotators for segments that they could not identify."""
    found: BoolArray
    """Whether each frame has a prediction, (F,)."""
    turned: BoolArray
    """Whether a frame is scored with the labels of the field turned by 180 degrees, (F, T); also where both scores are
    equal, as in SoccerNet's evaluation."""
    nearer_turned: BoolArray
    """Whether the turned labels are nearer, by the median distance of all annotated points, (F,)."""
    segments: IntArray
    """Segments that are TP, FP, FN, (F, T, L, 3): each 0 or 1."""
    points: IntArray
    """TP, FP, FN of annotated points, (F, T, L, 3), as in SoccerNet's table of classes. A segment without annotation
    counts as two points, a circle as nine."""
    errors: tuple[tuple[Mapping[str, Array], Mapping[str, Array]], ...]
    """Distances (n,) of each label's annotated points to its projection, in pixels, for each frame: with the labels as
    they are and with the other side's. Labels that are not projected have none."""

    @property
    def completeness(self) -> float:
        """CR: share of the frames that have a prediction; NaN without frames."""
        return _ratio(int(self.found.sum()), len(self.found))

    @property
    def frame_accuracy(self) -> Array:
        """AC of each frame at each threshold, (F, T); NaN without a prediction."""
        return np.where(self.found[:, None], _accuracy(self.segments), np.nan)

    @property
    def accuracy(self) -> Array:
        """AC at each threshold, (T,): the mean over the frames that have a prediction, NaN without any."""
        return self._mean(self.frame_accuracy)

    @property
    def precision(self) -> Array:
        """Mean over the frames with a projected segment, (T,)."""
        counts = self.segments.sum(axis=2)
        return self._mean(_share(counts[..., TP], counts[..., TP] + counts[..., FP]))

    @property
    def recall(self) -> Array:
        """Mean over the frames with a true positive or a false negative, (T,)."""
        counts = self.segments.sum(axis=2)
        return self._mean(_share(counts[..., TP], counts[..., TP] + counts[..., FN]))

    def _mean(self, values: Array) -> Array:
        counted = np.isfinite(values)
        count = counted.sum(axis=0)
        total = np.sum(np.where(counted, values, 0.0), axis=0)
        return np.where(count > 0, total / np.maximum(count, 1), np.nan)

    def per_label(self, threshold: float) -> dict[str, Confusion]:
        """Confusion of each label over all frames, counted in segments, without labels that never occur."""
        return self._per_label(self.segments, threshold)

    def per_label_points(self, threshold: float) -> dict[str, Confusion]:
        """Confusion of each label over all frames, counted in points: SoccerNet's table of classes."""
        return self._per_label(self.points, threshold)

    def _per_label(self, counts: IntArray, threshold: float) -> dict[str, Confusion]:
        total = counts[:, self._index(threshold)].sum(axis=0)
        return {label: Confusion(*row.tolist()) for label, row in zip(self.labels, total, strict=True) if row.any()}

    def __repr__(self) -> str:
        accuracy = ", ".join(f"AC@{t:g}={100.0 * a:.2f}" for t, a in zip(self.thresholds, self.accuracy, strict=True))
        return f"SegmentEvaluation({accuracy}, CR={100.0 * self.completeness:.2f} over {len(self.found)} frames)"

    def segment_errors(self, threshold: float | None = None) -> dict[str, Array]:
        """Distances of all annotated points to their reprojected segments, pixels, by label.

        Of each frame, the labels that are nearer are used (`nearer_turned`); with a threshold, as in SoccerNet's
        evaluation, those with which the frame is scored at that threshold: the turned ones if nothing is right.
        """
        turned = self.nearer_turned if threshold is None else self.turned[:, self._index(threshold)]
        by_label: dict[str, list[Array]] = {}
        for sides, other in zip(self.errors, turned.tolist(), strict=True):
            for label, distances in sides[other].items():
                by_label.setdefault(label, []).append(distances)
        return {label: np.concatenate(by_label[label]) for label in self.labels if label in by_label}

    def _index(self, threshold: float) -> int:
        if not is_number(threshold) or threshold not in self.thresholds:
            raise ValueError(f"threshold must be one of {self.thresholds}, got {threshold}")
        return self.thresholds.index(threshold)


def _share(part: IntArray, whole: IntArray) -> Array:
    return np.where(whole > 0, part / np.maximum(whole, 1), np.nan)


def evaluate_segments(
    predictions: Sequence[Prediction | None],
    annotations: Sequence[ImageSegments],
    image_size: tuple[int, int],
    *,
    thresholds: Sequence[float] = THRESHOLDS,
    planar: bool = False,
    field: Field | None = None,
    executor: Executor | None = None,
) -> SegmentEvaluation:
    """Compare predictions with annotated segments, as SoccerNet's evaluation does.

    Parameters
    ----------
    predictions : sequence of F cameras or homographies, or None
        A camera must have the size of the annotated image: it is not rescaled. A homography maps field points (x, y, 1)
        in metres to pixels.
    annotations : sequence of F mappings of str to (n, 2) array_like
        Annotated pixels of each frame, as `fieldcalib.io.soccernet.parse_annotation` with ``unknown=True`` reads them:
        labels of annotators for segments that they could not identify count as false negatives.
    image_size : (int, int)
        Width and height in pixels.
    thresholds : sequence of float
        Pixels.
    planar : bool
        Whether to leave out segments above the ground (goals), as the paper does for homographies.
    field : Field, optional
        The field that is projected, on its ground; SoccerNet's by default, a level soccer field of 105 x 68 m.
    executor : concurrent.futures.Executor, optional
        Runs the work on parts of the frames; the result does not depend on it.

    Returns
    -------
    SegmentEvaluation

    Raises
    ------
    ValueError
        If the numbers of predictions and annotations differ, a prediction is neither a camera nor a homography, a label
        is unknown or given twice, pixels are not finite or not of shape (n, 2), a threshold is not positive, or
        homographies are given without `planar`.

    References
    ----------
    The SoccerNet package, `SoccerNet.Evaluation.utils_calibration`; paper, section "Metrics".

    Examples
    --------
    >>> from fieldcalib import Camera
    >>> camera = Camera.from_angles(0.0, 1.3, 0.0, 1500.0, (0.0, 60.0, -15.0), (960, 540))
    >>> labels = ("Middle line", "Side line top", "Circle central")  # all that this camera sees
    >>> lines = {label: camera.project(soccer()[label].sample(9.0)) for label in labels}
    >>> lines = {label: xy[np.all((xy > 0) & (xy < (950, 530)), axis=1)] for label, xy in lines.items()}
    >>> shifted = {label: xy + 7.0 for label, xy in lines.items()}
    >>> evaluation = evaluate_segments([camera, camera, None], [lines, shifted, lines], (960, 540))
    >>> evaluation.accuracy, round(evaluation.completeness, 3)
    (array([0.5, 1. , 1. ]), 0.667)
    """
    field = soccer() if field is None else expect(field, Field, FIELD)
    if len(listed(predictions, "predictions")) != len(listed(annotations, "annotations")):
        raise ValueError(
            f"expected as many predictions as annotations, got {len(predictions)} and {len(annotations)}: "
            f"give None for a frame without a camera"
        )
    size = checked_image_size(image_size)
    given = listed(thresholds, "thresholds in pixels")
    if not len(given) or not all(is_number(one) and one > 0.0 for one in given):
        raise ValueError(f"thresholds must be a sequence of positive pixels, at least one, got {thresholds!r}")
    limits = np.array(given, dtype=float)
    given = {f: checked_prediction(p, size) for f, p in enumerate(predictions) if p is not None}
    if not truth(planar, "planar") and any(is_homography(prediction) for prediction in given.values()):
        raise ValueError("homographies map the ground alone: evaluate them with planar=True")
    classes = _Classes.of(field, planar)
    annotated = [_annotated_points(frame, classes) for frame in _checked(annotations, field)]

    F, T, L = len(predictions), len(limits), len(classes.labels)
    found = np.isin(np.arange(F), list(given))
    is_turned, is_nearer_turned = np.zeros((F, T), dtype=bool), np.zeros(F, dtype=bool)
    segments, points = np.zeros((2, F, T, L, 3), dtype=np.intp)
    errors: list[tuple[Mapping[str, Array], Mapping[str, Array]]] = [({}, {})] * F
    samples = sample_segments(classes.segments, field.terrain)
    frames = list(given)
    chunks = [frames[begin : begin + CHUNK] for begin in range(0, len(frames), CHUNK)]
    of_chunk = partial(_compared, samples=samples, size=size, classes=classes, thresholds=limits.tolist())
    items = (([given[f] for f in chunk], [annotated[f] for f in chunk]) for chunk in chunks)
    for chunk, (straight, turned) in zip(chunks, in_order(executor, of_chunk, items), strict=True):
        better = _accuracy(straight.segments) > _accuracy(turned.segments)
        is_turned[chunk], is_nearer_turned[chunk] = ~better, turned.median < straight.median
        segments[chunk] = np.where(better[:, :, None, None], straight.segments, turned.segments)
        points[chunk] = np.where(better[:, :, None, None], straight.points, turned.points)
        for f, *sides in zip(chunk, straight.errors, turned.errors, strict=True):
            errors[f] = (sides[0], sides[1])
    return SegmentEvaluation(
        tuple(limits.tolist()), classes.labels, found, is_turned, is_nearer_turned, segments, points, tuple(errors)
    )


@dataclass(frozen=True)
class _Classes:
    """The labels of an evaluation."""

    segments: Mapping[str, Segment]
    """The segments that are projected."""
    labels: tuple[str, ...]
    """Labels of the segments, then those of annotators for segments that they could not identify."""
    turned: IntArray
    """Index of each label on the field turned by 180 degrees, (L,)."""
    extra: IntArray
    """Number of points that a projected segment without annotation counts for, (L,)."""

    @classmethod
    def of(cls, field: Field, planar: bool) -> _Classes:
        segments = {label: s for label, s in field.markings.items() if label not in field.half_labels}
        unknown = set(UNKNOWN_LABELS)
        if planar:
            segments = {label: s for label, s in segments.items() if not np.any(s.sample()[:, 2])}
            unknown.remove("Goal unknown")
        labels = (*segments, *sorted(unknown))
        turned = [labels.index(field.symmetric.get(label, label)) for label in labels]
        extra = [CIRCLE_POINTS if label.startswith("Circle") else LINE_POINTS for label in labels]
        return cls(segments, labels, np.array(turned), np.array(extra))


def check_annotation(annotation: ImageSegments, field: Field) -> Pixels:
    """The annotated pixels of one frame as float arrays, or a ValueError.

    Unlike `fieldcalib.problem.labelled_pixels.check_segments`, it admits what can be evaluated, not what can be
    calibrated: labels for segments that annotators could not identify, the centre circle as a whole only, and pixels
    outside the image.

    Examples
    --------
    >>> check_annotation({"Middle line ": [(480, 100), (480, 400)], "Line unknown": []}, soccer())
    {'Middle line': array([[480., 100.],
           [480., 400.]])}
    """
    if not isinstance(annotation, Mapping):
        raise ValueError(f"expected a mapping of labels to (n, 2) pixels, got {type(annotation).__name__}")
    known = {*field.markings, *UNKNOWN_LABELS} - field.half_labels
    pixels: Pixels = {}
    for given, values in annotation.items():
        label = given.strip() if isinstance(given, str) else given
        if label not in known:
            raise ValueError(
                f"{given!r} is not an evaluated segment; expected SoccerNet's labels, the centre circle as a whole"
            )
        try:
            xy = real_array(values)
        except ValueError:
            xy = np.full(2, np.nan)
        if xy.size == 0:
            continue
        if xy.ndim != 2 or xy.shape[1] != 2 or not are_finite(xy):
            raise ValueError(f"{given!r}: expected finite pixels of shape (n, 2), got {values!r}")
        if label in pixels:
            raise ValueError(f"{label!r} is given twice, with and without surrounding blanks")
        pixels[label] = xy
    return pixels


def _checked(annotations: Sequence[ImageSegments], field: Field) -> Iterator[Pixels]:
    for f, annotation in enumerate(annotations):
        try:
            yield check_annotation(annotation, field)
        except ValueError as error:
            raise ValueError(f"frame {f}: {error}") from None


def _annotated_points(pixels: Pixels, classes: _Classes) -> tuple[Array, IntArray]:
    """Pixels (n, 2) of a frame and the indices of their labels (n,), label by label; only of evaluated labels."""
    points = {classes.labels.index(label): xy for label, xy in pixels.items() if label in classes.labels}
    counts = [len(xy) for xy in points.values()]
    return np.concatenate([np.zeros((0, 2)), *points.values()]), np.repeat(np.array([*points], dtype=np.intp), counts)


class _Comparison(NamedTuple):
    """Scores of F frames under one of the two labellings."""

    segments: IntArray
    """TP, FP and FN of each frame and label at each threshold, (F, T, L, 3), counted in segments."""
    points: IntArray
    """TP, FP and FN counted in points, (F, T, L, 3)."""
    errors: list[dict[str, Array]]
    """Distances of the points of each label that is projected, for each frame."""
    median: Array
    """Median distance of all annotated points, (F,); infinite for points whose label is not projected."""


def _compared(
    frames: tuple[Sequence[Prediction], Sequence[tuple[Array, IntArray]]],
    *,
    samples: Samples,
    size: tuple[int, int],
    classes: _Classes,
    thresholds: Sequence[float],
) -> tuple[_Comparison, _Comparison]:
    """Scores of some frames with their labels as they are, and with those of the field turned by 180 degrees."""
    predictions, annotated = frames
    polylines = project_segments(predictions, samples, size)
    xy, label = (np.concatenate(parts) for parts in zip(*annotated, strict=True))
    frame = np.repeat(np.arange(len(predictions)), [len(points) for points, _ in annotated])
    return (
        _compare(xy, frame, label, polylines, classes, thresholds),
        _compare(xy, frame, classes.turned[label], polylines, classes, thresholds),
    )


def _compare(
    xy: Array, frame: IntArray, label: IntArray, polylines: Polylines, classes: _Classes, thresholds: Sequence[float]
) -> _Comparison:
    F, L = len(polylines.count), len(classes.labels)
    projected = np.zeros((F, L), dtype=bool)
    projected[:, : len(classes.segments)] = polylines.count > 0
    compared = projected[frame, label]
    distance = np.full(len(xy), np.nan)
    index = frame[compared] * len(classes.segments) + label[compared]
    distance[compared] = distances_to_polylines(xy[compared], polylines, index)

    where = frame * L + label
    total = np.bincount(where, minlength=F * L).reshape(F, 1, L)
    near = np.stack(  # NaN is never near
        [np.bincount(where[distance < t], minlength=F * L).reshape(F, L) for t in thresholds], axis=1
    )
    annotated, seen = total > 0, projected[:, None]
    both = annotated & seen
    right = both & (near == total)
    segments = np.broadcast_arrays(right, seen & ~right, annotated & ~seen)
    points = np.broadcast_arrays(
        near, np.where(both, total - near, np.where(seen, classes.extra, 0)), np.where(seen, 0, total)
    )
    errors: list[dict[str, Array]] = [{} for _ in range(F)]
    edges = np.flatnonzero(np.diff(where, prepend=-1, append=-1))
    for begin, end in pairwise(edges.tolist()):
        if compared[begin]:
            errors[frame[begin]][classes.labels[label[begin]]] = distance[begin:end]
    by_frame = np.split(np.where(compared, distance, np.inf), np.searchsorted(frame, np.arange(1, F)))
    median = np.array([np.median(distances) if len(distances) else np.inf for distances in by_frame])
    return _Comparison(np.stack(segments, axis=-1).astype(np.intp), np.stack(points, axis=-1), errors, median)


def _accuracy(segments: IntArray) -> Array:
    """AC (F, T) of counts (F, T, L, 3)."""
    counts = segments.sum(axis=2)
    return np.asarray(counts[..., TP] / np.maximum(counts.sum(axis=-1), 1))


def compound_score(
    accuracies: ArrayLike, completeness: float, kind: CompoundScore = "printed", *, share: float = 1.0
) -> float:
    """CS: ``(1 - exp(-4 CR)) (0.5 AC@5 + 0.35 AC@10 + 0.15 AC@20)`` (paper, section "Metrics").

    The paper's tables do not follow this formula: the code that made them assigns the weights to the thresholds in the
    order 20, 10, 5, and for SN-Calib-test-center counts completeness over all 2719 images of the test split, of which
    1454 show the main camera. "tables" is that variant; `share` is 1454 / 2719 there, and 1 for WC14.

    Parameters
    ----------
    accuracies : (3,) array_like
        AC@5, AC@10, AC@20, 0..1.
    completeness : float
        CR, 0..1.
    kind : {"printed", "tables"}
        The formula as printed, or the one that made the paper's tables.
    share : float
        Share of the whole dataset that the evaluated frames make up, for "tables".

    Returns
    -------
    float
        0..1.

    Raises
    ------
    ValueError
        If there are not three accuracies, a number is not in 0..1, or `kind` is not valid.

    Examples
    --------
    TVCalib on ground truth segments of SN-Calib-test-center; the paper's table has 75.5:

    >>> round(100 * compound_score([0.653, 0.842, 0.926], 1.0), 1)
    74.6
    >>> round(100 * compound_score([0.653, 0.842, 0.926], 1.0, "tables", share=1454 / 2719), 1)
    75.5
    """
    one_of(kind, get_args(CompoundScore), "kind")
    values = real_array(accuracies)
    if values.shape != (3,):
        raise ValueError(f"expected AC@5, AC@10 and AC@20, got an array of shape {values.shape}")
    if number(completeness, "completeness") == 0.0:
        return 0.0  # without predictions the accuracies are NaN
    given = np.array([*values, completeness, number(share, "share")])
    if not np.all((given >= 0.0) & (given <= 1.0)):
        raise ValueError(f"expected ratios in 0..1, got {given.tolist()}; divide percentages by 100")
    if kind == "tables":
        values, completeness = values[::-1], completeness * share
    return float((1.0 - np.exp(-4.0 * completeness)) * (values @ WEIGHTS))
