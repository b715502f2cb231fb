"""Markings, labelled pixels and calibrations drawn onto an image.

Images are OpenCV's: uint8, (height, width, 3), blue, green, red. Every function returns a new image.
"""

from __future__ import annotations

from collections.abc import Mapping
from reprlib import repr as short
from types import MappingProxyType
from typing import Any
from zlib import crc32

import numpy as np

from fieldcalib._types import CAMERA, Array, expect, is_number, listed, positive, real_array, truth
from fieldcalib.assess.result import Calibration
from fieldcalib.draw.ground import COLOURS, Colour
from fieldcalib.draw.minimap import DARK, inset_map
from fieldcalib.draw.scene import SHIFT, dashes, draw_dot, draw_text, fixed_point, image_curves_of, text_size, wrapped
from fieldcalib.fields.field import Field, ObjectSegments, terrain_of
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.image_files import Image, checked_image
from fieldcalib.problem.labelled_pixels import ImageSegments, check_object

MAGENTA: Colour = (220, 40, 255)
ORANGE: Colour = (0, 140, 255)  # markings that lie beside their paint
GREY: Colour = (170, 170, 170)  # markings without paint
NO_COLOURS: Mapping[str, Colour] = MappingProxyType({})
THICKEST = 32767  # of OpenCV
DASH = 6.0  # length of dashes and of gaps, in thicknesses of the line
PALETTE = tuple(COLOURS["labels"].values())
PALETTE_SALT = 1952  # chosen so that neighbouring labels of a soccer field have different colours


def draw_field(
    image: Image,
    camera: Camera,
    object_segments: ObjectSegments,
    *,
    colour: Colour = MAGENTA,
    thickness: int = 2,
    dashed: bool = False,
    colours: Mapping[str, Colour] = NO_COLOURS,
) -> Image:
    """Draw the projected markings, with distortion, onto a copy of an image.

    Lines, arcs and ordered point clouds become anti-aliased curves, unordered clouds become dots. Points are left out,
    but of a `Field` that has nothing else they are dots with their names.
    Segments of a `Field` without paint along them (rows of marks, edges of wide lines) are drawn darker.
    Parts behind the camera, or so far out that the lens is not monotone, have no image and are not drawn.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        In OpenCV's order: blue, green, red. It is not changed.
    camera : Camera
        A camera of that image size, e.g. from `fieldcalib.io.soccernet.parse_camera`. Of one that is not
        `checked`, parts where the lens folds back are drawn too: where it does is unknown.
    object_segments : mapping of str to segment
        The calibration object, e.g. a `Field`.
    colour : (int, int, int)
        Blue, green, red.
    thickness : int
        Pixels.
    dashed : bool
        Whether curves are dashed: for cameras that should not be used.
    colours : mapping of str to (int, int, int)
        Colours of some labels, instead of `colour`.

    Returns
    -------
    (height, width, 3) uint8 array

    Raises
    ------
    ValueError
        If the image is not uint8, has no three channels, or is not of the camera's size.

    Examples
    --------
    >>> from fieldcalib.fields.sports.soccer import soccer
    >>> camera = Camera.from_angles(0.0, np.radians(75), 0.0, 1500.0, C=(0, 56, -15), image_size=(960, 540))
    >>> picture = draw_field(np.zeros((540, 960, 3), np.uint8), camera, soccer(), colour=(0, 255, 255))
    >>> picture[269, 480].tolist()  # the centre mark, on the middle line
    [0, 255, 255]
    """
    import cv2

    picture = np.array(checked_image(image, expect(camera, Camera, CAMERA).image_size), order="C")
    check_object(object_segments)
    expect(colours, Mapping, '{"Middle line": (0, 0, 255)}')
    truth(dashed, "dashed")
    if not isinstance(thickness, int | np.integer) or isinstance(thickness, bool) or not 1 <= thickness <= THICKEST:
        raise ValueError(f"thickness must be a whole number of pixels, 1 to {THICKEST}, got {thickness!r}")
    for one in (colour, *colours.values()):
        if len(listed(one, "a colour (blue, green, red)")) != 3 or not all(map(is_number, one)):
            raise ValueError(f"expected a colour (blue, green, red), got {short(one)}")
    dark: Colour = (colour[0] // 2, colour[1] // 2, colour[2] // 2)
    rows = [
        label
        for label in object_segments
        if isinstance(object_segments, Field) and not object_segments.paint_of(label).is_along
    ]
    labels = sorted(object_segments, key=rows.__contains__, reverse=True)  # lines over rows
    segments = [object_segments[label] for label in labels]
    terrain = terrain_of(object_segments)
    for label, segment, curves in zip(labels, segments, image_curves_of(camera, segments, terrain), strict=True):
        shade = colours.get(label, dark if label in rows else colour)
        if not (segment.is_curve or segment.is_point):
            X = segment.sample()
            for xy in camera.project(X if terrain is None else terrain.raised(X)):
                draw_dot(picture, xy, float(thickness), shade)
        else:
            parts = (
                [part for curve in curves for part in dashes(curve, DASH * thickness)]
                if truth(dashed, "dashed")
                else curves
            )
            cv2.polylines(picture, [fixed_point(part) for part in parts], False, shade, thickness, cv2.LINE_AA, SHIFT)
    if isinstance(object_segments, Field) and not object_segments.markings:
        points = np.concatenate([np.empty((0, 3)), *(segment.sample() for segment in segments)])
        places = camera.project(points if terrain is None else terrain.raised(points))
        pixels = {label: xy[None] for label, xy in zip(labels, places, strict=True)}
        for xy in places:
            draw_dot(picture, xy, 2.0 * thickness, colour)
        _write_names(picture, pixels, 4.0 * max(1.0, thickness / 2.0))
    return picture


def draw_segments(image: Image, image_segments: ImageSegments, *, radius: float = 4.0, names: bool = True) -> Image:
    """Draw labelled pixels onto a copy of an image: dots with a dark rim, one colour per label, and its name.

    A label has the same colour in every image: it does not depend on the other labels.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        In OpenCV's order: blue, green, red. It is not changed.
    image_segments : mapping of str to (N, 2) array_like
        Pixels (x, y) of each visible segment.
    radius : float
        Radius of the dots in pixels; the size of the names is proportional to it.
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
    picture = np.array(checked_image(image), order="C")
    if positive(radius, "radius") > THICKEST:
        raise ValueError(f"radius must be at most {THICKEST} pixels, got {radius}")
    pixels = {}
    for label, values in expect(image_segments, Mapping, '{"Middle line": [(480, 100), (490, 400)]}').items():
        xy = real_array(values)
        if xy.size and (xy.ndim != 2 or xy.shape[1] != 2):
            raise ValueError(f"{label!r}: expected pixels of shape (N, 2), got {xy.shape}")
        pixels[expect(label, str, '"Middle line"').strip()] = xy.reshape(-1, 2)
    for label, xy in pixels.items():
        for pixel in xy:
            draw_dot(picture, pixel, radius + max(1.0, 0.3 * radius), DARK)
            draw_dot(picture, pixel, radius, label_colour(label))
    if truth(names, "names"):
        _write_names(picture, pixels, radius)
    return picture


def label_colour(label: str) -> Colour:
    """The colour (blue, green, red) in which a label is drawn: a function of its name alone.

    Examples
    --------
    >>> label_colour("Goal left post left ") == label_colour("Goal left post left")
    True
    """
    return PALETTE[
        crc32(expect(label, str, "'Middle line'").strip().encode(errors="replace"), PALETTE_SALT) % len(PALETTE)
    ]


def draw_calibration(
    image: Image, calibration: Calibration, field: Field | None = None, *, show_paint: bool = False
) -> Image:
    """Draw a calibration onto a copy of its image: the projected markings, and a map in a corner.

    If it is not accepted, its markings are dashed, and its status and the reason are written instead of the map.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        In OpenCV's order: blue, green, red. It is not changed.
    calibration : Calibration
        The calibration of this image.
    field : Field, optional
        By default the calibration's own.
    show_paint : bool
        Whether markings that lie beside their paint are drawn in orange, and those without any in grey
        (`Calibration.markings`).

    Returns
    -------
    (height, width, 3) uint8 array

    Raises
    ------
    ValueError
        As in `draw_field`.

    Examples
    --------
    >>> from fieldcalib import Status, soccer
    >>> image = np.zeros((540, 960, 3), np.uint8)
    >>> nothing = Calibration.without_camera(Status.TOO_FEW_SEGMENTS, "no labelled pixels")
    >>> bool(draw_calibration(image, nothing, soccer())[:450].any())  # the status is written below
    False
    """
    expect(calibration, Calibration, "that of calibrate_from_segments")
    truth(show_paint, "show_paint")
    shown: Any = calibration.field if field is None else field
    (height, width), camera, accepted = checked_image(image).shape[:2], calibration.camera, calibration.accepted
    if camera is not None or shown is not None:
        check_object(shown)
    if camera is None:
        picture = np.array(image, order="C")
    else:
        colours = {one.label: ORANGE if one.is_displaced else GREY for one in calibration.markings if one.is_off}
        thickness = max(1, round(height / 540.0))
        picture = draw_field(
            image, camera, shown, thickness=thickness, dashed=not accepted, colours=colours if show_paint else {}
        )
        if accepted:
            inset_map(picture, camera, shown)
            return picture
    scale = min(height, 1.5 * width) / 900.0
    margin, reason = round(20.0 * scale), calibration.message.partition(";")[0]
    lines = wrapped(f"no camera: {calibration.status}, {reason}", scale, width - 2 * margin)
    for row, line in enumerate(reversed(lines)):
        _write(picture, line, (margin, height - round((20.0 + 40.0 * row) * scale)), scale, (255, 255, 255))
    return picture


def _write_names(picture: Image, pixels: dict[str, Array], radius: float) -> None:
    """Write each label beside its first pixel, at the first place inside the image without dots and other names."""
    size, scale = np.array(picture.shape[1::-1]), 0.1 * radius
    dots = np.concatenate([np.empty((0, 2)), *pixels.values()])
    taken = np.concatenate([dots - radius, dots + radius], axis=1)
    for label, xy in pixels.items():
        inside = np.all((xy >= 0.0) & (xy < size), axis=-1)
        if not inside.any():
            continue
        x, y = xy[inside][0]
        width, height, below = text_size(label, scale)
        beside = (x + 2.0 * radius, x - 2.0 * radius - width)
        rows = y + height * (0.5 + 1.6 * np.array([0, -1, 1, -2, 2, -3, 3]))
        corners = np.stack(np.meshgrid(beside, rows), axis=-1).reshape(-1, 2)
        boxes = np.column_stack([corners[:, 0], corners[:, 1] - height, corners[:, 0] + width, corners[:, 1] + below])
        fits = np.all((boxes[:, :2] >= 0.0) & (boxes[:, 2:] <= size), axis=1)
        apart = (boxes[:, None, :2] >= taken[:, 2:]) | (boxes[:, None, 2:] <= taken[:, :2])
        best = int(np.argmax(fits & np.all(np.any(apart, axis=-1), axis=1)))
        taken = np.concatenate([taken, boxes[best : best + 1]])
        left, bottom = np.rint(corners[best]).astype(int).tolist()
        blue, green, red = ((channel + 255) // 2 for channel in label_colour(label))
        _write(picture, label, (left, bottom), scale, (blue, green, red))


def _write(picture: Image, text: str, place: tuple[int, int], scale: float, colour: Colour) -> None:
    """Write text with a dark outline; its lower left corner is at `place`."""
    x, y = place
    for around in ((x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)):  # thick strokes are wider in OpenCV 5 than in 4
        draw_text(picture, text, around, scale, DARK)
    draw_text(picture, text, place, scale, colour)
