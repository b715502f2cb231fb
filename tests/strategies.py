"""Hypothesis strategies: what is drawn are the parameters themselves, so that a failure shrinks to a simple camera.

Points in general position are a fixed set moved by drawn distances. A seed is drawn by `generators`, for noise whose
values do not matter.
"""

import numpy as np
from hypothesis import assume, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from synthetic import displaced, distorted

from fieldcalib.fields.traits import DISTRIBUTIONS, focal_length_from_fov
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.lens.model import COEFFICIENTS
from fieldcalib.geometry.rotation import rotation_from_angles
from fieldcalib.problem.layout import theta_from_camera

MOST_EXAMPLES = settings.get_profile("random").max_examples  # the profiles are in conftest.py
IMAGE_SIZES = ((960, 540), (1280, 720), (1920, 1080))


# Of many scripts, and what formats escape. For `hypothesis.strategies.text` a table of Unicode is made: seconds.
CHARACTERS = "aZ09 _-.,:;/\\'\"<>&%#@[]{}éßλж漢あ한ع🏀\u0301\u00a0"


def examples(count):
    """Settings of a property: `count` examples at random, a share of them where they are the same on every run."""
    return settings(max_examples=max(1, count * settings().max_examples // MOST_EXAMPLES))


def texts(**limits):
    """Texts of CHARACTERS; `limits` are those of `hypothesis.strategies.lists`."""
    return st.lists(st.sampled_from(CHARACTERS), **limits).map("".join)


def numbers(low, high):
    """Floats from low to high, the ends and, where they lie between, 0 and whole numbers among them."""
    return st.floats(low, high, allow_subnormal=False)


def vectors(low, high, count=None):
    """Arrays (n,) within bounds (n,); with `count`, (count, n)."""
    low, high = np.array(low, dtype=float), np.array(high, dtype=float)
    shape = low.shape if count is None else (count, *low.shape)
    return arrays(float, shape, elements=numbers(0.0, 1.0)).map(lambda share: low + share * (high - low))


def bounded(shape, low, high):
    """Arrays of a shape with `numbers` from low to high."""
    return arrays(float, shape, elements=numbers(low, high))


def moved(x, distance):
    """Arrays like `x`, every entry moved by up to `distance`."""
    return bounded(np.shape(x), -distance, distance).map(lambda by: x + by)


def pixel_arrays(low, high, most=8):
    """One to `most` pixels (N, 2) within bounds."""
    return st.integers(1, most).flatmap(lambda count: vectors(low, high, count))


def generators():
    """NumPy generators."""
    return st.builds(np.random.default_rng, st.integers(0, 2**32 - 1))


def angle(limit):
    """Angles in radians from -limit to limit, 0 and the ends among them."""
    return numbers(-limit, limit)


def any_angles():
    """(pan, tilt, roll) anywhere, straight down and straight up included."""
    return st.builds(lambda *a: np.array(a), angle(np.pi), angle(np.pi), angle(np.pi))


def operated_angles():
    """(pan, tilt, roll) of a camera that somebody holds: neither straight down nor straight up, |roll| < 90 degrees."""
    return st.builds(lambda *a: np.array(a), angle(3.14), numbers(0.01, np.pi - 0.01), angle(1.57))


@st.composite
def cameras(draw, lens=None, stands=tuple(DISTRIBUTIONS), image_sizes=IMAGE_SIZES):
    """Broadcast cameras on the stands that look at a point of the field: without lens, with one, or (None) either.

    A lens comes with a principal point off the centre and with pixels that are not square.
    """
    stand = DISTRIBUTIONS[draw(st.sampled_from(stands))]
    width, height = draw(st.sampled_from(image_sizes))
    C = np.array([draw(numbers(*limits)) for limits in (stand.x, stand.y, stand.z)])
    x, y, z = (draw(numbers(-52.5, 52.5)), draw(numbers(-34.0, 34.0)), 0.0) - C  # to where it looks
    pan, tilt = np.arctan2(x, -y), np.arctan2(np.hypot(x, y), z)
    low, high = np.radians(stand.pan)
    assume(0.0 <= (pan - low) % (2.0 * np.pi) <= high - low)
    assume(np.radians(stand.tilt[0]) <= tilt)
    roll, fov = np.radians([draw(numbers(*stand.roll)), draw(numbers(*stand.fov))])
    f = float(focal_length_from_fov(fov, width))
    camera = Camera.from_angles(pan, tilt, roll, f, C, (width, height))
    if draw(st.booleans()) if lens is None else lens:
        # the corner moves by -8 % to 17 %, inside the monotone part of the lens
        a1, b2 = draw(numbers(-0.06, 0.15)), draw(numbers(-0.02, 0.02))
        offset = [draw(numbers(-0.02, 0.02)) * width for _ in "xy"]
        return distorted(camera, a1, b2, offset, draw(numbers(-0.01, 0.01)))
    return camera


def thetas(lens=None):
    """(theta, image_size) of broadcast cameras."""
    return cameras(lens).map(lambda camera: (theta_from_camera(camera), camera.image_size))


@st.composite
def anywhere(draw, lens=None):
    """Cameras at any angle, straight down and upside down included, without any field in mind."""
    image_size = draw(st.sampled_from(IMAGE_SIZES))
    C, f = draw(vectors([-50.0] * 3, [50.0] * 3)), image_size[0] * draw(numbers(0.5, 7.0))
    with_lens = draw(st.booleans()) if lens is None else lens
    k = draw(vectors((-0.1, -0.01), (0.3, 0.02))) if with_lens else (0.0, 0.0)
    return Camera.from_angles(*draw(any_angles()), f, C, image_size, k=k)


@st.composite
def labelled_frames(draw, seen, distances, *, least=1):
    """Some of the labels of a frame, `least` or more, with every pixel moved by a distance that `distances` draws."""
    assume(len(seen) >= least)
    labels = draw(st.sets(st.sampled_from(sorted(seen)), min_size=least))
    frame = {label: xy for label, xy in seen.items() if label in labels}
    return displaced(frame, draw(distances), draw(angle(np.pi)))


# Coefficients that move points at radius 1 by up to about its half; the denominator is at least 0.7 there.
lenses = vectors([-0.1] * len(COEFFICIENTS), [0.1] * len(COEFFICIENTS))


@st.composite
def unchecked_cameras(draw):
    """Cameras with every coefficient, at any angle; focal lengths differ and may be negative."""
    image_size = draw(st.sampled_from(IMAGE_SIZES))
    fx, fy = (image_size[0] * draw(st.sampled_from((1.0, -1.0))) * draw(numbers(0.5, 5.0)) for _ in "xy")
    cx, cy = image_size * draw(vectors((0.4, 0.4), (0.6, 0.6)))
    K = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    C = draw(vectors([-50.0] * 3, [50.0] * 3))
    return Camera(K, rotation_from_angles(draw(any_angles())), C, image_size, draw(lenses), checked=False)
