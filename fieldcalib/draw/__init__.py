"""Pictures: markings and labelled pixels drawn onto an image, and the field from above.

Images are OpenCV's: uint8, (height, width, 3), blue, green, red. Every function returns a new image.
"""

from fieldcalib.draw.overlays import (
    add_minimap,
    draw_calibration,
    draw_field,
    draw_minimap,
    draw_segments,
    label_colour,
)
from fieldcalib.draw.scene import render_field

__all__ = [
    "add_minimap",
    "draw_calibration",
    "draw_field",
    "draw_minimap",
    "draw_segments",
    "label_colour",
    "render_field",
]
