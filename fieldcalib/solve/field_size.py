"""Length and width of a pitch, estimated together with the cameras that see it.

Law 1 allows a range of sizes; on a pitch of another size, assuming 105 x 68 m makes the cameras wrong. Segments move
with length and width (`Field.motion`); their shapes stay. The size is another block of the parameters, shared by all
frames: Levenberg-Marquardt minimises the cost of all frames, each with a camera of its own, and of the prior of the
size; the cameras are eliminated from its steps (`fieldcalib.problem.levenberg_marquardt`). Then the frames are
calibrated again, as segments that seemed mislabelled may fit a pitch of another size, until the size converges.

Where the frames together determine that the ground is crowned, its height is estimated with the size.

The covariance is the sandwich of `fieldcalib.assess.uncertainty` with two more parameters. In the errors of each camera
the size is a considered parameter with that covariance V: with P the covariance of the camera on a pitch of known size
and K the derivatives of its estimate by the size, that of the camera is P + K V K^T, the marginal one of both.

Size and ground of the field from the labels of a single frame, estimated together with its camera.

A frame is calibrated on the given field, on level ground if nothing else is known, and its evidence for another size
and for a crown is known to first order (`fieldcalib.assess.size_evidence`). If the given size, or level ground, is
improbable, those of length, width and crown that the frame determines become free parameters: they are solved under
the prior of such fields, within the legal sizes. What the frame does not determine stays as given.

The errors of the camera have all that the labels leave possible, as on the given field: that this is the right one
nevertheless, another size than the estimated one, or mistakes among the labels.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from fieldcalib._html import table
from fieldcalib._types import Array, BoolArray, IntArray
from fieldcalib.assess.camera_errors import Solved
from fieldcalib.assess.findings import Finding, Status, What
from fieldcalib.assess.result import Calibration, in_picture, with_findings
from fieldcalib.assess.sequence_errors import ReducedSystem
from fieldcalib.assess.size_evidence import SizeEvidence
from fieldcalib.fields.field import Field
from fieldcalib.fields.traits import DEVIATIONS
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.evaluation import Evaluation, evaluate
from fieldcalib.problem.labelled_pixels import ImageSegments, PixelTable
from fieldcalib.problem.layout import CROWN_RANGE, GaussianPrior, Layout, Role, SizeBlock
from fieldcalib.problem.levenberg_marquardt import levenberg_marquardt
from fieldcalib.problem.picture_shape import Placement
from fieldcalib.solve.batch import calibrate_batch
from fieldcalib.solve.sequence.joint_solution import LARGEST_CROWN_SIGMA, CrownEstimate, crown_of, joint_evaluation
from fieldcalib.solve.solver_options import DEFAULT_CRITERIA, DEFAULT_FLAGS, Prior

# Probability of the given size or ground from which on it is kept, and where a marking lies beside its paint: that is
# what another field looks like, as long as pixels of this marking were left out as wrong ones.
LIKELY, LIKELY_BESIDE = 0.5, 0.9
# m: of a length, a width and a crown that count as determined; less than the prior's standard deviations
LARGEST_SIGMAS = np.array([2.0, 2.0, LARGEST_CROWN_SIGMA])

STILL = 1e-3  # metres: a size that changes by less has converged
ROUNDS = 10
# Share below which labels count as uninformative: a frame of one half has 2 % for the length, through the prior of the
# camera's position.
SILENT = 0.05
# Probability of a size that a person told, below which its camera is "check": on rendered pictures right sizes have 0.4
# and more, most that are 2 to 8 m too long or too short 0.26 and less, where the labels determine the length.
LEAST_KNOWN = 0.3
MOSTLY = 0.5  # share from which on a size counts as determined by the labels


def with_field_from_labels(calibration: Calibration, again: Callable[[Field, Camera], Calibration]) -> Calibration:
    """Calibrate a frame again on a field of the size and ground that its labels determine, unless the given are likely.

    Parameters
    ----------
    calibration : Calibration
        Calibration on the given field.
    again : callable
        Function that calibrates the frame on another field, from a camera that fits its lines there.
    """
    labels = _FieldFromLabels.of(calibration)
    if labels is None or calibration.solved is None:
        return calibration
    field, camera = labels.fitted(calibration.solved, labels.field, labels.expected)
    found = again(field, camera)
    if not found.accepted or found.solved is None or found.solved is calibration.solved:
        return calibration
    estimated = np.array([field.length, field.width, field.terrain.crown])[labels.index]
    field, camera = labels.fitted(found.solved, field, estimated)
    solved = labels.on_field(found.solved, field, camera)
    found = replace(found, camera=camera, field=field, errors=solved)
    height, sigma = field.terrain.crown, float(np.sqrt(solved.uncertainty.covariance[-1, -1]))
    if not height - labels.field.terrain.crown > sigma:
        return found
    return in_picture(found, Placement.whole(camera.image_size), Finding(What.RAISED, numbers=(height, sigma)))


@dataclass(frozen=True, eq=False)
class _FieldFromLabels:
    """Evidence of one frame for those of length, width and crown of its field that are uncertain: c quantities."""

    field: Field
    """The given field."""
    size: SizeBlock
    """Its size and crown as parameters."""
    evidence: SizeEvidence
    index: IntArray
    """Which of length, width and crown the quantities are, (c,)."""
    freed: BoolArray
    """Which of them the frame determines, and are unlikely as given, (c,)."""

    @classmethod
    def of(cls, calibration: Calibration) -> _FieldFromLabels | None:
        """The evidence of a calibration; None if the given field is likely, or no other one is possible."""
        field, solved = calibration.field, calibration.solved
        if field is None or solved is None or calibration.status not in (Status.ACCEPTED, Status.IMPROBABLE):
            return None
        problem, evidence = solved.evaluation.problem, solved.uncertainty.size
        size = problem.layout.field_size
        if evidence is None or size is None or problem.prior is None:
            return None
        index = np.flatnonzero(problem.layout.considered) - problem.layout.field_size_block.start
        as_given = np.array([evidence.as_given, evidence.as_given, evidence.level])[index]
        likely = LIKELY_BESIDE if any(one.is_beside for one in calibration.markings) else LIKELY
        freed = (as_given <= likely) & (_deviations(evidence, problem.layout.prior_moment) < LARGEST_SIGMAS[index])
        if field.moved_by_width.isdisjoint(solved.pixels.by_label(0)):
            freed &= index != 1  # without a touchline the ends of goal lines and the crown hardly tell the width
        return cls(field, size, evidence, index, freed) if np.any(freed) else None

    @property
    def expected(self) -> Array:
        """The expected quantities, (c,)."""
        return np.append(self.size.given, self.size.height)[self.index] + self.evidence.mean

    def fitted(self, solved: Solved, field: Field, start: Array) -> tuple[Field, Camera]:
        """Field and camera that fit a frame best, which was solved on a field: the freed quantities are solved too.

        They start from (c,); on 439 rendered pictures other starts end in the same minimum.
        """
        alone, size = solved.alone.evaluation, self.size
        roles = np.full(2 if size.crown is None else 3, Role.FIXED)
        roles[self.index[self.freed]] = Role.FRAME
        layout, prior = _layout_on(field, alone.problem.layout, size, roles), alone.problem.prior
        assert prior is not None
        _, sigmas = size.possibilities_with_crown
        allows = np.all(sigmas[:, self.index[self.freed]] > 0.0, axis=1)
        likely = sigmas[np.argmax(np.where(allows, self.evidence.weights[: len(sigmas)], -1.0))]
        sigma = np.where(likely > 0.0, likely, 1.0)  # of quantities that are kept any one will do
        sigma[self.index] *= self.evidence.width_of_cost  # the prior weighs as much against the cost as against noise
        given = np.append(size.given, size.height)[: len(roles)]
        some = given.copy()
        some[self.index[self.freed]] = start[self.freed]
        some = np.clip(some, *np.column_stack([size.limits, CROWN_RANGE])[:, : len(roles)])
        both = GaussianPrior(_beside(prior.mean, layout, given), _beside(prior.sigma, layout, sigma))
        at_start = evaluate(replace(alone.problem, layout=layout, prior=both), _beside(alone.theta, layout, some))
        _, iterations, tolerance = DEFAULT_CRITERIA
        theta = levenberg_marquardt(at_start, max_iterations=iterations, tolerance=tolerance).evaluation.theta[0]
        return _field_of(self.field, layout, theta), layout.camera(theta)

    def on_field(self, solved: Solved, field: Field, camera: Camera) -> Solved:
        """The labels of a frame at a camera and a field that fit them, and what they tell there of size and ground."""
        roles = np.full(2 if self.size.crown is None else 3, Role.FIXED)
        roles[self.index] = Role.CONSIDERED
        return _considering(solved, field, camera, self.size, roles)


def _considering(solved: Solved, field: Field, camera: Camera, size: SizeBlock, roles: Array) -> Solved:
    """A frame at a camera on a field whose size and crown have some roles."""
    alone = solved.alone
    problem = alone.evaluation.problem
    layout, prior = _layout_on(field, problem.layout, size, roles), problem.prior
    assert prior is not None
    quantities, before, observations = layout.quantities, problem.layout.field_size, problem.observations
    if before is not None and not before.is_known:
        observations = observations.moved(quantities[None, :2] - before.given)
    elif field.moves_with_size:  # it was solved as known
        observations = replace(observations, motion=field.motion[[*map([*field].index, observations.labels)]])
    both = GaussianPrior(
        _beside(prior.mean, layout, quantities), _beside(prior.sigma, layout, np.ones_like(quantities))
    )
    known = replace(problem, observations=observations, layout=layout, prior=both)
    return Solved(evaluate(known, layout.theta(camera)[None]), _beside(alone.unit, layout, 0.0 * quantities))


def _deviations(evidence: SizeEvidence, moment: Array) -> Array:
    """Standard deviation of each quantity by the labels, (c,), the others having their prior moment (c, c)."""
    information, prior = np.linalg.inv(evidence.covariance), np.diag(1.0 / np.diagonal(moment))
    found = [np.linalg.inv(information + prior - prior * one)[i, i] for i, one in enumerate(np.eye(len(prior)))]
    return np.sqrt(np.where(np.greater(found, 0.0), found, np.inf))


def _layout_on(field: Field, cameras: Layout, size: SizeBlock, roles: Array) -> Layout:
    """The layout of cameras on a field, with its size and crown, in some roles, as parameters."""
    given, height = np.array([field.length, field.width]), field.terrain.crown
    on = size._replace(given=given, height=height, shift=np.append(given - size.given, height - size.height))
    layout = Layout.of(cameras.image_size, cameras.lens, on)
    return replace(layout, roles=np.append(cameras.roles[: layout.field_size_block.start], roles))


def _beside(cameras: Array, layout: Layout, field: Array) -> Array:
    """Parameters (T, n) with those of cameras (T, m), and those of size and crown (c,) or (T, c) behind them."""
    own = cameras[:, : layout.field_size_block.start]
    return np.concatenate([own, np.broadcast_to(field, (len(own), np.shape(field)[-1]))], axis=1)


def _field_of(field: Field, layout: Layout, theta: Array) -> Field:
    """A field in the size, and on the ground, of a parameter vector."""
    if layout.field_size is None:
        return field
    length, width = theta[layout.field_size_block].tolist()
    return layout.field_size.resize(field, length, width, float(np.sum(theta[layout.crown_block])))


@dataclass(frozen=True, eq=False)
class FieldSize:
    """The estimated size of a pitch, and its uncertainty. Pairs are (length, width)."""

    field: Field
    """The pitch, of the estimated size and on the estimated ground."""
    covariance: Array
    """Covariance of length and width given labels and prior, (2, 2) square metres."""
    from_labels: Array
    """Share of the estimate that comes from the labels, (2,); the rest comes from the prior: ``information / (1 +
    information)``, with the information of the labels in units of the prior's."""
    calibrations: tuple[Calibration, ...]
    """Calibrations of the frames on that pitch, whose errors have those of its size."""
    crown: CrownEstimate | None = None
    """The crown of the pitch, if the frames determine one; the ground of `field` has it."""

    @property
    def length(self) -> float:
        """Length of a touchline, metres."""
        return self.field.length

    @property
    def width(self) -> float:
        """Length of a goal line, metres."""
        return self.field.width

    def _repr_html_(self) -> str:
        """The field, its size with standard deviations, and how much of it the labels tell, for notebooks."""
        sizes = zip(("length", "width"), (self.length, self.width), self.std_deviations, self.from_labels, strict=True)
        rows = {name: f"{size:.2f} ± {sd:.2f} m, {share:.0%} from the labels" for name, size, sd, share in sizes}
        return self.field.as_svg() + table(rows | {"frames": str(len(self.calibrations))})

    @property
    def is_told(self) -> bool:
        """Whether length and width come from the labels rather than the prior."""
        return bool(np.all(self.from_labels >= MOSTLY))

    @property
    def std_deviations(self) -> Array:
        """Standard deviations, (2,) metres: those of the prior where the labels are uninformative."""
        return np.asarray(np.sqrt(np.diagonal(self.covariance)))

    @property
    def interval(self) -> Array:
        """Lower and upper ends of the 95 % intervals of length and width, (2, 2) metres.

        They are clipped to the legal sizes.
        """
        size, half = np.array([self.length, self.width]), DEVIATIONS * self.std_deviations
        limits = (-np.inf, np.inf) if self.field.size_model is None else self.field.size_model.limits
        return np.asarray(np.clip([size - half, size + half], *limits))

    def __str__(self) -> str:
        """Sizes and where they come from, in words."""
        sizes, deviations = (self.length, self.width), self.std_deviations
        words = [*map(_in_words, ("length", "width"), sizes, deviations, self.from_labels)]
        if self.crown is not None:
            words.append(f"crown: {self.field.terrain.crown:.2f} ± {self.crown.sigma:.2f} m")
        return "; ".join(words)


def _in_words(name: str, metres: float, deviation: float, share: float) -> str:
    if not deviation:
        return f"{name}: {metres:.2f} m"
    if share < SILENT:
        return f"{name}: the labels say nothing, {metres:.1f} ± {deviation:.1f} m is from the prior"
    origin = "from the labels" if share >= MOSTLY else f"mostly from the prior ({100.0 * share:.0f} % from the labels)"
    return f"{name}: {metres:.2f} ± {deviation:.2f} m {origin}"


def estimate_field_size(
    field: Field,
    frames: Sequence[ImageSegments],
    image_size: tuple[int, int],
    *,
    flags: int = DEFAULT_FLAGS,
    prior: Prior = "all",
    tau: float | None = None,
) -> FieldSize:
    """Calibrate frames of one pitch together with its length and width.

    Length and width are normal a priori, with the size of `field` as mean and a 95 % interval as wide as the usual
    range of its `size_model`. For `soccer` that is the range of law 1 for international matches, 100 to 110 m and 64
    to 75 m: sigma is 2.55 and 2.81 m. The estimate stays within the legal sizes, 90 to 120 m and 45 to 90 m. Only
    accepted frames are used.

    A frame determines the width by both touchlines, or by one and markings in the middle; it determines the length by a
    goal line or a penalty area together with the middle line or the centre circle, or by both halves.

    Parameters
    ----------
    field : Field
        The pitch as `soccer` makes it, of the most likely size; or another field with a `size_model`. Of a field of
        exact size, as `american_football` makes it, the crown alone is estimated.
    frames : sequence of mappings of str to (N, 2) array_like
        Pixels of one or several frames of the same pitch.
    image_size : (int, int)
        Width and height of every frame, pixels.
    flags, prior, tau
        As in `calibrate_batch`, for the cameras.

    Returns
    -------
    FieldSize
        The mean of the prior where the labels are uninformative, or no frame is accepted.

    Raises
    ------
    ValueError
        If it is unknown how the segments of the field move with its size, and it has no crown to be estimated, or the
        size is illegal; otherwise as in `calibrate_batch`.

    References
    ----------
    IFAB, Laws of the Game, law 1, sections 3 and 4. The range as a 95 % interval: Theiner, Ewerth: TVCalib, WACV 2023,
    appendix "Camera Distribution".

    Examples
    --------
    >>> from fieldcalib import Camera, soccer
    >>> pitch, frames = soccer(101.0, 66.5), []
    >>> for pan in (-0.6, -0.2, 0.2, 0.6):
    ...     camera = Camera.from_angles(pan, 1.35, 0.0, 900.0, (0.0, 68.0, -17.0), (960, 540))
    ...     seen = {label: camera.project(segment.sample(2.0)) for label, segment in pitch.markings.items()}
    ...     frames.append({label: xy[((xy > 0.0) & (xy < (959, 539))).all(axis=1)] for label, xy in seen.items()})
    >>> found = estimate_field_size(soccer(), frames, (960, 540))
    >>> round(found.length, 1), round(found.width, 1), found.from_labels.round(1)
    (101.0, 66.6, array([1., 1.]))
    >>> middle = {label: frames[1][label] for label in ("Middle line", "Circle central", "Side line top")}
    >>> print(str(estimate_field_size(soccer(), [middle], (960, 540))).split("; ")[0])
    length: the labels say nothing, 105.0 ± 2.6 m is from the prior
    """
    size_prior = _checked_prior(field)
    is_known = field.size_known or size_prior.is_known

    def calibrated(pitch: Field, *, size_known: bool = True) -> list[Calibration]:
        on = replace(pitch, size_known=size_known)
        return calibrate_batch(on, frames, image_size, flags=flags, prior=prior, tau=tau)

    pitch = given = field if size_prior.is_known else field.resized(field.length, field.width)
    calibrations = calibrated(pitch)
    for _ in range(ROUNDS):
        # if none is accepted, a wrong size may be the reason
        seen = _with_status(calibrations, Status.ACCEPTED) or _with_status(
            calibrations, Status.NOT_CONVERGED, Status.IMPLAUSIBLE
        )
        if not seen:
            break
        found = _most_likely(seen, size_prior, field).field
        if _change(pitch, found) < STILL:
            break
        pitch = found
        calibrations = calibrated(pitch)
    accepted = _with_status(calibrations, Status.ACCEPTED)
    if not accepted and pitch is not given:
        pitch, calibrations = given, calibrated(given)
    joint = _joint(accepted, size_prior, _role(accepted)) if accepted else None
    covariance, from_labels, crown = _uncertainty(accepted, joint, size_prior)
    if prior is not None and not is_known:  # without a prior nothing is known of a size that labels leave open
        calibrations = [of_size(one, pitch, covariance) for one in calibrated(pitch, size_known=False)]
    return FieldSize(pitch, covariance, from_labels, tuple(calibrations), crown)


def shared_size(field: Field, calibrations: Sequence[Calibration]) -> FieldSize:
    """The field, its size and ground estimated from all calibrations; the given one if none of them is accepted.

    Parameters
    ----------
    field : Field
        Field of the most likely size, as for `estimate_field_size`.
    calibrations : sequence of Calibration
        Calibrations on fields of any size.
    """
    size_prior, accepted = _checked_prior(field), _with_status(calibrations, Status.ACCEPTED)
    found = _most_likely(accepted, size_prior, field) if accepted else None
    uncertainty = _uncertainty(accepted, None if found is None else found.joint, size_prior)
    return FieldSize(field if found is None else found.field, *uncertainty[:2], tuple(calibrations), uncertainty[2])


def _checked_prior(field: Field) -> SizeBlock:
    """Prior of length and width around those of a field of legal size, whose segments must move with its size.

    Of a field of exact size only the crown is unknown.
    """
    if not isinstance(field, Field):
        raise ValueError(f"expected a field as soccer(length, width) makes it, got {type(field).__name__}")
    if field.size_model is None and (exact := SizeBlock.of(field)) is not None:
        return exact
    sizes = field.resized(field.length, field.width).size_model
    assert sizes is not None  # else it cannot be resized
    size, (low, high) = np.array([field.length, field.width]), sizes.limits
    if np.any(size < low) or np.any(size > high):
        raise ValueError(
            f"expected a pitch of {low[0]:g} to {high[0]:g} x {low[1]:g} to {high[1]:g} m ({sizes.rules}) whose size "
            f"is to be estimated, got {field.length:g} x {field.width:g}; give a likely size in metres, the touchline "
            f"first"
        )
    crown = field.crown if field.ground is None else None
    return SizeBlock(size, sizes.sigma, sizes.limits, crown=crown, height=field.terrain.crown)


def of_size(calibration: Calibration, pitch: Field, covariance: Array) -> Calibration:
    """A calibration on a pitch, with the errors of the size of that, which is known with a covariance (2, 2)."""
    solved = calibration.solved
    if solved is None or solved.evaluation.problem.prior is None or calibration.field != pitch:
        return calibration
    size, evidence = _checked_prior(pitch), solved.uncertainty.size
    considered = np.zeros((2, 2) if size.crown is None else (3, 3))
    considered[:2, :2] = covariance
    if evidence is not None:
        considered[2:, 2:] = evidence.moment[-1, -1]
    found = _considering(solved, pitch, solved.camera, size, np.full(len(considered), Role.CONSIDERED))
    known = replace(found.evaluation.problem, considered=considered)
    return replace(calibration, errors=Solved(found.evaluation.of(known), found.unit))


def doubted_for_size(calibration: Calibration) -> Calibration:
    """Doubt a camera on a field that is said to have its size where the labels tell another one.

    Examples
    --------
    >>> from fieldcalib import Camera, calibrate_from_segments, soccer
    >>> camera = Camera.from_angles(0.1, 1.35, 0.0, 900.0, (0.0, 68.0, -17.0), (960, 540))
    >>> seen = {label: camera.project(one.sample(2.0)) for label, one in soccer(105.0, 68.0).markings.items()}
    >>> pixels = {label: xy[((xy > 0.0) & (xy < (959, 539))).all(axis=1)] for label, xy in seen.items()}
    >>> wrong = calibrate_from_segments(soccer(101.0, 68.0, size_known=True), pixels, (960, 540))
    >>> print(doubted_for_size(wrong).findings[-1])
    the field is more probably of another size, about 105 x 68 m
    """
    field, solved = calibration.field, calibration.solved
    if not calibration.accepted or solved is None or field is None or not field.size_known:
        return calibration
    size = SizeBlock.of(replace(field, size_known=False))
    if size is None or size.is_known or solved.evaluation.problem.prior is None:
        return calibration
    roles = np.full(2 if size.crown is None else 3, Role.CONSIDERED)
    told = _considering(solved, field, solved.camera, size, roles).uncertainty.size
    if told is None or told.as_given > LEAST_KNOWN:
        return calibration
    length, width = np.clip(size.given + told.mean[:2], *size.limits)
    return with_findings(calibration, Finding(What.OTHER_SIZE, numbers=(float(length), float(width))))


def _with_status(calibrations: Sequence[Calibration], *statuses: Status) -> list[Calibration]:
    return [one for one in calibrations if one.status in statuses and one.solved is not None]


def _joint(calibrations: Sequence[Calibration], size_prior: SizeBlock, crown: Role) -> Evaluation:
    """Calibrations on one pitch as one problem whose frames share its size, evaluated at their cameras.

    The priors of the cameras' positions count once for all frames, as does that of the size. The position's prior
    contains a little information on the length; frames of one pitch may have one camera, and then it must not count
    again in every frame.

    Parameters
    ----------
    crown : Role
        Whether the crown is shared too, or considered.
    """
    parts = [one.solved.alone.evaluation for one in calibrations if one.solved is not None]
    problem, pitch, count = parts[0].problem, calibrations[0].field, len(parts)
    assert pitch is not None
    size_role = Role.FIXED if size_prior.is_known else Role.SHARED
    roles = np.array([size_role, size_role, *([] if size_prior.crown is None else [crown])])
    layout = _layout_on(pitch, problem.layout, size_prior, roles)
    cameras, c = layout.field_size_block.start, len(roles)
    mean, sigma = np.zeros((count, layout.size)), np.full((count, layout.size), np.inf)
    for t, part in enumerate(parts):
        if part.problem.prior is not None:
            mean[t, :cameras] = part.problem.prior.mean[0, :cameras]
            sigma[t, :cameras] = part.problem.prior.sigma[0, :cameras]
    spread = 0.0 if size_prior.crown is None else size_prior.crown.height
    mean[:, cameras:], sigma[:, cameras:] = [*size_prior.given, 0.0][:c], [*size_prior.sigma, spread][:c]
    once = layout.is_centre | (np.arange(layout.size) >= cameras)
    own = np.concatenate([part.theta[:, :cameras] for part in parts])
    theta = _beside(own, layout, np.array([pitch.length, pitch.width, pitch.terrain.crown][:c]))
    like = replace(problem, layout=layout, prior=GaussianPrior(mean, sigma), considered=None)
    pixels = PixelTable.joined(pitch, [one.solved.pixels for one in calibrations if one.solved is not None])
    return joint_evaluation(like, pitch, pixels, theta, once)


def _change(before: Field, after: Field) -> float:
    """Largest change of length, width and crown, metres."""
    sizes = abs(after.length - before.length), abs(after.width - before.width)
    return float(max(*sizes, abs(after.terrain.crown - before.terrain.crown)))


class _MostLikely(NamedTuple):
    """The most likely pitch of some calibrations."""

    field: Field
    joint: Evaluation
    """The calibrations on it, with its size as a parameter."""
    crown: CrownEstimate | None
    """Its crown, to first order where the ground is taken to be level; None where all fields are level."""


def _most_likely(calibrations: Sequence[Calibration], size_prior: SizeBlock, field: Field) -> _MostLikely:
    """The pitch of least cost: on level ground, or on crowned ground where the calibrations determine that."""
    found = _solved(calibrations, size_prior, field, _role(calibrations))
    if _role(calibrations) == Role.SHARED or found.crown is None or found.crown.height < found.crown.sigma:
        return found  # to first order; lines that bend on level ground look noisy, and make the crown less certain
    raised = _solved(calibrations, size_prior, field, Role.SHARED)
    return raised if raised.crown is not None and raised.crown.is_determined else found


def _role(calibrations: Sequence[Calibration]) -> Role:
    """Role of the crown: estimated with the size if the pitch of the calibrations has one."""
    pitch = calibrations[0].field
    return Role.SHARED if pitch is not None and pitch.terrain.crown else Role.CONSIDERED


def _solved(calibrations: Sequence[Calibration], size_prior: SizeBlock, field: Field, crown: Role) -> _MostLikely:
    """Solve size, and crown if it is shared, together with the cameras."""
    _, iterations, tolerance = DEFAULT_CRITERIA
    start = _joint(calibrations, size_prior, crown)
    found = levenberg_marquardt(start, max_iterations=iterations, tolerance=tolerance).evaluation
    layout, theta = found.problem.layout, found.theta[0]
    crown_found = crown_of(_system(calibrations, found), layout, theta)
    return _MostLikely(_field_of(field, layout, theta), found, crown_found)


def _system(calibrations: Sequence[Calibration], joint: Evaluation) -> ReducedSystem:
    """Normal equations of length, width and, if fields may be crowned, crown."""
    found = [one.solved.uncertainty for one in calibrations if one.solved is not None]
    kappa, sigma = np.array([(one.curvature, one.robust_sigma) for one in found]).T
    return ReducedSystem.of(joint, sigma, kappa)


def _uncertainty(
    calibrations: Sequence[Calibration], joint: Evaluation | None, size_prior: SizeBlock
) -> tuple[Array, Array, CrownEstimate | None]:
    """Covariance (2, 2) and shares from the labels (2,) of the most likely size, and its crown if it is shared."""
    if joint is None:
        return np.diag(size_prior.sigma**2), np.zeros(2), None
    layout, system = joint.problem.layout, _system(calibrations, joint)
    is_raised = Role.SHARED in layout.roles[layout.crown_block]
    crown = crown_of(system, layout, joint.theta[0]) if is_raised else None
    if size_prior.is_known:
        return np.zeros((2, 2)), np.ones(2), crown
    system = system.take(np.arange(2 if crown is None else 3))
    share = np.maximum(1.0 - np.diagonal(system.inverse)[:2] / size_prior.sigma**2, 0.0)  # below 0 by rounding
    return system.white_covariance[:2, :2], share, crown
