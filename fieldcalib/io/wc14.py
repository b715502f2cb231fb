"""Homographies of others: ``<id>.homographyMatrix``, nine numbers in three lines, as `numpy.loadtxt` reads them.

The World Cup 2014 data set has one for each frame: it maps pixels of the 1280 x 720 image to the field in yards, origin
at the far left corner, y towards the camera. Its template measures 115 x 74 yards (105.16 x 67.67 m), as the paper has
it; KpSFR takes 114.83 x 74.37 yards (105.00 x 68.00 m) for the same files, 0.16 m less in length and 0.34 m more in
width. Files of Chen's and of Jiang's systems have other axes, see `fieldcalib.geometry.homography.ALIGNMENTS`.
"""

from __future__ import annotations

import io
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array, one_of
from fieldcalib.geometry.camera import checked_image_size
from fieldcalib.geometry.homography import ALIGNMENTS, SINGULAR, Alignment, finite_homography
from fieldcalib.io.files import BrokenFileError

AlignmentName: TypeAlias = Literal["wc14", "chen", "jiang"]

IMAGE_SIZE = (1280, 720)  # of the data set's images, which the files are for


def parse_homography(
    content: bytes | str, alignment: AlignmentName = "wc14", *, image_size: tuple[int, int] = IMAGE_SIZE
) -> Array:
    """The homography of a file, in this package's sense.

    Parameters
    ----------
    content : bytes or str
        The file's text.
    alignment : {"wc14", "chen", "jiang"}
        Data set or method whose axes the file has.
    image_size : (int, int)
        Width and height of the images that the homography shall be for, pixels; the file's is for 1280 x 720.

    Returns
    -------
    (3, 3) array
        Maps field points (x, y, 1) in metres, origin at the centre mark, y towards the camera, to pixels, up to scale
        and sign.

    Raises
    ------
    BrokenFileError
        If the content is not three lines of three finite numbers, or the matrix is singular.
    ValueError
        If there is no such alignment.

    Examples
    --------
    >>> H = parse_homography("0.1 0 0\\n0 0.1 0\\n0 0 1")  # ten pixels a yard
    >>> (H @ [0.0, 0.0, 1.0] / H[2, 2]).round(9)  # the centre mark
    array([575., 370.,   1.])
    """
    try:
        text = content if isinstance(content, str) else content.decode("utf-8-sig")
        rows = [[float(number) for number in line.split()] for line in text.splitlines() if line.strip()]
    except ValueError as error:
        raise BrokenFileError(f"is no matrix: {error}") from None
    return np.asarray(_resize(IMAGE_SIZE, image_size) @ _alignment(alignment).to_fieldcalib(checked_homography(rows)))


def format_homography(
    H: ArrayLike, alignment: AlignmentName = "wc14", *, image_size: tuple[int, int] = IMAGE_SIZE
) -> str:
    """The text of a homography file, the inverse of `parse_homography` up to scale and sign."""
    text = io.StringIO()
    np.savetxt(
        text, _alignment(alignment).from_fieldcalib(_resize(image_size, IMAGE_SIZE) @ np.asarray(H, dtype=float))
    )
    return text.getvalue()


def _resize(old: tuple[int, int], new: tuple[int, int]) -> Array:
    """Pixels of an image to pixels of the same image resized."""
    return np.diag([*np.divide(checked_image_size(new), checked_image_size(old)), 1.0])


def checked_homography(values: ArrayLike) -> Array:
    """An invertible matrix (3, 3) of finite numbers.

    Raises
    ------
    BrokenFileError
        If it is no such matrix.
    """
    try:
        H = finite_homography(values)
    except ValueError as error:
        raise BrokenFileError(str(error)) from None
    if np.linalg.cond(H) > SINGULAR:
        raise BrokenFileError("the homography is singular: it maps the image to a line or a point")
    return H


def _alignment(name: str) -> Alignment:
    return ALIGNMENTS[one_of(name, ALIGNMENTS, "alignment")]
