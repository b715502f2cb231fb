"""Labelled pixels: checks of what users give, the split of the centre circle, and many frames packed into arrays.

One frame is a mapping of labels to (N, 2) pixels, perhaps with weights. `pack` turns many frames into padded arrays
(T, N, ...) with a weight that is 0 where there is only padding, one set of rows for each kind of segment.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.field import Arc, Line, ObjectSegments, Point, PointCloud, Segment

ImageSegments: TypeAlias = Mapping[str, ArrayLike]
Pixels: TypeAlias = dict[str, Array]
Weights: TypeAlias = Mapping[str, ArrayLike]
Shares: TypeAlias = dict[str, Array]

LEVEL = 0.05  # slope of a middle line, seen from behind a goal, below which it has no left side
FARTHEST_PIXEL = 10.0  # image sizes from the centre: beyond, a number is a mistake

# Kinds of rows, and how many vectors describe a segment of each kind at least.
LEAST_DEPTH = {"lines": 2, "arcs": 3, "curves": 3, "points": 1, "clouds": 1, "ends": 2}


@dataclass(frozen=True)
class Rows:
    """Observed pixels on segments of one kind, T frames padded to N pixels each."""

    xy: Array
    """Pixels, (T, N, 2)."""
    weight: Array
    """(T, N); 0 where there is only padding."""
    label: IntArray
    """Index into `Observations.labels`, (T, N); -1 where there is only padding."""
    geometry: Array
    """World vectors of the segment, (T, N, G, 3): X | start, direction | centre, radius u, radius v | samples.

    Of an end its X, and in the first two components of the second vector the direction in the image that is measured.
    """

    def __bool__(self) -> bool:
        return bool(self.xy.shape[1] > 0)

    def take(self, index: IntArray) -> Rows:
        """The rows of frames `index`, in that order, repeated where `index` repeats."""
        return Rows(self.xy[index], self.weight[index], self.label[index], self.geometry[index])

    def choose(self, rows: IntArray) -> Rows:
        """Of each frame its own rows (T, N')."""
        frame = np.arange(len(rows))[:, None]
        return Rows(self.xy[frame, rows], self.weight[frame, rows], self.label[frame, rows], self.geometry[frame, rows])


@dataclass(frozen=True)
class Observations:
    """The labelled pixels of T frames against one calibration object."""

    labels: tuple[str, ...]
    image_size: tuple[int, int]
    lines: Rows
    arcs: Rows
    curves: Rows
    """Ordered point clouds."""
    points: Rows
    clouds: Rows
    """Unordered point clouds."""
    ends: Rows
    """Pixels past the end of their segment, and that end: see `fieldcalib.ends`."""

    def __len__(self) -> int:
        return len(self.lines.xy)

    def take(self, index: IntArray) -> Observations:
        """The observations of frames `index`, in that order, repeated where `index` repeats."""
        kinds = {kind: getattr(self, kind).take(index) for kind in LEAST_DEPTH}
        return replace(self, **kinds)

    @property
    def without_ends(self) -> Observations:
        """The labelled pixels alone."""
        return replace(self, ends=self.ends.choose(np.empty((len(self), 0), dtype=np.intp)))

    @cached_property
    def weight(self) -> Array:
        """Weight of every residual, (T, M), ordered as lines, arcs, curves, points' x, y, clouds' x, y, ends."""
        return self._by_residual("weight")

    @cached_property
    def label(self) -> IntArray:
        """Label index of every residual, (T, M); -1 where there is only padding."""
        return np.asarray(self._by_residual("label"), dtype=np.intp)

    def _by_residual(self, name: str) -> Array:
        order = (self.lines, self.arcs, self.curves, self.points, self.points, self.clouds, self.clouds, self.ends)
        return np.concatenate([getattr(rows, name) for rows in order], axis=-1)


def check_segments(
    object_segments: ObjectSegments, image_segments: ImageSegments, image_size: tuple[int, int]
) -> Pixels:
    """The labelled pixels of one frame as float arrays, or a ValueError that says what is wrong with them.

    Parameters
    ----------
    object_segments : mapping of str to segment
        The calibration object.
    image_segments : mapping of str to (N, 2) array_like
        Pixels (x, y) of each visible segment. A segment without pixels counts as not given.
    image_size : (int, int)
        Width and height in pixels.

    Returns
    -------
    dict of str to (N, 2) array
        Labels stripped of surrounding blanks.

    Raises
    ------
    ValueError
        An unknown label (the nearest known one is named), a wrong shape, a number that is not finite, coordinates that
        look normalised to 0..1, or pixels that only fit the image if width and height are swapped.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> check_segments(soccer(), {"Midle line": [(480, 100), (480, 400)]}, (960, 540))
    Traceback (most recent call last):
        ...
    ValueError: unknown label 'Midle line'; did you mean 'Middle line'?
    """
    if not isinstance(image_segments, Mapping):
        came = type(image_segments).__name__
        raise ValueError(
            f"expected a mapping of labels to (N, 2) pixels, got {came}; many frames go to calibrate_batch"
        )
    if not isinstance(object_segments, Mapping):
        raise ValueError(f"expected a field, as soccer(), or a mapping of names to segments, got {object_segments!r}")
    pixels: Pixels = {}
    for raw_label, values in image_segments.items():
        label = _known_label(raw_label, object_segments)
        try:
            xy = np.asarray(values, dtype=float)
        except (TypeError, ValueError):
            raise ValueError(f"{label!r}: expected pixels of shape (N, 2), got {values!r}") from None
        if xy.size == 0:
            continue
        if xy.ndim != 2 or xy.shape[1] != 2:
            hint = "; reshape(-1, 2) makes them so" if xy.shape[-1:] == (2,) else ""
            raise ValueError(f"{label!r}: expected pixels of shape (N, 2), got {xy.shape}{hint}")
        if not np.all(np.isfinite(xy)):
            first = int(np.flatnonzero(~np.isfinite(xy).all(axis=1))[0])
            raise ValueError(f"{label!r}: pixel {first} is not finite: {xy[first].tolist()}; leave it out")
        far = np.any(np.abs(xy / image_size - 0.5) > FARTHEST_PIXEL, axis=1)
        if np.any(far):
            first = int(np.flatnonzero(far)[0])
            at = tuple(xy[first].tolist())
            raise ValueError(f"{label!r}: pixel {first} at {at} is far outside the image of {image_size}; leave it out")
        if label in pixels:
            raise ValueError(f"{label!r} is given twice, with and without surrounding blanks")
        pixels[label] = xy
    if pixels:
        _check_scale(np.concatenate(list(pixels.values())), image_size)
    return pixels


def check_weights(
    object_segments: ObjectSegments, pixels: Pixels, weights: Weights | None
) -> tuple[Pixels, Shares | None]:
    """The pixels of one frame that weigh anything, and what each weighs, or a ValueError that says what is wrong.

    A segment of weight w counts as w segments of weight 1, which is what a label without a weight has. Its N pixels
    weigh w_i / N, so that a number is the same as N times that number.

    Parameters
    ----------
    object_segments : mapping of str to segment
        The calibration object.
    pixels : dict of str to (N, 2) array
        One frame, as `check_segments` returns it.
    weights : mapping of str to float or (N,) array_like, or None
        Not negative: one over the variance of the pixels, in units of that of a segment of weight 1. A number for a
        label that has no pixels does nothing, so one table may serve many frames.

    Returns
    -------
    pixels : dict of str to (N, 2) array
        Without the pixels of weight 0, and without the labels that have none left.
    shares : dict of str to (N,) array, or None
        What each of those pixels weighs; None without weights.

    Raises
    ------
    ValueError
        An unknown label (the nearest known one is named), a wrong length, a weight that is negative or not finite, or
        weights that are all 0.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> frame = check_segments(soccer(), {"Middle line": [(480, 100), (480, 400)], "Circle left": []}, (960, 540))
    >>> check_weights(soccer(), frame, {"Middle line": [0.5, 1.0]})[1]
    {'Middle line': array([0.25, 0.5 ])}
    """
    if weights is None:
        return pixels, None
    if not isinstance(weights, Mapping):
        raise ValueError(f"expected a mapping of labels to weights, got {type(weights).__name__}")
    given: dict[str, Array] = {}
    for raw_label, values in weights.items():
        label = _known_label(raw_label, object_segments)
        count = len(pixels.get(label, ()))
        if label in given:
            raise ValueError(f"{label!r} has two weights, with and without surrounding blanks")
        given[label] = _checked_weight(label, values, count)
    kept: Pixels = {}
    shares: Shares = {}
    for label, xy in pixels.items():
        weight = given.get(label, np.ones(len(xy)))
        seen = weight > 0.0  # a weight of 0 is that of padding
        if np.any(seen):
            kept[label], shares[label] = xy[seen], weight[seen] / len(xy)
    if pixels and not kept:
        raise ValueError("every label has the weight 0: nothing is left to calibrate from")
    return kept, shares


def _checked_weight(label: str, values: ArrayLike, count: int) -> Array:
    """Weights of the `count` pixels of a label, (count,)."""
    try:
        weight = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f"{label!r}: expected a weight, or one for each pixel, got {values!r}") from None
    if weight.shape not in ((), (count,)):
        raise ValueError(f"{label!r}: expected one weight or {count}, one for each pixel, got shape {weight.shape}")
    wrong = weight[~(np.isfinite(weight) & (weight >= 0.0))]
    if wrong.size:
        raise ValueError(f"{label!r}: a weight must be finite and not negative, got {wrong[0]}; 0 leaves a pixel out")
    return np.broadcast_to(weight, count)


def _known_label(raw_label: str, object_segments: ObjectSegments) -> str:
    """A label as the object has it, with or without its surrounding blanks."""
    label = raw_label.strip() if isinstance(raw_label, str) else raw_label
    if label in object_segments:
        return label
    if raw_label in object_segments:
        return raw_label
    raise ValueError(f"unknown label {raw_label!r}; {_nearest(label, object_segments)}")


def _nearest(label: str, object_segments: ObjectSegments) -> str:
    known = [str(name) for name in object_segments]
    close = difflib.get_close_matches(str(label), known, n=1, cutoff=0.5)
    if close:
        return f"did you mean {close[0]!r}?"
    rest = f" and {len(known) - 10} more" if len(known) > 10 else ""
    return f"known labels: {', '.join(known[:10])}{rest}"


def _check_scale(xy: Array, image_size: tuple[int, int]) -> None:
    width, height = image_size
    if min(image_size) > 16 and len(xy) > 1 and np.max(np.abs(xy)) <= 2.0:
        raise ValueError(
            f"pixels expected for an image of {width} x {height}, got coordinates between {xy.min():.3g} and "
            f"{xy.max():.3g}, which look normalised; multiply x by (width - 1) and y by (height - 1)"
        )
    # annotations may lie somewhat outside the image, so "inside" is generous
    inside = np.mean(np.all(np.abs((xy + 0.5) / image_size - 0.5) <= 0.75, axis=1))
    inside_swapped = np.mean(np.all(np.abs((xy + 0.5) / image_size[::-1] - 0.5) <= 0.75, axis=1))
    if len(xy) >= 8 and inside < 0.8 and inside_swapped > 0.95:  # a few stray pixels prove nothing
        raise ValueError(
            f"image_size = {image_size} leaves {100 * (1 - inside):.0f} % of the pixels far outside, swapped it would "
            f"hold them: give it as (width, height)"
        )
    if len(xy) >= 8 and inside < 0.5:
        share = f"{100 * (1 - inside):.0f} % of the pixels"
        raise ValueError(
            f"{share} lie far outside an image of {width} x {height}, up to {xy.max():.0f}: is image_size right?"
        )


def split_centre_circle(pixels: Pixels, image_size: tuple[int, int]) -> Pixels:
    """Assign the centre circle's pixels to its left and right half (paper, section "Modeling the Soccer Field").

    Pixels left of the middle line go to "Circle central left", the others to "Circle central right". (The paper's
    public code compares x with the mean x of the line's two ends.) Where the middle line is not given, or is level, the
    half depends on which side of the image the whole circle lies: the right half of the field is in view where the
    circle is left of the image's centre, and then it is the circle's right half that is seen.

    Parameters
    ----------
    pixels : dict of str to (N, 2) array
        One frame, as `check_segments` returns it.
    image_size : (int, int)
        Width and height in pixels.

    Returns
    -------
    dict of str to (N, 2) array
        The frame without "Circle central" and with the halves that have pixels.

    Examples
    --------
    >>> frame = {"Middle line": np.array([[500.0, 100], [500, 400]]), "Circle central": np.array([[450.0, 250]])}
    >>> list(split_centre_circle(frame, (960, 540)))
    ['Middle line', 'Circle central left']
    """
    if "Circle central" not in pixels:
        return dict(pixels)
    split = {label: xy for label, xy in pixels.items() if label != "Circle central"}
    circle = pixels["Circle central"]
    left = _left_of_middle_line(circle, pixels.get("Middle line"))
    if left is None:
        left = np.full(len(circle), circle[:, 0].mean() > image_size[0] / 2.0)
    for label, half in (("Circle central left", circle[left]), ("Circle central right", circle[~left])):
        if len(half):
            split[label] = np.concatenate([split[label], half]) if label in split else half
    return split


def _left_of_middle_line(xy: Array, middle_line: Array | None) -> BoolArray | None:
    if middle_line is None or len(middle_line) < 2:
        return None
    top, bottom = middle_line[middle_line[:, 1].argmin()], middle_line[middle_line[:, 1].argmax()]
    down = bottom - top
    if down[1] <= LEVEL * np.abs(down[0]):
        return None
    offset = xy - top
    return np.asarray(down[0] * offset[:, 1] - down[1] * offset[:, 0] > 0.0)


def pack(
    object_segments: ObjectSegments,
    frames: Sequence[Pixels],
    image_size: tuple[int, int],
    shares: Sequence[Shares | None] | None = None,
) -> Observations:
    """Pack checked frames into padded arrays; `shares` are what their pixels weigh, as `check_weights` returns it.

    Without them the pixels of a segment share a weight of 1, so that each segment counts alike however many pixels it
    has (paper, equation 2). On annotated frames this is more accurate than pixels that count alike: 85.6 against 84.2 %
    of segments within 5 px on SoccerNet's, 84.0 against 82.0 % on WC14's.

    Labels are numbered in the order of `object_segments`, so that frames packed together or one by one are numbered
    alike.
    """
    labels = tuple(object_segments)
    number = {label: index for index, label in enumerate(labels)}
    geometry = {label: _geometry(object_segments[label]) for label in {label for frame in frames for label in frame}}

    def pack_kind(kind: str) -> Rows:
        members = [[(label, xy) for label, xy in frame.items() if geometry[label][0] == kind] for frame in frames]
        count = max((sum(len(xy) for _, xy in member) for member in members), default=0)
        depth = max((len(vectors) for other, vectors in geometry.values() if other == kind), default=LEAST_DEPTH[kind])
        shape = (len(frames), count)
        rows = Rows(
            np.zeros((*shape, 2)),
            np.zeros(shape),
            np.full(shape, -1, dtype=np.intp),
            np.tile(np.eye(3)[np.arange(depth) % 3], (*shape, 1, 1)),  # padding must stay finite
        )
        for t, member in enumerate(members):
            end = 0
            share = shares[t] if shares is not None else None
            for label, xy in member:
                here = slice(end, end := end + len(xy))
                vectors = geometry[label][1]
                rows.xy[t, here] = xy
                rows.weight[t, here] = 1.0 / len(xy) if share is None else share[label]
                rows.label[t, here] = number[label]
                rows.geometry[t, here] = vectors[np.minimum(np.arange(depth), len(vectors) - 1)]
        return rows

    return Observations(labels, image_size, **{kind: pack_kind(kind) for kind in LEAST_DEPTH})


def _geometry(segment: Segment) -> tuple[str, Array]:
    """The kind of rows that a segment makes, and its vectors (G, 3)."""
    match segment:
        case Line(start, end):
            return "lines", np.array([start, np.subtract(end, start)])
        case Arc(center, radius, u=u, v=v):
            return "arcs", np.array([center, np.multiply(radius, u), np.multiply(radius, v)])
        case Point(X):
            return "points", np.array([X])
        case PointCloud():
            return "curves" if segment.ordered else "clouds", segment.X
