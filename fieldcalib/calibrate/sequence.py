"""Frames of one camera on a tripod: what they share is estimated from all of them together.

    frames one by one -> the place of the tripod -> every frame from there -> all together -> every frame again

Over a shot the centre, the law by which principal point and lens follow the zoom, and the size of the field do not
change (`fieldcalib.problem.layout`). They are blocks that the frames share; pan, tilt, roll and zoom are each frame's
own, and eliminated (`fieldcalib.problem.levenberg_marquardt`). A few hundred frames tell what is shared as well as all
of them, since paint and lens law are wrong by more than noise leaves; the others follow, each by itself. So the time is
linear in the number of frames.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from fieldcalib._types import Array, IntArray
from fieldcalib.assess.noise import pooled_noise
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.sequence import SequenceCalibration
from fieldcalib.assess.shared import shared_covariance
from fieldcalib.calibrate.from_segments import calibrate_frames, checked_frames
from fieldcalib.calibrate.initial_cameras import given_cameras
from fieldcalib.calibrate.options import (
    DEFAULT_CRITERIA,
    PAINT,
    CalibrationFlags,
    Options,
    Prior,
    checked_options,
    default_flags,
)
from fieldcalib.calibrate.together import put_together
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import ObjectSegments
from fieldcalib.problem.evaluation import Evaluation
from fieldcalib.problem.labelled_pixels import ImageSegments, Pixels, PixelWeights, Weights
from fieldcalib.problem.layout import CENTER, LOG_F, Layout, Role, SizeBlock, ZoomLaw
from fieldcalib.problem.levenberg_marquardt import levenberg_marquardt
from fieldcalib.problem.losses import LossName, RobustLoss

SHARED = ("centre", "principal point", "lens", "zoom law", "field size")
FIRST = 60  # frames that are calibrated one by one, to find the place of the tripod
TOGETHER = 400  # frames that are solved together
ROUNDS = 3  # of solving together, and every frame again
AGREE = 7.8  # squared distance of two centres in standard deviations: 95 % of chi-squared with three degrees of freedom
TOLD = 0.4  # m: standard deviation of length or width; clips that show a penalty area and the middle tell it to 0.2
NEAR = 0.1  # m: centres that are this near agree, however sure they are


def calibrate_sequence(
    object_segments: ObjectSegments,
    frames: Iterable[ImageSegments],
    image_size: tuple[int, int],
    *,
    flags: int | None = None,
    prior: Prior = "all",
    loss: LossName | RobustLoss = "cauchy",
    trust_labels: bool = False,
    weights: Iterable[Weights] | None = None,
    shared: Sequence[str] = SHARED,
    paint: float = PAINT,
) -> SequenceCalibration:
    """Calibrate frames of one camera on a tripod, which share its centre and the law of its zoom.

    Parameters
    ----------
    object_segments : mapping of str to segment
        The calibration object, e.g. `soccer()`.
    frames : iterable of mappings of str to (N, 2) array_like
        Pixels of each frame, in any order; frames without labels are allowed, and have no camera.
    image_size : (int, int)
        Width and height of every frame, pixels.
    flags, prior, loss, trust_labels, weights
        As in `calibrate_batch`. By default k2 is estimated too: frames together tell it.
    shared : sequence of str
        What the frames share, of ``"centre"`` (always), ``"principal point"``, ``"lens"``, ``"zoom law"`` and
        ``"field size"`` (unless that is said to be known, or the frames hardly tell it). What they do not share is each
        frame's own, under its prior; without a zoom law nothing follows the zoom, and a size that is not shared is that
        of the field.
    paint : float
        Standard deviation, in metres, of where a line is painted as a whole: however many frames see it, that stays.

    Returns
    -------
    SequenceCalibration
        A calibration for each frame, and what they share. Where no place of the tripod is found, the frames are
        calibrated one by one and share nothing.

    Raises
    ------
    ValueError
        As `calibrate_batch`, and for names of nothing that can be shared.

    References
    ----------
    Theiner, Ewerth: TVCalib, WACV 2023, whose tensors have a dimension T for frames of one camera.

    Examples
    --------
    >>> from fieldcalib import Camera, soccer
    >>> field, pans = soccer(size_known=True), (-0.3, -0.1, 0.1, 0.3)
    >>> cameras = [Camera.from_angles(pan, 1.35, 0.0, 1400.0, (0.0, 66.0, -16.0), (960, 540)) for pan in pans]
    >>> labels = ("Side line top", "Middle line", "Circle central", "Big rect. left main", "Big rect. right main")
    >>> frames = []
    >>> for camera in cameras:
    ...     seen = {label: camera.project(field[label].sample(2.0)) for label in labels}
    ...     inside = {label: xy[((xy > 0.0) & (xy < (959, 539))).all(axis=1)] for label, xy in seen.items()}
    ...     frames.append({label: xy for label, xy in inside.items() if len(xy) > 1})
    >>> found = calibrate_sequence(field, frames, (960, 540))
    >>> [str(frame.status) for frame in found]
    ['accepted', 'accepted', 'accepted', 'accepted']
    >>> found.values[1:3].round()  # y and z of the tripod
    array([ 66., -16.])
    """
    unknown = set(shared) - set(SHARED)
    if unknown:
        raise ValueError(f"frames cannot share {sorted(unknown)}: expected some of {', '.join(SHARED)}")
    field = object_segments if isinstance(object_segments, Field) else None
    if flags is None:
        flags = default_flags(prior) & ~CalibrationFlags.CALIB_FIX_K2
    options = checked_options(
        image_size,
        None,
        None,
        None,
        None,
        flags=flags,
        criteria=DEFAULT_CRITERIA,
        prior=prior,
        loss=loss,
        tau=None,
        field=field,
        paint=paint,
    )
    pixels, pixel_weights = checked_frames(object_segments, frames, weights, options.image_size)
    sequence = _Sequence(object_segments, pixels, pixel_weights, options, tuple(shared), trust_labels)
    return sequence.calibrated()


class _Sequence:
    """The frames of one tripod while they are calibrated."""

    def __init__(
        self,
        object_segments: ObjectSegments,
        frames: list[Pixels],
        weights: list[PixelWeights | None],
        options: Options,
        shared: tuple[str, ...],
        trust_labels: bool,
    ) -> None:
        self.object_segments = object_segments
        self.frames = frames
        self.weights = weights
        self.options = options
        self.shared = shared
        self.trust_labels = trust_labels
        self.kept: tuple[str, ...] = ()  # of length and width, what the frames do not tell: it stays as it is given

    def calibrated(self) -> SequenceCalibration:
        first = [c for c in self._frames(self._spread(FIRST), self.object_segments, self.options) if c.accepted]
        centre = agreed_centre(first)
        if centre is None:
            return self._one_by_one()
        some = self._spread(TOGETHER)
        known = np.where(np.arange(len(self.options.known)) < CENTER.stop, np.nan, self.options.known)
        known[CENTER] = centre
        from_there = replace(self.options, layout=self.options.layout.fixed("centre"), known=known)
        found = self._frames(some, self.object_segments, from_there)
        if not any(c.accepted for c in found):
            return self._one_by_one()
        together, covariance = self._together(found)
        self.kept = self._hardly_told(together, covariance)
        if self.kept:
            together, covariance = self._together(found)
        for _ in range(ROUNDS - 1):
            before = sum(c.accepted for c in found)
            again = self._frames(some, *self._known(together, covariance))
            if not any(c.accepted for c in again):
                break
            found = again
            together, covariance = self._together(found)
            if sum(c.accepted for c in found) == before:
                break
        layout = together.problem.layout
        field, options = self._known(together, covariance)
        every = self._frames(np.arange(len(self.frames)), field, options)
        names = np.array(layout.names)[layout.roles == Role.SHARED]
        return SequenceCalibration(
            tuple(every),
            tuple(names.tolist()),
            together.theta[0, layout.roles == Role.SHARED],
            covariance,
            options.field,
            len(together.theta),
        )

    def _hardly_told(self, together: Evaluation, covariance: Array) -> tuple[str, ...]:
        """Of length and width, what the frames hardly tell: estimated, it would absorb errors of lens and zoom."""
        layout = together.problem.layout
        sigma = np.full(layout.size, np.inf)
        sigma[layout.roles == Role.SHARED] = np.sqrt(np.diagonal(covariance))
        block = range(layout.size)[layout.field_size_block]
        return tuple(layout.names[index] for index in block if layout.free[index] and sigma[index] > TOLD)

    def _one_by_one(self) -> SequenceCalibration:
        every = self._frames(np.arange(len(self.frames)), self.object_segments, self.options)
        return SequenceCalibration(tuple(every), field=self.options.field)

    def _spread(self, count: int) -> IntArray:
        """Up to `count` frames, evenly spread, each the one with most labels of its part of the sequence."""
        labels = np.array([len(frame) for frame in self.frames], dtype=np.intp)
        parts = np.array_split(np.arange(len(labels)), min(count, max(len(labels), 1)))
        best = [part[np.argmax(labels[part])] for part in parts if len(part)]
        return np.array([t for t in best if labels[t]], dtype=np.intp)

    def _frames(self, index: IntArray, object_segments: ObjectSegments, options: Options) -> list[Calibration]:
        frames, weights = [self.frames[t] for t in index], [self.weights[t] for t in index]
        return calibrate_frames(object_segments, frames, weights, options, trust_labels=self.trust_labels)

    def _layout(self, reference: float) -> Layout:
        """Blocks of the frames together: what the flags fix stays fixed, what is shared is shared."""
        base, field = self.options.layout, self.options.field
        size = None
        if "field size" in self.shared and base.field_size is not None and field is not None:
            assert field.size_model is not None
            size = SizeBlock(np.array([field.length, field.width]), field.size_model.sigma, field.size_model.limits)
        law = ZoomLaw(reference) if "zoom law" in self.shared else None
        layout = Layout.of(base.image_size, base.lens, size, law)
        layout.roles[: base.lens_block.stop] = base.roles[: base.lens_block.stop]
        blocks = {*self.shared, "centre", *(("aspect",) if "principal point" in self.shared else ())}
        for name in blocks & layout.blocks.keys():
            block = layout.blocks[name]
            layout.roles[block] = np.where(layout.roles[block] == Role.FRAME, Role.SHARED, Role.FIXED)
        for name in self.kept:
            layout.roles[layout.names.index(name)] = Role.CONSIDERED
        return _law_of_what_is_free(layout)

    def _together(self, found: Sequence[Calibration]) -> tuple[Evaluation, Array]:
        """The accepted ones of some frames solved together, and the covariance of what they share."""
        parts = [c.solved.alone.evaluation for c in found if c.accepted and c.solved is not None]
        old = parts[0].problem.layout
        theirs = np.concatenate([part.theta for part in parts])
        layout = self._layout(float(np.median(theirs[:, LOG_F])) if old.zoom_law is None else old.zoom_law.reference)
        theta = np.zeros((len(parts), layout.size))
        column = {name: index for index, name in enumerate(old.names)}
        for index, name in enumerate(layout.names):
            if name in column:
                theta[:, index] = theirs[:, column[name]]
        theta[:, layout.roles == Role.SHARED] = np.median(theta[:, layout.roles == Role.SHARED], axis=0)

        prior = given_cameras(theta, layout, self.options.distributions).prior if self.options.use_prior else None
        once = layout.roles == Role.SHARED
        start = put_together(self.object_segments, parts, layout, theta, prior, once)
        solved = levenberg_marquardt(
            start, max_iterations=self.options.max_iterations, tolerance=self.options.tolerance
        ).evaluation
        covariance, _ = shared_covariance(solved, *pooled_noise(solved))
        return solved, covariance

    def _known(self, together: Evaluation, covariance: Array) -> tuple[ObjectSegments, Options]:
        """The object and the options for frames by themselves, what is shared being known with its covariance."""
        layout, theta = together.problem.layout, together.theta[0]
        object_segments, field, size = self.object_segments, self.options.field, layout.field_size
        if size is not None and field is not None:
            length, width = theta[layout.field_size_block].tolist()
            object_segments = field = replace(field.resized(length, width), size_known=True)
            layout = replace(layout, field_size=size._replace(given=np.array([length, width])))
        is_shared = layout.roles == Role.SHARED
        considered = is_shared | (layout.roles == Role.CONSIDERED)
        every = np.zeros((layout.size, layout.size))
        every[np.ix_(is_shared, is_shared)] = covariance
        if self.options.field is not None and self.options.field.size_model is not None:
            probability, sigma = self.options.field.size_model.possibilities
            for name in self.kept:
                index = layout.names.index(name)
                every[index, index] = probability @ np.square(sigma[:, index - layout.field_size_block.start])
        known = np.where(layout.roles == Role.FRAME, np.nan, theta)
        roles = np.where(considered, Role.CONSIDERED, layout.roles)
        options = replace(
            self.options,
            layout=replace(layout, roles=roles),
            known=known,
            field=field,
            considered=every[np.ix_(considered, considered)],
        )
        return object_segments, options


def _law_of_what_is_free(layout: Layout) -> Layout:
    """Without the parts of the zoom law of what is fixed itself."""
    if layout.zoom_law is None:
        return layout
    names, roles = layout.names, layout.roles.copy()
    for name, of in (("cx slope", "cx"), ("cy slope", "cy"), ("a1 slope", "a1"), ("a1 bend", "a1")):
        if of not in names or roles[names.index(of)] == Role.FIXED:
            roles[names.index(name)] = Role.FIXED
    return replace(layout, roles=roles)


def agreed_centre(calibrations: Sequence[Calibration]) -> Array | None:
    """The centre (3,) that most frames of one tripod agree on within their covariances; None without any.

    Frames that have another one, as wrong labels or a wrong minimum give it, do not count.
    """
    if not calibrations:
        return None
    C = np.array([c.uncertainty.theta[CENTER] for c in calibrations])
    V = np.array([c.covariance[CENTER, CENTER] for c in calibrations]) + NEAR**2 * np.eye(3)
    difference = C[:, None] - C
    distance = np.einsum("ijk,ijk->ij", difference, np.linalg.solve(V[:, None] + V, difference[..., None])[..., 0])
    agree = distance[np.argmax(np.sum(distance < AGREE, axis=1))] < AGREE
    precision = np.linalg.inv(V[agree])
    return np.asarray(np.linalg.solve(np.sum(precision, axis=0), np.einsum("nij,nj->i", precision, C[agree])))
