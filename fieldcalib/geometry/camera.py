"""The camera: a frozen pinhole with one of OpenCV's two lenses, in the conventions of the package.

World: metres, x right along the touchline, y towards the main camera, z down. Camera: x right, y down, z forward,
``Xc = R (X - C)``. Pixels: (x, y), the first pixel's centre is (0, 0); image sizes are (width, height).
"""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from reprlib import repr as short
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldcalib._html import table
from fieldcalib._json import to_json
from fieldcalib._types import Array, expect, file_path, is_number, number, real_array, truth
from fieldcalib._whole_files import write_text
from fieldcalib.geometry.homography import homogenize
from fieldcalib.geometry.lens import FisheyeLens, Lens, lens_of
from fieldcalib.geometry.lens.brown_conrady import brown_conrady, undistorted
from fieldcalib.geometry.lens.fisheye import fisheye_vector
from fieldcalib.geometry.lens.model import POWERS, opencv_vector, shortest_opencv_vector
from fieldcalib.geometry.rotation import angles_from_rotation, rotation_from_angles, rotation_from_vector

LENS_SHIFT = 1.0  # px, from which on a homography without the lens is worth a warning
FULL_TURN = 2.0 * np.pi
PIXELS_PER_AXIS = 17  # of the grid on which the lens is compared with a pinhole
ANGLE_NAMES = ("pan", "tilt", "roll")
CAMERA_TITLES = ("focal length", "pan, tilt, roll", "position")
NOT_ORTHONORMAL = 1e-6 + 1e-5 * np.eye(3)  # largest difference of R R^T from the identity


class RaySurface(Protocol):
    """A surface that rays meet: see `fieldcalib.fields.ground.Terrain`."""

    @property
    def is_level(self) -> bool:
        """Whether it is the plane z = 0."""

    def met_by_rays(self, C: Array, direction: Array, above: float = 0.0) -> Array:
        """Points (..., 3) that rays from C along directions (..., 3) meet `above` metres over it; NaN for none."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A calibrated camera.

    Parameters
    ----------
    K : (3, 3) array_like
        Intrinsic matrix in pixels, zero skew.
    R : (3, 3) array_like
        Rotation from the world to the camera.
    C : (3,) array_like
        Camera centre in the world, metres; z < 0 is above the ground.
    image_size : (int, int)
        Width and height in pixels.
    k : (2,) array_like
        OpenCV's radial coefficients k1, k2, or its dist_coeffs (k1, k2, p1, p2, k3, ...) of any of its lengths; of a
        fisheye lens the four of cv2.fisheye. The attribute `k` is (k1, k2) in any case, `dist` has them all.
    checked : bool
        False for a camera of another system, which is projected and evaluated as it is: its focal lengths may be
        negative and R need be no rotation, and points at which the lens is not monotone have a pixel, as in OpenCV and
        in SoccerNet's evaluation.
    fisheye : bool
        Whether the lens is that of cv2.fisheye (`fieldcalib.geometry.lens.fisheye`).

    Raises
    ------
    ValueError
        If a shape is wrong, a number is not finite, K has skew, the lens has a tilted sensor (the last two of 14
        coefficients), or a fisheye lens has not four coefficients; if `checked`, also if R is not a rotation, or K has
        no positive focal length.

    Examples
    --------
    A camera on the main stand, 15 m up, looking at the centre mark:

    >>> camera = Camera.from_angles(0.0, np.radians(75), 0.0, 1500.0, C=(0, 56, -15), image_size=(960, 540))
    >>> camera.project([0.0, 0.0, 0.0]).round(1)
    array([480. , 269.9])
    >>> camera.image_to_field([480.0, 269.9]).round(1) + 0.0
    array([0., 0., 0.])
    """

    K: Array
    R: Array
    C: Array
    image_size: tuple[int, int]
    k: Array
    """(k1, k2)."""
    dist: Array = field(repr=False)
    """OpenCV's dist_coeffs (1, 5); (1, 8) or (1, 12) if the coefficients that follow are not all 0; (1, 4) of a fisheye
    lens."""
    checked: bool = True
    fisheye: bool = False
    """Whether `dist` are the coefficients of cv2.fisheye."""

    def __init__(
        self,
        K: ArrayLike,
        R: ArrayLike,
        C: ArrayLike,
        image_size: tuple[int, int],
        k: ArrayLike = (0.0, 0.0),
        checked: bool = True,
        fisheye: bool = False,
    ) -> None:
        for name, value, shape in (("K", K, (3, 3)), ("R", R, (3, 3)), ("C", C, (3,))):
            object.__setattr__(self, name, finite_array(name, value, shape))
        object.__setattr__(self, "fisheye", truth(fisheye, "fisheye"))
        dist = fisheye_vector(k, "k") if fisheye else shortest_opencv_vector(opencv_vector(k, "k"))
        object.__setattr__(self, "dist", dist[None])
        object.__setattr__(self, "k", self.dist[0, :2])
        self.k.flags.writeable = self.dist.flags.writeable = False
        object.__setattr__(self, "image_size", checked_image_size(image_size))
        object.__setattr__(self, "checked", truth(checked, "checked"))
        if checked and not (self.K[0, 0] > 0.0 and self.K[1, 1] > 0.0):
            raise ValueError(f"K must have positive focal lengths, got {self.K[0, 0]} and {self.K[1, 1]}")
        (_, skew, _), (below, _, _), last = self.K.tolist()
        if skew != 0.0 or below != 0.0 or last != [0.0, 0.0, 1.0]:
            raise ValueError(f"K must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], got {self.K.tolist()}")
        with np.errstate(over="ignore", invalid="ignore"):
            is_orthonormal = np.all(np.abs(self.R @ self.R.T - np.eye(3)) <= NOT_ORTHONORMAL)
            is_rotation = is_orthonormal and np.linalg.det(self.R) > 0.0
        if checked and not is_rotation:
            raise ValueError(f"R must be a rotation matrix (R R^T = I, det R = 1), got {self.R.tolist()}")

    @classmethod
    def from_angles(
        cls,
        pan: float,
        tilt: float,
        roll: float,
        focal_length: float,
        C: ArrayLike,
        image_size: tuple[int, int],
        principal_point: ArrayLike | None = None,
        k: ArrayLike = (0.0, 0.0),
        fisheye: bool = False,
    ) -> Camera:
        """A camera with square pixels from its angles in radians and its focal length in pixels.

        The principal point defaults to (width / 2, height / 2), SoccerNet's.

        Raises
        ------
        ValueError
            As in the constructor, and if tilt or roll exceed a full turn, as in degrees.
        """
        centre = np.divide(checked_image_size(image_size), 2.0)
        cx, cy = centre if principal_point is None else finite_array("principal_point", principal_point, (2,))
        f = finite_array("focal_length", focal_length, ())
        K = np.array([[f, 0.0, cx], [0.0, f, cy], [0.0, 0.0, 1.0]])
        angles = [finite_array(name, value, ()) for name, value in (("pan", pan), ("tilt", tilt), ("roll", roll))]
        for name, angle in (("tilt", angles[1]), ("roll", angles[2])):  # a camera may pan on and on
            if abs(angle) > FULL_TURN:
                raise ValueError(f"{name}: expected radians, got {angle:g}: of degrees, np.deg2rad({angle:g})")
        return cls(K, rotation_from_angles(np.array(angles)), C, image_size, k, fisheye=fisheye)

    @classmethod
    def from_opencv(
        cls,
        rvec: ArrayLike,
        tvec: ArrayLike,
        camera_matrix: ArrayLike,
        dist_coeffs: ArrayLike | None,
        image_size: tuple[int, int],
        fisheye: bool = False,
    ) -> Camera:
        """A camera from OpenCV's rvec, tvec, K and dist (k1, k2, p1, p2, k3, ...; None: no distortion).

        Of a fisheye lens they are the K and D of cv2.fisheye.

        Raises
        ------
        ValueError
            As in the constructor.
        """
        rvec, tvec = (_three(name, vector) for name, vector in (("rvec", rvec), ("tvec", tvec)))
        R = rotation_from_vector(rvec)
        C = -R.T @ tvec
        dist = fisheye_vector(dist_coeffs) if truth(fisheye, "fisheye") else opencv_vector(dist_coeffs)
        return cls(camera_matrix, R, C, image_size, dist, fisheye=fisheye)

    def to_opencv(self) -> tuple[Array, Array, Array, Array]:
        """OpenCV's (rvec (3, 1), tvec (3, 1), K (3, 3), `dist`), as `cv2.projectPoints` takes them.

        Those of a fisheye lens are for `cv2.fisheye.projectPoints`.
        """
        from scipy.spatial.transform import Rotation  # a slow import; cv2.Rodrigues loses digits near half a turn

        R = self.R.copy()  # SciPy before 1.15 takes no read-only array
        rvec = Rotation.from_matrix(R).as_rotvec().reshape(3, 1)
        tvec = -(self.R @ self.C).reshape(3, 1)
        return rvec, tvec, self.K.copy(), self.dist.copy()

    @property
    def rvec(self) -> Array:
        """OpenCV's rotation vector, (3, 1)."""
        return self.to_opencv()[0]

    @property
    def tvec(self) -> Array:
        """OpenCV's translation, (3, 1): ``-R C``."""
        return self.to_opencv()[1]

    @property
    def P(self) -> Array:
        """Projection matrix (3, 4) of the pinhole, without distortion: ``K R [I -C]`` (Hartley & Zisserman, 6.1).

        Examples
        --------
        >>> camera = Camera.from_angles(0.1, 1.2, 0.0, 1500.0, (0.0, 56.0, -15.0), (960, 540))
        >>> u, v, w = camera.P @ [1.0, 2.0, 0.0, 1.0]
        >>> bool(np.allclose(camera.project([1.0, 2.0, 0.0]), (u / w, v / w)))
        True
        """
        return np.asarray(self.K @ self.R @ np.column_stack([np.eye(3), -self.C]))

    @property
    def focal_length(self) -> float:
        """Focal length along the image's rows, pixels."""
        return float(self.K[0, 0])

    @property
    def principal_point(self) -> Array:
        """(cx, cy) in pixels."""
        return self.K[:2, 2]

    @property
    def field_of_view(self) -> float:
        """Horizontal field of view in radians: ``2 atan(w / (2 fx))`` (paper, appendix "Camera Model").

        Of a fisheye lens, which is far from that, twice the angle that it images half a width from the principal point,
        and pi where that is 90 degrees or more.
        """
        half = 0.5 * self.image_size[0] / self.focal_length
        if self.fisheye:
            x, _ = self.normalized(self.principal_point + (0.5 * self.image_size[0], 0.0))
            half = np.inf if np.isnan(x) else x
        return float(2.0 * np.arctan(half))

    @cached_property
    def angles(self) -> Array:
        """Pan, tilt, roll in radians, with the smaller roll of the two solutions."""
        angles = angles_from_rotation(self.R)
        angles.flags.writeable = False
        return angles

    @property
    def half_diagonal(self) -> float:
        """Half the image's diagonal in pixels: the radius to which the lens coefficients are normalised."""
        return float(np.hypot(*self.image_size) / 2.0)

    @cached_property
    def lens(self) -> Lens:
        """The smallest lens model that has the coefficients of this camera; its parameters are `lens_coefficients`."""
        return FisheyeLens(self.half_diagonal) if self.fisheye else lens_of(self.dist, self.half_diagonal)

    @cached_property
    def lens_coefficients(self) -> Array:
        """The coefficients (n,) of `lens`, and the focal length if it needs that."""
        f = self.focal_length
        b = self.lens.at_focal_length(self.lens.from_opencv(self.dist, f), f)
        b.flags.writeable = False
        return b

    @property
    def is_pinhole(self) -> bool:
        """Whether the lens does not distort."""
        return not (self.fisheye or np.any(self.dist))

    @property
    def opencv_coefficients(self) -> Array:
        """The twelve coefficients k1, k2, p1, p2, k3, ... of OpenCV's lens, 0 where `dist` ends.

        Raises
        ------
        ValueError
            If the lens is a fisheye, which has others.
        """
        if self.fisheye:
            raise ValueError(
                "the lens is a fisheye, which has no coefficients k1, k2, p1, p2, k3, ...: undistort the pictures "
                "(fieldcalib undistort), or use a format that has this lens (opencv, colmap, nerfstudio)"
            )
        return opencv_vector(self.dist)

    @property
    def corner_distortion(self) -> Array:
        """(a1, a2): k1 and k2 normalised to the image's corner, see `fieldcalib.geometry.lens`."""
        return np.asarray(self.k * (self.half_diagonal / self.focal_length) ** POWERS[:2])

    @property
    def pinhole_homography(self) -> Array:
        """3 x 3 map of field points (x, y, 1) to the image of the pinhole, without distortion: ``K R [e1 e2 -C]``.

        Not finite where floats overflow.
        """
        with np.errstate(all="ignore"):  # absurd cameras overflow
            return np.asarray(self.K @ self.R @ np.column_stack([np.eye(3)[:, :2], -self.C]))

    @property
    def homography(self) -> Array:
        """`pinhole_homography`, with a warning where pixels of the picture are not those of the pinhole.

        Warns
        -----
        UserWarning
            If the lens moves a pixel of the image by more than 1 px (`lens_shift`).
        """
        if self.lens_shift > LENS_SHIFT:
            warnings.warn(
                f"the lens moves pixels by up to {self.lens_shift:.1f} px, and no homography has a lens: this one is "
                f"of undistorted pixels (pinhole_homography, without this warning); for pixels of the picture "
                f"field_homography(camera, field).from_raw is the nearest one, and image_to_field is exact",
                stacklevel=2,
            )
        return self.pinhole_homography

    @property
    def inverse_homography(self) -> Array:
        """3 x 3 map of pixels (x, y, 1) of the pinhole, without distortion, to the field; warns as `homography`.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the camera lies in the ground plane.
        """
        return np.asarray(np.linalg.inv(self.homography))

    @cached_property
    def lens_shift(self) -> float:
        """The largest distance by which the lens moves a pixel of the image, pixels.

        Examples
        --------
        >>> Camera.from_angles(0.0, 1.3, 0.0, 1500.0, (0, 56, -15), (960, 540), k=(0.1, 0)).lens_shift.__round__(1)
        7.1
        """
        if self.is_pinhole:
            return 0.0
        axes = (np.linspace(0.0, size - 1.0, PIXELS_PER_AXIS) for size in self.image_size)
        xy = np.stack(np.meshgrid(*axes), axis=-1)
        pinhole = self.normalized(xy) * self.K[[0, 1], [0, 1]] + self.K[:2, 2]
        return float(np.nanmax(np.linalg.norm(pinhole - xy, axis=-1)))  # NaN: no ray through the lens meets the pixel

    def depth(self, X: ArrayLike) -> Array:
        """Depth of world points (..., 3) along the optical axis, metres; negative behind the camera."""
        depth: Array = (_vectors(X, 3, "world points") - self.C) @ self.R[2]
        return depth

    def project(self, X: ArrayLike) -> Array:
        """Pixels of world points, with distortion.

        Parameters
        ----------
        X : (..., 3) array_like
            World points in metres.

        Returns
        -------
        (..., 2) array
            NaN for points without an image: behind the camera or in its plane (depth <= 0), where floats overflow, or,
            unless the camera is not `checked`, so far out that the lens is not monotone
            (`fieldcalib.geometry.lens.Lens.is_monotone`). Points may be outside the image.
        """
        with np.errstate(all="ignore"):  # absurd cameras overflow
            x, y, z = np.moveaxis((_vectors(X, 3, "world points") - self.C) @ self.R.T, -1, 0)
            visible = z > 0.0
            z = np.where(visible, z, 1.0)
            s = np.stack([x / z, y / z])
            if self.fisheye or (self.checked and not self.is_pinhole):
                lens, b = self.lens, self.lens_coefficients
                s *= self.focal_length
                visible &= lens.is_monotone(s, b) | (not self.checked)
                s = lens.distort(s, b) / self.focal_length
            elif not self.is_pinhole:
                s = brown_conrady(s, opencv_vector(self.dist))
            x, y = s[0] * self.K[0, 0] + self.K[0, 2], s[1] * self.K[1, 1] + self.K[1, 2]
        visible &= np.isfinite(x) & np.isfinite(y)
        return np.stack([np.where(visible, x, np.nan), np.where(visible, y, np.nan)], axis=-1)

    def normalized(self, xy: ArrayLike) -> Array:
        """Undistorted normalised image points (Xc / Zc, Yc / Zc) of pixels (..., 2).

        Returns
        -------
        (..., 2) array
            NaN where no ray through the lens meets the pixel; one of several rays if the lens is not monotone.
        """
        x = (_vectors(xy, 2, "pixels") - self.K[:2, 2]) / self.K[[0, 1], [0, 1]]
        if self.is_pinhole:
            return np.asarray(x)
        s = np.stack([x[..., 0], x[..., 1]])
        if self.checked or self.fisheye:
            s = self.lens.undistort(self.focal_length * s, self.lens_coefficients) / self.focal_length
        else:
            s = undistorted(s, opencv_vector(self.dist))
        return np.stack([*s], axis=-1)

    def image_to_field(self, xy: ArrayLike, *, z: float = 0.0, terrain: RaySurface | None = None) -> Array:
        """World points of pixels on the horizontal plane at height `z` (metres, down), distortion removed.

        Parameters
        ----------
        xy : (..., 2) array_like
            Pixels.
        z : float
            Height of the plane: 0 is level ground, -2.44 the crossbar.
        terrain : Terrain, optional
            The ground of a field that is not level (`Field.terrain`): points are then at height `z` above it.

        Returns
        -------
        (..., 3) array
            NaN where the pixel's ray does not meet the plane in front of the camera (above the horizon), or where no
            ray through the lens meets the pixel.
        """
        with np.errstate(all="ignore"):  # pixels may be infinite, and absurd cameras overflow
            ray = homogenize(self.normalized(xy)) @ self.R
            if not (terrain is None or hasattr(terrain, "met_by_rays")):
                raise ValueError(f"expected terrain as that of a field, soccer().terrain, got {short(terrain)}")
            if terrain is not None and not terrain.is_level:
                return terrain.met_by_rays(self.C, ray, above=-number(z, "z"))
            scale = (number(z, "z") - self.C[2]) / ray[..., 2]
            X = self.C + scale[..., None] * ray
        X[..., 2] = z
        return np.where((np.all(np.isfinite(X), axis=-1) & (scale > 0.0))[..., None], X, np.nan)

    def undistort(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """A picture without the distortion of the lens, with the same K; beyond its border it is black.

        Raises
        ------
        ValueError
            If it is no picture, or has not the camera's size.
        """
        import cv2

        if not isinstance(image, np.ndarray) or image.dtype != np.uint8 or image.ndim not in (2, 3):
            raise ValueError(f"image must be (height, width, 3) or (height, width), uint8, got {short(image)}")
        height, width = image.shape[:2]
        if (width, height) != self.image_size:
            expected, rows = self.image_size
            raise ValueError(
                f"the image has {width}x{height} pixels, and its camera is of {expected}x{rows}: are they of one clip?"
            )
        _, _, K, dist = self.to_opencv()
        if self.fisheye:
            return np.asarray(cv2.fisheye.undistortImage(image, K, dist, Knew=K), dtype=np.uint8)
        return np.asarray(cv2.undistort(image, K, dist), dtype=np.uint8)

    def to_dict(self) -> dict[str, Any]:
        """The camera as a dict for JSON: the keys of ``cameras.jsonl``, see ``docs/reference/files.md``."""
        return {
            "K": to_json(self.K),
            "dist": to_json(self.dist[0]),
            **({"lens": FisheyeLens.name} if self.fisheye else {}),
            "R": to_json(self.R),
            "C": to_json(self.C),
            "angles_degrees": dict(zip(ANGLE_NAMES, np.degrees(self.angles).tolist(), strict=True)),
            "image_size": list(self.image_size),
        }

    @classmethod
    def from_dict(cls, record: Mapping[str, Any]) -> Camera:
        """The camera of a dict of `to_dict`, such as a line of ``cameras.jsonl``.

        Raises
        ------
        ValueError
            If it is none.
        """
        expect(record, Mapping, "camera.to_dict()")
        missing = [name for name in ("K", "R", "C", "image_size", "dist") if name not in record]
        lens = record.get("lens")
        if missing:
            raise ValueError(f"the key {missing[0]!r} is missing, as camera.to_dict() has it")
        if lens not in (None, FisheyeLens.name):
            raise ValueError(f"'lens': expected {FisheyeLens.name!r}, or no such key for OpenCV's lens, got {lens!r}")
        K, R, C, image_size, dist = (record[name] for name in ("K", "R", "C", "image_size", "dist"))
        return cls(K, R, C, image_size, dist, fisheye=lens is not None)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the camera to a file of JSON; ``Camera.from_dict(json.loads(...))`` gives it back."""
        file = file_path(path, "a file of JSON")
        if file.is_dir():
            raise IsADirectoryError(f"{file} is a folder: expected the path of a file")
        write_text(file, json.dumps(self.to_dict(), indent=1) + "\n")

    def scaled(self, image_size: tuple[int, int]) -> Camera:
        """The camera of the image resized to another size; focal length and principal point scale with it."""
        new_size = checked_image_size(image_size)
        scale = np.array([new_size[0] / self.image_size[0], new_size[1] / self.image_size[1], 1.0])
        return Camera(scale[:, None] * self.K, self.R, self.C, new_size, self.dist, self.checked, self.fisheye)

    def moved(self, R: ArrayLike, C: ArrayLike) -> Camera:
        """The camera with another rotation and centre.

        Raises
        ------
        ValueError
            As in the constructor.

        Examples
        --------
        >>> camera = Camera.from_angles(0.0, 1.3, 0.0, 1500.0, (0, 56, -15), (960, 540), k=(0.1, 0))
        >>> camera.moved(camera.R, camera.C + (5.0, 0.0, 0.0))
        Camera(f=1500.0 px, pan=0.00°, tilt=74.48°, roll=0.00°, C=(5.00, 56.00, -15.00) m, k=(0.1, 0), ...)
        """
        return Camera(self.K, R, C, self.image_size, self.dist, self.checked, self.fisheye)

    def cropped(self, offset: ArrayLike, image_size: tuple[int, int]) -> Camera:
        """The camera of a part of the image, whose principal point is ``c - offset``.

        Parameters
        ----------
        offset : (2,) array_like
            Pixel (x, y) of the image that is (0, 0) of the part. Negative offsets undo a crop: they give the camera of
            the image that this one was cropped from.
        image_size : (int, int)
            Width and height of the part.

        Raises
        ------
        ValueError
            If the offset is not a pair of finite numbers, or `image_size` is not valid.

        Examples
        --------
        The right half of an image:

        >>> camera = Camera.from_angles(0.0, np.radians(75), 0.0, 1500.0, C=(0, 56, -15), image_size=(960, 540))
        >>> half = camera.cropped((480, 0), (480, 540))
        >>> half.principal_point
        array([  0., 270.])
        >>> half.cropped((-480, 0), (960, 540)) == camera
        True
        """
        shift = real_array(offset)
        if shift.shape != (2,) or not np.all(np.isfinite(shift)):
            raise ValueError(f"offset must be a pixel (x, y), got {offset!r}")
        K = self.K.copy()
        K[:2, 2] -= shift
        return Camera(K, self.R, self.C, image_size, self.dist, self.checked, self.fisheye)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Camera):
            return NotImplemented
        arrays = ((self.K, other.K), (self.R, other.R), (self.C, other.C), (self.dist, other.dist))
        is_alike = (self.image_size, self.checked, self.fisheye) == (other.image_size, other.checked, other.fisheye)
        return is_alike and all(np.array_equal(a, b) for a, b in arrays)

    __hash__ = None  # type: ignore[assignment]  # arrays do not hash

    def __reduce__(self) -> tuple[type[Camera], tuple[object, ...]]:
        copied = self.K, self.R, self.C, self.image_size, self.dist, self.checked, self.fisheye
        return Camera, copied  # copies are read-only too

    def _repr_html_(self) -> str:
        """A table for notebooks."""
        size = "{} x {} px".format(*self.image_size)
        return table(dict(zip(CAMERA_TITLES, camera_cells(self), strict=True)) | {"image size": size})

    def __repr__(self) -> str:
        pan, tilt, roll = np.degrees(self.angles)
        x, y, z = self.C
        k = self.dist[0] if np.any(self.dist[0, 2:]) else self.k
        lens = "fisheye, " if self.fisheye else ""
        return (
            f"Camera(f={self.focal_length:.1f} px, pan={pan:.2f}°, tilt={tilt:.2f}°, roll={roll:.2f}°, "
            f"C=({x:.2f}, {y:.2f}, {z:.2f}) m, {lens}k=({', '.join(f'{value:.4g}' for value in k)}), "
            f"image_size={self.image_size[0]}x{self.image_size[1]})"
        )


def camera_cells(camera: Camera | None) -> tuple[str, str, str]:
    """The cells of a camera in a table with `CAMERA_TITLES`; empty without one."""
    if camera is None:
        return "", "", ""
    angles = ", ".join(f"{angle:.2f}°" for angle in np.degrees(camera.angles))
    return f"{camera.focal_length:.1f} px", angles, ", ".join(f"{x:.2f}" for x in camera.C) + " m"


def finite_array(name: str, values: ArrayLike, shape: tuple[int, ...]) -> Array:
    """A read-only array of finite numbers of a shape, or a ValueError that begins with its name."""
    try:
        array = np.array(real_array(values))
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None
    if array.shape != shape or not np.all(np.isfinite(array)):
        expected = f"a finite array of shape {shape}" if shape else "a finite number"
        raise ValueError(f"{name} must be {expected}, got {np.asarray(values)!r}")
    array.flags.writeable = False
    return array


def _three(name: str, values: ArrayLike) -> Array:
    """OpenCV's vector of three numbers, of any shape."""
    array = real_array(values)
    return np.array(finite_array(name, array.reshape(3) if array.size == 3 else array, (3,)))


def _vectors(values: ArrayLike, size: int, what: str) -> Array:
    """Points with `size` coordinates as a float array (..., size), or a ValueError."""
    array = real_array(values)
    if array.ndim == 0 or array.shape[-1] != size:
        ground = size == 3 and array.ndim > 0 and array.shape[-1] == 2
        hint = "; points on level ground have z = 0: append a column of zeros" * ground
        came = "None" if values is None else f"shape {array.shape}"
        raise ValueError(f"expected {what} of shape (..., {size}), got {came}{hint}")
    return array


def checked_image_size(image_size: Any) -> tuple[int, int]:
    """(width, height) as two positive integers, or a ValueError."""
    is_array = isinstance(image_size, np.ndarray)
    count = image_size.size if is_array else len(image_size) if isinstance(image_size, tuple | list) else 0
    sides = list(image_size) if count == 2 and np.ndim(image_size[0]) == 0 else []
    if len(sides) != 2 or not all(is_number(side) and 0 < side < np.inf and side == int(side) for side in sides):
        came = f"an array of shape {image_size.shape}" if is_array and count > 4 else short(image_size)
        hint = "; of an image array it is image.shape[1::-1]" if count >= 3 else ""
        raise ValueError(f"image_size must be (width, height) in whole pixels, got {came}{hint}")
    return int(sides[0]), int(sides[1])
