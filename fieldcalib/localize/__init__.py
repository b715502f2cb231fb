"""From images to labelled pixels: a segmentation network, and points on what it sees.

    network = SegmentationNetwork.load()
    (found,) = localize(soccer(), [image], network)
    calibration = calibrate_from_segments(soccer(), found.pixels, image.shape[1::-1], weights=found.weights)

`ridge_points` and `skeleton_points` select the points: ours, to fractions of a pixel, and the paper's.
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
