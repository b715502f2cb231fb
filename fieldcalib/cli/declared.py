"""Options for pictures that are not whole frames with square pixels (`fieldcalib.assess.placement`)."""

from __future__ import annotations

import argparse
import re
from dataclasses import dataclass

import numpy as np

from fieldcalib.assess.placement import Crop, Placement
from fieldcalib.assess.whole_picture import Declared
from fieldcalib.console.arguments import image_size
from fieldcalib.console.options import option
from fieldcalib.console.parser import did_you_mean
from fieldcalib.io.files import BrokenFileError
from fieldcalib.io.intrinsics import Intrinsics
from fieldcalib.run_folder.options import ESTIMATED
from fieldcalib.solve.squashed_pictures import LEAST_RATIO, shown_as

SQUARE = "square"


def crop(text: str) -> Crop:
    """Parse "WIDTHxHEIGHT+X+Y", for argparse.

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
    """Parse "estimated", "square" or "16:9", for argparse.

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
        hint = did_you_mean(text, (ESTIMATED, SQUARE))
        raise argparse.ArgumentTypeError(f"expected {ESTIMATED}, {SQUARE} or width:height as 16:9, got {text!r}{hint}")
    return ratio


@dataclass(frozen=True)
class DeclaredPictures:
    """Options that say how pictures lie in whole frames with square pixels."""

    display_size: tuple[int, int] | None = option(
        "at which the pictures are shown, if their pixels are not square: 1920x1080 for a broadcast that was squashed "
        "to 640x640 (that of the pictures)",
        exclusive="pixels",
        type=image_size,
        metavar="WxH",
    )
    aspect: str | float = option(
        "estimated: pictures of another shape than 16:9 were squashed from it where their lines say so (default); "
        "square: their pixels are square; 16:9: they are shown like that",
        default=ESTIMATED,
        exclusive="pixels",
        type=aspect,
        metavar="estimated|square|W:H",
    )
    """`ESTIMATED`, `SQUARE`, or width / height as shown."""
    crop_of: Crop | None = option(
        "the pictures are parts of frames of this size, where their upper left corners are at X, Y; in pixels as "
        "shown; their own size with +0+0 says that nothing is cut off (where their lines do not tell, that is asked)",
        type=crop,
        metavar="WxH+X+Y",
    )
    intrinsics: Intrinsics | None = None
    """Known intrinsics of the camera."""

    @property
    def is_aspect_estimated(self) -> bool:
        """Whether nothing is declared that says how pixels are shown."""
        return self.aspect == ESTIMATED and not self._are_placed

    @property
    def may_be_enlarged(self) -> bool:
        """Whether pictures may be enlarged parts of frames: not if they are placed in one, or resized."""
        return isinstance(self.aspect, str) and not self._are_placed

    @property
    def _are_placed(self) -> bool:
        """Whether it is declared where they lie in frames, how large they are shown, or what their camera is."""
        return self.display_size is not None or self.crop_of is not None or self.intrinsics is not None

    @property
    def declared(self) -> Declared:
        """Whether the frame, its pixels or nothing is declared."""
        if self.crop_of is not None:
            return Declared.FRAME
        return Declared.NOTHING if self.is_aspect_estimated else Declared.PIXELS

    def placement(self, size: tuple[int, int]) -> Placement:
        """Placement of pictures of a size in their frames.

        Raises
        ------
        BrokenFileError
            If they cannot be a part of the frame, or are wide and said to be shown upright.
        """
        display_size, part = self.display_size or self._shown_size(size), self.crop_of
        if self.display_size is not None and size[0] > size[1] and display_size[0] < display_size[1]:
            raise BrokenFileError(
                f"is wide, {size[0]}x{size[1]}, and --display-size upright, {display_size[0]}x{display_size[1]}: "
                f"it is width x height (--aspect says that upright pictures were stretched)"
            )
        if part is not None and np.any(np.add(part.corner, display_size) > part.frame_size):
            width, height = display_size
            raise BrokenFileError(f"does not fit, with {width} x {height} pixels, into the frame of --crop-of {part}")
        return Placement(size, display_size, part)

    def _shown_size(self, size: tuple[int, int]) -> tuple[int, int]:
        """The size at which pictures are shown with the declared aspect, no side being shortened."""
        if isinstance(self.aspect, str):
            return size
        return shown_as(size, self.aspect)
