"""Objects of random points, cameras that look at them, and how far a camera is from another one."""

import numpy as np
from hypothesis import strategies as st
from strategies import vectors

from fieldcalib import Camera
from fieldcalib.geometry.rotation import rotation_from_angles
from fieldcalib.solve.from_homography import GROUND_POINTS

SIZE = (960, 540)


def relative_error(found, truth, extent=None):
    """The largest of the relative errors of focal length and position and of the rotation."""
    distance = np.linalg.norm(truth.C) if extent is None else extent
    return max(
        abs(found.focal_length / truth.focal_length - 1.0),
        np.linalg.norm(found.C - truth.C) / distance,
        np.linalg.norm(found.R - truth.R),
    )


# How a camera looks at an object of size 1: slant off the plane's normal, so that the focal length shows, azimuth,
# roll, distance; and how the object is turned and where it lies.
LEAST_VIEW = np.array([0.5, -np.pi, -np.pi, 2.5, *[-np.pi] * 3, *[-30.0] * 3])
LARGEST_VIEW = np.array([1.0, np.pi, np.pi, 6.0, *[np.pi] * 3, *[30.0] * 3])


def seen_object(X, view, *, planar, unit=1.0):
    """An object of points (N, 3) of size 1, flattened if planar and placed as `view` says: (X, camera, distance)."""
    slant, around, roll, distance = view[:4]
    turn, origin = rotation_from_angles(view[4:7]), view[7:]
    towards = np.array([np.sin(slant) * np.cos(around), np.sin(slant) * np.sin(around), np.cos(slant)])
    right = np.cross(-towards, [0.3, 1.0, 0.1])
    right /= np.linalg.norm(right)
    R = rotation_from_angles(np.array([0.0, 0.0, roll])) @ np.array([right, np.cross(-towards, right), -towards])
    f = 170.0 * distance
    K = np.array([[f, 0.0, 480.0], [0.0, f, 270.0], [0.0, 0.0, 1.0]])
    camera = Camera(K, R @ turn.T, unit * (turn @ (distance * towards) + origin), SIZE)
    return unit * (X * (1.0, 1.0, 0.0 if planar else 1.0) @ turn.T + origin), camera, unit * distance


def any_object(rng, *, planar, count, placed=True):
    """An object of random points, and a camera that looks at it."""
    view = rng.uniform(LEAST_VIEW, LARGEST_VIEW) * np.where(np.arange(10) < 4, 1.0, placed)
    return seen_object(rng.uniform(-1.0, 1.0, size=(count, 3)), view, planar=planar)


@st.composite
def objects(draw, *, planar, count, unit=1.0):
    """The same, of points in general position: near the corners of a square or an octahedron, and near others."""
    corners = [(-0.8, -0.7, 0), (0.7, -0.8, 0), (0.9, 0.7, 0), (-0.6, 0.8, 0)]
    octahedron = [(0.9, 0.1, 0.1), (-0.8, 0.2, -0.2), (0.2, 0.9, -0.1), (0.1, -0.7, 0.1), (0.1, 0.2, 0.8), (0, 0, -0.9)]
    X = np.random.default_rng(0).uniform(-1.0, 1.0, size=(count, 3))
    X[: 4 if planar else 6] = corners if planar else octahedron
    X += draw(vectors([-0.2] * 3, [0.2] * 3, count=count))
    return seen_object(X, draw(vectors(LEAST_VIEW, LARGEST_VIEW)), planar=planar, unit=unit)


def without_focal_length():
    """h2 is longer than h1 in the image's plane and along the optical axis: no weight of the axis makes them equal."""
    return np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.1, 1.0]])


def points_in_view(camera, tolerance):
    """Names of the ground points that a camera sees in its enlarged image."""
    xy = camera.project([point.X for point in GROUND_POINTS.values()])
    low, high = np.multiply(camera.image_size, -tolerance), np.multiply(camera.image_size, 1.0 + tolerance)
    return {
        name for name, inside in zip(GROUND_POINTS, np.all((xy >= low) & (xy <= high), axis=1), strict=True) if inside
    }
