"""Cameras of other systems, with every lens coefficient of SoccerNet's format and of OpenCV's rational model.

They are projected and evaluated, never estimated: this package calibrates `fieldcalib.geometry.camera.Camera`. All
finite numbers are allowed, so that implausible results of other systems can be scored.

The lens is OpenCV's, `brown_conrady` of `fieldcalib.geometry.lens.brown_conrady` in normalised image points
``(Xc / Zc, Yc / Zc)``. Unlike a `Lens`, it is not checked for being monotone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array
from fieldcalib.geometry.camera import Camera, _vectors, checked_image_size, finite_array
from fieldcalib.geometry.lens.brown_conrady import brown_conrady, newton_step
from fieldcalib.geometry.lens.opencv import COEFFICIENTS, opencv_vector
from fieldcalib.geometry.projective import dehomogenize, homogenize


def distort_rational(x: Array, dist: Array) -> Array:
    """OpenCV's distortion of normalised image points: `brown_conrady` with the components last.

    Parameters
    ----------
    x : (..., 2) array
        Normalised image points (Xc / Zc, Yc / Zc).
    dist : (..., 12) array
        Coefficients, broadcast against the leading axes of `x`.

    Returns
    -------
    (..., 2) array
        Not finite where the denominator is 0.

    Examples
    --------
    >>> distort_rational(np.array([0.3, 0.4]), np.array([0.04, *np.zeros(11)]))  # q = 0.25: 1 % outwards
    array([0.303, 0.404])
    """
    return np.moveaxis(brown_conrady(np.moveaxis(x, -1, 0), np.moveaxis(dist, -1, 0)), 0, -1)


def undistort_rational(d: Array, dist: Array) -> Array:
    """Normalised image points that the lens distorts to `d`: Newton's method, starting at `d`.

    Parameters
    ----------
    d : (..., 2) array
        Distorted normalised image points.
    dist : (..., 12) array
        Coefficients, broadcast against the leading axes of `d`.

    Returns
    -------
    (..., 2) array
        NaN where none is found, or only one on the opposite side of the image's centre; one of several if the lens is
        not monotone.

    Examples
    --------
    >>> undistort_rational(np.array([0.303, 0.404]), np.array([0.04, *np.zeros(11)])).round(12)
    array([0.3, 0.4])
    """
    target, a = np.moveaxis(d, -1, 0), np.moveaxis(dist, -1, 0)
    u = target.copy()
    with np.errstate(all="ignore"):  # iterations that do not converge may overflow
        for _ in range(40):
            step, _ = newton_step(u, a, target)
            u -= step
            if not np.any(np.abs(step) > 1e-15):
                break
        error = np.max(np.abs(brown_conrady(u, a) - target), axis=0)
        found = error <= 1e-9 * (1.0 + np.max(np.abs(target), axis=0))
    found &= np.sum(u * target, axis=0) >= 0.0
    return np.moveaxis(np.where(found, u, np.nan), 0, -1)


@dataclass(frozen=True, eq=False)
class RationalCamera:
    """A camera with OpenCV's rational, tangential and thin prism lens.

    Parameters
    ----------
    K : (3, 3) array
        Intrinsic matrix in pixels, zero skew; the focal lengths may have any value, even a negative one.
    R : (3, 3) array
        Rotation from the world to the camera.
    C : (3,) array
        Camera centre in the world, metres.
    dist : (12,) array
        k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4.
    image_size : (int, int)
        Width and height in pixels.

    Raises
    ------
    ValueError
        If a shape is wrong or a number is not finite, or K has skew.

    Examples
    --------
    >>> camera = Camera.from_angles(0.0, np.radians(75), 0.0, 1500.0, C=(0, 56, -15), image_size=(960, 540))
    >>> RationalCamera.from_camera(camera).project([0.0, 0.0, 0.0]).round(1)
    array([480. , 269.9])
    """

    K: Array
    R: Array
    C: Array
    dist: Array
    image_size: tuple[int, int]

    def __post_init__(self) -> None:
        for name, shape in (("K", (3, 3)), ("R", (3, 3)), ("C", (3,)), ("dist", (len(COEFFICIENTS),))):
            object.__setattr__(self, name, finite_array(name, getattr(self, name), shape))
        object.__setattr__(self, "image_size", checked_image_size(self.image_size))
        if np.any(self.K[[0, 1, 2, 2], [1, 0, 0, 1]] != 0.0) or self.K[2, 2] != 1.0:
            raise ValueError(f"K must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], got {self.K.tolist()}")

    @classmethod
    def from_camera(cls, camera: Camera | RationalCamera) -> RationalCamera:
        """The camera with all twelve coefficients of its lens; a rational camera is returned unchanged."""
        if isinstance(camera, RationalCamera):
            return camera
        return cls(camera.K, camera.R, camera.C, opencv_vector(camera.dist), camera.image_size)

    @property
    def pinhole_homography(self) -> Array:
        """3 x 3 map of field points (x, y, 1) to the image of the pinhole, without distortion: ``K R [e1 e2 -C]``.

        Not finite where floats overflow.
        """
        with np.errstate(all="ignore"):  # absurd cameras overflow
            return np.asarray(self.K @ self.R @ np.column_stack([np.eye(3)[:, :2], -self.C]))

    def depth(self, X: ArrayLike) -> Array:
        """Depth of world points (..., 3) along the optical axis, metres; negative behind the camera."""
        return np.asarray((_vectors(X, 3, "world points") - self.C) @ self.R[2])

    def project(self, X: ArrayLike) -> Array:
        """Pixels of world points, with distortion.

        Parameters
        ----------
        X : (..., 3) array_like
            World points in metres.

        Returns
        -------
        (..., 2) array
            NaN for points behind the camera or in its plane (depth <= 0), and where floats overflow. Unlike in
            `Camera.project`, points at which the lens is not monotone have a pixel, as in OpenCV and in SoccerNet's
            evaluation.
        """
        with np.errstate(all="ignore"):  # absurd cameras overflow
            Xc = (_vectors(X, 3, "world points") - self.C) @ self.R.T
            x = dehomogenize(Xc)
            if np.any(self.dist):
                x = distort_rational(x, self.dist)
            xy = x * self.K[[0, 1], [0, 1]] + self.K[:2, 2]
        visible = (Xc[..., 2] > 0.0) & np.all(np.isfinite(xy), axis=-1)
        return np.where(visible[..., None], xy, np.nan)

    def image_to_field(self, xy: ArrayLike) -> Array:
        """World points of pixels on the ground, with distortion removed.

        Parameters
        ----------
        xy : (..., 2) array_like
            Pixels.

        Returns
        -------
        (..., 3) array
            Metres; NaN where the pixel's ray does not meet the ground in front of the camera (above the horizon), or
            where no ray through the lens is found for the pixel.
        """
        with np.errstate(all="ignore"):
            x = (_vectors(xy, 2, "pixels") - self.K[:2, 2]) / self.K[[0, 1], [0, 1]]
            if np.any(self.dist):
                x = undistort_rational(x, self.dist)
            ray = homogenize(x) @ self.R
            scale = -self.C[2] / ray[..., 2]
            X = self.C + scale[..., None] * ray
        X[..., 2] = 0.0
        return np.where((np.all(np.isfinite(X), axis=-1) & (scale > 0.0))[..., None], X, np.nan)
