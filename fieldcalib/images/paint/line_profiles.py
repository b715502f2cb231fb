"""Detection of painted lines near projected markings, in intensity profiles across the markings (`Markings`).

All profiles are sampled at once by cv2.remap, in steps of a third of the expected line width, so that one filter fits
lines at any distance. (skimage.measure.profile_line samples one profile per call.)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array, BoolArray, Float32, IntArray
from fieldcalib.fields.field import Field, ObjectSegments
from fieldcalib.fields.segments import outwards
from fieldcalib.fields.traits import SOCCER_SCALE, LineLook, Paint
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.image_files import Image, size_of
from fieldcalib.problem.labelled_pixels import PixelTable
from fieldcalib.solve.solver_options import pixel_unit

POINT_SPACING = 1.0 / 160.0  # distance of points along a marking, in units of the field's scale
HIGHEST_NET = 2.0  # m: that of volleyball is higher
UPRIGHT = 0.5  # vertical share of the direction of posts; edges of nets sag by less
# Chosen by eye on broadcast frames. Of 31 images of WC14, one camera is not accepted; with one constant halved or
# doubled, 1 to 4, except where a number is given below. IoU_part stays within 95.6 and 96.0 % (mean).
# Lengths are in pixels of a 960 x 540 image and grow with the image.
SPACING = 12.0  # px between profiles
LEAST_PROFILES, MOST_PROFILES = 4, 30  # of a segment: fewer cannot confirm a line, more cost time
SHORTEST = 12.0  # px: shorter projections of a segment get no profiles
MARGIN = 2.0  # px from the border of the image that profiles keep, since samples beyond it are extrapolated
ROWS, ROW_SPACING = 3, 2.0  # parallel rows, and px between them, that are averaged for a profile
NEIGHBOURS = 5  # successive profiles, the middle one is judged: most must show the line at the same offset
SAME_LINE = 2.0  # px: tolerance of that offset
PROFILES_PER_SEGMENT = 5.0  # number of profiles that carries the weight of one segment without a weight
BLUR = 1.5  # px of any image: width added to lines by lens, motion and compression
# samples, 4/3 of a line width, between the middles of the line and of the ground beside it; 2: 13 not accepted
FLANK = 4
# weights of blue, green, red (Rec. 601): video has less resolution in colour
LUMA = np.array([0.114, 0.587, 0.299], np.float32)
EDGE = np.float32(0.5)  # weight of the contrast on the edge of an area: less than that of a line along the edge
LEAST_SIGNAL = 2.5  # times the median absolute deviation of the contrast in a profile; 5: 8 not accepted
OTHER_COLOUR = 4.0  # times the median colour difference of ground: what differs more is not ground; 99 % of ground less
GLARE, COLOURED = 218.0, 0.7  # luma of ground too light for paint; its darkest channel, as a share of its lightest
SAME_GROUND = 0.2  # of a line's contrast: smaller colour differences between both sides come from lossy compression
PAST_END_FROM, PAST_END_STEP, PAST_END_STEPS = 0.6, 0.25, 31  # m: where paint past the end of a line is looked for
NOISE_WINDOW = 12.0  # px on both sides, at least, in which the median absolute deviation is measured; 6: 6 not accepted


@dataclass(frozen=True)
class Markings:
    """Points along the middle of the paint of an object's markings, segment by segment."""

    labels: tuple[str, ...]
    member: IntArray
    """Index into `labels` of each point, (N,)."""
    X: Array
    """Points on the field, metres, (N, 3)."""
    along: Array
    """Unit vectors along the segments, (N, 3)."""
    on_ground: BoolArray
    """Whether the whole segment is on the ground, (N,)."""
    width: Array
    """Width of the paint, metres, (N,)."""
    inwards: Array
    """Vectors from the middle of the paint to the segment, which may be the edge of the paint, metres, (N, 3)."""
    is_arc: BoolArray
    """Whether each segment is an arc, (len(labels),)."""
    painted: Array
    """Share of each segment that is painted, less than 1 for dashes, (len(labels),)."""
    is_optional: BoolArray
    """Whether some fields of the kind lack each segment, (len(labels),)."""
    look: LineLook
    """Appearance of the lines."""

    @cached_property
    def net(self) -> tuple[str, ...]:
        """Labels of the edges of a low net across the middle of the field, which may be taken for lines on the ground.

        Examples
        --------
        >>> from fieldcalib.fields import tennis, volleyball
        >>> sorted(Markings.of(tennis()).net), Markings.of(volleyball()).net
        (['Net bottom', 'Net top'], ())
        """
        across = ~self.on_ground & (self.X[:, 0] == 0.0) & (np.abs(self.along[:, 2]) < UPRIGHT)
        is_low = np.min(self.X[across, 2], initial=0.0) > -HIGHEST_NET
        return tuple(self.labels[k] for k in np.unique(self.member[across])) if is_low else ()

    @cached_property
    def past_ends(self) -> Markings:
        """Continuations of the lines on the ground past both of their ends, where no other marking is.

        None on courts, where lines of other sports go on: fields whose lines may be borders of differently painted
        areas.

        Examples
        --------
        >>> from fieldcalib import soccer
        >>> past = Markings.of(soccer()).past_ends
        >>> np.max(np.abs(past.X[past.member == past.labels.index("Middle line")]), axis=0).round(1)
        array([ 0. , 42.1,  0. ])
        """
        from scipy.spatial import KDTree  # a slow import

        steps, count = PAST_END_FROM + PAST_END_STEP * np.arange(PAST_END_STEPS), len(self.labels)
        is_line = self.on_ground & ~self.is_arc[self.member] & (self.painted[self.member] == 1.0)
        first, last = np.diff(self.member, prepend=-1) != 0, np.diff(self.member, append=count) != 0
        ends = [np.flatnonzero(is_line & is_end & np.isfinite(self.look.ground_difference)) for is_end in (first, last)]
        at = np.repeat(np.concatenate(ends), len(steps))
        is_last = np.repeat([False, True], [len(some) * len(steps) for some in ends])
        along = np.where(is_last, 1.0, -1.0)[:, None] * self.along[at]
        X = self.X[at] + np.resize(steps, len(at))[:, None] * along
        free = KDTree(self.X).query(X)[0] > PAST_END_FROM - PAST_END_STEP
        at, member, X, along = at[free], (self.member[at] + count * is_last)[free], X[free], along[free]
        on_ground, width, inwards = self.on_ground[at], self.width[at], np.zeros_like(X)
        is_arc, painted, optional = np.tile(self.is_arc, 2), np.tile(self.painted, 2), np.tile(self.is_optional, 2)
        found = 2 * self.labels, member, X, along, on_ground, width, inwards, is_arc, painted, optional
        return Markings(*found, self.look)

    @classmethod
    def of(cls, object_segments: ObjectSegments) -> Markings:
        """Sample the markings painted along the segments of an object; a circle that has halves is taken once, whole.

        An object that is no `Field` gets the default `LineLook`. The markings of the last 16 fields are cached.
        """
        return _of_field(object_segments) if isinstance(object_segments, Field) else cls._along(object_segments)

    @classmethod
    def _along(cls, object_segments: ObjectSegments) -> Markings:
        look, scale = LineLook(), SOCCER_SCALE
        paint_of: Callable[[str], Paint] = dict.fromkeys(object_segments, Paint(width=look.width)).__getitem__
        if isinstance(object_segments, Field):
            look, scale = object_segments.lines, object_segments.scale
            paint_of = object_segments.paint_of
        whole = {segment.whole for segment in object_segments.values() if segment.is_whole}
        paint = {label: paint_of(label) for label in object_segments}
        markings = {
            label: segment
            for label, segment in object_segments.items()
            if segment.is_curve and (segment.is_whole or segment.whole not in whole) and paint[label].is_along
        }
        # a segment may be the edge of its paint: lines are looked for in the middle of the paint, `inwards` leads back
        points = [segment.sample(POINT_SPACING * scale) for segment in markings.values()]
        counts = [len(X) for X in points]
        member, X = np.repeat(np.arange(len(points)), counts), np.concatenate([np.zeros((0, 3)), *points])
        if isinstance(object_segments, Field):
            X = object_segments.terrain.raised(X)
        along, inwards = _along(member, X), np.zeros_like(X)
        for index, (label, segment) in enumerate(markings.items()):
            if paint[label].outwards:
                own = member == index
                inwards[own] = -paint[label].outwards * outwards(segment, X[own], along[own])
        return cls(
            tuple(markings),
            member,
            X - inwards,
            along,
            np.repeat(np.array([not np.any(X[:, 2]) for X in points], dtype=bool), counts),
            np.repeat(np.array([paint[label].width for label in markings], dtype=float), counts),
            inwards,
            np.array([segment.is_arc for segment in markings.values()], dtype=bool),
            np.array([paint[label].painted for label in markings], dtype=float),
            np.array([paint[label].is_optional for label in markings], dtype=bool),
            look,
        )


@lru_cache(maxsize=16)
def _of_field(field: Field) -> Markings:
    markings = Markings._along(field)
    for values in vars(markings).values():
        if isinstance(values, np.ndarray):
            values.flags.writeable = False
    return markings


def _along(member: IntArray, X: Array) -> Array:
    """Unit vectors (N, 3) along curves at their points X (N, 3), from one neighbour on the same curve to the other."""
    index = np.arange(len(X))
    before, after = np.maximum(index - 1, 0), np.minimum(index + 1, len(X) - 1)
    before, after = (np.where(member[at] == member, at, index) for at in (before, after))
    d = X[after] - X[before]
    return np.asarray(d / np.linalg.norm(d, axis=1, keepdims=True))


@dataclass(frozen=True)
class Profiles:
    """Places on projected markings across which an image is sampled, segment by segment."""

    member: IntArray
    """Index of the marking that each profile crosses, (n,)."""
    xy: Array
    """Pixels where the profiles cross the projected markings, (n, 2)."""
    normal: Array
    """Unit vectors across the marking, (n, 2)."""
    width: Array
    """Expected width of the line, px, (n,)."""
    room: Array
    """Half the distance to the next marking, px, (n,)."""
    on_ground: BoolArray
    """Whether the marking is on the ground, (n,)."""
    inwards: Array
    """Vectors from the middle of the paint to the segment, pixels, (n, 2)."""
    spacing: Array
    """Length of the projected marking for each profile, px, (n,)."""
    look: LineLook
    """Appearance of the lines."""

    def __len__(self) -> int:
        return len(self.xy)

    def take(self, index: IntArray) -> Profiles:
        """Select profiles by index (k,), in that order."""
        return replace(self, **{one.name: getattr(self, one.name)[index] for one in fields(self) if one.name != "look"})


def profiles_along(camera: Camera, markings: Markings) -> Profiles:
    """Place profiles across the markings in view, evenly spaced along each."""
    unit = pixel_unit(camera.image_size)
    xy = camera.project(markings.X)
    x, y = xy.T
    low, (right, bottom) = MARGIN * unit, np.subtract(camera.image_size, 1.0) - MARGIN * unit
    inside = (x >= low) & (y >= low) & (x <= right) & (y <= bottom)  # false for NaN
    joined = inside[1:] & inside[:-1] & (markings.member[1:] == markings.member[:-1])
    step = np.zeros(len(xy))
    step[1:][joined] = np.hypot(np.diff(x)[joined], np.diff(y)[joined])

    # one profile in each of `count` equal cells of a marking's visible length, at the first point past its middle
    length = np.bincount(markings.member, step, len(markings.labels))
    many = np.clip(np.floor(length / (SPACING * unit)), LEAST_PROFILES, MOST_PROFILES)
    count = np.where(length > SHORTEST * unit, many, 0.0)
    before = np.cumsum(length) - length
    share = (np.cumsum(step) - before[markings.member]) / np.maximum(length, 1.0)[markings.member]
    cell = np.floor(share * count[markings.member] + 0.5)
    place = np.flatnonzero(joined & (np.diff(cell) > 0.0)) + 1

    # paint has its width across the line on the ground; a post or bar shows its width across the line of sight
    X, along, on_ground = markings.X[place], markings.along[place], markings.on_ground[place]
    across = np.where(on_ground[:, None], _cross(along, (0.0, 0.0, 1.0)), _cross(along, X - camera.C))
    with np.errstate(divide="ignore", invalid="ignore"):  # where a line points at the camera
        across *= 0.5 * markings.width[place, None] / np.linalg.norm(across, axis=1, keepdims=True)
        one_end, other_end, one_side, other_side = camera.project(X + [0.1 * along, -0.1 * along, across, -across])
        towards = one_end - other_end
        normal = np.column_stack([-towards[:, 1], towards[:, 0]]) / np.linalg.norm(towards, axis=1, keepdims=True)
    width = np.abs(np.sum((one_side - other_side) * normal, axis=1))
    good = np.isfinite(width) & np.all(np.isfinite(normal), axis=1)
    place, normal, width, on_ground = place[good], normal[good], width[good], on_ground[good]
    member, xy = markings.member[place], xy[place]
    inwards = np.zeros_like(xy)
    if np.any(markings.inwards):
        inwards = camera.project(markings.X[place] + markings.inwards[place]) - xy
    spacing = (length / np.maximum(count, 1.0))[member]
    return Profiles(member, xy, normal, width, _room(member, xy), on_ground, inwards, spacing, markings.look)


def _cross(a: Array, b: ArrayLike) -> Array:
    """Cross products (n, 3); np.cross takes five times as long."""
    (ax, ay, az), (bx, by, bz) = a.T, np.asarray(b).T
    return np.column_stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def _room(member: IntArray, xy: Array) -> Array:
    """Half the distance (n,) of each point to the nearest point of another marking; infinite if there is none."""
    x, y = xy.T.astype(np.float32)  # to 1e-4 px, in a third of the time
    squared, dy = x[:, None] - x, y[:, None] - y
    squared *= squared
    dy *= dy
    squared += dy
    np.copyto(squared, np.inf, where=member[:, None] == member)
    return np.asarray(0.5 * np.sqrt(np.min(squared, axis=1, initial=np.inf)), dtype=float)


def pixels_of_lines(markings: Markings, profiles: Profiles, offset: Array) -> PixelTable:
    """Convert lines, given as `offset` (n,) from the markings in each profile (NaN for none), to labelled pixels."""
    found = np.flatnonzero(np.isfinite(offset))
    xy = profiles.xy[found] + offset[found, None] * profiles.normal[found] + profiles.inwards[found]
    weight = np.full(len(found), 1.0 / PROFILES_PER_SEGMENT)
    return PixelTable(markings.labels, 1, np.zeros(len(found), np.intp), profiles.member[found], xy, weight)


def find_lines(image: Image, profiles: Profiles, search_range: float) -> Array:
    """Find the line in each profile: signed distances from the marking along the normal, pixels (n,), NaN for none.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        Blue, green, red.
    profiles : Profiles
    search_range : float
        Largest distance of the line, in pixels of a 960 x 540 image; less where another marking is near.

    Notes
    -----
    A line is lighter (darker, if the field's `LineLook` says so) than the ground on both sides. The ground must have
    the same colour on both sides, about that beside most other markings, which excludes white letters on a board. The
    line is located at the largest contrast, which must exceed a threshold and the noise of the profile, and most
    neighbouring profiles of the segment must show it at the same offset.
    """
    return Strips.of(image, profiles, search_range).lines(search_range)


@dataclass(frozen=True, eq=False)
class Strips:
    """Samples of an image along all profiles; taken once, they serve every shorter search range (`part`)."""

    profiles: Profiles
    unit: float
    """Pixels of the image per pixel of a 960 x 540 image."""
    width: Array
    """Expected width of the line in the image, px, (n,)."""
    offset: Array
    """Distance of each sample from the marking, px, (n, m)."""
    contrast: Float32
    """Excess lightness of each sample over the lighter of its two sides, (n, m); if lines are dark, darkness. If they
    may be either, that of the two, or on an edge a share of the smaller difference from both sides."""
    may_be_line: BoolArray
    """Whether both sides of each sample have the colour of ground, or the marking is above the ground, (n, m)."""
    is_blind: BoolArray
    """Whether paint cannot be seen there, (n,): in a black border, and on grass in glaring sun, as light as paint."""

    @classmethod
    def of(cls, image: Image, profiles: Profiles, search_range: float, *, past_others: bool = False) -> Strips:
        """Sample strips that are long enough for a search range, in pixels of a 960 x 540 image.

        They end halfway to the next marking, unless `past_others`.
        """
        unit = pixel_unit(size_of(image))
        width = np.hypot(profiles.width, BLUR)
        spacing = width / 3.0
        half = _half(profiles, spacing, unit, search_range, past_others)
        colour = colours_across(image, profiles, spacing, half + FLANK + 2)
        look = profiles.look
        luma = np.tensordot(-LUMA if look.lighter is False else LUMA, colour, axes=1)
        sides = luma[:, : -2 * FLANK], luma[:, 2 * FLANK :]
        contrast = luma[:, FLANK:-FLANK] - np.maximum(*sides)
        if look.lighter is not True:
            stripe = np.maximum(contrast, np.minimum(*sides) - luma[:, FLANK:-FLANK])  # less than 0 on an edge
            # where lines are darker than the ground, nets and posts may still be lighter than what is behind them
            above = np.where(profiles.on_ground[:, None], contrast, stripe)
            contrast = above if look.lighter is False else np.maximum(stripe, -EDGE * stripe)
        column, row = np.round(profiles.xy).astype(int).T
        return cls(
            profiles,
            unit,
            width,
            np.arange(-half - 1, half + 2) * spacing[:, None],
            contrast,
            _is_ground(colour, contrast, profiles.on_ground, look.ground_difference) | ~profiles.on_ground[:, None],
            ~np.any(image[row, column], axis=-1) | (_is_glaring(colour) & (look.lighter is True)),
        )

    @property
    def spacing(self) -> Array:
        """Distance between samples, px, (n,)."""
        return self.width / 3.0

    @cached_property
    def deviation(self) -> Float32:
        """Median absolute deviation of the contrast, (n,)."""
        return _median(np.abs(self.contrast - _median(self.contrast)[:, None]))

    @property
    def least(self) -> Array:
        """Least contrast of a line, (n,)."""
        on_ground, look = self.profiles.on_ground, self.profiles.look
        least = np.where(on_ground, look.contrast, look.contrast_raised)
        return np.asarray(np.maximum(least, LEAST_SIGNAL * self.deviation))

    def part(self, index: IntArray, search_range: float, *, past_others: bool = False) -> Strips:
        """Select the strips of the profiles `index` (k,), shortened to a `search_range` at most as long as sampled."""
        profiles = self.profiles.take(index)
        half = _half(profiles, self.spacing[index], self.unit, search_range, past_others)
        middle = self.contrast.shape[1] // 2
        samples = index[:, None], np.arange(middle - half - 1, middle + half + 2)
        return replace(
            self,
            profiles=profiles,
            width=self.width[index],
            offset=self.offset[samples],
            contrast=self.contrast[samples],
            may_be_line=self.may_be_line[samples],
            is_blind=self.is_blind[index],
        )

    def lines(self, search_range: float) -> Array:
        """Signed distances (n,) of the lines from the markings; see `find_lines`."""
        profiles = self.profiles
        if not len(profiles):
            return np.zeros(0)
        gate = np.where(profiles.room > self.width, np.minimum(search_range * self.unit, profiles.room), -np.inf)
        found = self._highest(slice(None), (np.abs(self.offset) <= gate[:, None]) & self.may_be_line, self.least)
        return np.where(_consistent(found, profiles.member, SAME_LINE * self.unit), found, np.nan)

    def peaks_near(self, index: IntArray, line: Array, reach: float, least: Array) -> Array:
        """Locate the largest contrast near a known line in the profiles `index`: signed distances (k,), NaN for none.

        It is searched for up to `reach` pixels from the `line` (k,), and must exceed a contrast `least` (k,).
        """
        return self._highest(index, np.abs(self.offset[index] - line[:, None]) <= reach, least)

    def _highest(self, index: IntArray | slice, allowed: BoolArray, least: Array) -> Array:
        """Locate the largest contrast among the `allowed` samples (k, m) of some profiles, to a fraction of a sample.

        Returns its signed distances (k,) from the markings; NaN where it is not a peak, or not above `least` (k,).
        """
        contrast, offset, row = self.contrast[index], self.offset[index], np.arange(len(allowed))
        best = np.argmax(np.where(allowed, contrast, -np.inf)[:, 1:-1], axis=1) + 1
        before, peak, after = contrast[row, best - 1], contrast[row, best], contrast[row, best + 1]
        seen = allowed[row, best] & (peak >= np.maximum(before, after)) & (peak > least)
        return np.where(seen, offset[row, best] + _vertex(before, peak, after) * self.spacing[index], np.nan)

    def ridges(self, search_range: float, count: int) -> tuple[Array, BoolArray]:
        """Signed distances (n, count) of the strongest ridges from the marking, NaN for none; and which may be lines.

        A ridge may be a line if the ground beside it allows it; neighbouring profiles and markings are not considered.
        """
        contrast = self.contrast
        middle, before, after = contrast[:, 1:-1], contrast[:, :-2], contrast[:, 2:]
        top = (middle >= before) & (middle > after) & (middle > self.least[:, None])
        top &= np.abs(self.offset[:, 1:-1]) <= search_range * self.unit
        last = min(count, middle.shape[1] - 1)  # few samples: the lines are as wide as the strips
        best = np.argpartition(-np.where(top, middle, -np.inf), last, axis=1)[:, :count]
        row = np.arange(len(best))[:, None]
        vertex = _vertex(before[row, best], middle[row, best], after[row, best])
        offset = np.where(top[row, best], self.offset[row, best + 1] + vertex * self.spacing[:, None], np.nan)
        return offset, self.may_be_line[row, best + 1]


def _vertex(before: Float32, peak: Float32, after: Float32) -> Float32:
    """Vertex of the parabola through three samples, in samples from the middle one; NaN if it has no maximum."""
    curvature = 2.0 * peak - before - after
    return np.asarray(0.5 * (after - before) / np.where(curvature > 0.0, curvature, np.nan))


def _half(profiles: Profiles, spacing: Array, unit: float, search_range: float, past_others: bool) -> int:
    """Number of samples from the middle of the longest strip to its end."""
    room = np.inf if past_others else profiles.room
    reach = np.maximum(np.minimum(search_range * unit, room), NOISE_WINDOW * unit)
    return int(np.max(reach / spacing, initial=0.0))


def colours_across(image: Image, profiles: Profiles, spacing: Array, half: int) -> Float32:
    """Sample blue, green, red (3, n, 2 `half` - 1) across markings, averaged over `ROWS` rows and three samples each.

    The samples of a profile are `spacing` (n,) pixels apart, and the middle one lies on the marking.
    """
    import cv2

    n, m = len(profiles), 2 * half + 1
    if not n:
        return np.zeros((3, 0, m - 2), np.float32)
    along = ROW_SPACING * pixel_unit(size_of(image)) * (np.arange(ROWS) - (ROWS - 1) / 2.0)
    offset = np.arange(-half, half + 1) * spacing[:, None]
    (x, y), (nx, ny) = profiles.xy.T[..., None], profiles.normal.T[..., None]
    map_x, map_y = (
        (middle.astype(np.float32)[..., None] + step.astype(np.float32)[:, None]).reshape(-1, m)
        for middle, step in ((x + along * ny, offset * nx), (y - along * nx, offset * ny))
    )
    samples = cv2.remap(image, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).reshape(n, ROWS, -1)
    rows = np.sum(samples, axis=1, dtype=np.uint16).reshape(n, m, 3)
    channels = cv2.split(rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:])
    return np.array(channels, np.float32) * np.float32(1.0 / (3 * ROWS))


def _is_ground(colour: Float32, contrast: Float32, on_ground: BoolArray, largest: float) -> BoolArray:
    """Whether both sides of each sample have about the same colour, namely that beside most other markings.

    Chromaticities are compared: the share of each channel in the sum of the three. Where colours are saturated and
    compressed, chromaticities of the same ground differ by much; sides also count as equal if their channels differ by
    less than `SAME_GROUND` of the contrast of the line between them.

    Parameters
    ----------
    colour : (3, n, m) array
        Blue, green, red.
    contrast : (n, m - 2 * FLANK) array
        By how much each sample is lighter than both sides.
    on_ground : (n,) array
        Which profiles cross a marking on the ground.
    largest : float
        Largest difference of chromaticity between both sides of a line.

    Returns
    -------
    (n, m - 2 * FLANK) array
    """
    share = colour + np.float32(1.0)  # the share of black is not defined
    share /= np.sum(share, axis=0)
    one_side, other_side = share[..., : -2 * FLANK], share[..., 2 * FLANK :]
    alike = np.max(np.abs(one_side - other_side), axis=0) < largest
    difference = np.max(np.abs(colour[..., : -2 * FLANK] - colour[..., 2 * FLANK :]), axis=0)
    alike |= difference < SAME_GROUND * contrast
    if not np.any(on_ground):
        return np.asarray(alike)
    centre = alike.shape[1] // 2
    beside = np.concatenate([side[:, on_ground, centre] for side in (one_side, other_side)], axis=1)
    usual = _median(beside)[:, None]
    spread = float(_median(np.max(np.abs(beside - usual), axis=0)))
    difference = np.max(np.abs(share - usual[..., None]), axis=0)
    usual_colour = difference < max(OTHER_COLOUR * spread, 2.0 * largest)
    return np.asarray(alike & usual_colour[:, : -2 * FLANK] & usual_colour[:, 2 * FLANK :])


def _is_glaring(colour: Float32) -> BoolArray:
    """Whether the ground on a side of the middle of each profile is coloured, but nearly as light as white, (n,).

    `colour` (3, n, m) is blue, green, red.
    """
    sides = colour[..., [colour.shape[-1] // 2 + flank for flank in (-FLANK, FLANK)]]
    is_coloured = np.min(sides, axis=0) < COLOURED * np.max(sides, axis=0)
    return np.asarray(np.any(is_coloured & (np.tensordot(LUMA, sides, axes=1) > GLARE), axis=1))


def _median(values: Float32) -> Float32:
    """Median over the last axis; np.median spends more time on checks than on computing."""
    count = values.shape[-1]
    parted = np.partition(values, count // 2, axis=-1)
    upper = parted[..., count // 2]
    return np.asarray(upper if count % 2 else 0.5 * (np.max(parted[..., : count // 2], axis=-1) + upper))


def _consistent(found: Array, member: IntArray, tolerance: float) -> BoolArray:
    """Whether the offset in each profile (n,) is within `tolerance` of most of its neighbours' on the segment."""
    alike = np.isfinite(found).astype(int)  # each is like itself
    for step in range(1, NEIGHBOURS // 2 + 1):
        same = (member[step:] == member[:-step]) & (np.abs(found[step:] - found[:-step]) < tolerance)
        alike[step:] += same
        alike[:-step] += same
    return np.asarray(alike > NEIGHBOURS // 2)
