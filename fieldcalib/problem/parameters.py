"""The parameter vector theta of a camera, and its weak Gaussian prior.

    theta = (pan, tilt, roll, log f, x, y, z, a1, b2, cx, cy, log aspect)

Angles in radians, f the focal length along rows in pixels, (x, y, z) the camera centre in metres, a1 and b2 the lens
normalised to the image's corner so that it does not fold (`fieldcalib.geometry.lens.lens_coefficients`), (cx, cy) the
principal point in pixels, aspect fy / fx. What is not estimated stays in theta at its known value.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fieldcalib._types import Array, IntArray
from fieldcalib.fields.stands import CameraDistribution, focal_length_from_fov
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.lens import lens_coefficients, lens_parameters, opencv_coefficients
from fieldcalib.geometry.rotation import rotation_from_angles

PARAMETERS = ("pan", "tilt", "roll", "log f", "x", "y", "z", "a1", "b2", "cx", "cy", "log aspect")
ANGLES = slice(0, 3)
PAN, TILT, ROLL = 0, 1, 2
LOG_F = 3
CENTER = slice(4, 7)
LENS = slice(7, 9)
PRINCIPAL_POINT = slice(9, 11)
LOG_ASPECT = 11

# What the camera distributions say nothing about. Broadcast lenses bend the corner outwards: a1 has its median at 2.8 %
# on annotated frames, 95 % of them are below 5.5 %.
LENS_MEAN = (0.025, 0.0)  # a1, b2
LENS_SIGMA = (0.02, 0.005)
PRINCIPAL_POINT_SIGMA = 0.02  # of the image's width: measured broadcast cameras are up to 67 px off at 1920
LOG_ASPECT_SIGMA = 0.005  # square pixels, up to the resampling of a broadcast chain


def theta_from_camera(camera: Camera) -> Array:
    """The parameter vector of a camera, (12,)."""
    fx, fy = camera.K[0, 0], camera.K[1, 1]
    return np.array(
        [
            *camera.angles,
            np.log(fx),
            *camera.C,
            *lens_parameters(camera.corner_distortion),
            *camera.principal_point,
            np.log(fy / fx),
        ]
    )


def camera_from_theta(theta: Array, image_size: tuple[int, int]) -> Camera:
    """The camera of a parameter vector, the inverse of `theta_from_camera` up to full turns of the angles."""
    fx = np.exp(theta[LOG_F])
    (cx, cy), fy = theta[PRINCIPAL_POINT], fx * np.exp(theta[LOG_ASPECT])
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    k = opencv_coefficients(lens_coefficients(theta[LENS]), fx, np.hypot(*image_size) / 2.0)
    return Camera(K, rotation_from_angles(theta[ANGLES]), theta[CENTER], image_size, k)


def turned_around(theta: Array) -> Array:
    """The cameras (..., 12) that see the field turned by 180 degrees about its centre mark as these ones see it.

    Examples
    --------
    >>> camera = Camera.from_angles(0.2, 1.3, 0.0, 1500.0, (5.0, 60.0, -15.0), (960, 540))
    >>> opposite = camera_from_theta(turned_around(theta_from_camera(camera)), (960, 540))
    >>> np.allclose(opposite.project([-20.0, 10.0, -1.0]), camera.project([20.0, -10.0, -1.0]))
    True
    """
    turned = np.array(theta)
    turned[..., PAN] += np.pi
    turned[..., CENTER] *= (-1.0, -1.0, 1.0)
    return turned


@dataclass(frozen=True)
class GaussianPrior:
    """Independent normal distributions over theta: ``z = (theta - mean) / sigma``.

    `mean` and `sigma` are (..., 12) arrays; leading axes are one prior for each start or frame.
    """

    mean: Array
    sigma: Array

    def z_scores(self, theta: Array) -> Array:
        """``(theta - mean) / sigma``; pan and roll differ by less than half a turn."""
        difference = theta - self.mean
        turns = difference[..., [PAN, ROLL]]
        difference[..., [PAN, ROLL]] = turns - 2.0 * np.pi * np.round(turns / (2.0 * np.pi))
        return np.asarray(difference / self.sigma)

    def take(self, index: IntArray) -> GaussianPrior:
        """The priors `index` of several."""
        return GaussianPrior(self.mean[index], self.sigma[index])


def gaussian_prior(distribution: CameraDistribution, image_size: tuple[int, int]) -> GaussianPrior:
    """A camera distribution as independent normals over theta; mean and sigma are (12,).

    The field of view's range becomes one of log f, so that wide and narrow lenses weigh alike.

    Examples
    --------
    >>> tower = CameraDistribution("tower", (-60, 60), (40, 80), (-2, 2), (20, 60), (-1, 1), (44, 46), (-9, -7))
    >>> gaussian_prior(tower, (960, 540)).mean[4:7]
    array([ 0., 45., -8.])
    """
    ranges = distribution
    log_f = np.log(focal_length_from_fov(np.radians(ranges.fov), image_size[0]))[::-1]
    low, high = np.array(
        [*np.radians([ranges.pan, ranges.tilt, ranges.roll]), log_f, ranges.x, ranges.y, ranges.z],
    ).T
    mean, sigma = np.zeros(len(PARAMETERS)), np.empty(len(PARAMETERS))
    mean[:7], sigma[:7] = (low + high) / 2.0, (high - low) / (2.0 * 1.96)
    mean[PRINCIPAL_POINT] = np.asarray(image_size) / 2.0
    mean[LENS], sigma[LENS] = LENS_MEAN, LENS_SIGMA
    sigma[PRINCIPAL_POINT] = PRINCIPAL_POINT_SIGMA * image_size[0]
    sigma[LOG_ASPECT] = LOG_ASPECT_SIGMA
    return GaussianPrior(mean, sigma)


def sample_theta(
    distribution: CameraDistribution, count: int, rng: np.random.Generator, image_size: tuple[int, int]
) -> Array:
    """Draw `count` parameter vectors (count, 12) uniformly from the ranges: no lens, centred principal point."""
    d = distribution
    ranges = np.array([d.pan, d.tilt, d.roll, d.fov, d.x, d.y, d.z])
    values = rng.uniform(ranges[:, 0], ranges[:, 1], size=(count, 7))
    theta = np.zeros((count, len(PARAMETERS)))
    theta[:, ANGLES] = np.radians(values[:, :3])
    theta[:, LOG_F] = np.log(focal_length_from_fov(np.radians(values[:, 3]), image_size[0]))
    theta[:, CENTER] = values[:, 4:]
    theta[:, PRINCIPAL_POINT] = np.asarray(image_size) / 2.0
    return theta
