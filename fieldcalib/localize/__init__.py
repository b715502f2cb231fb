"""Labelled pixels from images: a segmentation network, and points selected from its class probabilities.

    network = SegmentationNetwork.load()
    (found,) = localize(soccer(), [image], network)
    calibration = calibrate_from_segments(soccer(), found.pixels, image.shape[1::-1], weights=found.weights)

`ridge_points` (sub-pixel, the default) and `skeleton_points` (the paper's) select the points.
"""

import lazy_loader

# The names are listed in __init__.pyi; each is imported when it is first used.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
