"""Pictures: markings and labelled pixels drawn onto an image, the field from above, and clips at one glance.

Images are OpenCV's: uint8, (height, width, 3), blue, green, red. Every function returns a new image.
"""

from fieldcalib.draw.clip_plot import plot_sequence
from fieldcalib.draw.contact_sheet import contact_sheet, worst_frames
from fieldcalib.draw.minimap import add_minimap, draw_minimap, draw_players
from fieldcalib.draw.overlays import draw_calibration, draw_field, draw_segments, label_colour
from fieldcalib.draw.scene import render_field
from fieldcalib.draw.topview import mosaic, overhead_camera, top_view

__all__ = [
    "add_minimap",
    "contact_sheet",
    "draw_calibration",
    "draw_field",
    "draw_minimap",
    "draw_players",
    "draw_segments",
    "label_colour",
    "mosaic",
    "overhead_camera",
    "plot_sequence",
    "render_field",
    "top_view",
    "worst_frames",
]
