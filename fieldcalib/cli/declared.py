"""Pictures that are not whole frames with square pixels: what the user declares, and the way to such a frame and back.

A camera is calibrated in a frame with square pixels and the principal point near the middle. A squashed picture is
stretched to that, a cropped one put in its place; the camera found there is then expressed in the picture's own pixels.
"""

from __future__ import annotations

import argparse
import re
from dataclasses import dataclass, replace

import numpy as np

from fieldcalib._types import Array
from fieldcalib.assess.result import Calibration
from fieldcalib.cli.arguments import image_size
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.image import Image
from fieldcalib.problem.labelled_pixels import Pixels

ESTIMATED, SQUARE = "estimated", "square"
LEAST_RATIO = 0.2  # of width and height: no picture is narrower


@dataclass(frozen=True)
class Crop:
    """A part of a frame."""

    frame_size: tuple[int, int]
    corner: tuple[int, int]
    """Pixel of the frame that is the part's first one."""

    def __str__(self) -> str:
        """As on the command line."""
        (width, height), (x, y) = self.frame_size, self.corner
        return f"{width}x{height}+{x}+{y}"


def crop(text: str) -> Crop:
    """What "WIDTHxHEIGHT+X+Y" says, for argparse.

    Examples
    --------
    >>> crop("1920x1080+960+0")
    Crop(frame_size=(1920, 1080), corner=(960, 0))
    """
    found = re.fullmatch(r"([0-9]+x[0-9]+)\+([0-9]+)\+([0-9]+)", text.lower())
    if found is None:
        raise argparse.ArgumentTypeError(f"expected WIDTHxHEIGHT+X+Y, as 1920x1080+960+0, got {text!r}")
    return Crop(image_size(found[1]), (int(found[2]), int(found[3])))


def aspect(text: str) -> str | float:
    """What "estimated", "square" or "16:9" says, for argparse.

    Examples
    --------
    >>> aspect("square"), aspect("3:2"), aspect("1.5")
    ('square', 1.5, 1.5)
    """
    if text in (ESTIMATED, SQUARE):
        return text
    found = re.fullmatch(r"([0-9]+(?:\.[0-9]+)?)(?::([0-9]+(?:\.[0-9]+)?))?", text)
    ratio = float(found[1]) / (float(found[2] or 1.0) or np.inf) if found else 0.0
    if not LEAST_RATIO <= ratio <= 1.0 / LEAST_RATIO:
        raise argparse.ArgumentTypeError(f"expected {ESTIMATED}, {SQUARE} or width:height as 16:9, got {text!r}")
    return ratio


def add_declarations(parser: argparse.ArgumentParser) -> None:
    """--display-size or --aspect, and --crop-of."""
    pixels = parser.add_mutually_exclusive_group()
    pixels.add_argument(
        "--display-size",
        type=image_size,
        metavar="WxH",
        help="at which the pictures are shown, if their pixels are not square: 1920x1080 for a broadcast that was "
        "squashed to 640x640 (that of the pictures)",
    )
    pixels.add_argument(
        "--aspect",
        type=aspect,
        default=ESTIMATED,
        metavar="estimated|square|W:H",
        help="estimated: pictures of another shape than 16:9 were squashed from it where their lines say so (default); "
        "square: their pixels are square; 16:9: they are shown like that",
    )
    parser.add_argument(
        "--crop-of",
        type=crop,
        metavar="WxH+X+Y",
        help="the pictures are parts of frames of this size, where their upper left corners are at X, Y; in pixels as "
        "shown (the pictures are whole frames)",
    )


def is_aspect_estimated(options: argparse.Namespace) -> bool:
    """Whether nothing is declared that says how pixels are shown."""
    known = options.display_size, options.crop_of, options.intrinsics
    return bool(options.aspect == ESTIMATED and all(one is None for one in known))


def _of_ratio(ratio: str | float, size: tuple[int, int]) -> tuple[int, int]:
    """At which size pictures of a size are shown, no side being shortened."""
    if isinstance(ratio, str):
        return size
    width, height = size
    return (round(ratio * height), height) if ratio * height >= width else (width, round(width / ratio))


@dataclass(frozen=True)
class Placement:
    """Where pictures of one size lie in their frame: ``xy_frame = scale * xy + corner``.

    Examples
    --------
    The right half of a frame of 1920 x 1080, squashed to a square:

    >>> placement = Placement((540, 540), (960, 1080), Crop((1920, 1080), (960, 0)))
    >>> placement.frame_size, placement.to_frame({"Middle line": [(10.0, 20.0)]})
    ((1920, 1080), {'Middle line': array([[977.77777778,  40.        ]])})
    """

    size: tuple[int, int]
    """Of the pictures."""
    display_size: tuple[int, int]
    """At which their pixels are square."""
    crop: Crop | None

    @classmethod
    def declared(cls, options: argparse.Namespace, size: tuple[int, int]) -> Placement:
        """What the options say of pictures of a size.

        Raises
        ------
        BrokenFileError
            If they cannot be a part of the frame.
        """
        display_size, part = options.display_size or _of_ratio(options.aspect, size), options.crop_of
        if part is not None and np.any(np.add(part.corner, display_size) > part.frame_size):
            width, height = display_size
            raise BrokenFileError(f"does not fit, with {width} x {height} pixels, into the frame of --crop-of {part}")
        return cls(size, display_size, part)

    @property
    def frame_size(self) -> tuple[int, int]:
        """Width and height of the frame."""
        return self.display_size if self.crop is None else self.crop.frame_size

    @property
    def is_whole(self) -> bool:
        """Whether pictures are frames as they are."""
        return self.size == self.display_size == self.frame_size

    @property
    def scale(self) -> Array:
        """Pixels as shown for each of the picture's, along x and y."""
        return np.divide(self.display_size, self.size)

    @property
    def corner(self) -> tuple[int, int]:
        """Pixel of the frame that is the picture's first one."""
        return (0, 0) if self.crop is None else self.crop.corner

    def to_frame(self, pixels: Pixels) -> Pixels:
        """Labelled pixels of a picture in the frame."""
        return {label: self.scale * xy + self.corner for label, xy in pixels.items()}

    def image_in_frame(self, image: Image) -> Image:
        """The frame with the picture in its place, black elsewhere."""
        import cv2

        if self.is_whole:
            return image
        # not cv2.resize, which maps corners of pixels: (0, 0) is the middle of the first one
        M = np.column_stack([np.diag(self.scale), self.corner])
        return np.asarray(cv2.warpAffine(image, M, self.frame_size, flags=cv2.INTER_LINEAR), dtype=np.uint8)

    def from_frame(self, calibration: Calibration) -> Calibration:
        """A calibration of the frame with its cameras in the picture's pixels, and its errors in the frame's."""
        if self.is_whole or calibration.camera is None:
            return calibration
        others = tuple(map(self._camera, calibration.alternatives))
        return replace(calibration, camera=self._camera(calibration.camera), alternatives=others)

    def _camera(self, camera: Camera) -> Camera:
        return camera.cropped(self.corner, self.display_size).scaled(self.size)
