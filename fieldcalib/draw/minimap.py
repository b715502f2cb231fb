"""A map of the field from above: the view and the place of a camera, players and their trails.

Images are OpenCV's: uint8, (height, width, 3), blue, green, red. Every function returns a new image.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import CAMERA, FIELD, LARGEST, Array, Float32, expect, listed, real_array
from fieldcalib.draw.ground import Colour, Ground, add_paint, mix, rays, surface
from fieldcalib.draw.scene import SHIFT, draw_dot, fixed_point, to_uint8
from fieldcalib.fields.field import Field
from fieldcalib.fields.ground import Terrain
from fieldcalib.fields.segments import Line
from fieldcalib.fields.traits import Paint
from fieldcalib.geometry.camera import Camera, checked_image_size
from fieldcalib.io.image_files import Image, checked_image

DARK: Colour = (24, 24, 24)
LARGEST_MAP = 4096  # px
MOST_PLACES = 100_000  # of all trails: they take a second
POINT: Colour = (40, 40, 235)
SPOTLIGHT: Colour = (90, 225, 255)
UNSEEN = 0.62  # brightness of the ground that a camera does not see
BORDER, AROUND = 64, 3  # points along a side of the image; pixels of the map around what is in view
FARTHEST = 1e5  # pixels of a map; OpenCV's are 32-bit integers
DOT = 5.0  # px: diameter of the points of a field that has nothing else
FINER, RIM = 6, 8  # subpixels along a pixel of the map, and of them in the border: what is seen moves without jumps
MAP_MARGIN = 7.0 / np.hypot(105.0, 68.0)  # around the field, in shares of its diagonal


def draw_minimap(
    camera: Camera | None,
    field: Field,
    *,
    size: tuple[int, int] = (336, 228),
    points: ArrayLike | None = None,
    colours: Colour | Sequence[Colour] = POINT,
    trails: Sequence[ArrayLike] = (),
) -> Image:
    """A map of the field with the ground in view, the position of the camera, and points such as players.

    For a camera outside the map, an arrow at the border points towards it.

    Parameters
    ----------
    camera : Camera, optional
        None draws no view and no camera.
    field : Field
    size : (int, int)
        Width and height of the map in pixels; the field is centred in it.
    points : (N, 2) or (N, 3) array_like, optional
        Points on the field, metres, drawn as dots with a dark rim. NaN (pixels above the horizon) and points off the
        map are left out.
    colours : (int, int, int) or sequence of them
        Blue, green, red; one colour for all points and trails, or one for each.
    trails : sequence of (M, 2) or (M, 3) array_like
        Earlier places of each of the points, oldest first; trails fade towards the past.

    Returns
    -------
    (height, width, 3) uint8 array

    Raises
    ------
    ValueError
        If `field` is not a `Field`, points or trails have another shape, or there are more of them than colours.

    Examples
    --------
    >>> from fieldcalib.fields.sports.soccer import soccer
    >>> camera = Camera.from_angles(0.0, np.radians(75), 0.0, 1500.0, C=(0, 56, -15), image_size=(960, 540))
    >>> draw_minimap(camera, soccer(), size=(240, 160)).shape
    (160, 240, 3)

    With two players, the first of whom came from the right:

    >>> players = camera.image_to_field([(300, 300), (600, 250)])
    >>> trails = [players[0] + [(6, 0, 0), (3, 1, 0), (0, 0, 0)]]
    >>> draw_minimap(camera, soccer(), points=players, colours=[(0, 0, 255), (255, 0, 0)], trails=trails).shape
    (228, 336, 3)
    """
    expect(field, Field, FIELD)
    if camera is not None:
        expect(camera, Camera, CAMERA)
    size = checked_image_size(size)
    if not 2 <= min(size) <= max(size) <= LARGEST_MAP:
        raise ValueError(f"expected a map of 2 to {LARGEST_MAP} pixels each way, got {size[0]} x {size[1]}")
    overhead, X, empty, dark = _map_of(field, size)
    if camera is None:
        result = to_uint8(empty)
    else:
        result = dark.copy()
        part, seen, rim = _in_view(camera, field.terrain, overhead, X)
        result[part] = to_uint8(_lit(empty[:, *part], seen, rim))
        _mark_camera(result, overhead.project(camera.C * (1.0, 1.0, 0.0)), overhead.principal_point)
    every = (np.empty((0, 2)) if points is None else points, *listed(trails, "trails of points"))
    at, *past = (np.atleast_1d(real_array(one))[..., :2] for one in every)  # a map is level
    return draw_players(result, overhead, at, colours=colours, trails=past)


def draw_players(
    image: Image,
    camera: Camera,
    points: ArrayLike,
    *,
    colours: Colour | Sequence[Colour] = POINT,
    trails: Sequence[ArrayLike] = (),
) -> Image:
    """Draw points of the ground onto a copy of an image: dots with a dark rim, and trails of earlier places.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        In OpenCV's order: blue, green, red. A top view, or a frame.
    camera : Camera
        The camera of that image, such as `fieldcalib.draw.overhead_camera`.
    points : (N, 2) or (N, 3) array_like
        Points on the ground, metres; z as `locate_on_ground` gives it, 0 if it is left out. NaN and points outside the
        image are left out.
    colours, trails
        As in `draw_minimap`.

    Returns
    -------
    (height, width, 3) uint8 array

    Raises
    ------
    ValueError
        If the image is not of the camera's size, or as in `draw_minimap`.

    Examples
    --------
    >>> from fieldcalib.draw import overhead_camera
    >>> from fieldcalib.fields.sports.soccer import soccer
    >>> overhead = overhead_camera(soccer(), 0.2)
    >>> width, height = overhead.image_size
    >>> grass = np.full((height, width, 3), (60, 130, 70), np.uint8)
    >>> draw_players(grass, overhead, [(0.0, 0.0)], colours=(0, 0, 255))[height // 2, width // 2].tolist()
    [0, 0, 255]
    """
    expect(camera, Camera, CAMERA)
    picture = np.array(checked_image(image, camera.image_size), order="C")
    places = _on_image(camera, points)
    past = [_on_image(camera, trail) for trail in listed(trails, "trails of points")]
    if sum(map(len, past)) > MOST_PLACES:
        raise ValueError(f"expected trails of at most {MOST_PLACES} places in all, got {sum(map(len, past))}")
    shades = _each_colour(colours, max(len(places), len(past)))
    width = camera.image_size[0]
    for trail, shade in zip(past, shades, strict=False):
        _draw_trail(picture, trail, shade, max(1, round(width / 224.0)))
    radius = max(2.5, width / 110.0)
    for xy, shade in zip(places, shades, strict=False):
        draw_dot(picture, xy, radius + max(1.0, 0.25 * radius), DARK)
        draw_dot(picture, xy, radius, shade)
    return picture


def add_minimap(image: Image, camera: Camera, field: Field) -> Image:
    """A copy of an image with `draw_minimap` in its upper right corner, or without it if the image is too small.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> camera = Camera.from_angles(0.0, np.radians(75), 0.0, 1500.0, C=(0, 56, -15), image_size=(960, 540))
    >>> picture = add_minimap(np.zeros((540, 960, 3), np.uint8), camera, soccer())
    >>> bool(picture[100, 900].any()), bool(picture[300].any())
    (True, False)
    """
    picture = np.array(checked_image(image), order="C")
    inset_map(picture, camera, field)
    return picture


def inset_map(picture: Image, camera: Camera, field: Field) -> None:
    """As `add_minimap`, in place."""
    unit = picture.shape[1] / 960.0
    width, height = min(round(224.0 * unit), 336), min(round(152.0 * unit), 228)  # larger ones are slow to render
    gap, rim = round(12.0 * unit), 2
    left, bottom = picture.shape[1] - width - gap, gap + height
    if gap < rim or bottom + gap > picture.shape[0]:
        return
    picture[gap - rim : bottom + rim, left - rim : left + width + rim] = 200  # a tuple takes a hundred times as long
    picture[gap:bottom, left : left + width] = draw_minimap(camera, field, size=(width, height))


def _lit(part: Float32, seen: Float32, rim: Float32) -> Float32:
    """A part (3, height, width) of a map with light on what is seen, and on the border of that."""
    picture = part * (UNSEEN + (1.0 - UNSEEN) * seen)
    mix(picture, SPOTLIGHT, 0.22 * seen)
    mix(picture, SPOTLIGHT, 0.9 * rim)
    return picture


def _in_view(
    camera: Camera, terrain: Terrain, overhead: Camera, X: Array
) -> tuple[tuple[slice, slice], Float32, Float32]:
    """Rows and columns of a map that hold all that a camera sees, and how far each pixel there is seen, or its border.

    `X` (height, width, 3) are the points of the map's pixels on level ground. The view of most cameras is a polygon on
    the ground; that of others, which see the horizon, or whose lens folds back, is found by projecting the ground.
    """
    import cv2

    height, width = X.shape[:2]
    border = overhead.project(_border_on_ground(camera, terrain))
    if not np.all(np.abs(border) < FARTHEST):  # NaN above the horizon, and where the lens folds back
        inside = _inside(camera, terrain.raised(X))
        seen = np.clip(np.nan_to_num(inside + 0.5, nan=0.0), 0.0, 1.0).astype(np.float32)
        rim = np.clip(np.nan_to_num(1.2 - np.abs(inside), nan=0.0), 0.0, 1.0).astype(np.float32)
        return (slice(0, height), slice(0, width)), seen, rim
    left, top = np.clip(np.floor(border.min(axis=0)) - AROUND, 0, (width, height)).astype(int).tolist()
    right, bottom = np.clip(np.ceil(border.max(axis=0)) + AROUND, 0, (width, height)).astype(int).tolist()
    part, size = (slice(top, bottom), slice(left, right)), (right - left, bottom - top)
    if 0 in size:
        return part, *np.zeros((2, *size[::-1]), np.float32)
    masks = np.zeros((2, FINER * size[1], FINER * size[0]), np.uint8)
    polygon = [fixed_point(FINER * (border - (left, top) + 0.5) - 0.5)]
    cv2.fillPoly(masks[0], polygon, 255, cv2.LINE_AA, SHIFT)
    cv2.polylines(masks[1], polygon, True, 255, RIM, cv2.LINE_AA, SHIFT)
    seen, rim = (cv2.resize(mask, size, interpolation=cv2.INTER_AREA) / np.float32(255.0) for mask in masks)
    return part, seen, rim


def _border_on_ground(camera: Camera, terrain: Terrain) -> Array:
    """Ground points (N, 3) that a camera sees at the border of its image, in order; NaN above the horizon."""
    share, zero, one = np.linspace(0.0, 1.0, BORDER), np.zeros(BORDER), np.ones(BORDER)
    x, y = np.concatenate([share, one, share[::-1], zero]), np.concatenate([zero, share, one, share[::-1]])
    return camera.image_to_field(np.stack([x, y], axis=-1) * camera.image_size - 0.5, terrain=terrain)


def _inside(camera: Camera, X: Array) -> Array:
    """Distance from the border of the view, of ground points (height, width, 3) of a map: its pixels, < 0 outside."""
    centre = (np.array(camera.image_size) - 1.0) / 2.0
    inside = np.min(centre + 0.5 - np.abs(camera.project(X) - centre), axis=-1)  # px of the image
    inside = np.maximum(inside, -centre[0])  # far outside and below the camera it is not linear
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(inside / np.hypot(*np.gradient(inside)))


def _on_image(camera: Camera, points: ArrayLike) -> Array:
    """Pixels (N, 2) of points of the ground; NaN of those behind the camera."""
    X = real_array(points)
    if X.ndim != 2 or X.shape[1] not in (2, 3):
        raise ValueError(f"expected field points of shape (N, 2) or (N, 3), got {X.shape}")
    X = np.pad(np.where(np.abs(X) <= LARGEST, X, np.nan), ((0, 0), (0, 3 - X.shape[1])))
    return np.where(camera.depth(X)[:, None] > 0.0, camera.project(X), np.nan)


def _each_colour(colours: Colour | Sequence[Colour], count: int) -> list[Colour]:
    """A colour for each of `count` points."""
    values = real_array(colours)
    if not np.all(np.isfinite(values)):
        raise ValueError("expected colours (blue, green, red), got numbers that are not finite")
    if values.shape != (3,) and (values.ndim != 2 or values.shape[1] != 3 or len(values) < count):
        raise ValueError(f"expected a colour (blue, green, red) or {count} of them, got shape {values.shape}")
    shades = np.broadcast_to(values, (count, 3)) if values.ndim == 1 else values
    return [(int(blue), int(green), int(red)) for blue, green, red in shades]


def _draw_trail(picture: Image, trail: Array, colour: Colour, thickness: int) -> None:
    """Draw a polyline that fades towards its beginning, in place, with gaps where points are missing."""
    import cv2

    size, margin = np.array(picture.shape[1::-1]), thickness + 2
    lines = np.stack([trail[:-1], trail[1:]], axis=1)
    steps = np.flatnonzero(np.all(np.abs(lines) < 1e6, axis=(1, 2)))  # not NaN, and within OpenCV's integers
    lines = lines[steps]
    low = np.clip(lines.min(axis=1).astype(int) - margin, 0, size)
    high = np.clip(lines.max(axis=1).astype(int) + margin + 1, 0, size)
    ends = fixed_point(lines - low[:, None])
    shares = 0.15 + 0.85 * (steps + 1) / max(len(trail) - 1, 1)
    for index in np.flatnonzero(np.all(low < high, axis=1)).tolist():
        (left, top), (right, bottom), share = low[index], high[index], float(shares[index])
        first, last = ends[index].tolist()
        around = picture[top:bottom, left:right]
        layer = around.copy()
        cv2.line(layer, first, last, colour, thickness, cv2.LINE_AA, SHIFT)
        around[:] = cv2.addWeighted(layer, share, around, 1.0 - share, 0.0)


@lru_cache(maxsize=4)  # slower than drawing the view of a camera, and the same in every frame of a video
def _map_of(field: Field, size: tuple[int, int]) -> tuple[Camera, Array, Float32, Image]:
    """A camera high above a field, its pixels' ground points (height, width, 3) and colours (3, ...), a dark map."""
    width, height = size
    margin = MAP_MARGIN * np.hypot(field.length, field.width)
    half = np.maximum(field.half_extent + 0.5 * margin, np.array([field.length, field.width]) / 2.0 + margin)
    scale = float(np.min(np.array(size) / (2.0 * half)))
    above = 100.0  # m; the map does not depend on it
    middle = ((width - 1) / 2.0, (height - 1) / 2.0)
    overhead = Camera.from_angles(0.0, 0.0, 0.0, scale * above, (0.0, 0.0, -above), size, middle)
    ground = Ground.of_rays(overhead, rays(overhead))
    picture = surface(ground, field)
    if not field.markings:  # the border, and the points as dots
        x, y = field.length / 2.0, field.width / 2.0
        corners = ((-x, -y, 0.0), (x, -y, 0.0), (x, y, 0.0), (-x, y, 0.0))
        border = {f"border {t}": Line(corners[t - 1], corners[t]) for t in range(4)}
        dots = dict.fromkeys(field.points, Paint(width=DOT / scale))
        field = replace(field, segments={**field.points, **border}, paint=dots)
    add_paint(picture, ground, field, 0.9, least=1.3 / scale)
    return overhead, np.stack([*ground.xy, np.zeros((height, width))], axis=-1), picture, to_uint8(UNSEEN * picture)


def _mark_camera(picture: Image, position: Array, centre: Array) -> None:
    """Draw a dot at the position of the camera or, if it is outside, an arrow at the border towards it."""
    import cv2

    inset = 9.0  # px
    towards = position - centre
    room = centre - inset
    beyond = float(np.max(np.abs(towards) / room))
    if beyond <= 1.0:
        draw_dot(picture, position, 5.0, DARK)
        draw_dot(picture, position, 3.5, (255, 255, 255))
        return
    tip = centre + towards / beyond
    heading = towards / np.linalg.norm(towards)
    side = np.array([-heading[1], heading[0]])
    for size, colour in ((9.0, DARK), (6.0, (255, 255, 255))):
        corners = np.array(
            [tip + size * heading, tip - 0.7 * size * (heading - side), tip - 0.7 * size * (heading + side)]
        )
        cv2.fillConvexPoly(picture, fixed_point(corners), colour, cv2.LINE_AA, SHIFT)
