"""Detection of painted lines near projected markings, in intensity profiles across the markings.

All profiles are sampled at once by cv2.remap, in steps of a third of the expected line width, so that one filter fits
lines at any distance. (skimage.measure.profile_line samples one profile per call.)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from fieldcalib._types import Array, BoolArray, Float32, IntArray
from fieldcalib.calibrate.options import pixel_unit
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Arc, ObjectSegments, Point, PointCloud, Segment
from fieldcalib.fields.stands import SOCCER_SCALE
from fieldcalib.fields.traits import LineLook
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.image import Image
from fieldcalib.problem.labelled_pixels import Pixels

POINT_SPACING = 1.0 / 160.0  # of the field's scale, along a marking: between points where a profile may be placed

# Chosen by eye on broadcast frames. Of 31 images of WC14, one camera is not accepted; with one constant halved or
# doubled, 1 to 4, except where a number is given below. IoU_part stays within 95.6 and 96.0 % (mean).
# Lengths are in pixels of a 960 x 540 image and grow with the image.
SPACING = 12.0  # px between profiles
LEAST_PROFILES, MOST_PROFILES = 4, 30  # of a segment: fewer cannot confirm a line, more cost time
SHORTEST = 12.0  # px: shorter projections of a segment get no profiles
MARGIN = 2.0  # px from the border of the image, where samples are extrapolated
ROWS, ROW_SPACING = 3, 2.0  # parallel rows, and px between them, that are averaged for a profile
NEIGHBOURS = 5  # profiles, itself included, most of which must show the line at the same offset,
SAME_LINE = 2.0  # px, to this tolerance

BLUR = 1.5  # px of any image: width added to lines by lens, motion and compression
FLANK = (
    4  # samples, 4/3 of a line width, between the middles of the line and of the ground beside it; 2: 13 not accepted
)
LUMA = np.array(
    [0.114, 0.587, 0.299], np.float32
)  # of blue, green, red (Rec. 601): video has less resolution in colour
LEAST_SIGNAL = 2.5  # times the median absolute deviation of the contrast in a profile; 5: 8 not accepted
OTHER_COLOUR = 4.0  # times the median difference in colour from the ground is another thing: 0.99 of markings are below
NOISE_WINDOW = 12.0  # px on both sides, at least, in which that deviation is measured; 6: 6 not accepted


@dataclass(frozen=True)
class Markings:
    """Points along the markings of an object, segment by segment."""

    labels: tuple[str, ...]
    member: IntArray
    """Index into `labels` of each point, (N,)."""
    X: Array
    """(N, 3)."""
    along: Array
    """Unit vectors along the segments, (N, 3)."""
    on_ground: BoolArray
    """Whether the whole segment is on the ground, (N,)."""
    look: LineLook
    """Appearance of their lines."""

    @classmethod
    def of(cls, object_segments: ObjectSegments) -> Markings:
        """The markings of an object: all segments but points, and of a circle and its halves only the circle.

        An object that is no `Field` gets the default `LineLook`.
        """
        look, scale = LineLook(), SOCCER_SCALE
        if isinstance(object_segments, Field):
            look, scale = object_segments.lines, object_segments.scale
        whole = {_circle(segment) for segment in object_segments.values() if _is_whole(segment)}
        markings = {
            label: segment
            for label, segment in object_segments.items()
            if _is_curve(segment) and (_is_whole(segment) or _circle(segment) not in whole)
        }
        points = [segment.sample(POINT_SPACING * scale) for segment in markings.values()]
        along = [np.gradient(X, axis=0) for X in points]
        counts = [len(X) for X in points]
        return cls(
            tuple(markings),
            np.repeat(np.arange(len(points)), counts),
            np.concatenate([np.zeros((0, 3)), *points]),
            np.concatenate([np.zeros((0, 3)), *(d / np.linalg.norm(d, axis=1, keepdims=True) for d in along)]),
            np.repeat([not np.any(X[:, 2]) for X in points], counts),
            look,
        )


def _is_curve(segment: Segment) -> bool:
    return not isinstance(segment, Point) and (not isinstance(segment, PointCloud) or segment.ordered)


def _circle(segment: Segment) -> tuple[object, ...] | None:
    return (segment.center, segment.radius, segment.u, segment.v) if isinstance(segment, Arc) else None


def _is_whole(segment: Segment) -> bool:
    return isinstance(segment, Arc) and abs(segment.stop - segment.start) >= 2.0 * np.pi


@dataclass(frozen=True)
class Profiles:
    """Places on projected markings across which an image is sampled, segment by segment."""

    member: IntArray
    """Index of the marking of each, (n,)."""
    xy: Array
    """Pixels, (n, 2)."""
    normal: Array
    """Unit vectors across the marking, (n, 2)."""
    width: Array
    """Expected width of the line, px, (n,)."""
    room: Array
    """Half the distance to the next marking, px, (n,)."""
    on_ground: BoolArray
    """(n,)."""
    look: LineLook
    """Appearance of the lines."""

    def __len__(self) -> int:
        return len(self.xy)


def profiles_along(camera: Camera, markings: Markings) -> Profiles:
    """Profiles across the markings in view, evenly spaced on each."""
    unit = pixel_unit(camera.image_size)
    xy = camera.project(markings.X)
    low = MARGIN * unit
    inside = np.all((xy >= low) & (xy <= np.subtract(camera.image_size, 1.0) - low), axis=1)  # false for NaN
    joined = inside[1:] & inside[:-1] & (markings.member[1:] == markings.member[:-1])
    step = np.zeros(len(xy))
    step[1:][joined] = np.linalg.norm(xy[1:][joined] - xy[:-1][joined], axis=1)

    length = np.bincount(markings.member, step, len(markings.labels))
    many = np.clip(np.floor(length / (SPACING * unit)), LEAST_PROFILES, MOST_PROFILES)
    count = np.where(length > SHORTEST * unit, many, 0.0)
    before = np.cumsum(length) - length
    share = (np.cumsum(step) - before[markings.member]) / np.maximum(length, 1.0)[markings.member]
    cell = np.floor(share * count[markings.member] + 0.5)
    place = np.flatnonzero(joined & (np.diff(cell) > 0.0)) + 1

    X, along, on_ground = markings.X[place], markings.along[place], markings.on_ground[place]
    towards = camera.project(X + 0.1 * along) - camera.project(X - 0.1 * along)
    across = np.where(on_ground[:, None], np.cross(along, (0.0, 0.0, 1.0)), np.cross(along, X - camera.C))
    with np.errstate(divide="ignore", invalid="ignore"):  # where a line points at the camera
        normal = np.column_stack([-towards[:, 1], towards[:, 0]]) / np.linalg.norm(towards, axis=1, keepdims=True)
        across *= 0.5 * markings.look.width / np.linalg.norm(across, axis=1, keepdims=True)
    width = np.abs(np.sum((camera.project(X + across) - camera.project(X - across)) * normal, axis=1))
    good = np.isfinite(width) & np.all(np.isfinite(normal), axis=1)
    place, normal, width, on_ground = place[good], normal[good], width[good], on_ground[good]
    member, xy = markings.member[place], xy[place]
    distance = np.hypot(xy[:, None, 0] - xy[:, 0], xy[:, None, 1] - xy[:, 1])
    distance[member[:, None] == member] = np.inf
    return Profiles(member, xy, normal, width, 0.5 * np.min(distance, axis=1, initial=np.inf), on_ground, markings.look)


def lines_near(image: Image, camera: Camera, markings: Markings, search_range: float) -> tuple[Pixels, int]:
    """Pixels (N, 2) of the line near each projected marking for which one is found, and the number of profiles.

    The range is that of `find_lines`.
    """
    profiles = profiles_along(camera, markings)
    offset = find_lines(image, profiles, search_range)
    found = np.isfinite(offset)
    xy, member = profiles.xy[found] + offset[found, None] * profiles.normal[found], profiles.member[found]
    return {markings.labels[k]: xy[member == k] for k in np.unique(member)}, len(profiles)


def find_lines(image: Image, profiles: Profiles, search_range: float) -> Array:
    """Signed distance of the line from the marking along the normal of each profile: (n,) pixels, NaN without a line.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        Blue, green, red.
    profiles : Profiles
    search_range : float
        Largest distance of the line, in pixels of a 960 x 540 image; less where another marking is near.

    Notes
    -----
    A line is lighter (darker, if the field's `LineLook` says so) than the ground on both sides, and the ground has the
    same colour on both sides, which is about that beside most other markings: white letters on a board are no line. It
    is located at the largest contrast, which must exceed a threshold and the noise of the
    profile, and most neighbouring profiles of the segment must show it at the same offset.
    """
    if not len(profiles):
        return np.zeros(0)
    unit = pixel_unit((image.shape[1], image.shape[0]))
    width = np.hypot(profiles.width, BLUR)
    gate = np.minimum(search_range * unit, profiles.room)
    spacing = width / 3.0
    half = np.max(np.maximum(gate, NOISE_WINDOW * unit) / spacing)
    strips, offset = _strips(image, profiles, spacing, int(half) + FLANK + 2)

    colour = (strips[:, :-2] + strips[:, 1:-1] + strips[:, 2:]) / np.float32(3.0)
    one_side, line, other_side = colour[:, : -2 * FLANK], colour[:, FLANK:-FLANK], colour[:, 2 * FLANK :]
    look = profiles.look
    luma = LUMA if look.lighter else -LUMA
    contrast = line @ luma - np.maximum(one_side @ luma, other_side @ luma)
    offset = offset[:, FLANK + 1 : -FLANK - 1]
    allowed = np.abs(offset) <= gate[:, None]
    near = np.any(allowed, axis=0)  # columns in the middle: elsewhere colours do not matter
    sides = np.array([_chromaticity(one_side[:, near]), _chromaticity(other_side[:, near])])
    alike = np.max(np.abs(sides[0] - sides[1]), axis=-1) < look.ground_difference
    is_ground = alike & _like_most(sides, profiles.on_ground, 2.0 * look.ground_difference)
    allowed[:, near] &= is_ground | ~profiles.on_ground[:, None]

    row = np.arange(len(profiles))
    best = np.argmax(np.where(allowed, contrast, -np.inf)[:, 1:-1], axis=1) + 1
    before, peak, after = contrast[row, best - 1], contrast[row, best], contrast[row, best + 1]
    curvature = 2.0 * peak - before - after
    deviation = np.median(np.abs(contrast - np.median(contrast, axis=1, keepdims=True)), axis=1)
    least = np.where(profiles.on_ground, look.contrast, look.contrast_raised)
    seen = allowed[row, best] & (peak >= np.maximum(before, after)) & (curvature > 0.0)
    seen &= (peak > np.maximum(least, LEAST_SIGNAL * deviation)) & (profiles.room > width)
    vertex = 0.5 * (after - before) / np.where(curvature > 0.0, curvature, 1.0)
    found = np.where(seen, offset[row, best] + vertex * spacing, np.nan)
    return np.where(_consistent(found, profiles.member, SAME_LINE * unit), found, np.nan)


def _like_most(sides: Float32, on_ground: BoolArray, least: float) -> BoolArray:
    """Which samples (n, m) have on both sides (2, n, m, 3) about the colour that most markings on the ground have."""
    if not np.any(on_ground):
        return np.ones(sides.shape[1:3], dtype=bool)
    middle = sides[:, on_ground, sides.shape[2] // 2].reshape(-1, 3)
    usual = np.median(middle, axis=0)
    spread = np.median(np.max(np.abs(middle - usual), axis=1))
    difference = np.max(np.abs(sides - usual.astype(np.float32)), axis=(0, 3))
    return np.asarray(difference < max(OTHER_COLOUR * spread, least))


def _strips(image: Image, profiles: Profiles, spacing: Array, half: int) -> tuple[Float32, Array]:
    """Colours (n, m, 3) along the profiles, and the distance (n, m) from the marking of each sample."""
    import cv2

    offset = np.arange(-half, half + 1) * spacing[:, None]
    tangent = np.column_stack([profiles.normal[:, 1], -profiles.normal[:, 0]])
    along = ROW_SPACING * pixel_unit((image.shape[1], image.shape[0])) * (np.arange(ROWS) - (ROWS - 1) / 2.0)
    middle = profiles.xy[:, None] + along[:, None] * tangent[:, None]
    xy = middle[:, :, None] + (offset[:, :, None] * profiles.normal[:, None])[:, None]
    places = xy.reshape(-1, offset.shape[1], 2).astype(np.float32)
    how, border = cv2.INTER_LINEAR, cv2.BORDER_REPLICATE
    samples = cv2.remap(image, places[..., 0], places[..., 1], how, borderMode=border)
    return samples.reshape(len(profiles), ROWS, -1, 3).mean(axis=1, dtype=np.float32), offset


def _chromaticity(colour: Float32) -> Float32:
    """Share of each channel in the sum of the three, for colours (..., 3)."""
    colour = colour + np.float32(1.0)  # the chromaticity of black is not defined
    return np.asarray(colour / np.sum(colour, axis=-1, keepdims=True))


def _consistent(found: Array, member: IntArray, tolerance: float) -> BoolArray:
    """Which profiles (n,) have an offset within `tolerance` of those of most of their neighbours on the segment."""
    half = NEIGHBOURS // 2
    near = sliding_window_view(np.pad(found, half, constant_values=np.nan), NEIGHBOURS)
    same = sliding_window_view(np.pad(member, half, constant_values=-1), NEIGHBOURS) == member[:, None]
    return np.asarray(np.sum(same & (np.abs(near - found[:, None]) < tolerance), axis=1) > half)
