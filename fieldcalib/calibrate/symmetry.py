"""The other side: a field turned by 180 degrees is the same field, and some frames do not tell the two apart.

A frame that shows nothing but the middle line and the centre circle fits a camera and the one across the field alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.calibrate.mislabels import CERTAIN
from fieldcalib.calibrate.options import Options
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.problem.observations import Observations
from fieldcalib.problem.parameters import CENTER, LENS, GaussianPrior, gaussian_prior, turned_around


@dataclass(frozen=True)
class OtherSide:
    """B cameras turned by 180 degrees about the centre mark."""

    theta: Array
    """(B, 12)."""
    prior: GaussianPrior
    """Of the stands where they are then, (B, 12)."""
    fits: BoolArray
    """Whether the labels say nothing against them, and the prior hardly more than against the others, (B,)."""


def other_side(
    object_segments: ObjectSegments, observations: Observations, theta: Array, options: Options
) -> OtherSide:
    """The cameras (B, 12) on the other side of the field, and whether they explain B frames as well."""
    turned = turned_around(theta)
    stands = [gaussian_prior(distribution, options.image_size) for distribution in options.distributions]
    prior = GaussianPrior(np.stack([stand.mean for stand in stands]), np.stack([stand.sigma for stand in stands]))
    here, there = (
        np.sum(np.square(prior.z_scores(camera[:, None])[..., : LENS.start]), axis=-1) for camera in (theta, turned)
    )
    fits = _look_alike(object_segments, observations) & bool(np.all(options.free[CENTER]))
    if options.use_prior:
        fits &= 0.5 * (there.min(axis=1) - here.min(axis=1)) < CERTAIN
    return OtherSide(turned, prior.take(np.argmin(there, axis=1)), fits)


def on_main_side(
    object_segments: ObjectSegments, observations: Observations, theta: Array, prior: GaussianPrior, options: Options
) -> tuple[Array, GaussianPrior]:
    """Cameras (B, 12) and their priors, those turned that may as well stand on the main side, where broadcasters do.

    A user who gave the position knows better.
    """
    if not np.isnan(options.known[CENTER]).any():
        return theta, prior
    other = other_side(object_segments, observations, theta, options)
    turn = (other.fits & (theta[:, CENTER][:, 1] < 0.0))[:, None]
    mean, sigma = np.where(turn, other.prior.mean, prior.mean), np.where(turn, other.prior.sigma, prior.sigma)
    return np.where(turn, other.theta, theta), GaussianPrior(mean, sigma)


def _look_alike(object_segments: ObjectSegments, observations: Observations) -> BoolArray:
    """Which frames (B,) are labelled with nothing but what is the same from the other side of the field."""
    if not isinstance(object_segments, Field):
        return np.zeros(len(observations), dtype=bool)
    alike = np.array([label in object_segments.self_symmetric for label in observations.labels])
    return np.asarray(np.all(alike[observations.label] | (observations.label < 0), axis=1))
