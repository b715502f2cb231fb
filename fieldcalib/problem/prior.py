"""Weak Gaussian priors of a camera: from the ranges of a camera distribution, the lens, the principal point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from fieldcalib._types import Array, IntArray
from fieldcalib.fields.stands import CameraDistribution, focal_length_from_fov
from fieldcalib.fields.traits import DEVIATIONS
from fieldcalib.problem.layout import LOG_ASPECT, LOG_F, PAN, POSE_AND_ZOOM, PRINCIPAL_POINT, ROLL, Layout
from fieldcalib.problem.picture_shape import principal_point_sigma

# Standard deviations of the zoom law: slopes of the principal point in image widths, slope and curvature of a1, and the
# offset in metres. On ten measured cameras the principal point moves by up to 0.011 widths and a1 by 0.04 as the focal
# length grows by a factor e, and the curvature is up to 0.14. A tripod head holds a camera near its centre of gravity:
# the pupil is a decimetre or two off.
ZOOM_LAW_SIGMA = (0.006, 0.006, 0.02, 0.08, 0.1)
LOG_ASPECT_SIGMA = 0.005  # square pixels, up to the resampling of a broadcast chain


@dataclass(frozen=True)
class GaussianPrior:
    """Independent normal distributions over theta: ``z = (theta - mean) / sigma``.

    `mean` and `sigma` are (..., n) arrays; leading axes are one prior for each initial camera or frame.
    """

    mean: Array
    sigma: Array

    def z_scores(self, theta: Array) -> Array:
        """``(theta - mean) / sigma``; pan and roll differ by less than half a turn."""
        difference = theta - self.mean
        turns = difference[..., [PAN, ROLL]]
        difference[..., [PAN, ROLL]] = turns - 2.0 * np.pi * np.round(turns / (2.0 * np.pi))
        return np.asarray(difference / self.sigma)

    def take(self, index: IntArray | slice) -> GaussianPrior:
        """The priors of the frames `index`."""
        return GaussianPrior(self.mean[index], self.sigma[index])


def gaussian_prior(distribution: CameraDistribution, layout: Layout) -> GaussianPrior:
    """A camera distribution as independent normals over theta; mean and sigma are (n,).

    The field of view's range becomes one of log f, so that wide and narrow lenses weigh alike. A lens that tells the
    focal length, as a fisheye does, takes the place of that range.

    Examples
    --------
    >>> tower = CameraDistribution("tower", (-60, 60), (40, 80), (-2, 2), (20, 60), (-1, 1), (44, 46), (-9, -7))
    >>> gaussian_prior(tower, Layout.of((960, 540))).mean[4:7]
    array([ 0., 45., -8.])
    """
    width = layout.image_size[0]
    mean, sigma = np.zeros(layout.size), np.ones(layout.size)
    mean[POSE_AND_ZOOM], sigma[POSE_AND_ZOOM] = _pose_and_zoom(distribution, width)
    mean[PRINCIPAL_POINT] = np.divide(layout.image_size, 2.0)
    sigma[PRINCIPAL_POINT] = principal_point_sigma(distribution.principal_point, layout.image_size)
    sigma[LOG_ASPECT] = LOG_ASPECT_SIGMA
    if layout.field_size is not None:
        mean[layout.field_size_block] = layout.field_size.given
        sigma[layout.field_size_block] = layout.field_size.sigma
        if layout.field_size.crown is not None:
            sigma[layout.crown_block] = layout.field_size.crown.height
    mean[layout.lens_block], sigma[layout.lens_block] = layout.lens.mean, layout.lens.sigma
    if layout.lens.usual_focal_length is not None:
        mean[LOG_F], sigma[LOG_F] = np.add(layout.lens.usual_focal_length, (np.log(width), 0.0))
    if layout.zoom_law is not None:
        sigma[layout.zoom_law_block] = np.multiply(ZOOM_LAW_SIGMA, (width, width, 1.0, 1.0, 1.0))
    return GaussianPrior(mean, sigma)


@lru_cache(maxsize=64)
def _pose_and_zoom(ranges: CameraDistribution, width: int) -> tuple[Array, Array]:
    """Means and standard deviations, (7,) each."""
    log_f = np.log(focal_length_from_fov(np.radians(ranges.fov), width))[::-1]
    low, high = np.array([*np.radians([ranges.pan, ranges.tilt, ranges.roll]), log_f, ranges.x, ranges.y, ranges.z]).T
    return (low + high) / 2.0, (high - low) / (2.0 * DEVIATIONS)


def gaussian_priors(distributions: Sequence[CameraDistribution], layout: Layout) -> GaussianPrior:
    """The priors of K camera distributions, (K, n)."""
    priors = [gaussian_prior(distribution, layout) for distribution in distributions]
    return GaussianPrior(np.stack([prior.mean for prior in priors]), np.stack([prior.sigma for prior in priors]))


def sample_theta(distribution: CameraDistribution, count: int, rng: np.random.Generator, layout: Layout) -> Array:
    """Draw `count` parameter vectors (count, n) uniformly from the ranges, with no lens and a centred principal
    point."""
    d = distribution
    ranges = np.array([d.pan, d.tilt, d.roll, d.fov, d.x, d.y, d.z])
    values = rng.uniform(ranges[:, 0], ranges[:, 1], size=(count, len(ranges)))
    theta = np.zeros((count, layout.size))
    values[:, :4] = np.radians(values[:, :4])
    values[:, 3] = np.log(focal_length_from_fov(values[:, 3], layout.image_size[0]))
    theta[:, POSE_AND_ZOOM] = values
    theta[:, PRINCIPAL_POINT] = np.asarray(layout.image_size) / 2.0
    return theta
