"""The field of pictures that a user does not name: that of the first ones, or of some frames of the first seconds."""

from __future__ import annotations

from itertools import islice

from fieldcalib.fields.catalogue import AUTO, FIELDS
from fieldcalib.images.which_field import which_field
from fieldcalib.localize.network import SegmentationNetwork
from fieldcalib.results.sources import Pictures

MOST = 3  # pictures that are searched
STEP = 100  # frames of a clip from one to the next


def auto_field(pictures: Pictures) -> str:
    """Name of the field that pictures show.

    Raises
    ------
    ValueError
        If they show none, or several fields explain them alike.
    """
    step = STEP if pictures.is_clip or pictures.is_video else 1
    frames = islice(pictures.frames(), 0, (MOST - 1) * step + 1, step)
    images = [frame.image for frame in frames if frame.image is not None]
    found = which_field(images, tuple(FIELDS), SegmentationNetwork.load())
    if found.name is None:
        raise ValueError(f'field "{AUTO}": {found.reason}')
    return found.name
