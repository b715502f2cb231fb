"""The parameter vector theta of a camera, and the camera distributions: its weak priors and the source of starts.

    theta = (pan, tilt, roll, log f, x, y, z, a1, b2, cx, cy, log aspect)

Angles in radians, f the focal length along rows in pixels, (x, y, z) the camera centre in metres, a1 and b2 the lens
normalised to the image's corner so that it does not fold (`fieldcalib.distortion.lens_coefficients`), (cx, cy) the
principal point in pixels, aspect fy / fx. What is not estimated stays in theta at its known value.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from fieldcalib._types import Array, IntArray
from fieldcalib.camera import Camera
from fieldcalib.distortion import lens_coefficients, lens_parameters, opencv_coefficients
from fieldcalib.rotation import rotation_from_angles

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


def focal_length_from_fov(fov: Array | float, width: float) -> Array:
    """Focal length in pixels of a horizontal field of view in radians: ``f = w / (2 tan(fov / 2))``."""
    return np.asarray(0.5 * width / np.tan(0.5 * np.asarray(fov)))


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


@dataclass(frozen=True)
class CameraDistribution:
    """Uniform ranges of a camera's parameters: where cameras of one kind stand and look.

    Angles and the horizontal field of view in degrees, positions in metres, each as (low, high). The paper (section
    "Initialization", appendix "Camera Distribution") turns a range (a, b) into a normal distribution whose 95 %
    interval is the range: mean (a + b) / 2 and sigma (b - a) / (2 x 1.96).

    Raises
    ------
    ValueError
        If a range is not (low, high) with low < high, or fields of view are not between 0 and 180 degrees.

    Examples
    --------
    >>> tower = CameraDistribution("tower", (-60, 60), (40, 80), (-2, 2), (20, 60), (-1, 1), (44, 46), (-9, -7))
    >>> tower.prior((960, 540)).mean[4:7]
    array([ 0., 45., -8.])
    """

    name: str
    pan: tuple[float, float]
    tilt: tuple[float, float]
    roll: tuple[float, float]
    fov: tuple[float, float]
    x: tuple[float, float]
    y: tuple[float, float]
    z: tuple[float, float]

    def __post_init__(self) -> None:
        for name in ("pan", "tilt", "roll", "fov", "x", "y", "z"):
            low, high = getattr(self, name)
            if not (np.isfinite(low) and np.isfinite(high) and low < high):
                raise ValueError(
                    f"{self.name!r}: {name} must be (low, high) with low < high, got {(low, high)}; flags fix a value"
                )
        if not 0.0 < self.fov[0] < self.fov[1] < 180.0:
            raise ValueError(f"{self.name!r}: fov must lie between 0 and 180 degrees, got {self.fov}")

    def sample(self, count: int, rng: np.random.Generator, image_size: tuple[int, int]) -> Array:
        """Draw `count` parameter vectors (count, 12) uniformly from the ranges: no lens, centred principal point."""
        ranges = np.array([self.pan, self.tilt, self.roll, self.fov, self.x, self.y, self.z])
        values = rng.uniform(ranges[:, 0], ranges[:, 1], size=(count, 7))
        theta = np.zeros((count, len(PARAMETERS)))
        theta[:, ANGLES] = np.radians(values[:, :3])
        theta[:, LOG_F] = np.log(focal_length_from_fov(np.radians(values[:, 3]), image_size[0]))
        theta[:, CENTER] = values[:, 4:]
        theta[:, PRINCIPAL_POINT] = np.asarray(image_size) / 2.0
        return theta

    def prior(self, image_size: tuple[int, int]) -> GaussianPrior:
        """The distribution as independent normals over theta.

        The field of view's range becomes one of log f, so that wide and narrow lenses weigh alike.
        """
        log_f = np.log(focal_length_from_fov(np.radians(self.fov), image_size[0]))[::-1]
        low, high = np.array(
            [*np.radians([self.pan, self.tilt, self.roll]), log_f, self.x, self.y, self.z],
        ).T
        mean, sigma = np.zeros(len(PARAMETERS)), np.empty(len(PARAMETERS))
        mean[:7], sigma[:7] = (low + high) / 2.0, (high - low) / (2.0 * 1.96)
        mean[PRINCIPAL_POINT] = np.asarray(image_size) / 2.0
        mean[LENS], sigma[LENS] = LENS_MEAN, LENS_SIGMA
        sigma[PRINCIPAL_POINT] = PRINCIPAL_POINT_SIGMA * image_size[0]
        sigma[LOG_ASPECT] = LOG_ASPECT_SIGMA
        return GaussianPrior(mean, sigma)


def _main(name: str, x: tuple[float, float]) -> CameraDistribution:
    return CameraDistribution(name, (-45, 45), (45, 90), (-10, 10), (8.2, 90), x, (40, 110), (-40, -5))


def _behind(name: str, pan: tuple[float, float], x: tuple[float, float]) -> CameraDistribution:
    return CameraDistribution(name, pan, (11.25, 90), (-5.6, 5.6), (8.2, 90), x, (-20, 20), (-35, -1))


MAIN_CENTER = _main("main center", (-16.5, 16.5))
MAIN_LEFT = _main("main left", (-36 - 16.5, -36 + 16.5))
MAIN_RIGHT = _main("main right", (36 - 16.5, 36 + 16.5))
MAIN_TRIBUNE = _main("main tribune", (-36, 36))
OPPOSITE_TRIBUNE = CameraDistribution(
    "opposite tribune", (135, 225), (45, 90), (-10, 10), (8.2, 90), (-36, 36), (-110, -40), (-40, -5)
)
BEHIND_LEFT_GOAL = _behind("behind left goal", (45, 135), (-95, -52.5))
BEHIND_RIGHT_GOAL = _behind("behind right goal", (-135, -45), (52.5, 95))

DISTRIBUTIONS: Mapping[str, CameraDistribution] = MappingProxyType(
    {
        d.name: d
        for d in (
            MAIN_CENTER,
            MAIN_LEFT,
            MAIN_RIGHT,
            MAIN_TRIBUNE,
            OPPOSITE_TRIBUNE,
            BEHIND_LEFT_GOAL,
            BEHIND_RIGHT_GOAL,
        )
    }
)
