"""The second pass over a part of a video: the lines in every frame whose camera is known to some pixels."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array
from fieldcalib.assess.result import Calibration
from fieldcalib.images.detected_lines import detected_lines, with_replaced
from fieldcalib.images.field_markings import Markings
from fieldcalib.images.paint_evidence import Ridges, evidence_of
from fieldcalib.images.pieces import CameraModel
from fieldcalib.images.solved_tripods import SolvedTripods
from fieldcalib.io.image import Image
from fieldcalib.localize import Network
from fieldcalib.problem.layout import PRINCIPAL_POINT
from fieldcalib.problem.pixel_table import PixelTable
from fieldcalib.problem.projection import Projection

PAINT_EVERY = 5  # frames, besides keyframes, in which paint beside the markings is looked for
LEAST_LINES = 0.2  # share of the profiles across the projected markings of a shot that must show a line


@dataclass(frozen=True, eq=False)
class ClipLines:
    """The lines in the frames of a clip, near the markings that the cameras of its tripods project."""

    solved: SolvedTripods
    members: tuple[tuple[int, ...], ...]
    """Pieces of each tripod whose frames show its lines."""
    labels: Mapping[int, PixelTable]
    """Lines by frame."""
    ridges: Mapping[int, Ridges]
    """Ridges beside the markings of some frames."""


class _FrameLines(NamedTuple):
    """Lines in one frame."""

    labels: PixelTable
    ridges: Ridges | None
    profiles: tuple[float, float]
    """Number of profiles with a line, and of all profiles."""


def find_clip_lines(solved: SolvedTripods, images: Iterable[Image], network: Network) -> ClipLines:
    """Find the lines in all frames; in keyframes and in every fifth frame, paint beside the markings too.

    The network sees the frames of pieces that are calibrated one by one.
    """
    pieces, options = solved.pieces, solved.keyframes.options
    given = Markings.of(options.object_segments)
    cameras: dict[int, tuple[Calibration, Markings]] = {}
    for tripod in solved.tripods:
        field = tripod.calibration.field
        markings = given if field is None else Markings.of(field)
        frames = pieces.frames(tripod.pieces).tolist()
        cameras |= {t: (one, markings) for t, one in zip(frames, tripod.calibration, strict=True)}
    keys = {key for key, _ in solved.keyframes.shots.matches}
    found: dict[int, _FrameLines] = {}
    for t, image in enumerate(images):
        if pieces.models.get(int(pieces.number[t])) is CameraModel.ALONE:
            (calibration,) = options.calibrate_alone([image], network)
            one = _fitted(image, calibration, given)
        else:
            one = _near_markings(image, *cameras.pop(t), t in keys or t % PAINT_EVERY == 0) if t in cameras else None
        if one is not None:
            found[t] = one
    count = np.zeros((len(pieces.number), 2))
    for t, one in found.items():
        count[t] = one.profiles
    shown = {p for p in pieces.numbers if _share(count[pieces.number == p]) >= LEAST_LINES}
    return ClipLines(
        solved,
        tuple(tuple(p for p in tripod.pieces if p in shown) for tripod in solved.tripods),
        {t: one.labels for t, one in found.items()},
        {t: one.ridges for t, one in found.items() if one.ridges is not None},
    )


def _fitted(image: Image, calibration: Calibration, markings: Markings) -> _FrameLines | None:
    """The lines from which a single frame was calibrated; None if it has no camera."""
    if calibration.camera is None or calibration.solved is None:
        return None
    return _FrameLines(calibration.solved.pixels, Ridges.of(image, calibration.camera, markings), (1.0, 1.0))


def _near_markings(image: Image, calibration: Calibration, markings: Markings, with_ridges: bool) -> _FrameLines | None:
    """The lines near the markings that the camera of a frame projects; None without a camera."""
    camera = calibration.camera
    if camera is None:
        return None
    labels, profiles = detected_lines(image, camera, markings, _picture_sigma(calibration))
    ridges = Ridges.of(image, camera, markings) if with_ridges else None
    if ridges is not None:
        labels = with_replaced(labels, evidence_of(ridges, markings).beside)
    return _FrameLines(labels, ridges, (float(len(labels.frame)), float(profiles)))


def _share(count: Array) -> float:
    """Share of the profiles (T, 2) of some frames that have a line."""
    with_line, profiles = np.sum(count, axis=0)
    return float(with_line / max(profiles, 1.0))


def _picture_sigma(calibration: Calibration) -> float:
    """Standard deviation of the position of the picture as a whole, pixels.

    Where a window moves, the turn of the camera and the shift of the window are each known much worse than their sum.
    """
    assert calibration.camera is not None
    errors, f = calibration.uncertainty.if_level, calibration.camera.focal_length
    layout = errors.layout
    if not np.any(layout.free[PRINCIPAL_POINT]):
        return float(f * np.sqrt(np.max(np.diagonal(errors.covariance)[:2])))
    projection = Projection(errors.theta[None], layout)
    middle = np.divide(layout.image_size, 2.0).reshape(1, 1, 2).repeat(2, axis=1)
    s = projection.ideal_offset(projection.observed_offset(middle))
    (J,) = projection.derivatives(s, np.zeros((1, 2)), np.eye(2)[:, None], np.ones(layout.size, dtype=bool))
    return float(np.sqrt(np.max(np.diagonal(J.T @ errors.covariance @ J))))
