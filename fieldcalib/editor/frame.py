"""Editing of a single image: marks and known values of a person, and the camera calibrated from both (`FrameEditor`).

Clicks are snapped to paint (`snapped`): to the nearest middle of a light line, with subpixel accuracy. A line is a
ridge of lightness. At the scale of its width the second derivative across it is strongly negative, and the zero of the
first derivative in that direction is the middle of the line (Steger: An Unbiased Detector of Curvilinear Structures,
1998, section 2).

The pixels of a picture may not be square (`fitted_in_shape`). A picture of another shape than 16:9 is a frame or a part
of one with square pixels, or a frame that was squashed. If the person has not said at which aspect it is shown, a
camera is fitted to it as it is and as shown at 16:9, and the one is taken that marks and lines make more likely
(`fieldcalib.problem.picture_shape`).

Marks can be copied from one frame to another of the same camera; they move as the static background does
(`moved_marks`). Advice: likely labels, the mark that helps most, the effect of inexact clicks.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from reprlib import repr as short
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._types import Array, Float32, IntArray, real_array
from fieldcalib.assess.camera_errors import Solved
from fieldcalib.assess.findings import Status, Verdict
from fieldcalib.assess.result import Calibration, in_picture
from fieldcalib.draw.overlays import draw_calibration
from fieldcalib.draw.scene import image_curves, image_curves_of
from fieldcalib.editor.edit import Edit, History, Known, Marks
from fieldcalib.editor.fitting import confirmed, fitted, not_followed
from fieldcalib.fields.catalogue import field as field_by_name
from fieldcalib.fields.field import Field, terrain_of
from fieldcalib.fields.segments import Segment
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.background.background_motion import mapped
from fieldcalib.images.background.matches import Matches, match_background, match_far
from fieldcalib.images.shape.shape_of_picture import log_ratio_of_squash
from fieldcalib.io.image_files import Image, checked_image, html_picture, size_of
from fieldcalib.problem.evaluation import Problem, evaluate
from fieldcalib.problem.labelled_pixels import PixelTable, nearest_label
from fieldcalib.problem.losses import RobustLoss
from fieldcalib.problem.observations import Observations
from fieldcalib.problem.picture_shape import Declared, Placement, may_be_squashed
from fieldcalib.solve.likelier_shape import likelier
from fieldcalib.solve.request import Task
from fieldcalib.solve.solver_options import pixel_unit

# px: standard deviation of a click, along x and y. By it, near lines are preferred to strong ones: of clicks 2 px off
# on 103 markings of correctly calibrated frames 97 % then snap to within 3 px of their marking; if strength counts
# more, to within 10 px.
CLICK = 2.0
PLACES = 9  # number of places on a marking where a mark may be set
BORDER = 0.02  # of width and height: nearer to the border of the image clicks are awkward
APART = 30.0  # px of a 960 x 540 image: marks nearer to each other on one marking snap to the same paint
GRID = (9, 7)  # ground points along and across the field at which the camera's errors are computed
REACH = 8.0  # px of a 960 x 540 image: largest distance from a click to the line it snaps to
WIDTHS = (1.0, 2.0, 4.0)  # standard deviations of the blur, px of such an image: thin lines far off, broad ones nearby
LEAST_CONTRAST = 6.0  # grey values: least strength of a line, from its blurred second derivative
FARTHEST = 0.75  # of width and height from the middle of the picture: marks somewhat outside belong to lines in view
NEAR_MIDDLE = 0.75  # px: largest distance of a pixel from the middle of the line that it belongs to
MARGIN = 4  # px beyond the reach, for `NEAR_MIDDLE` and the neighbours of two differences
LEAST_BLUR = 0.7  # px, for derivatives by differences of pixels
LARGEST_TURN = np.sin(np.radians(25.0))  # sine of the angle between a line and its expected direction
NEAREST = 12  # matches around a mark that correct the homography, which has no lens
NEAR = 30.0  # px of a 960 x 540 image: a projected marking within this is the one clicked on


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
    size, apart = np.array(camera.image_size), APART * pixel_unit(camera.image_size)
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


def snapped(image: Image, xy: ArrayLike, along: ArrayLike | None = None) -> Array:
    """Snap a click to the middle of the nearest line, or leave it if no line is near.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        Blue, green, red.
    xy : (2,) array_like
        The click, pixels.
    along : (2,) array_like, optional
        Direction of the line in the image, if it is known: lines across it are left out, as near a corner.

    Returns
    -------
    (2,) array

    Examples
    --------
    >>> image = np.full((540, 960, 3), (60, 140, 60), np.uint8)
    >>> image[:, 500:503] = 230
    >>> snapped(image, (498.2, 300.0)).round(1), snapped(image, (700.0, 300.0))
    (array([501., 300.]), array([700., 300.]))
    """
    import cv2

    click = np.asarray(xy, dtype=float)
    height, width = image.shape[:2]
    unit = pixel_unit((width, height))
    reach = REACH * unit
    near, end = _box(click, reach + MARGIN, (width, height))
    if np.any(end - near < 3):
        return click
    low, high = _box(click, reach + 4.0 * max(WIDTHS) * unit, (width, height))  # what the blur needs
    grey = cv2.cvtColor(image[low[1] : high[1], low[0] : high[0]], cv2.COLOR_BGR2GRAY).astype(np.float32)
    pixels = np.stack(np.meshgrid(np.arange(near[0], end[0]), np.arange(near[1], end[1])), axis=-1)
    rows, columns = (slice(near[axis] - low[axis], end[axis] - low[axis]) for axis in (1, 0))
    best, place = 0.0, click
    for scale in WIDTHS:
        sigma = max(scale * unit, LEAST_BLUR)
        blurred = np.asarray(cv2.GaussianBlur(grey, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE), np.float32)
        middle, normal, strength = _ridge(blurred[rows, columns], sigma)
        distance = np.linalg.norm(pixels + middle - click, axis=-1)
        is_line = (np.linalg.norm(middle, axis=-1) < NEAR_MIDDLE) & (strength > LEAST_CONTRAST) & (distance <= reach)
        if along is not None:
            is_line &= np.abs(normal @ np.asarray(along, dtype=float)) < LARGEST_TURN * np.linalg.norm(along)
        nearness = np.exp(-0.5 * np.square(distance / (CLICK * unit)))
        weight = np.where(is_line, np.sqrt(np.maximum(strength, 0.0)) * nearness, 0.0)
        at = np.unravel_index(np.argmax(weight), weight.shape)
        if weight[at] > best:
            best, across = float(weight[at]), normal[at]
            # along the line the click stays where it is
            place = click + across * float((pixels[at] + middle[at] - click) @ across)
    return place


def _box(xy: Array, reach: float, size: tuple[int, int]) -> tuple[IntArray, IntArray]:
    """Bounds of the part of an image around a place: first pixel and the pixel after the last, (2,) each."""
    margin = int(np.ceil(reach))
    corner = np.floor(xy).astype(int) - margin
    return np.maximum(corner, 0), np.minimum(corner + 2 * margin + 2, size)


def _ridge(blurred: Float32, sigma: float) -> tuple[Array, Array, Array]:
    """Offset from each pixel to the middle of a light line (h, w, 2), the line's normal (h, w, 2), and its strength.

    The strength is in grey values; `sigma` is the standard deviation of the blur.
    """
    gy, gx = np.gradient(blurred)
    gyy, gyx = np.gradient(gy)
    gxx = np.gradient(gx, axis=1)
    # the eigenvector of the smaller eigenvalue of the symmetric matrix [[gxx, gyx], [gyx, gyy]]
    half, mean = np.hypot(0.5 * (gxx - gyy), gyx), 0.5 * (gxx + gyy)
    angle = 0.5 * np.arctan2(2.0 * gyx, gxx - gyy) + 0.5 * np.pi
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    across, bend = normal[..., 0] * gx + normal[..., 1] * gy, np.maximum(half - mean, 1e-9)
    return (across / bend)[..., None] * normal, normal, sigma**2 * (half - mean)


def fitted_in_shape(field: Field, image: Image, marks: Marks, known: Known) -> Calibration:
    """Calibrate from marks (`fitted`) a picture that may have been squashed; the camera is in pixels of the picture.

    Its errors refer to the frame with square pixels.
    """
    size = size_of(image)
    placement = known.placement(size)
    task = known.task(field, placement)
    found = _fitted_in_frame(task, image, marks, placement)
    if known.aspect is not None:
        return replace(in_picture(found, placement), declared=Declared.PIXELS)
    if not (field.stands and may_be_squashed(size)):  # without a prior the shapes cannot be compared
        return found
    squashed = placement.squashed
    task_of_squashed = known.task(field, squashed)
    shown = _fitted_in_frame(task_of_squashed, image, marks, squashed)
    if found.solved is None and shown.solved is None:
        return found
    return likelier(found, shown, log_ratio_of_squash(task, found, shown, task_of_squashed), size)


def _fitted_in_frame(task: Task, image: Image, marks: Marks, placement: Placement) -> Calibration:
    """Calibrate the frame with square pixels in which a picture lies."""
    if not placement.is_whole:
        image, marks = placement.image_in_frame(image), marks.scaled(placement.scale)
    return fitted(task, image, marks)


@dataclass(frozen=True, eq=False)
class FrameEditor:
    """An image with marks, and the camera calibrated from them. Each change gives a new editor.

    Parameters
    ----------
    image : (height, width, 3) uint8 array
        Blue, green, red.
    field : Field
    history : History of Edit
        Marks and known values, now and before.
    base : Calibration, optional
        The camera that was found without a person.
    found : Calibration, optional
        The camera from the marks, if it is known already.

    Examples
    --------
    >>> from fieldcalib import Camera, soccer
    >>> from fieldcalib.draw.scene import render_field
    >>> truth = Camera.from_angles(-0.3, 1.35, 0.0, 1600.0, (0.0, 68.0, -17.0), (960, 540))
    >>> editor = FrameEditor.of(render_field(truth, soccer()))
    >>> for label in ("Side line left", "Side line top", "Big rect. left main", "Big rect. left top"):
    ...     ends = truth.project(soccer()[label].sample(3.0))
    ...     inside = ends[((ends > 5.0) & (ends < (955.0, 535.0))).all(axis=1)]
    ...     editor = editor.mark(label, inside[[0, -1]] + (1.5, -1.5))
    >>> editor
    FrameEditor(960x540 pixels, 8 marks of 4 markings)
    >>> str(editor.calibration.status), round(float(np.linalg.norm(editor.calibration.camera.C - truth.C))) < 5
    ('accepted', True)
    >>> editor.undo().undo().calibration.camera is None, editor.undo().redo().marks == editor.marks
    (False, True)
    """

    image: Image
    field: Field
    history: History[Edit]
    base: Calibration | None = None
    """The camera that was found without a person."""
    found: Calibration | None = None
    """The camera from the marks, if it is known already."""

    def __repr__(self) -> str:
        width, height = size_of(self.image)
        return f"FrameEditor({width}x{height} pixels, {len(self.marks)} marks of {len(self.marks.pixels)} markings)"

    @classmethod
    def of(
        cls,
        image: ArrayLike,
        field: Field | str = "soccer",
        pixels: Mapping[str, Iterable[Iterable[float]]] | None = None,
        known: Known | None = None,
    ) -> FrameEditor:
        """Begin with an image, the name of a sport or a field, and pixels that are labelled already.

        Raises
        ------
        ValueError
            If the image is not uint8 with three channels, or a label is not one of the field.
        """
        of_field = field_by_name(field) if isinstance(field, str) else field
        marks = Marks.of(pixels or {})
        for label in marks.pixels:
            _check_label(label, of_field)
        return cls(checked_image(image), of_field, History(Edit(marks, known or Known())))

    @property
    def marks(self) -> Marks:
        """The marks."""
        return self.history.present.marks

    @property
    def known(self) -> Known:
        """Known values of camera and field."""
        return self.history.present.known

    @cached_property
    def calibration(self) -> Calibration:
        """Camera from the marks, refined on the image if that agrees with them.

        Until a person changes something it is the camera that was found without a person.
        """
        if self.is_automatic and self.base is not None:
            return self.base
        if self.found is not None:
            return self.found
        try:
            field = self.known.of(self.field)
            found = fitted_in_shape(field, self.image, self.marks.of_field(self.field), self.known)
            if self.base is None or found.verdict is Verdict.GOOD or self.known != Known():
                return found
            # few labels may find another camera than the lines did with which they agree
            return confirmed(self.base, self.image, self.marks.of_field(self.field)) or found
        except ValueError as error:  # known values of another field than this one, and the like
            return Calibration.without_camera(Status.TOO_FEW_SEGMENTS, str(error))

    @property
    def is_automatic(self) -> bool:
        """Whether a person has changed nothing, or has undone all changes."""
        return self.history.present.automatic

    def mark(self, label: str, xy: ArrayLike, *, snap: bool = True) -> FrameEditor:
        """Set marks of a label at pixels (2,) or (N, 2), snapped to paint; a ValueError far outside the picture."""
        _check_label(label, self.field)
        clicks = _checked_clicks(xy, size_of(self.image))
        return self._then(marks=self.marks.added(label, [self.place(label, one, snap=snap) for one in clicks]))

    def move(self, to: Mapping[int, ArrayLike], *, snap: bool = True) -> FrameEditor:
        """Drag marks, by their numbers, to other pixels; a ValueError far outside the picture."""
        labels = [one.label for one in self.marks.all]
        places = {
            number: self.place(labels[number] if 0 <= number < len(labels) else "", xy, snap=snap)
            for number, xy in to.items()
        }
        return self._then(marks=self.marks.moved(places))

    def relabel(self, numbers: Collection[int], label: str) -> FrameEditor:
        """Give marks another label."""
        _check_label(label, self.field)
        return self._then(marks=self.marks.relabelled(numbers, label))

    def remove(self, numbers: Collection[int]) -> FrameEditor:
        """Remove marks."""
        return self._then(marks=self.marks.without(numbers))

    def clear(self) -> FrameEditor:
        """Remove all marks, to label the image from nothing."""
        return self._then(marks=Marks())

    def know(self, **values: Any) -> FrameEditor:
        """Set known values, see `Known`; None lets them be estimated.

        Raises
        ------
        ValueError
            If a value is impossible, or the field cannot have that size.
        """
        known = replace(self.known, **values)
        known.of(self.field)
        return self._then(known=known)

    def with_marks(self, marks: Marks) -> FrameEditor:
        """Replace all marks."""
        for label in marks.pixels:
            _check_label(label, self.field)
        return self._then(marks=marks)

    def automatic(self, marks: Marks) -> FrameEditor:
        """Go back to the camera that was found without a person, and to the marks of the network."""
        edit = replace(self.history.present, marks=marks, known=Known(), automatic=True)
        return replace(self, history=self.history.then(edit), found=None)

    def undo(self) -> FrameEditor:
        """Undo the last change."""
        return replace(self, history=self.history.undone, found=None)

    def redo(self) -> FrameEditor:
        """Redo the change that was undone last."""
        return replace(self, history=self.history.redone, found=None)

    def place(self, label: str, xy: ArrayLike, *, snap: bool = True) -> Array:
        """Pixel for a click: snapped to paint nearby for labels of lines and arcs, unchanged for other labels."""
        segment = self.field.get(label)
        (click,) = _checked_clicks(xy, size_of(self.image))
        if not snap or segment is None or not (segment.is_straight or segment.is_arc):
            return np.asarray(click)
        return snapped(self.image, click, self._direction(segment, label, click))

    def _direction(self, segment: Segment, label: str, xy: Array) -> Array | None:
        """Direction of a marking in the image near a pixel, from the camera or, if straight, from its other marks."""
        if self.calibration:
            terrain = terrain_of(self.calibration.field)
            near = nearest_on(image_curves(self.calibration.required_camera, segment, terrain), xy)
            if near is not None and near.distance < NEAR * pixel_unit(size_of(self.image)):
                return near.direction
        others = self.marks.pixels.get(label)
        if others is None or not segment.is_straight:
            return None
        way = others[np.argmax(np.linalg.norm(others - xy, axis=1))] - xy
        return way if np.linalg.norm(way) > NEAR * pixel_unit(size_of(self.image)) else None

    def likely_labels(self, xy: ArrayLike) -> list[str]:
        """Labels for a pixel, the likeliest first."""
        return likely_labels(self.field, self.calibration.camera, xy)

    @property
    def next_mark(self) -> NextMark | None:
        """The mark that would reduce the camera's errors most; None without a camera that was fitted to labels."""
        if self.calibration.solved is None:
            return None
        return next_mark(self.calibration, self.marks.of_field(self.field).only_by_hand.pixels)

    def click_errors(self, X: ArrayLike) -> Array:
        """Shift, metres, of ground points (..., 3) if all clicks are 2 px off."""
        return click_errors(self.calibration, X)

    def _repr_html_(self) -> str:
        """Show the picture with its projected markings, verdict and reason in a notebook."""
        calibration = self.calibration
        drawn = draw_calibration(self.image, calibration, calibration.field or self.field)
        said = escape(f"{calibration.verdict}: {calibration.reason}")
        return f"<div>{html_picture(drawn, 'projected markings')}<p>{said}</p></div>"

    def _then(self, **changes: Any) -> FrameEditor:
        edit = replace(self.history.present, automatic=False, **changes)
        if self.is_automatic and self.base is not None:  # marks that were left out of its camera stay so
            stray = not_followed(self.base.field or self.field, self.marks, self.base)
            edit = replace(edit, marks=Marks(tuple(one for one in edit.marks.all if one not in stray)))
        return replace(self, history=self.history.then(edit), found=None)


def _checked_clicks(xy: ArrayLike, image_size: tuple[int, int]) -> Array:
    """Pixels (N, 2) of clicks; a ValueError if they are none, or lie far outside the picture."""
    try:
        clicks = real_array(xy)
    except ValueError:
        clicks = np.empty(0)
    if clicks.shape[-1:] != (2,) or clicks.ndim > 2 or not np.all(np.isfinite(clicks)):
        raise ValueError(f"expected a pixel (x, y), or several of shape (N, 2), finite numbers, got {short(xy)}")
    clicks = clicks.reshape(-1, 2)
    outside = np.any(np.abs(clicks / image_size - 0.5) > FARTHEST, axis=1)
    if np.any(outside):
        (width, height), (x, y) = image_size, clicks[outside][0]
        raise ValueError(f"the picture is {width} x {height} pixels: ({x:g}, {y:g}) lies far outside")
    return clicks


def _check_label(label: str, field: Field) -> None:
    if label not in field:
        raise ValueError(f"unknown label {label!r}; {nearest_label(label, field)}")


def moved_marks(marks: Marks, image: Image, to: FrameEditor) -> Marks:
    """Move marks of an image to another frame, and snap them to its paint; marks out of view are left out.

    Raises
    ------
    ValueError
        If the two frames show no background in common, or nothing of the marks is in view.
    """
    if size_of(image) != size_of(to.image):
        raise ValueError("expected frames of one size")
    matches = match_background(image, to.image) or match_far(image, to.image)
    if matches is None:
        raise ValueError("the frames show no background in common: copy from a frame nearer by")
    labels = [one.label for one in marks.all]
    there = _moved(matches, np.array([(one.x, one.y) for one in marks.all]))
    moved = Marks()
    for label, xy in zip(labels, there, strict=True):
        if np.all((xy >= 0.0) & (xy < size_of(to.image))):
            moved = moved.added(label, [to.place(label, xy)])
    if not len(moved):
        raise ValueError("none of the marks is in view in this frame")
    return moved


def _moved(matches: Matches, xy: Array) -> Array:
    """Map pixels (N, 2) of static points to the second frame, by the homography and the residuals of matches nearby."""
    rest = matches.second - mapped(matches.homography, matches.first)
    apart = np.linalg.norm(xy[:, None] - matches.first, axis=2)
    near = np.argsort(apart, axis=1)[:, :NEAREST]
    return mapped(matches.homography, xy) + np.median(rest[near], axis=1)
