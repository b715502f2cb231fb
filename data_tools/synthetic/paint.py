"""The lines, areas and marks of a field, in their widths and colours, onto a ground of any kind."""

from __future__ import annotations

import colorsys
from dataclasses import replace

import numpy as np

from data_tools.synthetic.colours import Hsv, noise_at, one_of, random_colour
from data_tools.synthetic.looks import Look
from data_tools.synthetic.surroundings import reaches
from fieldcalib._types import Float32
from fieldcalib.draw.ground import Ground, bgr, mix, painted
from fieldcalib.draw.scene import Colour
from fieldcalib.fields.field import Field
from fieldcalib.fields.traits import WHITE

HUE, SHADE = 8.0, 0.12  # largest deviations of paint from its colour: hue in degrees; saturation and value


def paint_areas(picture: Float32, ground: Ground, field: Field, look: Look, rng: np.random.Generator) -> None:
    """Paint keys, goal areas, creases and the like, in place."""
    for fill in look.fills(field):
        colour = random_colour(rng, *one_of(fill.colours, rng))
        if rng.random() < fill.share:
            mix(picture, colour, fill.opacity * fill.area.share(ground))


def paint_lines(picture: Float32, ground: Ground, field: Field, look: Look, rng: np.random.Generator) -> None:
    """Paint lines, marks and spots, in place, fresh or worn; other colours than white are about those of the rules."""
    opacity = np.full_like(ground.xy[0], rng.uniform(0.75, 1.0))
    if rng.random() < 0.4:
        x, y = ground.xy
        opacity *= np.clip(0.92 + 0.12 * noise_at(x, y, rng.uniform(0.05, 0.5), rng), 0.4, 1.0)
    usual = one_of(look.colours, rng)
    shades = np.random.default_rng(rng.integers(1 << 32))  # the number of draws depends on what is in view
    for colour, cover in coverage(ground, field, look).items():
        mix(picture, _shade(colour, usual, shades), opacity * cover)


def coverage(ground: Ground, field: Field, look: Look) -> dict[str, Float32]:
    """Share of every pixel that is covered by the paint of each colour (`fieldcalib.fields.traits.Paint`).

    Examples
    --------
    >>> from fieldcalib import Camera
    >>> from fieldcalib.draw.ground import rays
    >>> from fieldcalib.fields.sports.ice_hockey import ice_hockey
    >>> from data_tools.synthetic.looks import LOOKS
    >>> camera = Camera.from_angles(0.0, 1.2, 0.0, 300.0, C=(0.0, 30.0, -15.0), image_size=(320, 180))
    >>> sorted(coverage(Ground.of_rays(camera, rays(camera)), ice_hockey("nhl"), LOOKS["ice-hockey-nhl"]))
    ['#1040a8', '#c8102e', '#e3b92c']
    """
    low, high = np.nanmin(ground.xy, axis=(1, 2)) - 1.0, np.nanmax(ground.xy, axis=(1, 2)) + 1.0
    everything = with_marks(field, look)
    far = max((abs(paint.outwards) for paint in everything.paint.values()), default=0.0)
    in_view = {label: one for label, one in everything.items() if reaches(one, low - 2.0 * far, high + 2.0 * far)}
    return painted(ground, replace(everything, segments=in_view, halves={}, size_model=None))


def with_marks(field: Field, look: Look) -> Field:
    """The field with the unlabelled marks of its look, and without halves of circles."""
    marks = look.marks(field)
    lines = {label: segment for label, segment in field.items() if label not in field.half_labels}
    return replace(
        field,
        segments={**lines, **{label: segment for label, (segment, _) in marks.items()}},
        paint={**field.paint, **{label: paint for label, (_, paint) in marks.items()}},
        halves={},
        size_model=None,
    )


def _shade(colour: str, usual: Hsv, rng: np.random.Generator) -> Colour:
    """A colour near the one of the rules; for white, one of the `usual` colours of lines."""
    if colour == WHITE:
        return random_colour(rng, *usual)
    blue, green, red = bgr(colour)
    h, s, v = colorsys.rgb_to_hsv(red / 255.0, green / 255.0, blue / 255.0)
    near = [(max(x - SHADE, 0.0), min(x + SHADE, 1.0)) for x in (s, v)]
    return random_colour(rng, (360.0 * h - HUE, 360.0 * h + HUE), *near)
