"""The verdict on a camera: plausibility, equations and unknowns, tau, and the reason in words."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fieldcalib._types import BoolArray
from fieldcalib.assess.findings import Finding, Status, What
from fieldcalib.assess.observability import OPEN_DIRECTION, Direction
from fieldcalib.fields.field import Field
from fieldcalib.fields.segments import Segment
from fieldcalib.problem.evaluation import Evaluation
from fieldcalib.problem.layout import CENTER, LOG_F, ROLL, TILT, exp_of
from fieldcalib.problem.observations import FrameLabels

LARGEST_ROLL = np.radians(45.0)
STEEPLY = np.radians(60.0)  # largest tilt of cameras that look down: seen straight from above, a roll is like a pan
FIELD_OF_VIEW = np.radians((0.5, 150.0))
LARGEST_SHARE_BEHIND = 0.1  # of the weight of fitting segments; 0.05 and 0.2 give the same verdicts on annotated frames
AGREEING = 2.0 / 3.0  # share of the labelled segments that must fit
# Equations beyond the unknowns that the other points must give before one is blamed: three from five points of six are
# met by chance so often that the wrong one is named.
TO_BLAME = 5


@dataclass(frozen=True)
class Evidence:
    """Evidence on one frame's camera, from which the verdict follows."""

    rms: float
    """Root mean square distance of the pixels, pixels."""
    loss_ndc: Callable[[], float]
    """The paper's loss, which is compared with tau."""
    errors: Mapping[str, float]
    """Root mean square distance of each segment, with the labels that were solved with, pixels."""
    labels: FrameLabels
    """The labels that were solved with."""
    given: FrameLabels
    """The given labels."""
    suspects: Sequence[str]
    """Given labels that the others contradict."""
    far: float
    """Pixels beyond which a segment counts as missed."""
    unknowns: int
    """Number of free parameters."""
    implausible: Sequence[str]
    """Reasons why the camera is implausible, see `implausibilities`."""
    weakest: Direction
    """The direction of pose and zoom that the labels determine least."""
    ground_error: Callable[[], float]
    """Largest error of the field in view, in units of the field's tolerance; NaN if the object is no field."""
    converged: bool
    """Whether the solver found a minimum."""
    lens_is_prior: bool = False
    """Whether the lens comes from the prior, since the labels hardly determine it."""


def verdict(evidence: Evidence, tau: float | None) -> tuple[Status, str, *tuple[Finding, ...]]:
    """Status of one frame's calibration, a message with the reason, and what may be told of it otherwise.

    The first that applies counts: rejected by tau, too few segments, degenerate, implausible, not converged.
    """
    segments, equations = evidence.labels.segments, sum(evidence.labels.equations.values())
    noun = _noun(segments.values())
    labelled = f"{len(segments)} {noun}{'s' * (len(segments) != 1)}"
    if tau is not None and not evidence.loss_ndc() <= tau:
        return Status.REJECTED, f"the loss in NDC, {evidence.loss_ndc():.4f}, is above tau = {tau:g}"
    if equations < evidence.unknowns:
        more = Finding(What.TOO_FEW_LABELS, noun, (len(segments), equations, evidence.unknowns))
        return Status.TOO_FEW_SEGMENTS, str(more), more
    missed = [label for label in segments if evidence.errors[label] > evidence.far]
    worst = max(missed, key=lambda label: evidence.errors[label], default="")
    is_named = missed and may_blame(evidence.given, missed, evidence.unknowns)
    off = f"; {worst!r} lies {evidence.errors[worst]:.0f} px off" if is_named else ""
    or_another = f"{off}: this label or another one is wrong" if off and not evidence.suspects else ""
    is_open = evidence.weakest.information < OPEN_DIRECTION
    if is_open and (evidence.implausible or not evidence.ground_error() <= 1.0):
        left_open = (
            f"the labels leave {evidence.weakest.parameters} open: label a {noun} elsewhere in the image, or give what "
            f"is known of the camera"
        )
        return Status.DEGENERATE, f"{degeneracy(list(segments.values())) or left_open}{or_another}"
    if evidence.implausible:
        why = "; ".join(evidence.implausible)
        return Status.IMPLAUSIBLE, f"the best fit is physically implausible: {why}{or_another}"
    complaint = disagreement(evidence.given, {*evidence.suspects, *missed}, evidence.unknowns)
    if complaint:
        return Status.IMPLAUSIBLE, f"{complaint}{or_another}"
    if not evidence.converged:
        return Status.NOT_CONVERGED, "the iterations ended before a minimum"
    if missed:
        fits = f"{len(segments) - len(missed)} of {labelled} agree{off}"
        return Status.ACCEPTED, fits + ", check its label" * bool(off)
    lens = "; the lens is poorly determined by the labels" if evidence.lens_is_prior else ""
    return Status.ACCEPTED, f"rms {evidence.rms:.2f} px over {labelled}{lens}"


def disagreement(labels: FrameLabels, missed: Collection[str], unknowns: int) -> str | None:
    """Reason to reject a camera that misses some of a frame's labels; None if there is none.

    Two thirds of the labels must agree with the camera, and give at least as many equations as there are unknowns.
    """
    agreeing = [equations for label, equations in labels.equations.items() if label not in missed]
    if len(agreeing) >= AGREEING * len(labels.equations) and sum(agreeing) >= unknowns:
        return None
    return (
        f"only {len(agreeing)} of {len(labels.equations)} {_noun(labels.segments.values())}s agree with the best fit: "
        f"check the labels, the field's and the image's size"
    )


def may_blame(labels: FrameLabels, blamed: Collection[str], unknowns: int) -> bool:
    """Whether a frame has enough labels beside some to name these as wrong; among few points any one may be wrong."""
    if _noun(labels.segments.values()) != "point":
        return True
    agreeing = sum(equations for label, equations in labels.equations.items() if label not in blamed)
    return agreeing - unknowns >= TO_BLAME


def _noun(segments: Iterable[Segment]) -> str:
    """Noun for labelled segments in messages."""
    return "point" if all(segment.is_point for segment in segments) else "segment"


def implausibilities(
    evaluation: Evaluation, *, far: float, field: Field | None, may_be_inside: bool = True
) -> dict[str, BoolArray]:
    """Reasons why cameras are implausible, each with a mask (B,) of the cameras that it applies to.

    A camera must have a field of view between 0.5 and 150 degrees, and the segments that it fits must lie in front of
    it: those of pixels within `far` pixels, as pixels farther off may have wrong labels. On a field it must also stand
    above the ground, no farther away than `field.farthest_camera`, beside the field unless it `may_be_inside`, and be
    rolled by at most 45 degrees, unless it looks down.
    """
    theta, points, observations = evaluation.theta, evaluation.points, evaluation.problem.observations
    width = observations.image_size[0]
    fov = 2.0 * np.arctan(0.5 * width / exp_of(theta, LOG_F))
    near = observations.weight * (np.abs(points.r) <= far)
    behind = np.sum(near * (points.inverse_depth < 0.0), axis=1)
    is_behind = behind > LARGEST_SHARE_BEHIND * np.sum(near, axis=1)
    labels = np.unique(observations.label) if np.any(is_behind) else ()  # nobody asks for the noun otherwise
    noun = _noun(observations.segments[label] for label in labels if label >= 0)
    reasons = {
        "its field of view is below 0.5 degrees": fov < FIELD_OF_VIEW[0],
        "its field of view is above 150 degrees": fov > FIELD_OF_VIEW[1],
        f"labelled {noun}s lie behind it": is_behind,
    }
    if field is not None:
        C = theta[:, CENTER]
        farthest, half = field.farthest_camera, (field.length / 2.0, field.width / 2.0)
        reasons["it stands below the ground"] = C[:, 2] > 0.0
        reasons[f"it stands more than {farthest:g} m away"] = np.linalg.norm(C, axis=1) > farthest
        if not may_be_inside:
            reasons["it stands inside the field"] = np.all(np.abs(C[:, :2]) < half, axis=1)
        # a rotation has two sets of angles, whose rolls differ by half a turn: the one with the smaller roll counts
        is_rolled = np.abs(np.sin(theta[:, ROLL])) > np.sin(LARGEST_ROLL)
        reasons["it is rolled by more than 45 degrees"] = is_rolled & (np.cos(theta[:, TILT]) < np.cos(STEEPLY))
    return reasons


def degeneracy(segments: Sequence[Segment]) -> str | None:
    """Reason why segments cannot determine a camera: parallel lines, lines through one point, or one circle."""
    if not segments or not all(segment.is_straight for segment in segments):
        circles = {segment.middle_of_curvature if segment.is_arc else None for segment in segments}
        alike = "only one circle is labelled, and it looks alike from all sides: any line would help"
        return alike if len(circles) == 1 and None not in circles else None
    starts, directions = np.moveaxis(np.array([line.vectors for line in segments]), 1, 0)
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    if np.linalg.matrix_rank(directions, tol=1e-6) == 1:
        return "all labelled lines are parallel: one line across them would help"
    # X is on every line where (I - d d^T)(X - start) = 0
    offsets = [np.eye(3) - np.outer(d, d) for d in directions]
    A = np.concatenate(offsets)
    b = np.concatenate([offset @ start for offset, start in zip(offsets, starts, strict=True)])
    X, *_ = np.linalg.lstsq(A, b, rcond=None)
    if np.abs(A @ X - b).max() < 1e-6:
        return "all labelled lines meet in one point: one line that misses it would help"
    return None
