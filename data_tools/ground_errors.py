"""Check of the standard deviations of ground points against markings that are left out of the calibration.

    python -m data_tools.ground_errors ANNOTATIONS --size 960x540

Every annotated marking of the ground is left out once, from frames that keep at least `--least` segments. Its pixels
are located on the ground by the camera of the other segments, if that is accepted; their distances from the marking
are compared with two kinds of standard deviations:

* "located": those of `fieldcalib.locate_on_ground`, of the camera alone and relative to the markings in view. They
  leave out that the marking may move with the size of the pitch otherwise than these.
* "from the marking": those of the distance itself, with the motion of the marking with the size of the pitch, and the
  noise of the annotated pixels, as it is in the rest of the frame.

One line of JSON is printed for each range of the distance, on the ground, to the nearest pixel used in the calibration.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from data_tools.annotated_frames import read_frames
from fieldcalib._types import Array
from fieldcalib.assess.ground_points import locate_on_ground
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.uncertainty import Uncertainty
from fieldcalib.console.arguments import add_size
from fieldcalib.console.program import run_command
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Arc, Line, Segment
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.problem.labelled_pixels import Pixels
from fieldcalib.solve.batch import calibrate_batch

LEAST = 3  # segments that remain for the calibration
RANGES = (0.0, 2.0, 5.0, 10.0, 20.0, 40.0)  # m
AT_ONCE = 500  # calibrations in memory


@dataclass(frozen=True)
class LeftOutMarking:
    """The pixels of a marking that was left out, N of them."""

    error: Array
    """Signed distances to the marking on the ground, (N,) metres."""
    located: Array
    """Standard deviations across the marking of the points, by the camera alone, (N,) metres."""
    expected: Array
    """Standard deviations of `error`, (N,) metres."""
    distance: Array
    """Distances on the ground to the nearest pixel used in the calibration, (N,) metres."""


def left_out_on_ground(
    field: Field, frames: Sequence[Pixels], size: tuple[int, int], *, least: int = LEAST
) -> Iterator[LeftOutMarking]:
    """Leave out each marking of the ground once; those where the camera of the others is accepted."""
    labels = {label for label, one in field.items() if isinstance(one, Line | Arc) and not np.any(one.sample()[:, 2])}
    motion = dict(zip(field, field.motion, strict=True))
    parts = [(frame, label) for frame in frames if len(frame) > least for label in frame if label in labels]
    for first in range(0, len(parts), AT_ONCE):
        chunk = parts[first : first + AT_ONCE]
        rest = [{other: xy for other, xy in frame.items() if other != label} for frame, label in chunk]
        for (frame, label), others, found in zip(chunk, rest, calibrate_batch(field, rest, size), strict=True):
            used = [xy for other, xy in others.items() if other in labels]
            if found.accepted and used:
                yield _left_out(found, field[label], motion[label], frame[label], np.concatenate(used))


def _left_out(calibration: Calibration, marking: Segment, motion: Array, xy: Array, used: Array) -> LeftOutMarking:
    assert calibration.camera is not None  # it is accepted
    known = np.isfinite(calibration.camera.image_to_field(xy)).all(axis=-1)
    xy = xy[known]
    found, uncertainty = locate_on_ground(calibration, xy, pixel_sd=0.0), calibration.uncertainty
    assert isinstance(uncertainty, Uncertainty)  # it was calibrated here
    X = found.X[:, :2]
    error, normal, moved = _across(marking, X, motion)
    derivative, _ = uncertainty.ground_jacobian(np.column_stack([X, np.zeros(len(X))]))
    by_theta = np.einsum("ni,nij->nj", normal, derivative)
    by_theta[:, uncertainty.layout.field_size_block] -= np.einsum("ni,nij->nj", normal, moved)
    of_camera = uncertainty.propagated(by_theta[:, None, :])[:, 0, 0]
    noisy = locate_on_ground(calibration, xy, pixel_sd=uncertainty.sigma).covariance
    there = calibration.camera.image_to_field(used)[:, :2]
    there = there[np.isfinite(there).all(axis=-1)]
    return LeftOutMarking(
        error,
        np.sqrt(_variance(found.covariance, normal)),
        np.sqrt(of_camera + _variance(noisy - found.covariance, normal)),
        np.min(np.linalg.norm(X[:, None] - there, axis=-1), axis=1),
    )


def _variance(covariance: Array, normal: Array) -> Array:
    return np.asarray(np.einsum("ni,nij,nj->n", normal, covariance, normal))


def _across(marking: Segment, X: Array, motion: Array) -> tuple[Array, Array, Array]:
    """Distances (N,) to a line or circle, normals (N, 2), and its derivatives by the field's size, (N, 2, 2)."""
    if isinstance(marking, Line):
        start, end = np.array(marking.start)[:2], np.array(marking.end)[:2]
        along = (end - start) / np.linalg.norm(end - start)
        normal = np.broadcast_to((-along[1], along[0]), X.shape)
        share = ((X - start) @ along / np.linalg.norm(end - start))[:, None, None]
        return np.sum((X - start) * normal, axis=-1), normal, (1.0 - share) * motion[0, :2] + share * motion[1, :2]
    assert isinstance(marking, Arc)
    offset = X - np.array(marking.center)[:2]
    radius = np.linalg.norm(offset, axis=-1)
    return radius - marking.radius, offset / radius[:, None], np.broadcast_to(motion[0, :2], (len(X), 2, 2))


def main(arguments: Sequence[str] | None = None) -> int:
    """Print one line of JSON for each range of distances."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("annotations", type=Path, help="folder or zip of <id>.json")
    add_size(parser, "of the images, e.g. 960x540", required=True)
    parser.add_argument("--least", type=int, default=LEAST, help=f"smallest number of segments that remain ({LEAST})")
    parser.set_defaults(run=run)
    return run_command(parser.parse_args(arguments))


def run(options: argparse.Namespace) -> int:
    """Measure and print; returns the exit code."""
    field = soccer()
    frames = list(read_frames([options.annotations], field, options.size).values())
    found = list(left_out_on_ground(field, frames, options.size, least=options.least))
    for low, high in pairwise((*RANGES, np.inf)):
        print(json.dumps({"metres": [low, high if np.isfinite(high) else None], **range_summary(found, low, high)}))
    return 0


def range_summary(found: Sequence[LeftOutMarking], low: float, high: float) -> dict[str, float | int | None]:
    """Statistics of pixels at distances in a range: medians in metres, shares within two standard deviations in %."""
    kept = [(one, (one.distance >= low) & (one.distance < high)) for one in found]
    values = [np.array([one.error, one.located, one.expected])[:, inside] for one, inside in kept if inside.any()]
    count = {"segments": len(values), "pixels": sum(part.shape[1] for part in values)}
    if not values:
        return count
    error, located, expected = np.concatenate(values, axis=1)
    return {
        **count,
        "median_error": round(float(np.median(np.abs(error))), 3),
        "median_located_sd": round(float(np.median(located)), 3),
        "median_z_located": round(float(np.median(np.abs(error) / located)), 2),
        "within_2_located": round(100.0 * float(np.mean(np.abs(error) < 2.0 * located)), 1),
        "median_z_from_marking": round(float(np.median(np.abs(error) / expected)), 2),
        "within_2_from_marking": round(100.0 * float(np.mean(np.abs(error) < 2.0 * expected)), 1),
    }


if __name__ == "__main__":
    raise SystemExit(main())
