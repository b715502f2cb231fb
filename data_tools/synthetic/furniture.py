"""Objects on the fields of other sports: goals with their nets, nets across courts, baskets, walls of glass."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from itertools import pairwise

import cv2
import numpy as np

from data_tools.synthetic.colours import random_colour
from data_tools.synthetic.looks import DARK, STEEL, WHITE, Look
from data_tools.synthetic.objects import FARTHEST, Drawable, GoalFrame, add_goal, mix_bars, random_goals
from fieldcalib._types import Array
from fieldcalib.draw.scene import NEAR_PLANE, SHIFT, Colour, fixed_point
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Arc, Line, Segment
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.image_files import Image

PIECE, STRIPE = 1.5, 0.2  # m: lengths of the pieces that bars are drawn in, each with its own thickness; of stripes
BAR = 0.06  # m: thickness of bars by default
WHITE_STRIPE: Colour = (245, 245, 245)
RIM_NET = 0.45  # m: length of the net of a basket
ARM, PAD = 2.2, 0.35  # m: distance of a backboard from its stanchion behind the court, and thickness of that
MULLIONS = 2.0  # m between the posts of walls of glass
POST_AWAY = 0.75  # m from the side line: posts of nets whose field has none


def furniture(image: Image, camera: Camera, field: Field, look: Look, rng: np.random.Generator) -> list[Drawable]:
    """All labelled objects above the ground and their supports, to be drawn onto an image."""
    raised = {label: s for label, s in field.markings.items() if np.any(s.sample()[:, 2])}
    goal_net, depth = random_goals(rng)
    mesh = random_colour(rng, *(DARK if rng.random() < 0.7 else WHITE)), rng.uniform(0.15, 0.5)
    steel = random_colour(rng, *STEEL)
    kinds = {look.colour(label, WHITE) for label in raised}
    shades = {kind: random_colour(rng, *kind) for kind in sorted(kinds)}
    things: list[Drawable] = []
    if look.nets:
        things += [_goal(image, camera, bar, look, goal_net, depth) for bar in _crossbars(raised)]
    things += _nets(image, camera, field, raised, mesh, steel)
    things += _baskets(image, camera, raised, steel, rng)
    things += _glass(image, camera, field, raised, steel)
    for label, segment in raised.items():
        width, colour = look.width(label, BAR), shades[look.colour(label, WHITE)]
        other = WHITE_STRIPE if look.striped and label.startswith(look.striped) else colour
        bar = partial(_add_bar, image, camera, segment, width, (colour, other))
        things.append(Drawable(segment.sample().mean(axis=0), bar))
    return things


def _add_bar(image: Image, camera: Camera, segment: Segment, width: float, colours: tuple[Colour, Colour]) -> None:
    """Draw a line or arc above the ground, in pieces of two alternating colours."""
    curved = isinstance(segment, Arc)
    X = segment.sample(0.1 if curved else STRIPE if colours[0] != colours[1] else PIECE)
    if curved:
        mix_bars(image, camera, [X], width, colours[0], 1.0)
        return
    for index, ends in enumerate(pairwise(X)):
        mix_bars(image, camera, [np.array(ends)], width, colours[index % 2], 1.0)


def _panel(image: Image, camera: Camera, corners: Array, colour: Colour, opacity: float) -> None:
    """Draw a translucent polygon (N, 3)."""
    edges = np.concatenate([np.linspace(a, b, 9)[:-1] for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)])
    xy = camera.project(edges)
    if not (np.all(camera.depth(edges) > NEAR_PLANE) and np.all(np.abs(xy) < FARTHEST)):
        return
    low = np.clip(np.floor(xy.min(axis=0)), 0, camera.image_size).astype(int)
    high = np.clip(np.ceil(xy.max(axis=0)) + 1, 0, camera.image_size).astype(int)
    if np.any(low >= high):
        return
    patch = image[low[1] : high[1], low[0] : high[0]]
    covered = np.zeros(patch.shape[:2], np.uint8)
    cv2.fillPoly(covered, [fixed_point(xy - low)], 255, cv2.LINE_AA, SHIFT)
    share = np.float32(opacity / 255.0) * covered[..., None]
    patch[:] = (patch + share * (np.array(colour, np.float32) - patch)).astype(np.uint8)


def _crossbars(raised: Mapping[str, Segment]) -> list[Line]:
    return [s for label, s in raised.items() if label.endswith("crossbar") and isinstance(s, Line)]


def _goal(
    image: Image, camera: Camera, bar: Line, look: Look, net: tuple[Colour, float], depth: tuple[float, float]
) -> Drawable:
    """The net of a goal; its posts and its crossbar have labels and are drawn as bars."""
    end, height = np.array(bar.end), -bar.end[2]
    frame = GoalFrame(2.0 * abs(end[1]), height, 0.5 * look.width("Goal left", BAR))
    shallow = (0.5 * depth[0], 0.4 * depth[1])
    middle = np.array([end[0], 0.0, 0.0])
    farther = middle + np.sign(middle) * (0.3, 0.0, 0.0)
    return Drawable(farther, partial(add_goal, image, camera, middle, net, shallow, frame))


def _nets(
    image: Image,
    camera: Camera,
    field: Field,
    raised: Mapping[str, Segment],
    mesh: tuple[Colour, float],
    steel: Colour,
) -> Iterator[Drawable]:
    """Nets across the court: down to the ground, or to their lower edge."""
    tops = [s for label, s in raised.items() if label.startswith("Net") and isinstance(s, Line) and "post" not in label]
    lower = [s for label, s in raised.items() if label == "Net lower edge" and isinstance(s, Line)]
    for top in tops:
        if top in lower:
            continue
        start, end = np.array(top.start), np.array(top.end)
        foot = np.array([1.0, 1.0, 0.0])
        below = [np.array(lower[0].end), np.array(lower[0].start)] if lower else [foot * end, foot * start]
        corners = np.array([start, end, *below])
        yield Drawable(corners.mean(axis=0), partial(_panel, image, camera, corners, *mesh))
    if lower:
        for sign in (-1.0, 1.0):
            x, y = 0.0, sign * (0.5 * field.width + POST_AWAY)
            post = Line((x, y, lower[0].start[2] - 1.0), (x, y, 0.0))
            yield Drawable(np.array([x, y, 0.0]), partial(_add_bar, image, camera, post, 0.1, (steel, steel)))


def _baskets(
    image: Image,
    camera: Camera,
    raised: Mapping[str, Segment],
    steel: Colour,
    rng: np.random.Generator,
) -> Iterator[Drawable]:
    """The glass or wood of backboards, the nets of the rims, and their supports."""
    glass = random_colour(rng, saturation=(0.0, 0.1), value=(0.7, 1.0)), float(rng.choice((0.25, 0.95)))
    pad = random_colour(rng, saturation=(0.3, 0.9), value=(0.2, 0.7))
    for label, upper in raised.items():
        if not (label.startswith("Backboard") and label.endswith("upper") and isinstance(upper, Line)):
            continue
        lower = raised[label.replace("upper", "lower")]
        rim = raised[label.replace("Backboard", "Rim").removesuffix(" upper")]
        assert isinstance(lower, Line)
        assert isinstance(rim, Arc)
        corners = np.array([upper.start, upper.end, lower.end, lower.start])
        yield Drawable(corners.mean(axis=0) + (0.0, 0.0, 0.01), partial(_panel, image, camera, corners, *glass))
        out = float(np.sign(upper.start[0]))
        middle = corners.mean(axis=0)
        back = Line((middle[0], 0.0, middle[2]), (middle[0] + out * ARM, 0.0, 0.8 * middle[2]))
        foot = Line(back.end, (back.end[0], 0.0, 0.0))
        yield Drawable(np.array(back.end), partial(_add_bar, image, camera, back, 0.2, (steel, steel)))
        yield Drawable(np.array(foot.end), partial(_add_bar, image, camera, foot, PAD, (pad, pad)))
        X = rim.sample(0.2)
        narrow = rim.center + 0.5 * (X - rim.center) + np.array([0.0, 0.0, RIM_NET])
        strands = [np.array(strand) for strand in zip(X, narrow, strict=True)]
        yield Drawable(X.mean(axis=0), partial(mix_bars, image, camera, strands, 0.02, WHITE_STRIPE, 0.7))


def _glass(
    image: Image, camera: Camera, field: Field, raised: Mapping[str, Segment], steel: Colour
) -> Iterator[Drawable]:
    """The posts between the panes of glass walls, and the upper edges of those along the sides."""
    fences = [s for label, s in raised.items() if label.startswith("Fence") and isinstance(s, Line)]
    for fence in fences:
        x, height = fence.start[0], fence.start[2]
        for y in np.arange(-0.5 * field.width + MULLIONS, 0.5 * field.width - 0.1, MULLIONS).tolist():
            post = Line((x, y, height), (x, y, 0.0))
            yield Drawable(np.array([x, y, 0.0]), partial(_add_bar, image, camera, post, 0.05, (steel, steel)))
        for y in (-0.5 * field.width, 0.5 * field.width):
            for at in np.arange(1.0, 0.5 * field.length / MULLIONS).tolist():
                along = float(np.sign(x) * (0.5 * field.length - at * MULLIONS))
                top = height if at < 2.0 else 0.75 * height  # the sides are lower than the back, but near it
                post = Line((along, y, top), (along, y, 0.0))
                yield Drawable(np.array([along, y, 0.0]), partial(_add_bar, image, camera, post, 0.05, (steel, steel)))
            rail = Line((x, y, 0.75 * height), (0.0, y, 0.75 * height))
            yield Drawable(np.array([0.5 * x, y, 0.0]), partial(_add_bar, image, camera, rail, 0.05, (steel, steel)))
