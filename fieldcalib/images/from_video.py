"""From a video of one shot to cameras that share a tripod.

frames -> cameras one by one, refined on the lines in their images -> the places of these lines, all together
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from fieldcalib.assess.result import Calibration
from fieldcalib.assess.sequence import SequenceCalibration
from fieldcalib.calibrate.options import ALL, DEFAULT_FLAGS, Prior, pixel_unit
from fieldcalib.calibrate.sequence import calibrate_sequence
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.images.from_images import calibrate_from_images
from fieldcalib.images.refinement import LOSS_SCALE
from fieldcalib.io.image import Image
from fieldcalib.io.images import IMAGES_AT_ONCE, in_parts
from fieldcalib.io.videos import VideoReader
from fieldcalib.localize import Network
from fieldcalib.localize.network import SegmentationNetwork
from fieldcalib.problem.labelled_pixels import Pixels, PixelWeights
from fieldcalib.problem.losses import RobustLoss


def calibrate_video(
    object_segments: ObjectSegments,
    source: str | Path | Iterable[Image],
    network: Network | None = None,
    *,
    flags: int = DEFAULT_FLAGS,
    prior: Prior = ALL,
) -> SequenceCalibration:
    """Calibrate the frames of one shot from one tripod together.

    Each frame is calibrated from its image first (`calibrate_from_images`), then all of them from the lines that were
    found there (`calibrate_sequence`): they share the centre, the law by which principal point and lens follow the
    zoom, and the size of the pitch. Frames of another camera, after a cut say, get no camera that is accepted.

    Parameters
    ----------
    object_segments : mapping of str to segment
        The calibration object that the network was trained for, e.g. `soccer()`.
    source : path, or iterable of (height, width, 3) uint8 arrays
        A video, or its frames: blue, green, red, all of one size.
    network : Network, optional
        Finds the markings; by default the one that comes with the package.
    flags, prior
        As in `calibrate_from_images`.

    Returns
    -------
    SequenceCalibration
        A frame that is not accepted by itself keeps that calibration, and takes no part in what is shared.

    Raises
    ------
    FileNotFoundError, BrokenFileError
        As `fieldcalib.io.videos.VideoReader`.
    ValueError
        If the frames are of several sizes, or as `calibrate_from_images`.

    Examples
    --------
    >>> import numpy as np
    >>> from fieldcalib import soccer
    >>> black = [np.zeros((540, 960, 3), np.uint8)] * 2
    >>> [str(frame.status) for frame in calibrate_video(soccer(), black)]
    ['too few segments', 'too few segments']
    """
    network = SegmentationNetwork.load() if network is None else network
    if isinstance(source, str | Path):
        with VideoReader(Path(source)) as video:
            return calibrate_video(object_segments, video, network, flags=flags, prior=prior)
    size: tuple[int, int] | None = None
    alone: list[Calibration] = []
    pixels: list[Pixels] = []
    weights: list[PixelWeights] = []
    for part in in_parts(source, IMAGES_AT_ONCE, lambda image: image.shape[0] * image.shape[1]):
        for index, image in enumerate(part, len(alone)):
            its_size = image.shape[1], image.shape[0]
            size = size or its_size
            if its_size != size:
                width, height = its_size
                raise ValueError(f"frame {index} has {width} x {height} pixels, those before it {size[0]} x {size[1]}")
        found = calibrate_from_images(object_segments, part, network, flags=flags, prior=prior)
        for calibration in found:
            xy, weight = _lines_of(calibration)
            pixels.append(xy)
            weights.append(weight)
        alone += found
    if size is None:
        return SequenceCalibration(())
    loss = RobustLoss("cauchy", LOSS_SCALE * pixel_unit(size))
    together = calibrate_sequence(
        object_segments, pixels, size, prior=prior, loss=loss, trust_labels=True, weights=weights
    )
    frames = [new if old.accepted else old for new, old in zip(together, alone, strict=True)]
    return replace(together, frames=tuple(frames))


def _lines_of(calibration: Calibration) -> tuple[Pixels, PixelWeights]:
    """The pixels that an accepted camera was fitted to, and their weights; none of others."""
    if not calibration.accepted or calibration.solved is None:
        return {}, {}
    pixels, weights = calibration.solved.alone.evaluation.problem.observations.without_ends.unpacked(0)
    return pixels, {label: len(weight) * weight for label, weight in weights.items()}
