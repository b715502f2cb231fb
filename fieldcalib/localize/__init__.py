"""From images to labelled pixels: a segmentation network, and points selected from its class probabilities.

    network = SegmentationNetwork.load()
    (found,) = localize(soccer(), [image], network)
    calibration = calibrate_from_segments(soccer(), found.pixels, image.shape[1::-1], weights=found.weights)

`ridge_points` (sub-pixel, the default) and `skeleton_points` (the paper's) select the points.
"""

from fieldcalib.localize.flow import Network, localize
from fieldcalib.localize.grid import BACKGROUND, Localization
from fieldcalib.localize.network import SegmentationNetwork
from fieldcalib.localize.ridges import ridge_points
from fieldcalib.localize.skeletons import skeleton_points

__all__ = [
    "BACKGROUND",
    "Localization",
    "Network",
    "SegmentationNetwork",
    "localize",
    "ridge_points",
    "skeleton_points",
]
