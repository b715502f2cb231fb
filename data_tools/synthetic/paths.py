"""Paths of the cameras of synthetic clips: an operator pans and zooms on a tripod, or the camera flies.

Zoom, principal point and lens are those of a measured camera, frame by frame, or follow a random law whose coefficients
are in the ranges of the measured ones; pan and tilt move as an operator moves them. `data_tools.synthetic.film` makes
pictures of a path.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from data_tools.synthetic.colours import Range
from fieldcalib._types import Array
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Arc, Line, Segment
from fieldcalib.geometry.camera import Camera
from fieldcalib.geometry.homography import homogenize
from fieldcalib.geometry.lens.model import POWERS
from fieldcalib.geometry.rotation import rotation_from_angles
from fieldcalib.solve.solver_options import paint_sigma

SIZE = (1920, 1080)  # of the measured cameras
RATE = 30.0  # frames per second
MEASURED_RATE = 60.0  # frames per second of the measured sequences, by the one of them that has a video

# An operator follows the play, and stops
PAN_PERIOD, ZOOM_PERIOD = 2.5, 5.0  # s from one move to the next, on average; no measured zoom is faster than 0.43 / s
RESTS, LEAST_RESTS = 0.3, 0.2  # share of the time at rest; the lower one where moves would be too fast
LEAST_MOVE = 0.5  # s: shortest duration of a move through the whole range
UNEVEN = 0.6  # standard deviation of the logarithm of durations: some moves are five times as fast as others
SHORTEST_MOVE = 0.15  # of the whole range, added to the length of a move: short ones take relatively long
HAND, HAND_TIME = np.radians(0.01), 0.25  # motion of the hand on the pan bar: standard deviation, correlation time in s
PAN_RANGE = (-np.radians(15.0), np.radians(15.0))
AIM_RANGE = (-10.0, 8.0)  # m: y of the ground that the camera aims at
LEAN, ROLL = np.radians(0.3), np.radians(0.3)  # of tripods and cameras that were levelled with a bubble

# Ranges after the ten measured sequences (1920 x 1080): four stadiums with |x| < 0.4, y 67 to 88 and z -12 to -19 m
X_SIGMA, Y_RANGE, Z_RANGE = 1.0, (62.0, 90.0), (-21.0, -11.0)
# the logarithm of the focal length over 4000 px spans -0.5 to 0.57, in one sequence at most 0.91
REFERENCE_FOCAL_LENGTH = 4000.0
LOG_FOCAL_RANGE, LOG_FOCAL_SPAN = (-0.5, 0.55), (0.3, 0.9)
# over it, the principal point is a line: pixels from the centre of the image, and pixels per unit
POINT_RANGES = ((-16.0, 38.0), (-66.0, -5.0))
POINT_SLOPES = ((-6.0, 18.0), (-6.0, 21.0))
# and the corner's displacement a1 + a2 and its part a2 are parabolas: constant, slope and curvature
DISPLACEMENT_RANGES = ((0.036, 0.041), (-0.030, -0.005), (-0.07, 0.01))
A2_RANGES = ((0.007, 0.013), (-0.040, -0.006), (0.0, 0.05))

# Flying cameras
FLIGHT, FLIGHT_PERIOD = ((-15.0, 15.0), (48.0, 56.0), (-20.0, -14.0)), 8.0  # ranges of x, y, z in m; s between stops
MOST_ACCELERATION = 5.0  # m/s^2


@dataclass(frozen=True, eq=False)
class MeasuredZoom:
    """Frames of a measured camera on a tripod that zooms, at `SIZE`."""

    K: Array
    """(N, 3, 3)."""
    k: Array
    """(N, 2): k1 and k2."""
    C: Array
    """(3,): where the axes of pan and tilt meet."""


@dataclass(frozen=True)
class PolynomialLaw:
    """Principal point and lens of a zoom lens as polynomials in u = log(f / `REFERENCE_FOCAL_LENGTH`), at `SIZE`.

    Coefficients are in ascending order.
    """

    principal_point: Array
    """(2, 2): rows constant and slope, columns x and y; pixels from (w / 2, h / 2)."""
    displacement: Array
    """(3,): coefficients of a1 + a2, the relative displacement of the corner (`fieldcalib.geometry.lens`)."""
    a2: Array
    """(3,): coefficients of a2."""

    @classmethod
    def random(cls, rng: np.random.Generator) -> PolynomialLaw:
        """A law uniform in the ranges of those measured."""
        point = np.stack([rng.uniform(*np.transpose(ranges)) for ranges in (POINT_RANGES, POINT_SLOPES)])
        displacement, a2 = (rng.uniform(*np.transpose(ranges)) for ranges in (DISPLACEMENT_RANGES, A2_RANGES))
        return cls(point, displacement, a2)

    def at(self, f: Array) -> tuple[Array, Array]:
        """K (N, 3, 3) and (k1, k2) (N, 2) at focal lengths (N,) in pixels.

        Examples
        --------
        >>> points = np.array([[10.0, -50.0], [5.0, 8.0]])
        >>> law = PolynomialLaw(points, np.array([0.04, -0.02, 0.0]), np.array([0.01, 0.0, 0.0]))
        >>> K, k = law.at(np.array([4000.0]))
        >>> K[0, :2, 2], (k[0] * (np.hypot(960, 540) / 4000.0) ** [2, 4]).round(6)
        (array([970., 490.]), array([0.03, 0.01]))
        """
        polynomial = np.polynomial.polynomial.polyval
        u = np.log(f / REFERENCE_FOCAL_LENGTH)
        K = np.zeros((len(f), 3, 3))
        K[:, 0, 0] = K[:, 1, 1] = f
        K[:, :2, 2] = np.array(SIZE) / 2.0 + polynomial(u, self.principal_point).T
        K[:, 2, 2] = 1.0
        a2 = polynomial(u, self.a2)
        a = np.stack([polynomial(u, self.displacement) - a2, a2], axis=-1)
        return K, a * (f[:, None] / (np.hypot(*SIZE) / 2.0)) ** POWERS[:2]


def camera_path(
    rng: np.random.Generator,
    frames: int,
    measured: MeasuredZoom | None = None,
    *,
    pan_range: Range = PAN_RANGE,
    centre: ArrayLike | None = None,
    image_size: tuple[int, int] = SIZE,
) -> list[Camera]:
    """The cameras of a clip from one tripod, `RATE` frames a second.

    Parameters
    ----------
    rng : numpy.random.Generator
    frames : int
        Number of frames.
    measured : MeasuredZoom, optional
        K and k are those of this measured sequence, played at its own speed from a random frame on, and backwards from
        its end. By default, a random `PolynomialLaw`, with zooming within the measured ranges.
    pan_range : (float, float)
        Smallest and largest pan, radians; the camera reaches both.
    centre : (3,) or (frames, 3) array_like, optional
        Where the axes of pan and tilt meet, for each frame if the camera moves (`flight`); by default the measured
        camera's, or on the main stand.
    image_size : (int, int)
        Width and height in pixels; the aspect ratio must be 16:9.

    Examples
    --------
    >>> cameras = camera_path(np.random.default_rng(0), 100, image_size=(960, 540))
    >>> len(cameras), bool(np.ptp([camera.C for camera in cameras], axis=0).any())
    (100, False)
    """
    if measured is None:
        K, k = _zoomed(rng, frames)
        drawn = [rng.normal(0.0, X_SIGMA), rng.uniform(*Y_RANGE), rng.uniform(*Z_RANGE)]
    else:
        K, k = _played(measured.K, measured.k, rng, frames)
        drawn = list(measured.C)
    axis = np.array(drawn if centre is None else centre, dtype=float)
    pan = _ranged(operated(rng, frames), pan_range) + _hand(rng, frames)
    aim = _ranged(operated(rng, frames), AIM_RANGE)
    tilt = np.arctan2((axis[..., 1] - aim) / np.cos(pan), -axis[..., 2]) + _hand(rng, frames)
    roll = np.full(frames, rng.normal(0.0, ROLL))
    R = rotation_from_angles(np.stack([pan, tilt, roll], axis=-1)) @ _leaning(rng)
    C = np.broadcast_to(axis, (frames, 3))
    return [Camera(*of_frame[:3], SIZE, of_frame[3]).scaled(image_size) for of_frame in zip(K, R, C, k, strict=True)]


def flight(rng: np.random.Generator, frames: int) -> Array:
    """Centres of a camera on wires or a drone, which flies along the near side line, (frames, 3) metres.

    It uses as much of the space `FLIGHT` as it can without exceeding `MOST_ACCELERATION`.
    """
    share = np.stack([operated(rng, frames, FLIGHT_PERIOD) for _ in FLIGHT], axis=-1)
    low, high = np.transpose(FLIGHT)
    path = low + (high - low) * share
    most = np.abs(np.diff(path, 2, axis=0)).max(initial=0.0) * RATE**2
    return np.asarray(path[0] + min(1.0, MOST_ACCELERATION / max(most, 1e-9)) * (path - path[0]))


def operated(rng: np.random.Generator, frames: int, period: float = PAN_PERIOD) -> Array:
    """Values from 0 to 1, (frames,), of an axis that an operator moves: rests, and minimum-jerk moves between them.

    A move and the rest before it take `period` seconds on average. Both 0 and 1 are reached; longer clips have more
    stops.

    Examples
    --------
    >>> values = operated(np.random.default_rng(0), 301)
    >>> float(values.min()), float(values.max()), bool(np.abs(np.diff(values)).max() < 0.1)
    (0.0, 1.0, True)
    """
    moves = max(1, round(frames / RATE / period))
    stops = rng.permutation(np.concatenate([[0.0, 1.0], rng.uniform(size=moves - 1)]))
    moving = (SHORTEST_MOVE + np.abs(np.diff(stops))) * np.exp(rng.normal(0.0, UNEVEN, size=moves))
    resting = np.exp(rng.normal(0.0, UNEVEN, size=moves))
    moving *= (1.0 - RESTS) / moving.sum()
    least = LEAST_MOVE * RATE / frames * np.sqrt(np.abs(np.diff(stops)))
    moving = np.maximum(moving, np.minimum(least, (1.0 - RESTS) / moves))
    moving *= min(1.0, (1.0 - LEAST_RESTS) / moving.sum())
    resting *= (1.0 - moving.sum()) / resting.sum()
    end = np.cumsum(moving + resting)
    t = np.linspace(0.0, 1.0, frames)
    s = np.clip((t - (end - moving)[:, None]) / moving[:, None], 0.0, 1.0)
    smooth = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)  # minimum jerk between two rests
    return np.asarray(np.clip(stops[0] + np.diff(stops) @ smooth, 0.0, 1.0))


def camera_between(a: Camera, b: Camera, share: float) -> Camera:
    """The camera between two frames, at a share of the way: rotation at constant speed, all else linear."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(b.R @ a.R.T).as_rotvec()
    R = Rotation.from_rotvec(share * turn).as_matrix() @ a.R
    K, C, dist = (of_a + share * (of_b - of_a) for of_a, of_b in ((a.K, b.K), (a.C, b.C), (a.dist, b.dist)))
    return Camera(K, R, C, a.image_size, dist)


def seen_far_away(camera: Camera, other: Camera, xy: Array) -> Array:
    """Pixels (..., 2) of `other` that show the same infinitely far points as the pixels xy (..., 2) of `camera`."""
    return other.project(other.C + homogenize(camera.normalized(xy)) @ camera.R)


def with_displaced_lines(field: Field, rng: np.random.Generator, sigma: float | None = None) -> Field:
    """The field with the lines on its ground displaced, and the radii of its circles changed, by some centimetres.

    `sigma` is their standard deviation, metres; by default that of `paint_sigma`.

    Examples
    --------
    >>> from fieldcalib.fields.sports.soccer import soccer
    >>> lines = with_displaced_lines(soccer(), np.random.default_rng(0))
    >>> [round(float(end), 3) for end in lines["Middle line"].start]
    [0.016, -34.0, 0.0]
    """
    sigma = paint_sigma(field) if sigma is None else sigma
    wider: dict[tuple[float, float, float], float] = {}  # by centre: halves of a circle have one radius

    def moved(segment: Segment) -> Segment:
        off = rng.normal(0.0, sigma)
        if isinstance(segment, Arc):
            return replace(segment, radius=segment.radius + wider.setdefault(segment.center, off))
        if isinstance(segment, Line) and segment.start[2] == segment.end[2] == 0.0:
            x, y, _ = np.subtract(segment.end, segment.start)
            across = off * np.array([-y, x, 0.0]) / np.hypot(x, y)
            return Line(tuple((segment.start + across).tolist()), tuple((segment.end + across).tolist()))
        return segment

    return replace(field, segments={name: moved(segment) for name, segment in field.segments.items()})


def _zoomed(rng: np.random.Generator, frames: int) -> tuple[Array, Array]:
    """K and k of a random `PolynomialLaw` while an operator zooms."""
    low, high = LOG_FOCAL_RANGE
    span = rng.uniform(*LOG_FOCAL_SPAN)
    start = rng.uniform(low, high - span)
    u = _ranged(operated(rng, frames, ZOOM_PERIOD), (start, start + span))
    return PolynomialLaw.random(rng).at(REFERENCE_FOCAL_LENGTH * np.exp(u))


def _played(K: Array, k: Array, rng: np.random.Generator, frames: int) -> tuple[Array, Array]:
    """K and k of the measured sequence, interpolated at `RATE` frames a second."""
    last = len(K) - 1
    moment = rng.uniform(0.0, last) + np.arange(frames) * MEASURED_RATE / RATE
    moment = last - np.abs(last - np.mod(moment, 2 * last)) if last else 0.0 * moment
    before = np.floor(moment).astype(int)
    after, share = np.minimum(before + 1, last), moment - before
    K, k = (
        (1.0 - weight) * values[before] + weight * values[after]
        for values, weight in ((K, share[:, None, None]), (k, share[:, None]))
    )
    return K, k


def _ranged(shares: Array, limits: Range) -> Array:
    low, high = limits
    return low + (high - low) * shares


def _hand(rng: np.random.Generator, frames: int) -> Array:
    """Small smooth movements of an angle, radians (frames,)."""
    from scipy.ndimage import gaussian_filter1d

    width = HAND_TIME * RATE
    noise = gaussian_filter1d(rng.standard_normal(frames), width, mode="wrap")
    return np.asarray(HAND * np.sqrt(2.0 * np.sqrt(np.pi) * width) * noise)  # undoes the loss of variance by the filter


def _leaning(rng: np.random.Generator) -> Array:
    """Small random rotation: a tripod is not exactly level."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec([*rng.normal(0.0, LEAN, size=2), 0.0]).as_matrix())
