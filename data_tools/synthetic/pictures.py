"""Graphics that a broadcast draws onto its pictures."""

from __future__ import annotations

import string

import cv2
import numpy as np

from data_tools.synthetic.colours import vivid_colour
from fieldcalib._types import BoolArray
from fieldcalib.io.image_files import Image

FONT = cv2.FONT_HERSHEY_DUPLEX


def add_graphics(image: Image, rng: np.random.Generator) -> BoolArray:
    """Draw score, clock, logos and captions onto an image, in place; returns the mask of the pixels that they hide."""
    height, width = image.shape[:2]
    hidden = np.zeros((height, width), bool)
    if rng.random() < 0.65:  # the score, in a corner above
        x, y = int(rng.uniform(0.02, 0.1) * width), int(rng.uniform(0.03, 0.1) * height)
        if rng.random() < 0.15:
            x = int(rng.uniform(0.3, 0.8) * width)
        for _ in range(rng.integers(1, 5)):
            x = _caption(image, hidden, (x, y), rng.uniform(0.03, 0.14), rng.uniform(0.03, 0.06), rng)
    if rng.random() < 0.35:  # the channel's logo
        corner = int(rng.uniform(0.8, 0.92) * width), int(rng.choice((0.04, 0.88)) * height)
        _watermark(image, corner, rng.uniform(0.3, 0.5) * width / 512.0, rng)
    if rng.random() < 0.12:  # a caption below
        _caption(
            image, hidden, (int(rng.uniform(0.05, 0.3) * width), int(rng.uniform(0.75, 0.85) * height)), 0.5, 0.1, rng
        )
    if rng.random() < 0.12:  # a redacted or empty bar
        x, y = int(rng.uniform(0.0, 0.65) * width), int(rng.uniform(0.02, 0.1) * height)
        cv2.rectangle(image, (x, y), (x + width // 3, y + height // 12), (0, 0, 0), cv2.FILLED)
        hidden[y : y + height // 12, x : x + width // 3] = True
    if rng.random() < 0.04:  # letterbox
        rim = int(rng.uniform(0.03, 0.12) * height)
        image[:rim], image[height - rim :] = 0, 0
        hidden[:rim], hidden[height - rim :] = True, True
    return hidden


def _caption(
    image: Image, hidden: BoolArray, corner: tuple[int, int], wide: float, high: float, rng: np.random.Generator
) -> int:
    """Draw a filled box with words, in shares of the image; returns the x at which the next one may begin."""
    height, width = image.shape[:2]
    (x, y), w, h = corner, int(wide * width), int(high * height)
    box = image[y : y + h, x : x + w]
    opacity = rng.choice((1.0, 0.7))
    box[:] = (box + opacity * (np.array(vivid_colour(rng)) - box)).astype(np.uint8)
    cv2.putText(image, _word(rng), (x + 2, y + int(0.8 * h)), FONT, 0.025 * h, vivid_colour(rng), 1, cv2.LINE_AA)
    hidden[y : y + h, x : x + w] = True
    return x + w + int(rng.integers(0, 4))


def _watermark(image: Image, corner: tuple[int, int], scale: float, rng: np.random.Generator) -> None:
    """Draw translucent words, which hide nothing."""
    written = image.copy()
    cv2.putText(written, _word(rng), corner, FONT, scale, (245, 245, 245), 1, cv2.LINE_AA)
    image[:] = cv2.addWeighted(written, share := rng.uniform(0.3, 0.9), image, 1.0 - share, 0.0)


def _word(rng: np.random.Generator) -> str:
    return "".join(rng.choice(list(string.ascii_uppercase + string.digits + ":- "), size=rng.integers(2, 9)))
