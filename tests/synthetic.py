"""Synthetic frames with known cameras: what a camera sees of an object, as labelled pixels."""

import numpy as np

from fieldcalib.fields.segments import Line
from fieldcalib.fields.sports.soccer import soccer
from fieldcalib.fields.traits import DISTRIBUTIONS, focal_length_from_fov
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.lens import RadialLens
from fieldcalib.problem.layout import GaussianPrior, gaussian_priors

SIZE = (960, 540)
LENGTH_IN_VIEW = 10.0  # px: shorter lines have no direction
GOLDEN_ANGLE = 2.399963  # rad: directions that never repeat and are even on the whole


# Cameras


def gaussian_prior(distribution, layout):
    """The prior of one distribution, mean and sigma (n,)."""
    priors = gaussian_priors([distribution], layout)
    return GaussianPrior(priors.mean[0], priors.sigma[0])


def random_camera(stand, rng, image_size=SIZE, a1=(0.0, 0.0)):
    """A camera of a distribution, uniform in its ranges, with a lens of normally distributed a1 (mean, sigma)."""
    ranges = np.array([stand.pan, stand.tilt, stand.roll, stand.fov, stand.x, stand.y, stand.z])
    pan, tilt, roll, fov, *C = rng.uniform(ranges[:, 0], ranges[:, 1])
    f = float(focal_length_from_fov(np.radians(fov), image_size[0]))
    camera = Camera.from_angles(*np.radians([pan, tilt, roll]), f, C, image_size)
    return distorted(camera, rng.normal(*a1)) if any(a1) else camera


def distorted(camera, a1, b2=0.0, offset=(0.0, 0.0), log_aspect=0.0):
    """The camera with a lens, the principal point moved by `offset` pixels and pixels that are not square."""
    k = RadialLens(camera.half_diagonal).to_opencv(np.array([a1, b2]), camera.focal_length)
    K = camera.K * [[1.0], [np.exp(log_aspect)], [1.0]]
    K[:2, 2] = camera.principal_point + offset
    return Camera(K, camera.R, camera.C, camera.image_size, k)


def random_distorted(camera, rng):
    """The camera with a lens, a principal point and an aspect ratio beyond those of broadcasts.

    The corner moves by -8 % to 17 %, inside the monotone part of the lens.
    """
    offset = rng.uniform(-0.02, 0.02, size=2) * camera.image_size[0]
    return distorted(camera, *rng.uniform((-0.06, -0.02), (0.15, 0.02)), offset, rng.uniform(-0.01, 0.01))


# What they see


def in_image(xy, image_size):
    """Which pixels lie in the image; NaN does not."""
    return np.all((xy >= 0.0) & (xy <= np.subtract(image_size, 1)), axis=-1)


def visible_field_points(camera, count=30, z=0.0):
    """`count` points of a 105 x 68 m field, raised to height z, that lie in the image; fewer where hardly any does.

    The points are always the same ones; which of them are in view depends on the camera.
    """
    rng, found = np.random.default_rng(0), np.empty((0, 3))
    for _ in range(100):
        X = np.column_stack([rng.uniform((-52.5, -34.0), (52.5, 34.0), size=(400, 2)), np.full(400, z)])
        found = np.concatenate([found, X[in_image(camera.project(X), camera.image_size)]])
        if len(found) >= count:
            break
    return found[:count]


def observe(object_segments, camera, rng=None, noise=0.0, per_line=3, per_curve=9):
    """Labelled pixels of all segments in view, evenly spread over their visible part, with Gaussian noise in pixels."""
    frame = {}
    for label, segment in object_segments.items():
        xy = camera.project(segment.sample(0.25))
        xy = xy[in_image(xy, camera.image_size)]
        is_line = isinstance(segment, Line)
        if len(xy) < 2 or (is_line and np.linalg.norm(xy[-1] - xy[0]) < LENGTH_IN_VIEW):
            continue
        count = min(per_line if is_line else per_curve, len(xy))
        frame[label] = xy[np.linspace(0, len(xy) - 1, count).round().astype(int)]
        if noise:
            frame[label] = frame[label] + rng.normal(scale=noise, size=frame[label].shape)
    return frame


def displaced(frame, distance, direction=0.0):
    """The frame with every pixel moved by `distance` (a number or (N, 1) arrays), each along another direction."""
    moved, count = {}, 1
    for label, xy in frame.items():
        angles = direction + GOLDEN_ANGLE * np.arange(count, count + len(xy))
        moved[label] = xy + distance * np.column_stack([np.cos(angles), np.sin(angles)])
        count += len(xy)
    return moved


def whole_circle_markings(field):
    """The markings as annotators name them: the centre circle once, not in halves too."""
    return {label: s for label, s in field.markings.items() if not label.startswith("Circle central ")}


def random_frames(
    count,
    seed,
    noise=0.0,
    *,
    least_segments=5,
    stands=tuple(DISTRIBUTIONS),
    image_size=SIZE,
    a1=(0.0, 0.0),
    field=None,
):
    """`count` frames of random cameras, one stand after the other, with so many segments or more: (frames, cameras).

    `seed` may be a generator, which goes on where it is; `stands` are names of stands of the field.
    """
    field = soccer() if field is None else field
    rng, markings = np.random.default_rng(seed), whole_circle_markings(field)
    frames, cameras = [], []
    while len(frames) < count:
        camera = random_camera(field.named_stands[stands[len(frames) % len(stands)]], rng, image_size, a1)
        frame = observe(markings, camera, rng, noise)
        if len(frame) >= least_segments:
            frames.append(frame)
            cameras.append(camera)
    return frames, cameras
