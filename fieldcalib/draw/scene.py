"""Rendering of a synthetic broadcast frame: every pixel is traced to the ground.

Images are OpenCV's: uint8, (height, width, 3), blue, green, red. The functions below `render_field` also serve the
other modules of `fieldcalib.draw`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fieldcalib._types import CAMERA, FIELD, Array, BoolArray, Float32, expect, number
from fieldcalib.draw.ground import Colour as Colour  # re-exported
from fieldcalib.draw.ground import Ground, add_paint, bgr, mix, rays, surface
from fieldcalib.fields.field import Field
from fieldcalib.fields.ground import Terrain
from fieldcalib.fields.segments import Line, Segment
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.image_files import Image

WHITE: Colour = (242, 248, 244)
WIDEST = 1000.0  # m, of a line
BOARDS = (6.5, 0.95)  # m: distance behind the lines, height
BOARD_COLOURS = np.array([(104, 58, 32), (46, 42, 126), (84, 80, 74), (110, 96, 30)], np.float32)
STAND: Colour = (58, 48, 44)
SEAT = (0.45, 0.75)  # m: distance of seats along a row, and of rows
CROWD = (64, 512)  # rows and seats of the texture, which is repeated on the stands

SAMPLE_SPACING = 0.1  # m: a chord of 9.15 m circles is 0.14 mm from the arc, less than 0.1 px in any broadcast frame
NEAR_PLANE = 0.1  # m in front of the camera: nearer points are outside the image of any real camera
SHIFT = 4  # fractional bits of the coordinates that OpenCV draws with: 1/16 px


def render_field(
    camera: Camera, field: Field, *, line_width: float | None = None, rng: np.random.Generator | None = None
) -> Image:
    """Render a synthetic broadcast picture: ground with its paint, goals, advertising boards and stands.

    The markings have their true width and perspective, with distortion: each pixel is traced to the ground, and its
    colour is mixed by the share of it that a marking covers.

    Parameters
    ----------
    camera : Camera
    field : Field
    line_width : float, optional
        Width of lines, posts and crossbars in metres; by default that of the field.
    rng : numpy.random.Generator, optional
        Adds a crowd on the stands and noise; without it, both are left out.

    Returns
    -------
    (height, width, 3) uint8 array

    Examples
    --------
    >>> from fieldcalib.fields.sports.soccer import soccer
    >>> camera = Camera.from_angles(0.0, np.radians(75), 0.0, 1500.0, C=(0, 56, -15), image_size=(960, 540))
    >>> picture = render_field(camera, soccer())
    >>> picture.shape, bool(picture[269, 480].min() > picture[260, 440].max())  # the centre mark, and grass
    ((540, 960, 3), True)
    """
    width, height = expect(camera, Camera, CAMERA).image_size
    expect(field, Field, FIELD)
    line_width = field.lines.width if line_width is None else number(line_width, "line_width")
    if line_width > WIDEST:
        raise ValueError(f"line_width must be at most {WIDEST:g} m, got {line_width}")
    if rng is not None:
        expect(rng, np.random.Generator, "numpy.random.default_rng(0)")
    ray = rays(camera)
    ground = Ground.of_rays(camera, ray, field.terrain)
    picture = surface(ground, field)
    add_paint(picture, ground, field, 0.92, line_width)
    _add_stands(picture, camera, ray, field, rng)
    _add_goals(picture, camera, field, line_width)
    across, down = (np.square(np.linspace(-1.0, 1.0, count, dtype=np.float32)) for count in (width, height))
    picture *= 1.0 - 0.13 * (across + down[:, None])  # vignetting
    if rng is not None:
        picture += 2.0 * rng.standard_normal((height, width), dtype=np.float32)
    return to_uint8(picture)


def to_uint8(planes: Float32) -> Image:
    """Colours (3, height, width) as an image."""
    return np.stack([np.clip(plane + 0.5, 0.0, 255.0).astype(np.uint8) for plane in planes], axis=-1)


# Objects above the ground


def _add_stands(picture: Float32, camera: Camera, ray: Float32, field: Field, rng: np.random.Generator | None) -> None:
    """Advertising boards around the field and dark stands above them."""
    import cv2

    C = camera.C.astype(np.float32)
    behind, board_height = BOARDS
    reach = (np.array(field.half_extent) + behind).astype(np.float32)[:, None, None]
    # rays along a row of boards would meet it nowhere: they are turned by a quarter of a pixel
    across = np.copysign(np.maximum(np.abs(ray[:2]), 0.25 / np.float32(camera.focal_length)), ray[:2])
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        to_end, to_side = (reach * np.sign(across) - C[:2, None, None]) / across
        at_end = to_end < to_side  # the ray meets the boards behind a goal line, otherwise behind a touchline
        scale = np.maximum(np.where(at_end, to_end, to_side), 0.0)
        above = -C[2] - scale * ray[2]  # the height at which the ray meets the boards or the stand behind them
        place = np.where(at_end, C[1] + scale * ray[1], C[0] + scale * ray[0])
        dy, dx = np.gradient(above)
        visible = above / np.sqrt(dx * dx + dy * dy) + 0.5
    visible = np.clip(np.nan_to_num(visible, nan=1.0), 0.0, 1.0)
    height = np.clip(np.nan_to_num(above, nan=60.0), 0.0, 60.0)
    place = np.nan_to_num(place)

    panel = (np.floor(place / 9.0) % len(BOARD_COLOURS)).astype(np.intp)
    light = 0.75 + 0.25 * np.minimum(height / board_height, 1.0)
    boards = BOARD_COLOURS.T[:, panel] * light
    stands = np.array(STAND, np.float32)[:, None, None] * (0.3 + 0.7 * np.exp(height / -12.0))
    if rng is not None:
        seat, row = np.mod(place / SEAT[0], CROWD[1]), np.mod(height / SEAT[1], CROWD[0])
        stands *= np.moveaxis(cv2.remap(_crowd(rng), seat, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP), -1, 0)
    background = np.where(height < board_height, boards, stands)
    for plane, top in zip(picture, background, strict=True):
        top = cv2.GaussianBlur(top, (0, 0), 0.7)  # anti-aliasing between boards
        plane += visible * (top - plane)


def _crowd(rng: np.random.Generator) -> Float32:
    """Brightness of each seat, (rows, seats, 3)."""
    light = rng.lognormal(-0.1, 0.4, size=(*CROWD, 1))
    return np.asarray(light * rng.normal(1.0, 0.15, size=(*CROWD, 3)), dtype=np.float32)


def _add_goals(picture: Float32, camera: Camera, field: Field, width: float) -> None:
    """Draw segments above the ground as round bars, and nets behind crossbars without posts above them."""
    raised = {label: s for label, s in field.markings.items() if np.any(s.sample()[:, 2])}
    if not raised:
        return
    highest = min(s.sample()[:, 2].min() for s in raised.values())
    crossbars = [s for label, s in raised.items() if _is_crossbar(label, s, highest)]
    strands = [strand for bar in crossbars for strand in _net(bar)]
    nets = [curve for curves in image_curves_of(camera, strands, field.terrain) for curve in curves]
    if nets:
        mix(picture, WHITE, 0.8 * _coverage(camera.image_size, nets, filled=False))
    bars: dict[str, list[Array]] = {}
    for label, segment in raised.items():
        X = field.terrain.raised(segment.sample(spacing=0.25))
        X = X[camera.depth(X) > NEAR_PLANE]
        if len(X) < 2:
            continue
        across = np.cross(np.gradient(X, axis=0), X - camera.C)
        across *= 0.5 * width / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
        outline = camera.project(np.concatenate([X - across, (X + across)[::-1]]))
        if np.all(np.abs(outline) < 1e6):
            bars.setdefault(field.paint_of(label).colour, []).append(outline)
    for colour, shapes in bars.items():
        mix(picture, bgr(colour), _coverage(camera.image_size, shapes, filled=True))


def _is_crossbar(label: str, segment: Segment, highest: float) -> bool:
    """Whether a segment is a crossbar as of a soccer goal, without posts above it."""
    start, end = segment.anchors
    return "crossbar" in label and segment.is_straight and start[2] == end[2] and bool(start[2] <= highest + 0.2)


def _net(crossbar: Segment) -> Iterator[Line]:
    """Strands of a net behind a crossbar: 1 m deep at the top and 2 m on the ground."""
    start, end = crossbar.anchors
    back = np.cross(end - start, (0.0, 0.0, 1.0))
    back *= np.copysign(1.0, back @ start) / np.linalg.norm(back)  # away from the middle of the field
    down = np.array([0.0, 0.0, -start[2]])

    def line(a: Array, b: Array) -> Line:
        return Line((a[0], a[1], a[2]), (b[0], b[1], b[2]))

    for post in np.linspace(start, end, 31):
        yield line(post, post + back)
        yield line(post + back, post + down + 2.0 * back)
    for X in np.concatenate([np.linspace(0.0 * back, back, 5), np.linspace(back, 2.0 * back + down, 11)]):
        yield line(start + X, end + X)
    for post in (start, end):
        for share in np.linspace(0.1, 1.0, 10):
            yield line(post + share * down, post + share * down + (1.0 + share) * back)
        for share in np.linspace(0.25, 0.75, 3):
            yield line(post + share * back, post + share * 2.0 * back + down)


def _coverage(image_size: tuple[int, int], curves: list[Array], *, filled: bool) -> Float32:
    """Share of every pixel inside closed curves, or under hair lines along open ones."""
    import cv2

    factor = 4
    mask = np.zeros((image_size[1] * factor, image_size[0] * factor), np.uint8)
    for curve in curves:
        points = fixed_point((curve + 0.5) * factor - 0.5)
        if filled:  # one by one: drawn together, overlapping polygons would leave holes
            cv2.fillPoly(mask, [points], 255, cv2.LINE_8, SHIFT)
        else:
            cv2.polylines(mask, [points], False, 255, 1, cv2.LINE_8, SHIFT)
    return np.asarray(cv2.resize(mask, image_size, interpolation=cv2.INTER_AREA), dtype=np.float32) / 255.0


# Curves in the image


def image_curves(camera: Camera, segment: Segment, terrain: Terrain | None = None) -> list[Array]:
    """The visible parts of a projected segment as polylines (N, 2), within 0.1 px of the curve.

    `terrain` is the ground that it stands on (`Field.terrain`), by default level.
    """
    return image_curves_of(camera, [segment], terrain)[0]


def image_curves_of(camera: Camera, segments: Iterable[Segment], terrain: Terrain | None = None) -> list[list[Array]]:
    """`image_curves` of each of some segments, which are projected together.

    Examples
    --------
    >>> from fieldcalib.fields.sports.soccer import soccer
    >>> camera = Camera.from_angles(0.0, np.radians(75), 0.0, 1500.0, C=(0, 56, -15), image_size=(960, 540))
    >>> of_middle, of_goal = image_curves_of(camera, [soccer()["Middle line"], soccer()["Goal left crossbar"]])
    >>> len(of_middle), len(of_goal)
    (1, 0)
    """
    X, begin = _sampled(tuple(segments))
    X = X if terrain is None else terrain.raised(X)
    xy = camera.project(X)
    (x, y), (width, height) = xy.T, camera.image_size
    # OpenCV's coordinates are 32-bit integers; points near the camera's plane may exceed them
    drawable = (camera.depth(X) >= NEAR_PLANE) & (np.abs(x) < 1e6) & (np.abs(y) < 1e6)
    near = drawable & (np.abs(x - width / 2.0) <= width) & (np.abs(y - height / 2.0) <= height)
    pixels: Float32 = xy.astype(np.float32)
    return [
        _visible(pixels[part], near[part], drawable[part]) if np.any(near[part]) else []
        for part in (slice(*ends) for ends in pairwise(begin))
    ]


@lru_cache(maxsize=32)
def _sampled(segments: tuple[Segment, ...]) -> tuple[Array, list[int]]:
    """Points (N, 3) along segments, and where those of each segment begin, with their end; points have none."""
    X = [np.zeros((0, 3)) if one.is_point else one.polyline(SAMPLE_SPACING) for one in segments]
    joined = np.concatenate([np.zeros((0, 3)), *X])
    joined.flags.writeable = False
    return joined, [0, *np.cumsum([len(one) for one in X]).tolist()]


def _visible(xy: Float32, near: BoolArray, drawable: BoolArray) -> list[Array]:
    """The parts of a curve through pixels (N, 2) that are `near` the image, as polylines."""
    import cv2

    shown = near.copy()  # and the first points outside, so that curves reach the border
    shown[1:] |= near[:-1]
    shown[:-1] |= near[1:]
    at = np.flatnonzero(shown & drawable)
    found = []
    for run in np.split(xy[at], np.flatnonzero(np.diff(at) > 1) + 1):
        # approxPolyDP simplifies against the chord, which a closed curve does not have: split it into halves
        middle = len(run) // 2 if np.max(np.abs(run[0] - run[-1])) < 1.0 else 0
        halves = (run[: middle + 1], run[middle:])
        simple = [cv2.approxPolyDP(half[:, None], 0.1, False).reshape(-1, 2) for half in halves]
        found.append(np.concatenate([simple[0][:-1], simple[1]]))
    return found


def dashes(curve: Array, length: float) -> Iterator[Array]:
    """Parts of a polyline (N, 2) that are `length` pixels long, with gaps as long between them.

    Examples
    --------
    >>> [part[:, 0].tolist() for part in dashes(np.array([[0.0, 0.0], [10.0, 0.0]]), 4.0)]
    [[0.0, 4.0], [8.0, 10.0]]
    """
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    for start in np.arange(0.0, at[-1], 2.0 * length):
        stop = min(start + length, at[-1])
        s = np.concatenate([[start], at[(at > start) & (at < stop)], [stop]])
        yield np.column_stack([np.interp(s, at, x) for x in curve.T])


def fixed_point(xy: Array) -> NDArray[np.int32]:
    """Pixels in the fixed-point units of OpenCV's drawing functions."""
    return np.asarray(np.rint(xy * (1 << SHIFT)), dtype=np.int32)


def draw_text(picture: Image, text: str, place: tuple[int, int], scale: float, colour: Colour) -> None:
    """Write text in place; its lower left corner is at `place`, and `scale` is that of OpenCV's font."""
    import cv2

    cv2.putText(picture, _in_utf8(text), place, cv2.FONT_HERSHEY_SIMPLEX, scale, colour, 1, cv2.LINE_AA)


def text_size(text: str, scale: float) -> tuple[int, int, int]:
    """Width of a text, and its height above and below the base line, pixels."""
    import cv2

    (width, above), below = cv2.getTextSize(_in_utf8(text), cv2.FONT_HERSHEY_SIMPLEX, scale, 1)
    return width, above, below


def wrapped(text: str, scale: float, width: int) -> list[str]:
    """The lines of a text, at most `width` pixels long unless one word is longer; at least one line."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if text_size(longer, scale)[0] <= width:
            lines[-1] = longer
        elif lines[-1]:
            lines.append(word)
        else:
            lines[-1] = word
    return lines


def _in_utf8(text: str) -> str:
    """A text with a "?" for each byte of a file's name that is not in UTF-8: OpenCV ends the process at these."""
    return text.encode(errors="replace").decode()


def draw_dot(picture: Image, xy: Array, radius: float, colour: Colour) -> None:
    """Draw a filled circle around a pixel, in place; nothing if the pixel is NaN."""
    import cv2

    if np.all(np.abs(xy) < 1e6):  # not NaN, and within OpenCV's integers
        x, y = fixed_point(xy).tolist()
        cv2.circle(picture, (x, y), round(radius * (1 << SHIFT)), colour, cv2.FILLED, cv2.LINE_AA, SHIFT)
