"""Random frames of known cameras: labelled pixels with errors as of annotators and networks, and with wrong labels.

Cameras come from all stands of the field, most often from the first one, the centre of the main stand; lenses and
principal points are as in broadcasts. Some visible markings are left out, pixels are noisy, and the pixels of a segment
share a part of their noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from data_tools.simulated import SHORTEST_SEGMENT
from fieldcalib._types import Array
from fieldcalib.assess.label_errors import SHARED_NOISE
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Arc
from fieldcalib.fields.traits import CameraDistribution, focal_length_from_fov
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.labelled_pixels import Pixels
from fieldcalib.problem.layout import POSE_AND_ZOOM, PRINCIPAL_POINT, ROLL, Layout

FIRST_STAND_SHARE = 0.4  # of the cameras; the others are spread evenly over the other stands
ROLL_SIGMA = np.radians(1.0)
LENS_SPREAD, STRONGEST_LENS = 0.018, 0.1  # of a1, about its mean on annotated frames
PRINCIPAL_POINT_SPREAD = (0.010, 0.015)  # of the width, along x and y: measured cameras are up to 0.035 off
NOISE_SPREAD = 0.5  # standard deviation of log sigma about 1 px at 960 x 540: annotators differ
KEPT = (0.4, 1.0)  # share of the visible markings that is labelled
PIXELS_PER_LINE, PIXELS_PER_CIRCLE = (2, 5), (4, 9)
LEAST_SEGMENTS = 3
# Rates of wrong labels, and the shares of the frames that have them. In real annotations 3 to 4 % are wrong.
WRONG_RATES, WRONG_SHARES = (0.0, 0.035, 0.1), (0.5, 0.3, 0.2)
CONFUSED = (
    ("left", "right"),
    ("top", "bottom"),
    ("Big", "Small"),
    ("top", "main"),
    ("bottom", "main"),
    ("left", "central"),
    ("right", "central"),
    ("inner", "outer"),
    ("upper", "lower"),
)
SIZE = (960, 540)


@dataclass(frozen=True)
class RandomFrame:
    """A frame of a known camera."""

    camera: Camera
    pixels: Pixels
    wrong: Mapping[str, str]
    """Mislabelled segments: label in `pixels` -> correct label."""


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


def random_frame(field: Field, rng: np.random.Generator) -> RandomFrame:
    """Draw a frame of 960 x 540 pixels with three segments or more.

    Examples
    --------
    >>> from fieldcalib.fields.sports.soccer import soccer
    >>> frame = random_frame(soccer(), np.random.default_rng(0))
    >>> len(frame.pixels) >= 3, frame.wrong
    (True, {})
    """
    while True:
        camera = random_broadcast_camera(field, rng)
        noise = float(np.exp(rng.normal(0.0, NOISE_SPREAD)))
        pixels = noisy_pixels(camera, field, rng, noise, float(rng.uniform(*KEPT)))
        if len(pixels) >= LEAST_SEGMENTS:
            break
    count = rng.binomial(len(pixels), rng.choice(WRONG_RATES, p=WRONG_SHARES))
    return RandomFrame(camera, *mislabelled(pixels, field, int(count), rng))


def random_broadcast_camera(field: Field, rng: np.random.Generator) -> Camera:
    """A camera on one of the stands of a field, with a lens and a principal point as in broadcasts."""
    first, *others = field.stands
    stand = first if rng.random() < FIRST_STAND_SHARE else others[rng.integers(len(others))]
    layout = Layout.of(SIZE)
    (theta,) = sample_theta(stand, 1, rng, layout)
    theta[ROLL] = rng.normal(0.0, ROLL_SIGMA)
    a1 = rng.normal(layout.lens.mean[0], LENS_SPREAD)
    theta[layout.blocks["k1"]] = np.clip(a1, -STRONGEST_LENS, STRONGEST_LENS)
    theta[PRINCIPAL_POINT] += rng.normal(size=2) * PRINCIPAL_POINT_SPREAD * SIZE[0]
    return layout.camera(theta)


def noisy_pixels(camera: Camera, field: Field, rng: np.random.Generator, noise: float, kept: float) -> Pixels:
    """Labelled pixels of a share of the markings in view, with normal noise that is correlated within a segment."""
    pixels: Pixels = {}
    largest = np.array(camera.image_size) - 1.0
    for label, segment in field.markings.items():
        xy = camera.project(segment.sample(spacing=0.1))
        xy = xy[np.all((xy >= 0.0) & (xy <= largest), axis=1)]  # false for NaN
        if (
            label in field.half_labels
            or not len(xy)
            or np.max(np.ptp(xy, axis=0)) < SHORTEST_SEGMENT
            or rng.random() > kept
        ):
            continue
        count = rng.integers(*(PIXELS_PER_CIRCLE if isinstance(segment, Arc) else PIXELS_PER_LINE), endpoint=True)
        chosen = xy[np.rint(np.linspace(0.0, len(xy) - 1.0, count)).astype(int)]
        own, shared = rng.normal(size=chosen.shape), rng.normal(size=2)
        pixels[label] = chosen + noise * (np.sqrt(1.0 - SHARED_NOISE) * own + np.sqrt(SHARED_NOISE) * shared)
    return pixels


def mislabelled(pixels: Pixels, field: Field, count: int, rng: np.random.Generator) -> tuple[Pixels, dict[str, str]]:
    """Replace `count` labels, where possible, by those of the other side or of a neighbour.

    Returns
    -------
    pixels : dict of str to (N, 2) array
        Pixels by new label, in the given order.
    wrong : dict of str to str
        Wrong label -> correct one.
    """
    wrong: dict[str, str] = {}
    for label in rng.permutation(list(pixels)).tolist():
        free = [other for other in confused_labels(label, field) if other not in pixels and other not in wrong]
        if len(wrong) < count and free:
            wrong[free[rng.integers(len(free))]] = label
    replaced = {right: label for label, right in wrong.items()}
    return {replaced.get(label, label): xy for label, xy in pixels.items()}, wrong


def confused_labels(label: str, field: Field) -> list[str]:
    """Labels that may be confused with this one: the other side's, and the neighbours'.

    Examples
    --------
    >>> from fieldcalib.fields.sports.soccer import soccer
    >>> confused_labels("Circle left", soccer())
    ['Circle central', 'Circle right']
    >>> confused_labels("Side line top", soccer())
    ['Side line bottom']
    """
    others = {field.symmetric.get(label, label)}
    for a, b in CONFUSED:
        others |= {label.replace(a, b), label.replace(b, a)}
        head, _, tail = label.rpartition(" ")
        others |= {f"{head} {tail.replace(a, b)}", f"{head} {tail.replace(b, a)}"}  # the other post, not the other goal
    return sorted(other for other in others if other != label and other in field.markings)
