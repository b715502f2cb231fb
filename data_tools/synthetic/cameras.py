"""Positions and directions of synthetic cameras, and the side from which labels are named.

An image cannot tell the left of a field from its right: turned by 180 degrees about its centre mark, the field looks
the same from the opposite stand. So labels are named as seen from the camera's side: the camera is turned about the
centre mark to the main side, y > 0, or, if it stands behind a goal line (|x| beyond half the length and |y| within half
the width plus `fieldcalib.fields.field.BEHIND_MARGIN`), to stand behind the left goal.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from data_tools.random_frames import LENS_SPREAD, PRINCIPAL_POINT_SPREAD, STRONGEST_LENS, sample_theta
from fieldcalib._types import Array
from fieldcalib.fields.field import OPPOSITE, Field, is_behind_end, looks_the_same_turned, side_of, turned_camera
from fieldcalib.fields.sports.soccer import GOAL_HEIGHT, soccer
from fieldcalib.fields.traits import (
    BEHIND_LEFT_GOAL,
    MAIN_CENTER,
    MAIN_LEFT,
    MAIN_RIGHT,
    MAIN_TRIBUNE,
    CameraDistribution,
)
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.layout import LOG_ASPECT, PAN, PRINCIPAL_POINT, ROLL, TILT, Layout

# Broadcasts, the paper's stands, and wide ranges around these. Opposite stands and those behind the right goal are left
# out: turned by 180 degrees, they are among these.
BROADCAST = CameraDistribution("broadcast", (-45, 45), (60, 88), (-3, 3), (12, 60), (-20, 20), (50, 110), (-35, -8))
AROUND_MAIN = CameraDistribution("around main", (-70, 70), (30, 90), (-5, 5), (8, 100), (-75, 75), (42, 130), (-60, -3))
AROUND_GOAL = CameraDistribution(
    "around goal", (30, 150), (20, 90), (-5, 5), (8, 100), (-120, -58), (-50, 50), (-50, -1)
)
STANDS = {
    BROADCAST: 0.5,
    MAIN_CENTER: 0.1,
    MAIN_LEFT: 0.08,
    MAIN_RIGHT: 0.08,
    MAIN_TRIBUNE: 0.05,
    AROUND_MAIN: 0.08,
    BEHIND_LEFT_GOAL: 0.07,
    AROUND_GOAL: 0.04,
}
AIMED_SHARE = 0.75  # share of cameras that look at a point of the field; the others as their distribution says
STEEP = 45.0  # degrees: cameras that look down more than this are not aimed, or they would turn in all directions
ROLL_SIGMA, LEVEL_SHARE = np.radians(0.7), 0.85
STRONG_LENS_SHARE = 0.15  # share of lenses of any strength
SQUEEZED_SHARE, SQUEEZE = 0.08, 4.0 / 3.0  # fy / fx of 4:3 pictures stretched to 16:9
STANDARD_SHARE, LAW_SHARE = 0.5, 0.15  # 105 x 68 m; any legal size; the rest has sizes of international matches
LEAST_MARKINGS, LEAST_EXTENT = 2, 0.04  # in view; share of the image's width that each spans
LEAST_FIELD = 0.2  # of the image
SAMPLES = 2.0, 0.05  # along markings: metres, and shares of `Field.scale`, whichever is finer; 2 m on soccer fields


def random_field(rng: np.random.Generator) -> Field:
    """A field within law 1: 90 to 120 m by 45 to 90 m, or 100 to 110 by 64 to 75 for international matches."""
    kind = rng.random()
    if kind < STANDARD_SHARE:
        return soccer()
    if kind < STANDARD_SHARE + LAW_SHARE:
        return soccer(rng.uniform(90.0, 120.0), rng.uniform(45.0, 90.0))
    return soccer(rng.uniform(100.0, 110.0), rng.uniform(64.0, 75.0))


def random_camera(
    field: Field,
    size: tuple[int, int],
    rng: np.random.Generator,
    stands: Mapping[CameraDistribution, float] = MappingProxyType(STANDS),
) -> Camera:
    """A camera on its canonical side, outside the field, that sees enough of it and at least two markings.

    It stands on one of `stands`, drawn in proportion to their numbers.

    Examples
    --------
    >>> camera = random_camera(soccer(), (512, 288), np.random.default_rng(0))
    >>> camera == on_canonical_side(camera, soccer())
    True
    """
    shares = np.array(list(stands.values()))
    while True:
        stand = list(stands)[rng.choice(len(stands), p=shares / shares.sum())]
        camera = on_canonical_side(_drawn(stand, field, size, rng), field)
        if _is_outside(camera, field) and _shows_field(camera, field) and _shows_markings(camera, field):
            return camera


def on_canonical_side(camera: Camera, field: Field) -> Camera:
    """The camera, turned by 180 degrees about the field's centre if it is not on its canonical side.

    It is not turned if the turned field looks different: then left and right can be told apart from all sides.

    Examples
    --------
    >>> opposite = Camera.from_angles(np.pi, 1.3, 0.0, 900.0, C=(10, -60, -15), image_size=(512, 288))
    >>> on_canonical_side(opposite, soccer()).C
    array([-10.,  60., -15.])
    """
    is_turned = side_of(_place(camera, field), field) == OPPOSITE and looks_the_same_turned(field)
    return turned_camera(camera) if is_turned else camera


def is_behind_goal(camera: Camera, field: Field) -> bool:
    """Whether the camera stands behind a goal line."""
    return is_behind_end(_place(camera, field), field)


def _place(camera: Camera, field: Field) -> Array:
    """Where a camera stands, (3,); one over the field as if it stood where the lower edge of its picture is."""
    half = 0.5 * np.array([field.length, field.width])
    if np.any(np.abs(camera.C[:2]) > half):
        return camera.C
    ahead = (camera.R[2] - camera.R[1])[:2]
    along = int(np.argmax(np.abs(ahead)))
    place = np.zeros(3)
    place[along] = -np.copysign(2.0 * half[along], ahead[along])
    return place


def _drawn(stand: CameraDistribution, field: Field, size: tuple[int, int], rng: np.random.Generator) -> Camera:
    """A camera of a distribution, with a lens, a principal point and sometimes squeezed pixels."""
    layout = Layout.of(size)
    (theta,) = sample_theta(stand, 1, rng, layout)
    if rng.random() < AIMED_SHARE and stand.tilt[1] > STEEP:
        target = np.array([field.length, field.width]) * rng.uniform(-0.5, 0.5, size=2)
        (x, y), z = target - theta[4:6], -theta[6]
        theta[PAN], theta[TILT] = np.arctan2(x, -y), np.arctan2(np.hypot(x, y), z)
    if rng.random() < LEVEL_SHARE:
        theta[ROLL] = rng.normal(0.0, ROLL_SIGMA)
    a1 = rng.uniform(-1.0, 1.0) * STRONGEST_LENS if rng.random() < STRONG_LENS_SHARE else rng.normal(0.0, LENS_SPREAD)
    theta[layout.blocks["k1"]] = np.clip(layout.lens.mean[0] + a1, -STRONGEST_LENS, STRONGEST_LENS)
    theta[PRINCIPAL_POINT] += rng.normal(size=2) * PRINCIPAL_POINT_SPREAD * size[0]
    if rng.random() < SQUEEZED_SHARE:
        theta[LOG_ASPECT] = np.log(SQUEEZE)
    return layout.camera(theta)


def _is_outside(camera: Camera, field: Field) -> bool:
    """Whether the camera stands beside the field or, as those on cables do, well above the goals."""
    x, y, z = np.abs(camera.C)
    return bool(x > field.length / 2.0 + 1.0 or y > field.width / 2.0 + 1.0 or z > 3.0 * GOAL_HEIGHT)


def _shows_field(camera: Camera, field: Field) -> bool:
    x, y = (np.linspace(0.0, length - 1.0, 12) for length in camera.image_size)
    X = camera.image_to_field(np.stack(np.meshgrid(x, y), axis=-1))[..., :2]
    on_field = np.all(np.abs(X) < np.array([field.length, field.width]) / 2.0, axis=-1)  # false above the horizon
    return bool(on_field.mean() > LEAST_FIELD)


def _shows_markings(camera: Camera, field: Field) -> bool:
    width, height = camera.image_size
    spacing = min(SAMPLES[0], SAMPLES[1] * field.scale)
    count = 0
    for segment in field.markings.values():
        xy = camera.project(segment.sample(spacing=spacing))
        xy = xy[np.all((xy >= 0.0) & (xy <= (width - 1.0, height - 1.0)), axis=1)]  # false for NaN
        count += len(xy) > 1 and bool(np.max(np.ptp(xy, axis=0)) > LEAST_EXTENT * width)
    return count >= LEAST_MARKINGS
