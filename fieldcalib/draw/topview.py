"""The field as seen from above: the ground of a frame, or of many frames of a clip, in one picture.

Images are OpenCV's: uint8, (height, width, 3), blue, green, red.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from fieldcalib._types import CAMERA, FIELD, Array, BoolArray, expect, is_number, named, several
from fieldcalib.draw.scene import Colour
from fieldcalib.fields.field import Field, terrain_of
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.image_files import LONGEST_SIDE, Image, checked_image

ABOVE = 100.0  # m: height of the camera above the field; the picture of the ground does not depend on it
PIXELS_OF_SCALE = 400.0  # default length of `Field.scale` in the picture
COARSEST = 2.0  # m of ground per pixel of the image: coarser ground, towards the horizon, counts as unseen
EDGE = 2.0  # px: the outermost rows and columns of broadcasts are often dark
UNSEEN: Colour = (40, 36, 34)
ROWS_AT_ONCE = 32  # rows of all views of which the median is taken at a time
UNKNOWN = 256  # stands for unseen pixels: above all values


def overhead_camera(field: Field, metres_per_pixel: float | None = None, margin: float = 5.0) -> Camera:
    """A camera that looks down on a field: x to the right, the side of the main camera below.

    Parameters
    ----------
    field : Field
    metres_per_pixel : float, optional
        Scale on the ground. By default ``field.scale / 400``, to two digits: 0.1 on soccer pitches, 0.021 on tennis
        courts.
    margin : float
        Metres of ground around the field.

    Returns
    -------
    Camera
        Its `project` places points of the ground in the picture; `fieldcalib.draw.draw_field` draws the lines with it.

    Raises
    ------
    ValueError
        If the numbers are not positive (margin: negative), or the picture would have a side of more than 32766 pixels.

    Examples
    --------
    >>> from fieldcalib.fields.sports.soccer import soccer
    >>> overhead = overhead_camera(soccer(), margin=5.0)
    >>> overhead.image_size, overhead.project([0.0, 0.0, 0.0])
    ((1150, 780), array([574.5, 389.5]))
    """
    expect(field, Field, FIELD)
    if not is_number(margin) or not (metres_per_pixel is None or is_number(metres_per_pixel)):
        raise ValueError(f"expected numbers of metres, got {metres_per_pixel!r} and {margin!r}")
    if metres_per_pixel is None:
        metres_per_pixel = float(f"{field.scale / PIXELS_OF_SCALE:.1e}")
    if not (0.0 < metres_per_pixel < np.inf and 0.0 <= margin < np.inf):
        raise ValueError(f"expected positive metres per pixel and a margin, got {metres_per_pixel} and {margin}")
    lengths = [(side + 2.0 * float(margin)) / float(metres_per_pixel) for side in (field.length, field.width)]
    if max(lengths) > LONGEST_SIDE:
        raise ValueError(
            f"the picture would have {lengths[0]:.0f} x {lengths[1]:.0f} pixels, up to {LONGEST_SIDE} a side are drawn"
        )
    size = max(round(lengths[0]), 1), max(round(lengths[1]), 1)
    middle = (np.array(size) - 1.0) / 2.0
    return Camera.from_angles(0.0, 0.0, 0.0, ABOVE / metres_per_pixel, (0.0, 0.0, -ABOVE), size, middle)


def top_view(image: Image, camera: Camera, overhead: Camera, field: Field | None = None) -> tuple[Image, BoolArray]:
    """Warp the ground of an image to the view of a camera above the field; distortion is removed.

    Only the ground is in its place: players, goals and all else above it are smeared away from the camera.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        In OpenCV's order: blue, green, red.
    camera : Camera
        The camera of that image.
    overhead : Camera
        The view from above, e.g. of `overhead_camera`.
    field : Field, optional
        The field in view, whose ground may not be level.

    Returns
    -------
    picture : (height, width, 3) uint8 array
        Picture of the size of `overhead`; dark where nothing is seen.
    seen : (height, width) bool array
        Ground that the image shows with at most 2 m per pixel.

    Raises
    ------
    ValueError
        If the image is not of the camera's size, or not uint8 with three channels.

    Examples
    --------
    >>> from fieldcalib.draw.scene import render_field
    >>> from fieldcalib.fields.sports.soccer import soccer
    >>> camera = Camera.from_angles(0.0, np.radians(75), 0.0, 1500.0, C=(0, 56, -15), image_size=(960, 540))
    >>> picture, seen = top_view(render_field(camera, soccer()), camera, overhead_camera(soccer(), 0.2))
    >>> picture.shape, bool(seen[195, 287]), bool(seen[0, 0])
    ((390, 575, 3), True, False)
    """
    import cv2

    for one in (camera, overhead):
        expect(one, Camera, CAMERA)
    picture = checked_image(image, camera.image_size)
    X = overhead.image_to_field(np.stack(np.meshgrid(*map(np.arange, overhead.image_size)), axis=-1))
    terrain = terrain_of(field)
    xy = camera.project(X if terrain is None else terrain.raised(X))
    width, height = camera.image_size
    inside = np.all((xy >= EDGE - 0.5) & (xy <= (width - EDGE - 0.5, height - EDGE - 0.5)), axis=-1)
    seen = inside & (_metres_per_pixel(xy, overhead) < COARSEST)
    x, y = np.moveaxis(np.where(seen[..., None], xy, -1.0).astype(np.float32), -1, 0)
    warped = np.asarray(cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), dtype=np.uint8)
    return np.where(seen[..., None], warped, np.array(UNSEEN, np.uint8)), seen


def mosaic(
    views: Iterable[tuple[Image, Camera]], overhead: Camera, field: Field | None = None
) -> tuple[Image, BoolArray]:
    """Combine many images of a field into one top view: the median colour at each place.

    Moving objects disappear where more than half of the views show the ground. All views are held in memory, four
    bytes per pixel of the picture.

    Parameters
    ----------
    views : iterable of (image, Camera)
        Images of one field, with their cameras; a generator will do.
    overhead : Camera
        The view from above, e.g. of `overhead_camera`.
    field : Field, optional
        The field, whose ground may not be level.

    Returns
    -------
    picture, seen
        As in `top_view`; seen is the ground that at least one view shows.

    Raises
    ------
    ValueError
        If there is no view, or as in `top_view`.

    Examples
    --------
    Two halves of a field:

    >>> from fieldcalib.draw.scene import render_field
    >>> from fieldcalib.fields.sports.soccer import soccer
    >>> pans = [Camera.from_angles(pan, 1.3, 0.0, 700.0, (0, 60, -18), (960, 540)) for pan in (-0.4, 0.4)]
    >>> overhead = overhead_camera(soccer(), 0.5)
    >>> _, seen = mosaic(((render_field(camera, soccer()), camera) for camera in pans), overhead)
    >>> bool(seen[78, 40]), bool(seen[78, 190])
    (True, True)
    """
    pictures, masks = [], []
    for view in several(views, "pictures with their cameras"):
        if not (isinstance(view, tuple | list) and len(view) == 2):
            raise ValueError(f"expected pairs (picture, camera), got {named(view)}")
        image, camera = view
        picture, seen = top_view(image, camera, overhead, field)
        pictures.append(picture)
        masks.append(seen)
    if not pictures:
        raise ValueError("expected at least one image with its camera")
    result = np.empty_like(pictures[0])
    for row in range(0, len(result), ROWS_AT_ONCE):
        rows = slice(row, row + ROWS_AT_ONCE)
        seen = np.array([mask[rows] for mask in masks])
        values = np.where(seen[..., None], np.array([picture[rows] for picture in pictures]), np.int16(UNKNOWN))
        values.sort(axis=0)  # unseen ones come last
        count = seen.sum(axis=0)
        low, high = (
            np.take_along_axis(values, index[None, ..., None], axis=0)[0]
            for index in (np.maximum(count - 1, 0) // 2, count // 2)
        )
        median = (low + high + 1) // 2
        result[rows] = np.where((count > 0)[..., None], median, np.array(UNSEEN, np.int16))
    return result, np.any(masks, axis=0)


def _metres_per_pixel(xy: Array, overhead: Camera) -> Array:
    """Largest extent on the ground of a pixel of the image, (height, width) metres.

    NaN beside pixels of the picture that the image does not show.
    """
    if min(xy.shape[:2]) < 2:
        raise ValueError(f"expected a picture of 2 x 2 pixels or more, got {overhead.image_size}")
    down, across = (np.gradient(xy, axis=axis) for axis in (0, 1))  # pixels of the image for each of the picture
    area = np.abs(across[..., 0] * down[..., 1] - across[..., 1] * down[..., 0])
    longest = np.sqrt(np.sum(across**2 + down**2, axis=-1))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(-overhead.C[2] / overhead.focal_length * longest / area)
