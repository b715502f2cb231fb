"""A sheet of many frames of a clip, and the choice of the worst ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fieldcalib._types import expect, listed, whole_number
from fieldcalib.assess.result import Calibration
from fieldcalib.draw.scene import Colour, draw_text, wrapped
from fieldcalib.io.image_files import LONGEST_SIDE, Image, checked_image

BACKGROUND: Colour = (30, 27, 25)
CAPTION, TITLE = 0.45, 0.8  # scales of OpenCV's font
GAP, CAPTION_HEIGHT, TITLE_HEIGHT = 14, 30, 36  # px
LINE_HEIGHT, INDENT = 18, 2  # px: height of each further line of a caption, space to the left of captions


def contact_sheet(
    pictures: Sequence[Image], captions: Sequence[str], *, columns: int = 3, width: int = 480, title: str = ""
) -> Image:
    """Arrange reduced pictures in rows, each with its caption below.

    Parameters
    ----------
    pictures : sequence of (height, width, 3) uint8 arrays
        In OpenCV's order: blue, green, red. Each is fitted into a tile of the shape of the first one.
    captions : sequence of str
        One per picture; broken between words into as many lines as fit the tile.
    columns : int
        Tiles in a row.
    width : int
        Width of a tile, pixels.
    title : str
        A line above the tiles.

    Returns
    -------
    (..., ..., 3) uint8 array

    Raises
    ------
    ValueError
        If there is no picture, the numbers of pictures and captions differ, or a picture is not uint8 or has no three
        channels.

    Examples
    --------
    >>> frame = np.zeros((540, 960, 3), np.uint8)
    >>> contact_sheet([frame] * 4, ["frame 0", "frame 7", "frame 12", "frame 15"], columns=2).shape
    (642, 1002, 3)
    """
    import cv2

    pictures, captions = list(listed(pictures, "pictures")), list(listed(captions, "captions"))
    if not pictures or len(pictures) != len(captions):
        raise ValueError(f"expected pictures with a caption each, got {len(pictures)} and {len(captions)} captions")
    for text in (title, *captions):
        expect(text, str, '"00:12"')
    columns = min(whole_number(columns, "columns", 1), len(pictures))
    if whole_number(width, "width", 1) * columns > LONGEST_SIDE:
        raise ValueError(f"expected a sheet at most {LONGEST_SIDE} pixels wide, got {columns} columns of {width}")
    width = int(width)
    first = checked_image(pictures[0])
    height = max(round(width * first.shape[0] / first.shape[1]), 1)
    top = GAP + TITLE_HEIGHT * bool(title)
    lines = [wrapped(caption, CAPTION, width - INDENT) for caption in captions]
    step = np.array([height + CAPTION_HEIGHT + LINE_HEIGHT * (max(map(len, lines)) - 1) + GAP, width + GAP])
    rows = -(-len(pictures) // columns)
    sheet = np.full((*(np.array([top, GAP]) + step * (rows, columns)), 3), BACKGROUND, np.uint8)
    draw_text(sheet, title, (GAP, 34), TITLE, (245, 245, 245))
    for index, (picture, caption) in enumerate(zip(pictures, lines, strict=True)):
        y, x = np.array([top, GAP]) + step * divmod(index, columns)
        picture = checked_image(picture)
        scale = min(width / picture.shape[1], height / picture.shape[0])
        size = max(round(scale * picture.shape[1]), 1), max(round(scale * picture.shape[0]), 1)
        tile = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
        left, above = x + (width - size[0]) // 2, y + (height - size[1]) // 2
        sheet[above : above + size[1], left : left + size[0]] = tile
        for row, line in enumerate(caption):
            place = (x + INDENT, y + height + 20 + LINE_HEIGHT * row)
            draw_text(sheet[:, : x + width], line, place, CAPTION, (205, 205, 205))
    return sheet


def worst_frames(calibrations: Sequence[Calibration | None], count: int = 12) -> list[int]:
    """The frames of a clip to look at first, worst first.

    Frames without camera come first, then those whose camera is not accepted, then by the largest distance of paint
    from its marking (`Calibration.markings`), then by the largest expected error in the part of the field in view
    (`fieldcalib.assess.probability.largest_error`). Neighbours of a chosen frame come after all others, so that one
    bad moment does not take all places; equally bad frames are spread over the clip.

    Parameters
    ----------
    calibrations : sequence of Calibration or None
        The calibrations of the frames in order, e.g. a `SequenceCalibration`; None is a frame without camera.
    count : int
        Number of frames to choose; all if there are fewer.

    Returns
    -------
    list of int
        Indices into `calibrations`.

    Raises
    ------
    ValueError
        If `count` is negative.

    Examples
    --------
    >>> from fieldcalib import Status
    >>> nothing = Calibration.without_camera(Status.TOO_FEW_SEGMENTS, "no labelled pixels")
    >>> worst_frames([nothing] * 100, 5)
    [0, 64, 32, 96, 16]
    """
    checked_calibrations(calibrations)
    count = whole_number(count, "count")
    bits = len(calibrations).bit_length()
    order = sorted(range(len(calibrations)), key=lambda index: f"{index:0{bits}b}"[::-1])  # by halves, quarters, ...
    left = sorted(order, key=lambda index: _rank(calibrations[index]))
    count = min(count, len(left))
    apart = len(left) // max(2 * count, 1)
    chosen: list[int] = []
    while len(chosen) < count:
        for index in left:
            if len(chosen) < count and all(abs(index - other) >= apart for other in chosen):
                chosen.append(index)
        left = [index for index in left if index not in chosen]
        apart //= 2
    return chosen


def checked_calibrations(calibrations: Sequence[Calibration | None]) -> None:
    """Raise a ValueError unless these are calibrations, some of which may be None."""
    for calibration in listed(calibrations, "calibrations"):
        if calibration is not None:
            expect(calibration, Calibration, "fieldcalib.calibrate_from_segments(...)")


def _rank(calibration: Calibration | None) -> tuple[int, float, float]:
    """Sort key of a frame: the smallest is the worst."""
    if calibration is None or calibration.camera is None:
        return 0, 0.0, 0.0
    off = max((one.offset for one in calibration.markings), default=0.0)
    error = np.nan if calibration.field is None else calibration.errors.largest_error(calibration.field)
    return (2 if calibration.accepted else 1), -off, -float(np.nan_to_num(error, nan=np.inf))
