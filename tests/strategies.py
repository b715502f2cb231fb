"""Hypothesis strategies: what is drawn is a seed, so that examples are cheap; a failure names the seed."""

import numpy as np
from fieldcalib.problem.parameters import LENS, LOG_ASPECT, PRINCIPAL_POINT, camera_from_theta, sample_theta
from hypothesis import strategies as st

from fieldcalib.fields.stands import DISTRIBUTIONS
from fieldcalib.geometry.camera import Camera

IMAGE_SIZES = ((960, 540), (1280, 720), (1920, 1080))

seeds = st.integers(0, 2**32 - 1)


def generators():
    """NumPy generators."""
    return st.builds(np.random.default_rng, seeds)


def angle(limit):
    """Angles in radians from -limit to limit, 0 and the ends among them."""
    return st.floats(-limit, limit, allow_subnormal=False)


def any_angles():
    """(pan, tilt, roll) anywhere, straight down and straight up included."""
    return st.builds(lambda *a: np.array(a), angle(np.pi), angle(np.pi), angle(np.pi))


def operated_angles():
    """(pan, tilt, roll) of a camera that somebody holds: neither straight down nor straight up, |roll| < 90 degrees."""
    tilt = st.floats(0.01, np.pi - 0.01)
    return st.builds(lambda *a: np.array(a), angle(3.14), tilt, angle(1.57))


def in_image(xy, image_size):
    """Which pixels lie in the image; NaN does not."""
    return np.all((xy >= 0.0) & (xy <= np.subtract(image_size, 1)), axis=-1)


def random_field_points(camera, rng, z):
    """Those of 400 random points of a 105 x 68 m field, raised to height z, that lie in the image."""
    X = np.column_stack([rng.uniform((-52.5, -34.0), (52.5, 34.0), size=(400, 2)), np.full(400, z)])
    return X[in_image(camera.project(X), camera.image_size)]


def visible_field_points(camera, rng, count=30, z=0.0):
    """`count` random points of the field, raised to height z, that lie in the image; fewer where hardly any does."""
    found = np.empty((0, 3))
    for _ in range(100):
        found = np.concatenate([found, random_field_points(camera, rng, z)])
        if len(found) >= count:
            break
    return found[:count]


def broadcast_theta(name, image_size, lens, seed):
    """Parameters of a camera of the named distribution that has at least 10 of 400 random field points in view."""
    rng = np.random.default_rng(seed)
    for _ in range(1000):
        theta = sample_theta(DISTRIBUTIONS[name], 1, rng, image_size)[0]
        if lens:
            # the corner moves by -8 % to 17 %, inside the monotone part of the lens
            theta[LENS] = rng.uniform((-0.06, -0.02), (0.15, 0.02))
            theta[PRINCIPAL_POINT] += rng.uniform(-0.02, 0.02, size=2) * image_size[0]
            theta[LOG_ASPECT] = rng.uniform(-0.01, 0.01)
        if len(random_field_points(camera_from_theta(theta, image_size), rng, z=0.0)) >= 10:
            return theta
    raise AssertionError(f"no camera of {name!r} sees the field")


def thetas(lens):
    """(theta, image_size) of cameras from every distribution; `lens` adds k1, k2, principal point and aspect."""
    return st.builds(
        lambda name, image_size, seed: (broadcast_theta(name, image_size, lens, seed), image_size),
        st.sampled_from(sorted(DISTRIBUTIONS)),
        st.sampled_from(IMAGE_SIZES),
        seeds,
    )


def cameras(lens=None):
    """Broadcast cameras from every distribution that see the field: without lens, with one, or (None) either."""
    either = st.booleans() if lens is None else st.just(lens)
    return either.flatmap(thetas).map(lambda drawn: camera_from_theta(*drawn))


def anywhere(lens=None):
    """Cameras at any angle, straight down and upside down included, without any field in mind."""

    def build(angles, with_lens, rng):
        k = rng.uniform((-0.1, -0.01), (0.3, 0.02)) if with_lens else (0.0, 0.0)
        image_size = IMAGE_SIZES[rng.integers(len(IMAGE_SIZES))]
        focal_length = image_size[0] * rng.uniform(0.5, 7.0)
        return Camera.from_angles(*angles, focal_length, rng.uniform(-50, 50, size=3), image_size, k=k)

    either = st.booleans() if lens is None else st.just(lens)
    return st.builds(build, any_angles(), either, generators())
