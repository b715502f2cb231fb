"""Cameras with the same image: across the field, or a few steps along it.

A field turned by 180 degrees is the same field: a frame that shows only the middle line and the centre circle fits a
camera and the one across the field equally well. And where lines repeat, as yard lines do, labels may be miscounted.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.fields.field import Field
from fieldcalib.fields.sides import OPPOSITE, looks_the_same_turned, side_of, side_of_stand
from fieldcalib.problem.layout import CENTER, PAN, POSE_AND_ZOOM, turned_around
from fieldcalib.problem.observations import Observations
from fieldcalib.problem.prior import GaussianPrior
from fieldcalib.solve.options import CERTAIN, Options


@dataclass(frozen=True)
class OtherSide:
    """B cameras turned by 180 degrees about the centre mark."""

    theta: Array
    """Parameters of the turned cameras, (B, n)."""
    prior: GaussianPrior
    """Prior of the stands where the turned cameras are, (B, n); meaningless if none fits."""
    fits: BoolArray
    """Whether labels do not contradict the turned cameras, and the prior hardly more than the others, (B,)."""


def other_side(observations: Observations, theta: Array, options: Options) -> OtherSide:
    """The cameras (B, n) on the other side of the field, and whether they explain B frames as well."""
    turned, prior, free = turned_around(theta), options.stands, options.layout.free
    fits = _look_alike(options.field, observations) & bool(np.all(free[CENTER]) and free[PAN])
    if not np.any(fits):
        return OtherSide(turned, prior.take(np.zeros(len(theta), dtype=np.intp)), fits)
    here, there = (
        np.sum(np.square(prior.z_scores(camera[:, None])[..., POSE_AND_ZOOM]), axis=-1) for camera in (theta, turned)
    )
    if options.use_prior:
        fits &= 0.5 * (there.min(axis=1) - here.min(axis=1)) < CERTAIN
    return OtherSide(turned, prior.take(np.argmin(there, axis=1)), fits)


def on_main_side(
    observations: Observations, theta: Array, prior: GaussianPrior, options: Options
) -> tuple[Array, GaussianPrior]:
    """Cameras (B, n) and their priors; those that fit equally well on the main side, the usual one, are turned to it.

    Cameras are not turned if the position is given, or if they are known to be on the other side.
    """
    if options.side == OPPOSITE or not np.isnan(options.known[CENTER]).any():
        return theta, prior
    other = other_side(observations, theta, options)
    turn = (other.fits & (theta[:, CENTER][:, 1] < 0.0))[:, None]
    if not np.any(turn):
        return theta, prior
    mean, sigma = np.where(turn, other.prior.mean, prior.mean), np.where(turn, other.prior.sigma, prior.sigma)
    return np.where(turn, other.theta, theta), GaussianPrior(mean, sigma)


def is_against_convention(C: Array, options: Options) -> bool:
    """Whether labels put a camera at C (3,) on the opposite side of the field, and nothing else tells its side.

    Labels name the ends as seen from the main side. If they name them as the camera itself sees them, it is the one
    turned by 180 degrees: its image is the same, and most cameras are on the main side.
    """
    field, is_told = options.field, not np.isnan(options.known[CENTER]).any() or not options.layout.free[PAN]
    if field is None or options.side is not None or is_told or side_of(C, field) != OPPOSITE:
        return False
    sides = {side_of_stand(stand, field) for stand in options.distributions}
    return len(sides) > 1 and looks_the_same_turned(field)


def repeats(labels: Iterable[str], options: Options) -> bool:
    """Whether a frame with these labels looks the same one step of `Field.repeats` along the field.

    Then labels that are all one step off fit equally well. False if the position is given.
    """
    if options.field is None or not np.all(options.layout.free[CENTER]):
        return False
    return any(set(labels) <= alike for alike in options.field.alike_further_on)


def _look_alike(field: Field | None, observations: Observations) -> BoolArray:
    """Mask (B,) of the frames whose labels all look the same from the other side of the field."""
    if field is None:
        return np.zeros(len(observations), dtype=bool)
    alike = np.array([label in field.self_symmetric for label in observations.labels])
    return np.asarray(np.all(alike[observations.label] | (observations.label < 0), axis=1))
