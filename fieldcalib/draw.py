"""Pictures: markings and labelled pixels drawn onto an image, the field from above, a synthetic broadcast frame.

Images are OpenCV's: uint8, (height, width, 3), blue, green, red. Every function returns a new image.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, TypeAlias
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.camera import Camera, checked_image_size
from fieldcalib.distortion import undistort
from fieldcalib.field import Arc, Field, Line, ObjectSegments, Point, PointCloud, Segment
from fieldcalib.projective import homogenize
from fieldcalib.segments import ImageSegments

Image: TypeAlias = NDArray[np.uint8]
Colour: TypeAlias = tuple[int, int, int]
Float32: TypeAlias = NDArray[np.float32]

MAGENTA: Colour = (220, 40, 255)
# Far from the green of grass and the white of lines, and far from each other.
PALETTE: tuple[Colour, ...] = (
    (64, 64, 255),  # red
    (30, 150, 255),  # orange
    (50, 225, 255),  # yellow
    (245, 245, 40),  # cyan
    (255, 180, 60),  # sky
    (255, 80, 60),  # blue
    (255, 90, 170),  # violet
    (210, 90, 255),  # pink
    (150, 180, 255),  # peach
    (255, 190, 215),  # lavender
)
DARK: Colour = (24, 24, 24)

SAMPLE_SPACING = 0.1  # m: a chord of 9.15 m circles is 0.14 mm from the arc, less than 0.1 px in any broadcast frame
NEAR_PLANE = 0.1  # m in front of the camera; what is nearer is never within the image's angle of view
SHIFT = 4  # fractional bits of the coordinates that OpenCV draws with: 1/16 px


def draw_field(
    image: Image,
    camera: Camera,
    object_segments: ObjectSegments,
    *,
    colour: Colour = MAGENTA,
    thickness: int = 2,
) -> Image:
    """Draw the projected markings onto a copy of an image, lens included.

    Lines, arcs and ordered point clouds become anti-aliased curves, unordered clouds become dots; points are left out.
    What lies behind the camera, or so far out that the lens folds back, has no image and is not drawn.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        In OpenCV's order: blue, green, red. It is not changed.
    camera : Camera
        A camera of that image size.
    object_segments : mapping of str to segment
        The calibration object, e.g. a `Field`.
    colour : (int, int, int)
        Blue, green, red.
    thickness : int
        Pixels.

    Returns
    -------
    (height, width, 3) uint8 array

    Raises
    ------
    ValueError
        If the image is not uint8, has no three channels, or is not of the camera's size.

    Examples
    --------
    >>> from fieldcalib.field import soccer
    >>> camera = Camera.from_angles(0.0, np.radians(75), 0.0, 1500.0, C=(0, 56, -15), image_size=(960, 540))
    >>> picture = draw_field(np.zeros((540, 960, 3), np.uint8), camera, soccer(), colour=(0, 255, 255))
    >>> picture[269, 480].tolist()  # the centre mark, on the middle line
    [0, 255, 255]
    """
    import cv2

    picture = _checked_copy(image, camera.image_size)
    for segment in object_segments.values():
        if isinstance(segment, PointCloud) and not segment.ordered:
            for xy in camera.project(segment.X):
                _dot(picture, xy, float(thickness), colour)
        else:
            curves = [_fixed_point(curve) for curve in _image_curves(camera, segment)]
            cv2.polylines(picture, curves, False, colour, thickness, cv2.LINE_AA, SHIFT)
    return picture


def draw_segments(image: Image, image_segments: ImageSegments, *, radius: float = 4.0, names: bool = True) -> Image:
    """Draw labelled pixels onto a copy of an image: dots with a dark rim, one colour a label, and the label's name.

    A label has the same colour in every image, whatever other labels there are.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        In OpenCV's order: blue, green, red. It is not changed.
    image_segments : mapping of str to (N, 2) array_like
        Pixels (x, y) of each visible segment.
    radius : float
        Of the dots, in pixels; the names grow with it.
    names : bool
        Whether to write each label beside its first pixel.

    Returns
    -------
    (height, width, 3) uint8 array

    Raises
    ------
    ValueError
        If the image is not uint8 or has no three channels, or pixels are not of shape (N, 2).

    Examples
    --------
    >>> grass = np.full((540, 960, 3), (60, 130, 70), np.uint8)
    >>> picture = draw_segments(grass, {"Middle line": [(480, 100), (490, 400)]})
    >>> tuple(picture[100, 480].tolist()) == label_colour("Middle line")
    True
    """
    picture = _checked_copy(image, None)
    pixels = {}
    for label, values in image_segments.items():
        xy = np.asarray(values, dtype=float)
        if xy.size and (xy.ndim != 2 or xy.shape[1] != 2):
            raise ValueError(f"{label!r}: expected pixels of shape (N, 2), got {xy.shape}")
        pixels[label.strip()] = xy.reshape(-1, 2)
    for label, xy in pixels.items():
        for pixel in xy:
            _dot(picture, pixel, radius + max(1.0, 0.3 * radius), DARK)
            _dot(picture, pixel, radius, label_colour(label))
    if names:
        _write_names(picture, pixels, radius)
    return picture


def label_colour(label: str) -> Colour:
    """The colour (blue, green, red) in which a label is drawn: a function of its name alone.

    Examples
    --------
    >>> label_colour("Goal left post left ") == label_colour("Goal left post left")
    True
    """
    return PALETTE[crc32(label.strip().encode()) % len(PALETTE)]


def draw_minimap(camera: Camera, field: Field, *, size: tuple[int, int] = (336, 228)) -> Image:
    """The field from above, with the ground that the camera sees and where the camera stands.

    A camera outside the map is shown by an arrow at the border that points towards it.

    Parameters
    ----------
    camera : Camera
    field : Field
    size : (int, int)
        Width and height of the map in pixels; the field is centred in it.

    Returns
    -------
    (height, width, 3) uint8 array

    Examples
    --------
    >>> from fieldcalib.field import soccer
    >>> camera = Camera.from_angles(0.0, np.radians(75), 0.0, 1500.0, C=(0, 56, -15), image_size=(960, 540))
    >>> draw_minimap(camera, soccer(), size=(240, 160)).shape
    (160, 240, 3)
    """
    import cv2

    width, height = checked_image_size(size)
    margin = 7.0  # m
    scale = min(width / (field.length + 2.0 * margin), height / (field.width + 2.0 * margin))
    centre = (np.array([width, height]) - 1.0) / 2.0
    ground = _Ground.from_above((width, height), scale)
    picture = _grass(ground, field)
    _mix(picture, WHITE, 0.9 * _painted(ground, field, line_width=1.3 / scale))

    factor = 3  # per axis and pixel, for smooth edges
    fine = _Ground.from_above((width * factor, height * factor), scale * factor)
    X = np.stack([*fine.xy, np.zeros_like(fine.xy[0])], axis=-1)
    xy = camera.project(X)
    seen = np.all((xy >= -0.5) & (xy <= np.array(camera.image_size) - 0.5), axis=-1).astype(np.uint8)
    seen = seen.reshape(height * factor, width * factor)
    rim = cv2.morphologyEx(seen, cv2.MORPH_GRADIENT, np.ones((factor + 1, factor + 1), np.uint8))
    seen_share, rim_share = (
        np.asarray(cv2.resize(mask.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA)).ravel()
        for mask in (seen, rim)
    )
    picture *= (0.62 + 0.38 * seen_share)[:, None]
    _mix(picture, (90, 225, 255), 0.22 * seen_share)
    _mix(picture, (90, 225, 255), 0.9 * rim_share)
    result = _to_uint8(picture.reshape(height, width, 3))
    _mark_camera(result, centre + scale * camera.C[:2], centre)
    return result


def render_field(
    camera: Camera, field: Field, *, line_width: float = 0.12, rng: np.random.Generator | None = None
) -> Image:
    """A synthetic broadcast picture of an empty stadium: mown grass, painted lines, goals, boards and stands.

    The markings have their true width and perspective, lens included: each pixel is traced to the ground, and is as
    white as the share of it that a marking covers.

    Parameters
    ----------
    camera : Camera
    field : Field
    line_width : float
        Of lines, posts and crossbars in metres; the laws of the game allow up to 0.12.
    rng : numpy.random.Generator, optional
        Adds a crowd and film grain.

    Returns
    -------
    (height, width, 3) uint8 array

    Examples
    --------
    >>> from fieldcalib.field import soccer
    >>> camera = Camera.from_angles(0.0, np.radians(75), 0.0, 1500.0, C=(0, 56, -15), image_size=(960, 540))
    >>> picture = render_field(camera, soccer())
    >>> picture.shape, bool(picture[269, 480].min() > picture[260, 440].max())  # the centre mark, and grass
    ((540, 960, 3), True)
    """
    width, height = camera.image_size
    ray = _rays(camera)
    ground = _Ground.of_rays(camera, ray)
    picture = _grass(ground, field)
    _mix(picture, WHITE, 0.92 * _painted(ground, field, line_width))
    picture = picture.reshape(height, width, 3)
    _add_stands(picture, camera, ray, field, rng)
    _add_goals(picture, camera, field, line_width)
    v, u = np.mgrid[-1.0 : 1.0 : height * 1j, -1.0 : 1.0 : width * 1j].astype(np.float32)
    picture *= (1.0 - 0.13 * (u * u + v * v))[..., None]  # the lens darkens the corners
    if rng is not None:
        picture += 2.0 * rng.standard_normal((height, width, 1), dtype=np.float32)
    return _to_uint8(picture)


# Curves in the image


def _image_curves(camera: Camera, segment: Segment) -> Iterator[Array]:
    """The visible parts of a projected segment as polylines (N, 2), within 0.1 px of the curve."""
    import cv2

    if isinstance(segment, Point):
        return
    X = _smooth_curve(segment.X) if isinstance(segment, PointCloud) else segment.sample(SAMPLE_SPACING)
    xy = camera.project(X)
    # OpenCV's coordinates are 32-bit integers; points next to the camera's plane, or bent by the lens, exceed them
    drawable = (camera.depth(X) >= NEAR_PLANE) & np.all(np.abs(xy) < 1e6, axis=-1)
    size = np.array(camera.image_size)
    near = drawable & np.all(np.abs(xy - size / 2.0) <= size, axis=-1)
    near[1:-1] |= near[:-2] | near[2:]  # also the first point outside, so that curves reach the border
    shown = np.flatnonzero(near & drawable)
    for run in np.split(xy[shown], np.flatnonzero(np.diff(shown) > 1) + 1):
        # in two halves: a closed curve has no chord that it could be simplified against
        middle = len(run) // 2
        halves = [
            cv2.approxPolyDP(half.astype(np.float32)[:, None], 0.1, False).reshape(-1, 2)
            for half in (run[: middle + 1], run[middle:])
            if len(half)
        ]
        if halves:
            yield np.concatenate(halves)


def _smooth_curve(X: Array) -> Array:
    """Points of an ordered cloud's curve: the parabola through each three neighbours, blended from one to the next."""
    middle = np.clip(np.arange(len(X)), 1, len(X) - 2)
    t = np.linspace(0.0, 1.0, 9)[:, None, None]

    def parabola(index: IntArray, s: Array) -> Array:
        m = middle[index]
        s = s + (index - m)[:, None]
        before, at, after = X[m - 1], X[m], X[m + 1]
        return np.asarray(at + s * (after - before) / 2.0 + s * s * (after - 2.0 * at + before) / 2.0)

    start = np.arange(len(X) - 1)
    pieces = (1.0 - t) * parabola(start, t) + t * parabola(start + 1, t - 1.0)
    return np.asarray(pieces.swapaxes(0, 1).reshape(-1, 3))


def _fixed_point(xy: Array) -> NDArray[np.int32]:
    return np.asarray(np.rint(xy * (1 << SHIFT)), dtype=np.int32)


def _dot(picture: Image, xy: Array, radius: float, colour: Colour) -> None:
    import cv2

    if np.all(np.abs(xy) < 1e6):  # neither NaN nor beyond OpenCV's integers
        x, y = _fixed_point(xy).tolist()
        cv2.circle(picture, (x, y), round(radius * (1 << SHIFT)), colour, cv2.FILLED, cv2.LINE_AA, SHIFT)


def _write_names(picture: Image, pixels: dict[str, Array], radius: float) -> None:
    """Each label beside its first pixel: at the first place around it that is inside and free of other names."""
    import cv2

    height, width = picture.shape[:2]
    font, scale = cv2.FONT_HERSHEY_SIMPLEX, 0.1 * radius
    taken = np.empty((0, 4))
    for label, xy in pixels.items():
        inside = np.all((xy >= 0.0) & (xy < (width, height)), axis=-1)
        if not inside.any():
            continue
        x, y = xy[inside][0]
        (w, h), base = cv2.getTextSize(label, font, scale, 1)
        gap, step = 2.0 * radius, h + base + 2.0
        places = [
            (left, y + h / 2.0 + rows * step) for rows in (0, -1, 1, -2, 2, -3, 3) for left in (x + gap, x - gap - w)
        ]
        boxes = np.array([(left, bottom - h, left + w, bottom + base) for left, bottom in places])
        fits = np.all((boxes[:, :2] >= 0.0) & (boxes[:, 2:] <= (width, height)), axis=1)
        apart = (boxes[:, None, :2] >= taken[None, :, 2:]) | (boxes[:, None, 2:] <= taken[None, :, :2])
        fits &= np.all(np.any(apart, axis=-1), axis=1)
        best = int(np.argmax(fits))
        taken = np.concatenate([taken, boxes[best : best + 1]])
        corner = (round(places[best][0]), round(places[best][1]))
        cv2.putText(picture, label, corner, font, scale, DARK, 3, cv2.LINE_AA)
        cv2.putText(picture, label, corner, font, scale, (255, 255, 255), 1, cv2.LINE_AA)


def _mark_camera(picture: Image, position: Array, centre: Array) -> None:
    """A dot where the camera stands or, if that is outside, an arrow at the border towards it."""
    import cv2

    inset = 9.0  # px
    towards = position - centre
    room = centre - inset
    beyond = float(np.max(np.abs(towards) / room))
    if beyond <= 1.0:
        _dot(picture, position, 5.0, DARK)
        _dot(picture, position, 3.5, (255, 255, 255))
        return
    tip = centre + towards / beyond
    heading = towards / np.linalg.norm(towards)
    side = np.array([-heading[1], heading[0]])
    for size, colour in ((9.0, DARK), (6.0, (255, 255, 255))):
        corners = np.array(
            [tip + size * heading, tip - 0.7 * size * (heading - side), tip - 0.7 * size * (heading + side)]
        )
        cv2.fillConvexPoly(picture, _fixed_point(corners), colour, cv2.LINE_AA, SHIFT)


# The ground and what is painted on it. Pixels are flattened: (N,) for scalars, (2, N) for points of the ground.

WHITE: Colour = (242, 248, 244)
LIGHT_GRASS: Colour = (60, 141, 80)
DARK_GRASS: Colour = (50, 123, 66)
TRACK: Colour = (52, 74, 56)
MOWN_STRIPES = 20  # along the length of the field, as UEFA's pitch manuals show them: two in a penalty area's depth
RUN_OFF = 3.0  # m of grass around the field
BOARDS = (6.5, 0.95)  # m behind the lines, and their height
BOARD_COLOURS = np.array([(104, 58, 32), (46, 42, 126), (84, 80, 74), (110, 96, 30)], np.float32)
SPOT_RADIUS = 0.11  # m: penalty and centre marks


@dataclass(frozen=True)
class _Ground:
    """The ground under every pixel, in metres, and how far it moves from one pixel to the next."""

    xy: Float32
    along_row: Float32
    along_column: Float32

    @classmethod
    def of_rays(cls, camera: Camera, ray: Float32) -> _Ground:
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = np.float32(-camera.C[2]) / ray[..., 2]
            scale[~(scale > 0.0)] = np.nan  # above the horizon
            xy = np.stack([np.float32(camera.C[i]) + scale * ray[..., i] for i in (0, 1)])
            along_column, along_row = np.gradient(xy, axis=(1, 2))
        return cls(*(v.reshape(2, -1) for v in (xy, along_row, along_column)))

    @classmethod
    def from_above(cls, size: tuple[int, int], scale: float) -> _Ground:
        """Looking straight down at the centre mark with `scale` pixels a metre."""
        width, height = size
        v, u = np.indices((height, width), dtype=np.float32)
        xy = np.stack([u - (width - 1) / 2.0, v - (height - 1) / 2.0]).reshape(2, -1) / np.float32(scale)
        step = np.full_like(xy[0], 1.0 / scale)
        return cls(xy, np.stack([step, 0.0 * step]), np.stack([0.0 * step, step]))

    def __getitem__(self, index: IntArray | BoolArray) -> _Ground:
        return _Ground(self.xy[:, index], self.along_row[:, index], self.along_column[:, index])

    def pixel_size(self, normal: Any) -> Float32:
        """Metres from one pixel to the next along the direction `normal` (2,) or (2, N) of the ground."""
        nx, ny = normal
        u = nx * self.along_row[0] + ny * self.along_row[1]
        v = nx * self.along_column[0] + ny * self.along_column[1]
        return np.asarray(np.hypot(u, v) + np.float32(1e-9))

    @property
    def reach(self) -> Float32:
        """The largest `pixel_size` in any direction, or a little more."""
        return np.sqrt(np.sum(np.square(self.along_row) + np.square(self.along_column), axis=0))


def _band(distance: Float32, half_width: float, pixel_size: Float32) -> Float32:
    """Share of a pixel within `half_width` of a line, itself at `distance` from the pixel's centre; all in metres."""
    high = np.minimum((distance + half_width) / pixel_size, np.float32(0.5))
    low = np.maximum((distance - half_width) / pixel_size, np.float32(-0.5))
    return np.maximum(high - low, np.float32(0.0))


def _painted(ground: _Ground, field: Field, line_width: float) -> Float32:
    """Share of every pixel that is covered by a marking on the ground."""
    x, y = np.abs(ground.xy)
    on_field = np.flatnonzero((x < field.length / 2.0 + 1.0) & (y < field.width / 2.0 + 1.0))
    patch = ground[on_field]
    reach = patch.reach + np.float32(line_width / 2.0)
    cover = np.zeros(len(on_field), np.float32)
    for start, end in _ground_lines(field):
        length = float(np.hypot(*(end - start)))
        direction = (end - start) / length
        normal = np.array([-direction[1], direction[0]], np.float32)
        across = normal[0] * (patch.xy[0] - start[0]) + normal[1] * (patch.xy[1] - start[1])
        near = np.flatnonzero(np.abs(across) < reach)
        here = patch[near]
        along = direction[0] * (here.xy[0] - start[0]) + direction[1] * (here.xy[1] - start[1]) - length / 2.0
        share = _band(across[near], line_width / 2.0, here.pixel_size(normal))
        share *= _band(along, (length + line_width) / 2.0, here.pixel_size(direction))
        cover[near] = np.maximum(cover[near], share)
    for arc in _ground_arcs(field):
        offset = patch.xy - np.array(arc.center[:2], np.float32)[:, None]
        radius = np.sqrt(np.sum(np.square(offset), axis=0))
        near = np.flatnonzero(np.abs(radius - arc.radius) < reach)
        here, offset, radius = patch[near], offset[:, near], radius[near]
        share = _band(radius - np.float32(arc.radius), line_width / 2.0, here.pixel_size(offset / radius))
        phi = np.arctan2(np.array(arc.v[:2]) @ offset, np.array(arc.u[:2]) @ offset)
        share[np.mod(phi - arc.start, 2.0 * np.pi) > arc.stop - arc.start] = 0.0
        cover[near] = np.maximum(cover[near], share)
    for spot in _spots(field):
        offset = patch.xy - spot[:, None]
        radius = np.sqrt(np.sum(np.square(offset), axis=0))
        near = np.flatnonzero(radius < SPOT_RADIUS + reach)
        size = patch[near].pixel_size(offset[:, near] / (radius[near] + 1e-6))
        cover[near] = np.maximum(cover[near], np.clip((SPOT_RADIUS - radius[near]) / size + 0.5, 0.0, 1.0))
    whole = np.zeros(ground.xy.shape[1], np.float32)
    whole[on_field] = cover
    return whole


def _on_ground(segment: Segment) -> bool:
    return not np.any(segment.sample()[:, 2])


def _ground_lines(field: Field) -> Iterator[tuple[Float32, Float32]]:
    """End points of the straight pieces that are painted on the ground."""
    for segment in field.markings.values():
        if not isinstance(segment, Arc) and _on_ground(segment):
            X = np.array([segment.start, segment.end]) if isinstance(segment, Line) else segment.sample()
            yield from zip(X[:-1, :2].astype(np.float32), X[1:, :2].astype(np.float32), strict=True)


def _ground_arcs(field: Field) -> Iterator[Arc]:
    for segment in field.markings.values():
        if isinstance(segment, Arc) and _on_ground(segment):
            yield segment


def _spots(field: Field) -> Iterator[Float32]:
    for name, point in field.points.items():
        if name.endswith("_MARK"):
            yield np.array(point.X[:2], np.float32)


def _grass(ground: _Ground, field: Field) -> Float32:
    """Colours (N, 3) of a mown field with its run-off, and of the track around it."""
    stripe = field.length / MOWN_STRIPES
    phase = ground.xy[0] / np.float32(stripe)
    edge = np.abs(phase - np.rint(phase)) * np.float32(stripe) / ground.pixel_size((1.0, 0.0))
    light = np.where(np.floor(phase) % 2.0 == 0.0, 1.0, -1.0) * np.minimum(edge, 0.5) + 0.5
    picture = np.empty((ground.xy.shape[1], 3), np.float32)
    picture[:] = DARK_GRASS
    _mix(picture, LIGHT_GRASS, np.nan_to_num(light.astype(np.float32)))
    for i, half in ((0, field.length / 2.0), (1, field.width / 2.0)):
        size = ground.pixel_size((1.0 - i, float(i)))
        _mix(picture, TRACK, np.clip(np.nan_to_num((np.abs(ground.xy[i]) - half - RUN_OFF) / size, nan=1.0), 0.0, 1.0))
    return picture


# What stands on the ground


def _rays(camera: Camera) -> Float32:
    """The world direction in which every pixel looks, (height, width, 3); NaN where no ray reaches a pixel."""
    width, height = camera.image_size
    v, u = np.indices((height, width), dtype=float)
    x = (np.stack([u, v], axis=-1) - camera.K[:2, 2]) / camera.K[[0, 1], [0, 1]]
    if np.any(camera.k):
        x = undistort(x, camera.k, rho=1.0)
    return np.asarray(homogenize(x) @ camera.R, dtype=np.float32)


def _add_stands(picture: Float32, camera: Camera, ray: Float32, field: Field, rng: np.random.Generator | None) -> None:
    """Advertising boards around the field and dark stands above them."""
    import cv2

    C = camera.C.astype(np.float32)
    behind, board_height = BOARDS
    with np.errstate(divide="ignore", invalid="ignore"):
        scales = [
            (np.copysign(np.float32(half + behind), ray[..., i]) - C[i]) / ray[..., i]
            for i, half in ((0, field.length / 2.0), (1, field.width / 2.0))
        ]
        at_end = scales[0] < scales[1]  # behind a goal line, otherwise behind a touchline
        scale = np.maximum(np.where(at_end, scales[0], scales[1]), 0.0)
        place = np.where(at_end, C[1] + scale * ray[..., 1], C[0] + scale * ray[..., 0])
        above = -C[2] - scale * ray[..., 2]  # the height at which the ray meets the boards or the stand behind them
        size = np.hypot(*np.gradient(above)) + np.float32(1e-9)

    height = np.clip(np.nan_to_num(above, nan=60.0), 0.0, 60.0)
    stands = np.array((50, 42, 38), np.float32) * (0.35 + 0.65 * np.exp(-height / 9.0))[..., None]
    stands *= (1.0 + 0.12 * np.sin(height * 2.0 * np.pi / 1.6))[..., None]  # rows of seats
    if rng is not None:
        crowd = cv2.GaussianBlur(rng.standard_normal(picture.shape, dtype=np.float32), (0, 0), 1.2)
        stands *= 1.0 + 1.1 * crowd
    panel = np.nan_to_num(place / 9.0).astype(int) % len(BOARD_COLOURS)
    boards = BOARD_COLOURS[panel] * (0.75 + 0.25 * np.minimum(height / board_height, 1.0))[..., None]
    stands = np.where((above < board_height)[..., None], boards, stands)
    background = cv2.GaussianBlur(stands, (0, 0), 0.7)  # no jagged edges between boards
    visible = np.clip(np.nan_to_num(above / size, nan=1.0, posinf=1.0, neginf=0.0) + 0.5, 0.0, 1.0)
    _mix(picture, background, visible)


def _add_goals(picture: Float32, camera: Camera, field: Field, width: float) -> None:
    """Everything above the ground as round white bars, with a net behind what looks like a crossbar."""
    raised = [s for s in field.markings.values() if not _on_ground(s)]
    crossbars = [s for s in raised if isinstance(s, Line) and s.start[2] == s.end[2]]
    nets = [curve for bar in crossbars for strand in _net(bar) for curve in _image_curves(camera, strand)]
    _mix(picture, WHITE, 0.8 * _coverage(camera.image_size, nets, filled=False))
    bars = []
    for segment in raised:
        X = segment.sample(spacing=0.25)
        X = X[camera.depth(X) > NEAR_PLANE]
        if len(X) < 2:
            continue
        across = np.cross(np.gradient(X, axis=0), X - camera.C)
        across *= 0.5 * width / np.linalg.norm(across, axis=1, keepdims=True)
        outline = camera.project(np.concatenate([X - across, (X + across)[::-1]]))
        if np.all(np.abs(outline) < 1e6):
            bars.append(outline)
    _mix(picture, WHITE, _coverage(camera.image_size, bars, filled=True))


def _net(crossbar: Line) -> Iterator[Segment]:
    """Strands of a net that hangs from a crossbar: back 1 m at the top and 2 m on the ground."""
    start, end = np.array(crossbar.start), np.array(crossbar.end)
    back = np.cross(end - start, (0.0, 0.0, 1.0))
    back *= np.sign(back @ start) / np.linalg.norm(back)  # away from the middle of the field
    down = np.array([0.0, 0.0, -start[2]])
    profile = np.array([0.0 * back, 1.0 * back, 2.0 * back + down])

    def point(X: Array) -> tuple[float, float, float]:
        return (float(X[0]), float(X[1]), float(X[2]))

    for share in np.linspace(0.0, 1.0, 31):
        foot = start + share * (end - start)
        for a, b in zip(profile[:-1], profile[1:], strict=True):
            yield Line(point(foot + a), point(foot + b))
    for a, b, count in ((profile[0], profile[1], 5), (profile[1], profile[2], 11)):
        for share in np.linspace(0.0, 1.0, count):
            across = a + share * (b - a)
            yield Line(point(start + across), point(end + across))
    for post in (start, end):
        for share in np.linspace(0.1, 1.0, 10):
            yield Line(point(post + share * down), point(post + share * down + (1.0 + share) * back))
        for share in np.linspace(0.2, 0.8, 4):
            yield Line(point(post + share * profile[1]), point(post + share * 2.0 * back + down))


def _coverage(image_size: tuple[int, int], curves: list[Array], *, filled: bool) -> Float32:
    """Share of every pixel inside closed curves, or under hair lines along open ones."""
    import cv2

    factor = 4
    mask = np.zeros((image_size[1] * factor, image_size[0] * factor), np.uint8)
    points = [_fixed_point((curve + 0.5) * factor - 0.5) for curve in curves]
    if filled:
        cv2.fillPoly(mask, points, 255, cv2.LINE_8, SHIFT)
    else:
        cv2.polylines(mask, points, False, 255, 1, cv2.LINE_8, SHIFT)
    return np.asarray(cv2.resize(mask, image_size, interpolation=cv2.INTER_AREA), dtype=np.float32) / 255.0


def _mix(picture: Float32, colour: Colour | Float32, share: Float32) -> None:
    """Let `colour` cover a share of every pixel, in place."""
    covered = share > 0.0
    alpha = share[covered][:, None]
    top = colour[covered] if isinstance(colour, np.ndarray) else np.array(colour, np.float32)
    picture[covered] += alpha * (top - picture[covered])


def _to_uint8(picture: Float32) -> Image:
    return np.asarray(np.clip(np.rint(picture), 0.0, 255.0), dtype=np.uint8)


def _checked_copy(image: Image, image_size: tuple[int, int] | None) -> Image:
    """A contiguous copy that OpenCV can draw on, or a ValueError that says what is wrong with the image."""
    array = np.asarray(image)
    if array.dtype != np.uint8:
        raise ValueError(
            f"image must be uint8, got {array.dtype}; for values in 0..1 pass (255 * image).round().astype(np.uint8)"
        )
    if array.ndim != 3 or array.shape[2] != 3:
        raise ValueError(
            f"image must be (height, width, 3) in blue, green, red, got shape {array.shape}; "
            f"cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) or cv2.COLOR_BGRA2BGR makes it so"
        )
    if image_size is not None and array.shape[1::-1] != image_size:
        width, height = array.shape[1::-1]
        raise ValueError(
            f"image must have the camera's size, {image_size[0]} x {image_size[1]}, got {width} x {height}; "
            f"pass camera.scaled(({width}, {height})) or resize the image"
        )
    return np.array(array, order="C")
