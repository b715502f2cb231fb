"""What may have been typed wrong: other readings of points and labels, tried where they do not fit as they were given.

A reading changes all points or labels alike: axes that are turned over, pixels that are not square or those of another
size of the picture, left and right exchanged. It is believed if it explains all of them, and its likelihood exceeds
that of the input as given, with each contradicted label taken for a mistake of its own (`fieldcalib.solve.mislabels`).
Many labels that are wrong in one way have one cause, which is said once, instead of each label being blamed.

A rectangle of four points always has a camera: what nothing in the input can check is said too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from fieldcalib._types import Array
from fieldcalib.assess.findings import Finding, Status, SuspectLabel, What, in_words
from fieldcalib.assess.result import Calibration, found_of, with_findings
from fieldcalib.assess.verdict import TO_BLAME
from fieldcalib.fields.field import OPPOSITE, Field, side_of
from fieldcalib.solve.mislabels import LOG_ODDS, MOST_LABELS
from fieldcalib.solve.request import Options
from fieldcalib.solve.solver_options import CERTAIN, CalibrationFlags

FLAT = 1e-6  # of the extent: flatter points are of a plane, and their axes may be turned over unnoticed
# Of the labels as given; a reading that explains all of them is said instead.
BY_LABEL = frozenset([What.SUSPECTS, What.MISSED, What.MISFIT])
WIDTHS = (480, 512, 640, 720, 854, 960, 1024, 1280, 1366, 1440, 1600, 1920, 2560, 3840)  # usual ones, px
EXPLAINED = 3.0  # times the usual noise: points that people click fit their camera to 2.5 at most
CORNER = 1.5  # px from a corner of the picture
EDGE = 0.006  # of the width: nearer to an edge, a click is where a line leaves the picture
FAR_OUT = 2.5  # times the median error: of normal errors, one point in a hundred
SINGLES = "Singles s"  # how the labels of side lines of a court for singles begin, instead of with S
ENDS = ("Base line left", "Base line right", "Back line left", "Back line right")
COURTS = ((23.77, 10.97, 8.23), (13.40, 6.10, 5.18))  # tennis, badminton: length, widths of doubles and singles, metres
SAME_SIDE = 0.02  # of a side of a court: as lengths are rounded, or measured between other edges of lines

UnderOtherNames: TypeAlias = Callable[[Sequence[int], Sequence[Mapping[str, str]]], list[Calibration]]


@dataclass(frozen=True, eq=False)
class PointReading:
    """Another way to read points: axes, size of the picture, and shape of its pixels."""

    findings: tuple[Finding, ...] = ()
    """What is wrong if this is the right reading."""
    axes: Array = field(default_factory=lambda: np.eye(3))
    """Factor (3, 3) of the coordinates."""
    image_size: tuple[int, int] | None = None
    """Size of the picture in which the pixels are; None for the given one."""
    exchanges_pixels: bool = False
    """Whether the two coordinates of the pixels are exchanged."""
    freed: int = 0
    """`CalibrationFlags` that are taken away: what they fix is then estimated."""
    finds_wrong: bool = True
    """Whether single wrong points are searched for."""


NOT_SQUARE = PointReading((Finding(What.NOT_SQUARE),), freed=CalibrationFlags.CALIB_FIX_ASPECT_RATIO)
EXCHANGED_PIXELS = PointReading((Finding(What.EXCHANGED_PIXELS),), exchanges_pixels=True)
LENS = PointReading((Finding(What.WANTS_LENS),), freed=CalibrationFlags.CALIB_FIX_K1)
TURNED_OVER = tuple(
    PointReading((Finding(What.LEFT_HANDED, axis),), np.diag(np.where(np.arange(3) == k, -1.0, 1.0)))
    for k, axis in enumerate("xyz")
)
Y_AND_Z = PointReading((Finding(What.OTHER_AXES, "y and z"),), np.diag([1.0, -1.0, -1.0]))


def point_readings(
    X: Array, xy: Array, image_size: tuple[int, int], *, on_field: bool, is_shape_known: bool
) -> list[PointReading]:
    """Readings of points (N, 3) with pixels (N, 2) that are worth trying.

    Cameras of a field are above the ground: there, points of one plane tell the handedness of their axes too.
    """
    x, y, z = TURNED_OVER
    of_field, of_others = ([y, x], []) if is_flat(X) else ([z, y, x, Y_AND_Z], [z])
    found = of_field if on_field else of_others
    found += [EXCHANGED_PIXELS] * bool(np.all(xy[:, ::-1] < image_size))
    if is_shape_known:
        return found
    found += [replace(NOT_SQUARE, findings=one.findings + NOT_SQUARE.findings, axes=one.axes) for one in found]
    found += [NOT_SQUARE, LENS]
    width, height = image_size
    sizes = [(other, round(other * height / width)) for other in WIDTHS if other != width]
    sizes = [size for size in sizes if np.all(xy < size)]
    return found + [PointReading((Finding(What.OTHER_PICTURE, numbers=size),), image_size=size) for size in sizes]


def is_flat(X: Array) -> bool:
    """Whether points (N, 3) are of one plane."""
    extent = np.linalg.svd(X - X.mean(axis=0), compute_uv=False)
    return len(X) < 4 or bool(extent[2] <= FLAT * extent[0])


def are_enough_to_explain(calibration: Calibration, count: int, unknowns: int) -> bool:
    """Whether so many points can tell one reading from another, which fit few or degenerate ones by chance."""
    is_open = calibration.status in (Status.TOO_FEW_SEGMENTS, Status.DEGENERATE)
    return not is_open and 2 * count - unknowns >= TO_BLAME and count <= MOST_LABELS


def is_contradicted(calibration: Calibration) -> bool:
    """Whether a camera contradicts some of its labels, or misses all of them."""
    return not calibration.accepted or any(one.what in BY_LABEL for one in found_of(calibration))


def with_best_reading(
    found: Calibration, options: Options, readings: Sequence[PointReading], read: Callable[[PointReading], Calibration]
) -> Calibration:
    """The calibration, with the reading named that explains all points, if there is one; no point is then blamed."""
    given = np.inf if found.status is Status.IMPLAUSIBLE else _points_cost(found, options)
    explained: list[tuple[float, PointReading, Calibration]] = []

    def fits(one: Calibration) -> bool:
        return one.accepted and not is_contradicted(one) and one.rms <= EXPLAINED * options.noise

    for reading in sorted(readings, key=lambda one: len(one.findings)):
        if explained and len(reading.findings) > len(explained[0][1].findings):
            break  # one cause rather than two
        # the search for wrong points takes longest, and a reading under which some are wrong explains not all of them
        if fits(read(replace(reading, finds_wrong=False))) and fits(one := read(reading)):
            odds = LOG_ODDS + np.log(len(readings)) + CERTAIN * len(reading.findings)
            odds += CERTAIN * (options.field is not None and _is_opposite(one, options.field))
            cost = _points_cost(one, options) + odds
            if cost < given:
                explained.append((cost, reading, one))
    if not explained:
        return found
    _, reading, best = min(explained, key=lambda one: one[0])
    count = len(found.per_segment_errors)
    findings = (*reading.findings, Finding(What.EXPLAINED, numbers=(count, best.rms)))
    others = (one for one in found_of(found) if one.what not in BY_LABEL)
    no_camera = any(one.what in (What.LEFT_HANDED, What.OTHER_AXES, What.EXCHANGED_PIXELS) for one in findings)
    status = Status.IMPLAUSIBLE if no_camera else found.status
    message = str(findings[-1]) if status is Status.ACCEPTED else in_words(*findings)
    return replace(found, status=status, message=message, suspect_labels=(), _found=(*findings, *others))


def _points_cost(calibration: Calibration, options: Options) -> float:
    """Minus the log likelihood of points under their camera, in the pixels that were given.

    Unlike the solver's cost it does not depend on the size of the picture, which scales the solver's noise.
    """
    if calibration.camera is None:
        return np.inf
    suspects = {one.label for one in calibration.suspect_labels}
    errors = np.array([error for label, error in calibration.per_segment_errors.items() if label not in suspects])
    cost = 0.5 * np.sum(options.loss.evaluate(np.square(errors))[0]) / options.noise**2
    return float(cost + _mistakes(calibration, options))


def _mistakes(calibration: Calibration, options: Options) -> float:
    """Cost of the labels that are contradicted, each as a mistake of its own (`fieldcalib.solve.mislabels`)."""
    missed = 0.5 * float(options.wide_loss.evaluate(np.array(options.wide_loss.scale**2))[0]) / options.noise**2
    others = np.log(max(len(options.object_segments) - 1, 1))
    return float(sum(LOG_ODDS + (missed if one.fits is None else others) for one in calibration.suspect_labels))


def log_cost(calibration: Calibration, options: Options) -> float:
    """Minus the log likelihood of a frame's labels and of its camera, up to a constant."""
    if calibration.solved is None:
        return np.inf
    return float(calibration.solved.evaluation.cost[calibration.solved.frame] + _mistakes(calibration, options))


def with_other_names(
    found: Mapping[int, Calibration], options: Options, solve: UnderOtherNames
) -> dict[int, Calibration]:
    """Calibrations of frames, by number, with the names of their labels exchanged where that explains them.

    Parameters
    ----------
    found : mapping of int to Calibration
        Calibrations of the labels as given.
    options : Options
    solve : callable
        Calibrations of some of the frames under other names of their labels, which are given for each frame.
    """
    of = options.field
    if of is None or not found:
        return dict(found)
    named = _with_exchanged_sides(found, of, options, solve)
    accepted = {t: one.per_segment_errors for t, one in named.items() if one.accepted}
    courts = {t: names for t, labels in accepted.items() if (names := other_court(of, labels))}
    others = solve(list(courts), list(courts.values())) if courts else []
    for (t, names), other in zip(courts.items(), others, strict=True):
        if other.accepted and log_cost(other, options) < log_cost(named[t], options) + CERTAIN:
            sides = ([of[label].sample()[0, 1] for label in some] for some in (names, names.values()))
            named[t] = with_findings(named[t], _two_widths(named[t], other, [float(np.ptp(one)) for one in sides]))
    return named


def _with_exchanged_sides(
    found: Mapping[int, Calibration], of: Field, options: Options, solve: UnderOtherNames
) -> dict[int, Calibration]:
    """Calibrations of labels in which left and right, or top and bottom, are exchanged, where that explains them."""
    exchanged = dict(found)
    doubtful = [t for t, one in found.items() if one.camera and not _is_mostly_explained(one)]
    for about, names in (("left and right", of.mirrored[0]), ("top and bottom", of.mirrored[1])):
        tried = [t for t in doubtful if any(names.get(one, one) != one for one in found[t].per_segment_errors)]
        others = solve(tried, [names] * len(tried)) if tried else []
        for t, other in zip(tried, others, strict=True):
            if not other.accepted or log_cost(other, options) + LOG_ODDS + CERTAIN >= log_cost(found[t], options):
                doubtful.remove(t)  # the other way is this one turned by 180 degrees
            elif not (about == "left and right" and options.task.side is None and _is_opposite(other, of)):
                doubtful.remove(t)
                exchanged[t] = _under_given_names(other, names, Finding(What.EXCHANGED_SIDES, about))
    return exchanged


def _is_mostly_explained(calibration: Calibration) -> bool:
    """Whether a camera is accepted and misses none of its labels, of which at most one is suspect."""
    is_missed = any(one.what is What.MISSED for one in found_of(calibration))
    return calibration.accepted and len(calibration.suspect_labels) < 2 and not is_missed


def _is_opposite(calibration: Calibration, field: Field) -> bool:
    """Whether a camera is on the opposite side of a field."""
    return side_of(calibration.required_camera.C, field) == OPPOSITE


def _under_given_names(other: Calibration, names: Mapping[str, str], finding: Finding) -> Calibration:
    """A calibration of labels under other names, with the names that were given."""
    given = {label: label for label in other.per_segment_errors} | {new: label for label, new in names.items()}
    suspects = (SuspectLabel(given[one.label], one.fits, one.error_px) for one in other.suspect_labels)
    return replace(
        other,
        per_segment_errors={given[label]: error for label, error in other.per_segment_errors.items()},
        pixel_counts={given[label]: count for label, count in other.pixel_counts.items()},
        suspect_labels=tuple(suspects),
        _found=(finding, *found_of(other)),
    )


def other_court(field: Field, labels: Iterable[str]) -> Mapping[str, str]:
    """The labels of the court of the other width for those of a court's four sides; empty for other labels.

    The side lines of a court for doubles and those of one for singles make rectangles that look alike.

    Examples
    --------
    >>> from fieldcalib.fields import tennis
    >>> sides = ("Base line left", "Base line right", "Side line top", "Side line bottom")
    >>> other_court(tennis(), sides)
    {'Side line bottom': 'Singles side line bottom', 'Side line top': 'Singles side line top'}
    >>> other_court(tennis(), (*sides, "Service line left"))
    {}
    """
    singles = {label.replace(SINGLES, "S", 1): label for label in field if label.startswith(f"{SINGLES}ide")}
    doubles = {other: line for line, other in singles.items()}
    sides = set(labels) - set(ENDS)
    return next((names for names in (singles, doubles) if names and set(names) == sides), {})


def unchecked(
    found: Calibration, X: Array, unknowns: int, read: Callable[[PointReading], Calibration]
) -> tuple[Finding, ...]:
    """What nothing checks in a camera from points (N, 3): the distances between four points of a plane.

    Any rectangle fits the homography of its four corners, and most have a camera with square pixels. If the rectangle
    is a court for singles or doubles, the other one is named.
    """
    if not found.accepted or len(X) > 4 or not is_flat(X) or 2 * len(X) - unknowns > 1:
        return ()
    for length, *widths in COURTS:
        for width, other in (widths, widths[::-1]):
            across = _width_of_rectangle(X, (length, width))
            if across is not None:
                as_other = read(PointReading(axes=np.eye(3) + (other / width - 1.0) * np.outer(across, across)))
                if as_other.accepted:
                    return (_two_widths(found, as_other, (width, other)),)
    return (Finding(What.UNCHECKED),)


def _width_of_rectangle(X: Array, size: tuple[float, float]) -> Array | None:
    """Direction (3,) of the width, if four points (4, 3) are the corners of a rectangle of a length and width."""
    to = X[1:] - X[0]
    order = np.argsort(np.linalg.norm(to, axis=1))
    lengths = np.linalg.norm(to, axis=1)[order]
    length, width = size
    if not np.allclose(lengths, (width, length, np.hypot(length, width)), rtol=SAME_SIDE):
        return None
    if not np.allclose(to[order[0]] + to[order[1]], to[order[2]], atol=SAME_SIDE * width):
        return None
    return np.asarray(to[order[0]] / lengths[0])


def _two_widths(found: Calibration, other: Calibration, widths: Sequence[float]) -> Finding:
    """The finding that a court of another width fits as well, with the heights of both cameras, metres."""
    heights = (abs(one.required_camera.C[2]) for one in (found, other))
    return Finding(What.TWO_WIDTHS, numbers=(*widths, *heights))


def with_doubted_points(
    found: Calibration, xy: Mapping[str, Array], image_size: tuple[int, int], unknowns: int
) -> Calibration:
    """The calibration of points, with those named that are off, as far as the others tell, and what is odd about them.

    Parameters
    ----------
    found : Calibration
    xy : mapping of str to (1, 2) array
        Pixel of each point.
    image_size : (int, int)
    unknowns : int
        Number of parameters that the points must determine.
    """
    if not found.has_finding(*BY_LABEL) or any(one.what.explains_all for one in found_of(found)):
        return found
    suspects = [one.label for one in found.suspect_labels]
    if not suspects and 2 * (len(xy) - 1) - unknowns < TO_BLAME:
        return with_findings(found, Finding(What.ONE_OF, numbers=(len(xy),)))
    errors = found.per_segment_errors
    far = FAR_OUT * float(np.median(list(errors.values())))
    farthest = [label for label in sorted(errors, key=lambda one: -errors[one]) if errors[label] > far]
    added = [] if suspects or not farthest else [Finding(What.FARTHEST, ", ".join(map(repr, farthest)))]
    off = suspects or farthest
    last = np.array(image_size) - 1.0
    at_edge = [one for one in off if np.min([xy[one][0], last - xy[one][0]]) < EDGE * image_size[0]]
    return with_findings(found, *added, *(Finding(What.AT_EDGE, one) for one in at_edge))


def are_picture_corners(xy: Array, image_size: tuple[int, int]) -> bool:
    """Whether three or more pixels (N, 2) are corners of their picture.

    Examples
    --------
    >>> are_picture_corners(np.array([[0, 0], [1919, 0], [1919, 1079], [500, 400]]), (1920, 1080))
    True
    """
    width, height = image_size
    corners = np.array([(x, y) for x in (0.0, width - 1.0) for y in (0.0, height - 1.0)])
    near = np.max(np.abs(xy[:, None] - corners), axis=-1) <= CORNER
    return int(np.sum(np.any(near, axis=0))) >= 3
