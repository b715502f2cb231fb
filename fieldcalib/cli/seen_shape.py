"""How the frames of a clip lie in those that were filmed, where nobody says it: seen in some of them."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np

from fieldcalib.assess.whole_picture import SHAPE
from fieldcalib.calibrate.aspect import WAS_SQUASHED, may_be_squashed, shown_size
from fieldcalib.cli.declared import Crop, Placement
from fieldcalib.cli.fields import field_of, prior_of
from fieldcalib.cli.known_camera import KnownCamera
from fieldcalib.images.borders import shown_part
from fieldcalib.images.from_images import calibrate_from_images
from fieldcalib.io.image import Image
from fieldcalib.localize import Network

SEEN, APART = 8, 12  # frames that are looked at, of the first hundred
MOST = 2.0 / 3.0  # of them say so
DARK = 10.0  # mean brightness: of a frame that shows nothing


def placement_seen(options: argparse.Namespace, images: Sequence[Image], network: Network) -> Placement | None:
    """The place of frames whose black borders are left out, or that were squashed; None if they are as they seem."""
    images = [image for image in images if np.mean(image) > DARK]
    if not images:
        return None
    size = images[0].shape[1], images[0].shape[0]
    parts = [shown_part(image) for image in images]
    x, y = np.min([part.corner for part in parts], axis=0).tolist()
    if x or y:
        return Placement(size, size, Crop((size[0] - 2 * x, size[1] - 2 * y), (-x, -y)))
    if not may_be_squashed(size):
        return None
    flags = KnownCamera.of(options).flags
    found = calibrate_from_images(field_of(options), images, network, flags=flags, prior=prior_of(options))
    squashed = [WAS_SQUASHED in one.message and SHAPE not in one.complaints for one in found]
    return Placement(size, shown_size(size), None) if np.mean(squashed) >= MOST else None
