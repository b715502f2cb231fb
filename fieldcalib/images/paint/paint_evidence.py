"""Paint of projected markings as evidence for a camera: whether each marking lies on paint, and how wide its paint is.

Place. Refinement looks for lines close to the projected markings only. A marking whose paint lies further off is not
used there while the other markings fit, so a camera may be consistent and wrong. Here the paint of every marking in
view is looked for in a wide band around its projection. In each profile across the marking the strongest ridges are
taken (peaks of brightness with the same ground on both sides). Ridges that lie along a straight or evenly bent line, or
a shifted arc, and are clearly more than the ridges where the marking is projected, are its paint. Lines appear bent
where the ground is not flat or the lens differs from that of the camera. They appear skewed while a camera turns whose
rows are exposed one after another: the first row and the last one are up to the motion of a frame apart.

Posts and crossbars are left out, since nets and stands behind them are full of lines, and so are markings of short
dashes with wide gaps, of which few places show paint.

Width. It is measured in units of the width that the camera projects. Lines of soccer are at most 12 cm wide. A smaller
field with the same markings gives the same picture, and so the same labels, as a larger one from further away, but its
paint looks wider than projected. Motion and defocus widen lines too, but also their edges: a line that is blurred to a
multiple of its width has edges as long as it is wide. So only places with sharp edges count.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array, BoolArray, Float32, IntArray
from fieldcalib.assess.paint_in_view import CONFIRMED, LEAST_PLACES, LONG, UNSEEN, MarkingInView
from fieldcalib.assess.verdict import STEEPLY
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.paint.line_profiles import (
    LUMA,
    SPACING,
    Markings,
    Profiles,
    Strips,
    colours_across,
    find_lines,
    pixels_of_lines,
    profiles_along,
)
from fieldcalib.io.image_files import Image
from fieldcalib.problem.labelled_pixels import PixelTable
from fieldcalib.solve.solver_options import pixel_unit

# Lengths are in pixels of a 960 x 540 image and grow with the image.
BAND = 30.0  # px to both sides of a marking in which its paint is looked for
ON_PAINT = 2.25  # px: nearer ridges are the paint of the marking
BESIDE = 3.0  # px: paint further off is beside the marking; with correct cameras of 98 broadcast frames at most 2.9 px
MOST_SKEWED = 4.25  # px: the most for paint that a rolling shutter skews
SAME_RUN = 1.2  # px from the line or arc that the paint follows
PEAKS = 5  # strongest ridges that are kept of each profile
SEEN = 0.5  # least share of the profiles that paint beside a marking must cover
MORE, MORE_SHARE = 3, 0.25  # profiles, and share of them, by which it must exceed the paint on the marking
NEARER = 0.2  # share of the profiles by which paint at the end of the band must exceed paint at the marking
AS_NARROW = 1.2  # other markings are compared if their width in the image is at most this times the marking's
EXPECTED = 0.6  # if more than this share of the compared markings' profiles show paint, the marking should show it too
LOOKED_AT = 0.87  # if more than this share of the profiles show paint at the projection, the marking is on its paint
NEARLY_ALL = 0.9  # share of the profiles on one line or arc, from which `MORE` is enough
WIDEST = 15.0  # px: the edge of a net that is nearer is too wide to be found as a line
NET_HEIGHTS = (1.0, 0.8, 1.25, 0.6, 1.5)  # times that of the net: right cameras of half courts are up to a third off
# Successive places from an end of a line on, the least share of them with paint, and px: right cameras of 186 pictures
# and of 463 frames of clips show none; five places or more would show fewer wrong cameras of parts of pictures.
LEAST_PAST, PAINTED_PAST, SHORTEST_PAST = 4, 0.7, 24.0
FROM_BORDER = 10.0  # px: nearer to the border of the picture the ground is seen on one side only
LEAST_PAINTED = 0.3  # painted share of a dashed marking: with less it is left out
DRAWS = 200  # random samples of a marking's ridges, each of which determines a line or an arc
APART = 0.3  # least share of a marking's profiles between the outer ridges of a sample
LEAST_DETERMINANT = 0.1  # of a sample's equations: ridges with parallel normals do not determine the shift of an arc

NARROWEST = 3.0  # px of any image: the width of narrower lines cannot be measured
SHARPEST = 0.6  # longest sharp edge, in projected widths; the edges of a moving or defocused line are longer
STEPS = 16  # samples per projected width
REACH = 4.5  # projected widths sampled to both sides of a marking, which includes the ground on both sides
NEAR, NEAR_PX = 1.2, 1.0  # projected widths plus px from the marking within which the middle of the paint lies
GROUND_FROM, GROUND_FROM_PX = 1.8, 1.0  # projected widths plus px from the middle of the paint to the ground
LEAST_CONTRAST = 15.0  # levels
EVEN = 0.5  # of the contrast: largest difference between the grounds on both sides


@dataclass(frozen=True, eq=False)
class PaintEvidence:
    """Evidence of paint in an image for the markings on the ground that a camera projects."""

    markings: tuple[MarkingInView, ...]
    beside: PixelTable
    """Pixels on the paint of markings that lie beside it."""


@dataclass(frozen=True, eq=False)
class Ridges:
    """Ridges in an image near the projected markings on the ground, with the profiles in which they were found."""

    profiles: Profiles
    xy: Float32
    """Pixels (n, k, 2) of the ridges in each profile, NaN for none."""
    may_be_line: BoolArray
    """Whether each ridge has the same ground on both sides, (n, k)."""
    raised: Profiles
    """Profiles across what is above the ground: the tape of a net, a crossbar, posts."""
    unit: float
    """Pixels of the image per pixel of a 960 x 540 image."""

    @classmethod
    def of(cls, image: Image, profiles: Profiles) -> Ridges:
        """Look for ridges up to 30 px (in an image of 960 x 540) beside the markings that a camera projects."""
        return cls.across(wide_strips(image, profiles))

    @classmethod
    def across(cls, wide: Strips) -> Ridges:
        """Look for ridges in those wide strips that cross markings on the ground."""
        strips = wide.part(np.flatnonzero(wide.profiles.on_ground), BAND, past_others=True)
        profiles = strips.profiles
        offset, may_be_line = strips.ridges(BAND, PEAKS)
        is_on = np.any(np.abs(offset) < ON_PAINT * strips.unit, axis=1)
        shown = np.flatnonzero(is_on | ~strips.is_blind)
        xy = profiles.xy[:, None] + offset[..., None] * profiles.normal[:, None]
        raised = wide.profiles.take(np.flatnonzero(~wide.profiles.on_ground))
        return cls(profiles.take(shown), xy[shown].astype(np.float32), may_be_line[shown], raised, strips.unit)

    @classmethod
    def past_ends(cls, image: Image, camera: Camera, markings: Markings) -> Ridges:
        """Look for lines at the continuations of the projected lines past their ends, at most 3 px beside them.

        Not near the border of the picture.
        """
        unit, middle = pixel_unit(camera.image_size), np.divide(camera.image_size, 2.0)
        profiles = profiles_along(camera, markings.past_ends)
        is_free = np.all(np.abs(profiles.xy - middle) < middle - FROM_BORDER * unit, axis=1)
        profiles = profiles.take(np.flatnonzero(is_free))
        profiles = replace(profiles, room=np.full(len(profiles), np.inf))  # other markings are not near
        xy = profiles.xy + find_lines(image, profiles, BESIDE)[:, None] * profiles.normal
        return cls(profiles, xy[:, None].astype(np.float32), np.isfinite(xy[:, :1]), profiles.take(np.arange(0)), unit)

    @property
    def offset(self) -> Array:
        """Signed distances (n, k) of the ridges from the markings, pixels; NaN for none."""
        return np.asarray(np.sum((self.xy - self.profiles.xy[:, None]) * self.profiles.normal[:, None], axis=-1))

    def seen_by(self, camera: Camera, markings: Markings, reach: float = BAND) -> Ridges:
        """Relate the ridges to the markings that another camera projects; those farther off than `reach` are dropped.

        Markings past the ends of others are looked at with a reach of 0: ridges before such an end are not past it.
        """
        old, new = self.profiles, profiles_along(camera, markings)
        raised, new = (new.take(np.flatnonzero(new.on_ground == is_on)) for is_on in (False, True))
        pairs = [np.zeros((2, 0), dtype=np.intp)]
        for k in np.intersect1d(old.member, new.member):
            here, there = np.flatnonzero(old.member == k), np.flatnonzero(new.member == k)
            distance = np.linalg.norm(old.xy[here][:, None] - new.xy[there], axis=-1)
            near = np.min(distance, axis=1) < (reach + SPACING) * self.unit
            pairs.append(np.stack([here[near], there[np.argmin(distance, axis=1)][near]]))
        kept, at = np.concatenate(pairs, axis=1)
        return replace(self, profiles=new.take(at), xy=self.xy[kept], may_be_line=self.may_be_line[kept], raised=raised)


def wide_strips(image: Image, profiles: Profiles) -> Strips:
    """Sample the wide strips in which paint beside markings is looked for."""
    return Strips.of(image, profiles, BAND, past_others=True)


def paint_evidence(image: Image, profiles: Profiles, markings: Markings) -> PaintEvidence:
    """Look for the paint of every marking in view, up to 30 px (in an image of 960 x 540) beside its projection.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        Blue, green, red.
    profiles : Profiles
        Those of the camera (`profiles_along`).
    markings : Markings
        Lighter or darker than the ground, as the field's `LineLook` says.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> from fieldcalib.draw.scene import render_field
    >>> truth = Camera.from_angles(0.3, 1.36, 0.0, 1300.0, (0.0, 66.0, -16.0), (960, 540))
    >>> wider = Markings.of(soccer(105.0, 72.0))  # the camera is right, the size of the pitch is not
    >>> seen = paint_evidence(render_field(truth, soccer()), profiles_along(truth, wider), wider)
    >>> found = {one.label: one for one in seen.markings}
    >>> found["Big rect. right main"].share, round(found["Side line top"].offset)
    (1.0, 4)
    """
    return evidence_of(Ridges.of(image, profiles), markings)


def evidence_of(ridges: Ridges, markings: Markings, motion: ArrayLike = (0.0, 0.0)) -> PaintEvidence:
    """Decide from ridges which markings lie on paint and which beside it, and where that paint is.

    `motion` (2,) is that of the picture from one frame to the next, pixels, if it is known.
    """
    profiles, offset, unit = ridges.profiles, ridges.offset, ridges.unit
    is_on = np.any(np.abs(offset) < ON_PAINT * unit, axis=1)
    found, beside = [], np.full(len(profiles), np.nan)
    for k in np.unique(profiles.member):
        if markings.painted[k] < LEAST_PAINTED:
            continue
        # ridges on the paint of other markings, and on what is above the ground, are excluded: from low behind a court
        # the tape of the net is near the far lines; a bent line is only tried if no straight one is found
        at = np.flatnonzero(profiles.member == k)
        on, off, is_bent = int(np.count_nonzero(is_on[at])), 0.0, False
        if len(at) >= LEAST_PLACES and on <= min(LOOKED_AT * len(at), len(at) - MORE):
            free, xy = ridges.may_be_line[at] & np.isfinite(offset[at]), ridges.xy[at].astype(float)
            for others in (profiles.take(np.flatnonzero(is_on & (profiles.member != k))), ridges.raised):
                free[free] = ~_is_paint_of(others, xy[free], unit)
            may_be = np.where(free, offset[at], np.nan)
            off, run = _run_beside(may_be, profiles.normal[at] if markings.is_arc[k] else _along(len(at)), on, unit)
            skew = 0.5 * float(np.median(np.abs(profiles.normal[at] @ np.asarray(motion)))) / unit
            most = min(BESIDE + skew, MOST_SKEWED)
            if off == 0.0 and not markings.is_arc[k]:
                off, run = _run_beside(may_be, _along(len(at), bent=True), on, unit)
                most, is_bent = BESIDE, off > BESIDE * unit
            seen = np.isfinite(run)
            if off <= most * unit:  # near enough to be the paint on which the marking lies
                off, on = 0.0, max(on, int(np.count_nonzero(seen)))
            elif not is_bent:
                beside[at] = run
        length = float(np.sum(profiles.spacing[at]))
        expected = not markings.is_optional[k] and _is_expected(profiles, is_on, k, by_one=bool(markings.net))
        found.append(MarkingInView(markings.labels[k], length, len(at), on / len(at), off, expected, is_bent))
    return PaintEvidence(tuple(found), pixels_of_lines(markings, profiles, beside))


def missing_net(image: Image, camera: Camera, markings: Markings, seen: Sequence[MarkingInView]) -> list[MarkingInView]:
    """The edges of a net as one marking without paint, if they must be in view before the field and are not; else none.

    They must be, if the image shows marked lines (`seen`). Where they are is as uncertain as the heights of a camera
    that is right on the ground, so they are looked for higher and lower too. A wrong camera, which takes the net for a
    line on the ground, projects it where no net is at any height.
    """
    if camera.angles[1] < STEEPLY:  # its edges look as thin as they are
        return []
    confirmed = sum(one.places for one in seen if one.is_confirmed)
    profiles, offset, unit = _across_net(image, camera, markings)
    reach = np.max(np.abs(markings.X[markings.on_ground, :2]), axis=0)
    before_field = np.all(np.abs(camera.image_to_field(profiles.xy)[:, :2]) < reach, axis=1)  # false for the sky
    edge = profiles.take(np.flatnonzero(before_field))
    if min(confirmed, len(edge)) < LONG or np.median(edge.width) > WIDEST * unit:
        return []
    share = float(np.mean(np.any(np.abs(offset[before_field]) < ON_PAINT * unit, axis=1)))
    if share >= UNSEEN or any(_shows_net(image, camera, markings, height) for height in NET_HEIGHTS):
        return []
    label = markings.labels[np.bincount(edge.member).argmax()]
    return [MarkingInView(label, float(np.sum(edge.spacing)), len(edge), share, 0.0)]


def _across_net(image: Image, camera: Camera, markings: Markings, height: float = 1.0) -> tuple[Profiles, Array, float]:
    """Profiles across the edges of a net, times as high; offsets (n, k) of the ridges in them; and `Ridges.unit`."""
    higher = replace(markings, X=markings.X * (1.0, 1.0, height))
    profiles = profiles_along(camera, higher)
    edges = [markings.labels.index(label) for label in markings.net]
    strips = wide_strips(image, profiles.take(np.flatnonzero(np.isin(profiles.member, edges))))
    strips = strips.part(np.flatnonzero(~strips.is_blind), BAND, past_others=True)
    return strips.profiles, strips.ridges(BAND, PEAKS)[0], strips.unit


def _shows_net(image: Image, camera: Camera, markings: Markings, height: float) -> bool:
    """Whether a line lies near an edge of the net that is times as high."""
    profiles, offset, unit = _across_net(image, camera, markings, height)
    edges = [np.flatnonzero(profiles.member == k) for k in np.unique(profiles.member)]
    return any(_run_beside(offset[at], _along(len(at)), 0, unit)[0] > 0.0 for at in edges)


def _is_expected(profiles: Profiles, is_on: BoolArray, k: int, *, by_one: bool) -> bool:
    """Whether the paint of marking k should be visible: paint as narrow of the others mostly is.

    A camera that takes the net of a court for a line projects most of them where there is no paint. There another line
    that shows it nearly everywhere is enough (`by_one`); elsewhere a line may lie under a carpet or behind boards.
    """
    narrow = (profiles.member != k) & (profiles.width < AS_NARROW * np.median(profiles.width[profiles.member == k]))
    if by_one:
        most = int(np.max(profiles.member)) + 1
        count, on = (np.bincount(profiles.member[some], minlength=most) for some in (narrow, narrow & is_on))
        if np.any((count >= LONG) & (on >= CONFIRMED * count)):
            return True
    return bool(np.count_nonzero(narrow) >= LONG and np.mean(is_on[narrow]) > EXPECTED)


def with_lines(
    evidence: PaintEvidence, markings: Markings, strips: Strips, lines: Array, labelled: Collection[str]
) -> PaintEvidence:
    """Count lines that a person labelled as paint on their markings, where they show more of it than the ridges.

    Paint beside such a marking then counts only if it is still clearly more.

    Parameters
    ----------
    evidence : PaintEvidence
    markings : Markings
    strips : Strips
        Samples across the markings.
    lines : (n,) array
        Signed distances of the lines from the markings, pixels; NaN for none.
    labelled : collection of str
        Markings that a person labelled.
    """
    is_on = np.abs(lines) < ON_PAINT * strips.unit  # false for NaN
    seen, on_paint = [], []
    for one in evidence.markings:
        k = markings.labels.index(one.label)
        share = float(np.mean(is_on[strips.profiles.member == k])) if one.label in labelled else 0.0
        if share > one.share:
            one = replace(one, share=share)
            if np.count_nonzero(evidence.beside.label == k) < (share + MORE_SHARE) * one.places:
                one = replace(one, offset=0.0, is_bent=False)
                on_paint.append(k)
        seen.append(one)
    return PaintEvidence(tuple(seen), evidence.beside.take(~np.isin(evidence.beside.label, on_paint)))


def _along(count: int, *, bent: bool = False) -> Array:
    """Basis (n, 2) of the offsets of a shifted and rotated line in each profile; (n, 3) with a parabolic bend."""
    t = np.linspace(-1.0, 1.0, count)
    return np.column_stack([np.ones(count), t, t * t][: 2 + bent])


def _is_paint_of(others: Profiles, xy: Array, unit: float) -> BoolArray:
    """Whether pixels (N, 2) lie on a marking in one of the profiles `others`."""
    (x, y), (nx, ny) = others.xy.T, others.normal.T
    dx, dy = xy[:, :1] - x, xy[:, 1:] - y
    across, along = np.abs(dx * nx + dy * ny), np.abs(dx * ny - dy * nx)
    return np.asarray(np.any((across < ON_PAINT * unit) & (along < SPACING * unit), axis=-1))


def _run_beside(offset: Array, basis: Array, on: int, unit: float) -> tuple[float, Array]:
    """Find paint beside a marking: its largest distance, 0 without any, and its offset in each profile, (n,) or NaN.

    RANSAC: lines or arcs through as many ridges as there are unknowns are compared by the number of profiles with a
    ridge on them. The ridges are drawn with a fixed seed.

    Parameters
    ----------
    offset : (n, k) array
        Ridges of the profiles of the marking, in their order along it; NaN for none.
    basis : (n, d) array
        The offsets of a displaced marking are combinations of these columns.
    on : int
        Number of profiles with a ridge where the marking is projected.
    """
    n, nothing = len(offset), np.full(len(offset), np.nan)
    place, peak = np.nonzero(np.isfinite(offset))
    if len(np.unique(place)) < max(LEAST_PLACES, SEEN * n, on + MORE):
        return 0.0, nothing
    some = np.random.default_rng(0).integers(len(place), size=(basis.shape[1], DRAWS))
    few = np.moveaxis(basis[place[some]], 0, 1)  # (draws, d, d)
    good = (np.ptp(place[some], axis=0) >= APART * n) & (np.abs(np.linalg.det(few)) > LEAST_DETERMINANT)
    if not np.any(good):
        return 0.0, nothing
    values = offset[place[some], peak[some]].T[good]
    predicted = np.linalg.solve(few[good], values[..., None])[..., 0] @ basis.T  # (draws, n)
    near = np.any(np.abs(offset - predicted[..., None]) < SAME_RUN * unit, axis=2)
    count = np.sum(near, axis=1)
    # of parallel markings that are seen equally well, take the nearer one
    best = int(np.argmax(count - NEARER * n * np.mean(np.abs(predicted), axis=1) / (BAND * unit)))
    least = on + (MORE if count[best] >= NEARLY_ALL * n else max(MORE, MORE_SHARE * n))
    if count[best] < max(SEEN * n, least):
        return 0.0, nothing
    distance = np.where(np.isfinite(offset), np.abs(offset - predicted[best][:, None]), np.inf)
    run = np.where(near[best], offset[np.arange(n), np.argmin(distance, axis=1)], np.nan)
    fitted, *_ = np.linalg.lstsq(basis[near[best]], run[near[best]], rcond=None)
    return float(np.max(np.abs(basis @ fitted))), run


def paint_past_ends(past: Ridges, markings: Markings) -> dict[str, float]:
    """How far the paint of lines goes on past an end of their projections, pixels, by label; 0 where it does not.

    `past` has what was found there (`Ridges.past_ends`). Lines whose ends are not in view are left out.
    """
    found = dict[str, float]()
    is_on, profiles = np.any(np.abs(past.offset) < ON_PAINT * past.unit, axis=1), past.profiles
    for k in np.unique(profiles.member):
        at = np.flatnonzero(profiles.member == k)  # from the end on
        share = np.cumsum(is_on[at]) / np.arange(1, len(at) + 1)
        count = int(np.max(np.flatnonzero(share >= PAINTED_PAST), initial=-1)) + 1
        length, label = float(np.sum(profiles.spacing[at[:count]])), markings.past_ends.labels[k]
        is_past = count >= LEAST_PAST and length >= SHORTEST_PAST * past.unit
        if len(at) >= LEAST_PAST:
            found[label] = max(found.get(label, 0.0), length * is_past)
    return found


def with_extents(
    seen: Sequence[MarkingInView], widths: Mapping[str, Array], past: Mapping[str, float] | None = None
) -> tuple[MarkingInView, ...]:
    """Add what was measured of the paint of markings in view, by label.

    These are the median of its widths (n,), unless it lies beside its marking, and, where most of it is seen, by how
    many pixels it goes on past an end.
    """
    found = []
    for one in seen:
        if one.label in widths and not one.is_beside:
            one = replace(one, width=float(np.median(widths[one.label])), widths=len(widths[one.label]))
        found.append(replace(one, past_end=(past or {}).get(one.label, 0.0)) if one.share >= SEEN else one)
    return tuple(found)


def widths_by_marking(image: Image, profiles: Profiles, markings: Markings) -> dict[str, Array]:
    """Measure the paint of each marking that is wide enough in the image: widths (n,) in units of the projected width.

    They are measured along the profiles of a camera (`profiles_along`).

    Fields whose lines may be borders of differently painted areas get none.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> from fieldcalib.draw.scene import render_field
    >>> camera = Camera.from_angles(0.3, 1.36, 0.0, 3200.0, (0.0, 66.0, -16.0), (1920, 1080))
    >>> markings = Markings.of(soccer())
    >>> found = widths_by_marking(render_field(camera, soccer()), profiles_along(camera, markings), markings)
    >>> {label: round(float(np.median(width)), 1) for label, width in found.items()}
    {'Middle line': 1.0, 'Circle right': 1.0, 'Circle central': 1.0}
    """
    if not np.isfinite(markings.look.ground_difference):
        return {}
    solid = markings.painted[profiles.member] >= LEAST_PAINTED
    profiles = profiles.take(np.flatnonzero(profiles.on_ground & solid & (profiles.width >= NARROWEST)))
    width = paint_widths(image, profiles)
    measured = np.isfinite(width)
    members = np.unique(profiles.member[measured]).tolist()
    return {markings.labels[k]: width[measured & (profiles.member == k)] for k in members}


def paint_widths(image: Image, profiles: Profiles) -> Array:
    """Measure the width (n,) of the paint in each profile, in units of the projected width; NaN if not sharp, or none.

    The width is that at half the height of the brightness profile above the ground on each side.
    """
    if not len(profiles):
        return np.zeros(0)
    half = round(REACH * STEPS)
    colour = colours_across(image, profiles, profiles.width / STEPS, half + 1)
    level = np.tensordot(-LUMA if profiles.look.lighter is False else LUMA, colour, axes=1)
    pixel = STEPS / profiles.width  # in samples
    near = np.abs(np.arange(-half, half + 1)) <= (NEAR * STEPS + NEAR_PX * pixel)[:, None]
    top = np.argmax(np.where(near, level, -np.inf), axis=1)
    peak = np.take_along_axis(level, top[:, None], axis=1)[:, 0]
    away = GROUND_FROM * STEPS + GROUND_FROM_PX * pixel
    sides = [_Side.of(level, top, away), _Side.of(level[:, ::-1], 2 * half - top, away)]
    contrast = peak - np.maximum(*(one.ground for one in sides))
    even = np.abs(np.subtract(*(one.ground for one in sides))) <= EVEN * contrast
    sharp = np.maximum(*(one.length for one in sides)) < SHARPEST * STEPS  # false for NaN
    width = sum(one.edge for one in sides) / STEPS
    return np.where((contrast >= LEAST_CONTRAST) & even & sharp, width, np.nan)


class _Side(NamedTuple):
    """One side of the paint in each profile."""

    ground: Array
    """Level of the ground, (n,)."""
    edge: Array
    """Samples from the top of the paint to half its height, (n,)."""
    length: Array
    """Length of the edge in samples, (n,): twice that between a quarter and three quarters of its height."""

    @classmethod
    def of(cls, level: Float32, top: IntArray, away: Array) -> _Side:
        """Measure the right side of profiles (n, m) from their `top` (n,); ground begins `away` (n,) samples off."""
        index = np.arange(level.shape[1])
        is_ground = index > (top + away)[:, None]
        levels, count = np.sort(np.where(is_ground, level, np.nan), axis=1), np.sum(is_ground, axis=1)
        middle = np.column_stack([(count - 1) // 2, count // 2])  # of those without NaN, which is sorted to the end
        ground = np.mean(np.take_along_axis(levels, middle, axis=1), axis=1)  # np.nanmedian takes ten times as long
        peak = np.take_along_axis(level, top[:, None], axis=1)[:, 0]
        upper, half, lower = (_fall(level, top, ground + share * (peak - ground)) for share in (0.75, 0.5, 0.25))
        return cls(ground, half, 2.0 * (lower - upper))


def _fall(level: Float32, top: IntArray, height: Array) -> Array:
    """Samples (n,) from the top of each row rightwards until its level falls to `height` (n,); NaN if it never does.

    They are interpolated to a fraction of a sample.
    """
    below = (level <= height[:, None]) & (np.arange(level.shape[1]) > top[:, None])  # false for NaN
    at = np.argmax(below, axis=1)
    low, high = (np.take_along_axis(level, one[:, None], axis=1)[:, 0] for one in (at, at - 1))
    found = np.any(below, axis=1) & (high > low)
    return np.where(found, at - top - (height - low) / np.where(found, high - low, 1.0), np.nan)
