"""Advice to a person who labels a frame: likely labels, the mark that helps most, the effect of inexact clicks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array
from fieldcalib.assess.camera_errors import Solved
from fieldcalib.assess.result import Calibration
from fieldcalib.draw.scene import image_curves_of
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.evaluation import Problem, evaluate
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.observations import Observations
from fieldcalib.problem.picture_shape import Placement
from fieldcalib.problem.pixel_table import PixelTable
from fieldcalib.solve.solver_options import pixel_unit

CLICK = 2.0  # px: standard deviation of a click, along x and y
PLACES = 9  # number of places on a marking where a mark may be set
BORDER = 0.02  # of width and height: nearer to the border of the image clicks are awkward
NEAR = 30.0  # px of a 960 x 540 image: marks nearer to each other on one marking snap to the same paint
GRID = (9, 7)  # ground points along and across the field at which the camera's errors are computed


def likely_labels(field: Field, camera: Camera | None, xy: ArrayLike) -> list[str]:
    """Sort the labels of a field's markings by the distance of their projections from a pixel; unsorted without camera.

    Examples
    --------
    >>> from fieldcalib import soccer
    >>> camera = Camera.from_angles(0.0, 1.35, 0.0, 1400.0, (0.0, 66.0, -16.0), (960, 540))
    >>> likely_labels(soccer(), camera, camera.project((0.0, -20.0, 0.0)) + 5.0)[0]
    'Middle line'
    """
    if camera is None:
        return list(field.markings)
    click = np.asarray(xy, dtype=float)
    curves = dict(zip(field.markings, image_curves_of(camera, field.markings.values(), field.terrain), strict=True))
    near = {label: nearest_on(of_label, click) for label, of_label in curves.items()}
    return sorted(near, key=lambda label: np.inf if (of_label := near[label]) is None else of_label.distance)


class Near(NamedTuple):
    """The place on a curve that is nearest to a pixel."""

    distance: float
    direction: Array
    """Direction of the curve there, (2,)."""


def nearest_on(curves: Sequence[Array], xy: Array) -> Near | None:
    """Find the nearest place on polylines (N, 2); None without any.

    Examples
    --------
    >>> nearest_on([np.array([[0.0, 0.0], [10.0, 0.0]])], np.array([4.0, 3.0])).distance
    3.0
    """
    found = []
    for curve in curves:
        start, way = curve[:-1], np.diff(curve, axis=0)
        share = np.sum((xy - start) * way, axis=1) / np.maximum(np.sum(way**2, axis=1), 1e-12)
        distance = np.linalg.norm(start + np.clip(share, 0.0, 1.0)[:, None] * way - xy, axis=1)
        if len(distance):
            found.append(Near(float(np.min(distance)), way[np.argmin(distance)]))
    return min(found, key=lambda one: one.distance, default=None)


class NextMark(NamedTuple):
    """The mark that would reduce the camera's errors most."""

    label: str
    xy: tuple[float, float]
    """Place of the mark on its marking, pixels."""
    gain: float
    """Share of the mean squared error of the field in view that the mark removes, 0 to 1."""


def next_mark(
    calibration: Calibration, marks: Mapping[str, Array] = MappingProxyType({}), pixel_sd: float = CLICK
) -> NextMark | None:
    """Find the marking, and the place on it, where a mark lowers the errors of the field in view most.

    A mark with standard deviation s and derivatives j with respect to the parameters changes their covariance V to
    ``V - V j j^T V / (s^2 + j^T V j)``. Candidates are places on lines and arcs in view, away from the border of the
    image and from existing marks (N, 2) of the same label, near which a new mark adds no information.

    Returns
    -------
    NextMark or None
        None if there is no camera, or nothing to mark.

    Raises
    ------
    ValueError
        If the calibration is not that of a single frame of a `Field`.
    """
    if calibration.camera is None:
        return None
    field, solved = _field_and_solution(calibration)
    estimate, camera = calibration.uncertainty, solved.camera
    placement = Placement.of_cameras(calibration.camera, camera)
    V, J = estimate.covariance, _of_ground(calibration, _ground_in_view(calibration.camera, field))
    places = _places(camera, field, {label: placement.to_frame(xy) for label, xy in marks.items()})
    if not len(J) or not len(places.frame) or not np.all(np.isfinite(V)):
        return None
    layout, theta = estimate.layout, estimate.theta
    observations = Observations.of(field, places, layout.image_size, field.motion if layout.is_sized else None)
    seen = evaluate(Problem(observations, layout, RobustLoss("linear", 1.0)), theta[None])
    by_mark = seen.derivatives(np.ones(layout.size, dtype=bool))[0].T  # (M, n)
    G = J.reshape(-1, layout.size)
    removed = np.sum(np.square(G @ V @ by_mark.T), axis=0) / (
        pixel_sd**2 + np.einsum("mi,ij,mj->m", by_mark, V, by_mark)
    )
    removed[~np.isfinite(removed) | (observations.label[0] < 0)] = 0.0
    best = int(np.argmax(removed))
    xy = np.concatenate([rows.xy[0] for rows in observations.rows for _ in range(rows.components)])[best]
    total = float(np.einsum("mi,ij,mj->", G, V, G))
    label = observations.labels[observations.label[0, best]]
    x, y = placement.to_picture(xy).tolist()
    return NextMark(label, (x, y), float(removed[best]) / total)


def click_errors(calibration: Calibration, X: ArrayLike, pixel_sd: float = CLICK) -> Array:
    """Root mean square shift (...,), metres, of ground points (..., 3) if every mark is off by `pixel_sd` pixels.

    To first order ``A^-1 J^T W`` maps errors of the marks to errors of the parameters, with A the Hessian of the cost
    and W the weights of the residuals in its gradient.

    Raises
    ------
    ValueError
        If the calibration is not that of a single frame of a `Field`.
    NoCameraError
        If it has no camera.
    """
    _, solved = _field_and_solution(calibration)
    evaluation = solved.alone.evaluation
    free = evaluation.problem.free
    pulled = evaluation.JT[0] * evaluation.irls_weight[0]
    by_marks = np.linalg.solve(evaluation.hessian[0], pulled)  # (P, M)
    J = _of_ground(calibration, np.asarray(X, dtype=float))[..., free] @ by_marks
    return np.asarray(pixel_sd * np.sqrt(np.sum(np.square(J), axis=(-2, -1))))


def _field_and_solution(calibration: Calibration) -> tuple[Field, Solved]:
    calibration.required_camera  # noqa: B018 - raises with the reason
    if calibration.field is None or calibration.solved is None:
        raise ValueError("expected the calibration of a single frame of a Field, as calibrate_from_segments gives it")
    return calibration.field, calibration.solved


def _of_ground(calibration: Calibration, X: Array) -> Array:
    """Derivatives (..., 2, n) of ground points relative to the markings in view, 0 where there are none."""
    estimate = calibration.uncertainty
    J, known = estimate.ground_jacobian(X)
    return np.where(known[..., None, None], J - estimate.motion_of_markings, 0.0)


def _ground_in_view(camera: Camera, field: Field) -> Array:
    """Ground points (K, 3) of a grid over the field that the camera sees."""
    x, y = (np.linspace(-half, half, count) for half, count in zip(field.half_extent, GRID, strict=True))
    X = np.stack([*np.meshgrid(x, y), np.zeros((len(y), len(x)))], axis=-1).reshape(-1, 3)
    xy = camera.project(X)
    return X[np.all((xy >= 0.0) & (xy < camera.image_size), axis=1)]  # false for NaN


def _places(camera: Camera, field: Field, marks: Mapping[str, Array]) -> PixelTable:
    """Places on lines and arcs in view where a mark may be set, away from existing marks."""
    size, apart = np.array(camera.image_size), NEAR * pixel_unit(camera.image_size)
    samples = {
        label: segment.samples(PLACES)
        for label, segment in field.markings.items()
        if label not in field.half_labels and (segment.is_straight or segment.is_arc)
    }
    member = np.repeat(np.arange(len(samples)), [len(X) for X in samples.values()])
    xy = camera.project(np.concatenate([np.zeros((0, 3)), *samples.values()]))
    free = np.all((xy > BORDER * size) & (xy < (1.0 - BORDER) * size), axis=1)  # false for NaN
    for index, label in enumerate(samples):
        for mark in marks.get(label, ()):
            free &= (member != index) | (np.linalg.norm(xy - mark, axis=1) > apart)
    member, xy = member[free], xy[free]
    weight = 1.0 / np.bincount(member, minlength=len(samples))[member]
    return PixelTable(tuple(samples), 1, np.zeros(len(member), np.intp), member, xy, weight)
