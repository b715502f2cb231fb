"""The size of the field from the labels of a single frame, estimated together with its camera.

A frame is calibrated on a field of the given size, and its evidence for another size is known to first order
(`fieldcalib.assess.size_evidence`). If the given size is improbable, length and width, or the one of them that the
frame determines, become free parameters: they are solved from several starts under the prior of sizes, within the legal
ones. A dimension that the frame does not determine stays as given.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.size_evidence import SizeEvidence
from fieldcalib.assess.solved import Solved
from fieldcalib.assess.words import Status
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.problem.evaluation import Evaluation, evaluate
from fieldcalib.problem.layout import Layout, Role, SizeBlock
from fieldcalib.problem.levenberg_marquardt import levenberg_marquardt
from fieldcalib.problem.prior import GaussianPrior
from fieldcalib.solve.options import DEFAULT_CRITERIA

LIKELY = 0.5  # probability of the given size from which on it is kept
LARGEST_SIGMA = 2.0  # m: of a length or width that counts as determined; less than the prior's standard deviations


def with_size_from_labels(calibration: Calibration, again: Callable[[Field, Camera], Calibration]) -> Calibration:
    """Calibrate a frame again on a field of the size that its labels determine, unless the given size is likely.

    Parameters
    ----------
    calibration : Calibration
        Calibration on a field of the given size.
    again : callable
        Function that calibrates the frame on another field, from a camera that fits its lines there.
    """
    size = _SizeFromLabels.of(calibration)
    if size is None or calibration.solved is None:
        return calibration
    sized = size.solved(calibration.solved, size.starts)
    found = again(sized.field, sized.camera)
    if not found.accepted or found.solved is None or found.solved is calibration.solved:
        return calibration
    sized = size.solved(found.solved, sized.size[None])
    unit = np.where(sized.layout.free, sized.prior_sigma, 0.0)[None]
    return replace(found, camera=sized.camera, field=sized.field, errors=Solved(sized.evaluation, unit))


@dataclass(frozen=True, eq=False)
class _Sized:
    """A frame that was solved together with the size of its field."""

    like: Field
    evaluation: Evaluation

    @property
    def layout(self) -> Layout:
        return self.evaluation.problem.layout

    @property
    def size(self) -> Array:
        """Length and width, (2,) metres."""
        return np.asarray(self.evaluation.theta[0, self.layout.field_size_block])

    @property
    def field(self) -> Field:
        return self.like.resized(*self.size.tolist())

    @property
    def camera(self) -> Camera:
        return self.layout.camera(self.evaluation.theta[0])

    @property
    def prior_sigma(self) -> Array:
        assert self.evaluation.problem.prior is not None
        return np.asarray(self.evaluation.problem.prior.sigma[0])


@dataclass(frozen=True, eq=False)
class _SizeFromLabels:
    """Evidence of one frame for the size of its field, to first order."""

    field: Field
    """Field of the given size."""
    size: SizeBlock
    evidence: SizeEvidence
    determined: BoolArray
    """Whether the frame determines length and width, (2,)."""
    wide: BoolArray
    """Mask (K,) of the possibilities under which length and width are both uncertain."""
    of_crown: Array
    """Second moment of the crown, (1,); (0,) where all fields are level."""

    @classmethod
    def of(cls, calibration: Calibration) -> _SizeFromLabels | None:
        """The evidence of a calibration; None if the given size is likely, or no other one is possible."""
        field, solved = calibration.field, calibration.solved
        if field is None or solved is None or calibration.status not in (Status.ACCEPTED, Status.IMPROBABLE):
            return None
        problem, evidence = solved.evaluation.problem, solved.uncertainty.size
        size = problem.layout.field_size
        if evidence is None or size is None or problem.prior is None or evidence.as_given > LIKELY:
            return None
        determined = np.sqrt(np.diagonal(evidence.covariance)) < LARGEST_SIGMA
        wide = np.all(size.possibilities[1] > 0.0, axis=1)
        with_crown = solved.uncertainty.with_crown
        of_crown = np.zeros(0) if with_crown is None else with_crown.moment[2:, 2]
        return cls(field, size, evidence, determined, wide, of_crown) if np.any(determined) and np.any(wide) else None

    @property
    def starts(self) -> Array:
        """Sizes (3, 2): the given one, the one of the best fit to first order, and the expected one."""
        return self.size.given + np.stack([np.zeros(2), self.evidence.offset, self.evidence.mean])

    def solved(self, solved: Solved, starts: Array) -> _Sized:
        """Solve the frame together with the size that it determines, from several sizes (S, 2); least cost wins."""
        alone = solved.alone.evaluation
        layout, prior, block = alone.problem.layout, alone.problem.prior, alone.problem.layout.field_size_block
        assert prior is not None
        for role, which in ((Role.FRAME, self.determined), (Role.CONSIDERED, ~self.determined)):
            some = np.zeros(layout.size, dtype=bool)
            some[block] = which
            layout = layout.with_roles_of(some, role)
        likely = int(np.argmax(np.where(self.wide, self.evidence.weights[:-1], -1.0)))
        mean, sigma = prior.mean.copy(), prior.sigma.copy()
        mean[:, block], sigma[:, block] = self.size.given, self.size.possibilities[1][likely]
        kept = np.append(np.diagonal(self.evidence.moment)[~self.determined], self.of_crown)
        considered = np.diag(kept) if len(kept) else None
        problem = replace(alone.problem, layout=layout, prior=GaussianPrior(mean, sigma), considered=considered)
        theta = np.repeat(alone.theta, len(starts), axis=0)
        theta[:, block] = np.where(self.determined, np.clip(starts, *self.size.limits), self.size.given)
        start = evaluate(problem.take(np.zeros(len(starts), dtype=np.intp)), theta)
        _, iterations, tolerance = DEFAULT_CRITERIA
        found = levenberg_marquardt(start, max_iterations=iterations, tolerance=tolerance).evaluation
        return _Sized(self.field, found.take(np.array([np.argmin(found.cost)])))
