"""The words of a result: verdict, status and remedy, labels in doubt, and the error on a missing camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType

from fieldcalib._checks import expect, number
from fieldcalib.assess.remedies import BY_HAND, KNOWN_CAMERA, LEFT_OUT, LOOK, PICTURE

BESIDE = 5.0  # px: nearer pixels lie on the line
OTHER_SIDE_FITS = "the camera across the field, turned by 180 degrees, fits as well"
SEEN_FROM_OPPOSITE = (
    "it is on the opposite side of the field, if the labels name the ends as seen from the main side; otherwise it is "
    "the camera turned by 180 degrees, in alternatives"
)

UP_TO_SIDE = (
    "cameras and probabilities are up to the side of the field: its markings look the same from the opposite side, and "
    "the main one is taken; the camera turned by 180 degrees about the centre mark is in alternatives, and side or "
    "prior decide which one it is"
)


class Verdict(StrEnum):
    """Verdict on a calibration: what to do with it."""

    GOOD = "good"
    """Use it."""
    CHECK = "check"
    """Plausible, but there is evidence against it, or too little for it: look at the frame."""
    REJECT = "reject"
    """Do not use it."""


class Status(StrEnum):
    """Outcome of a calibration. The best camera is given with every status."""

    ACCEPTED = "accepted"
    REJECTED = "rejected by tau"
    """The loss in NDC is above the threshold that the user set."""
    IMPROBABLE = "probably wrong"
    """The probability that the camera is right is below the one that the user requires, the image shows no lines at the
    projected markings, or, in a sequence, the error of the field in view exceeds the field's tolerance."""
    TOO_FEW_SEGMENTS = "too few segments"
    """The labels give fewer equations than there are unknowns; the prior determines the others."""
    DEGENERATE = "degenerate"
    """There are enough equations, but a direction of the parameters is not determined."""
    NOT_CONVERGED = "not converged"
    """The solver reached its limit of iterations."""
    IMPLAUSIBLE = "implausible"
    """The best fit is physically implausible."""


REMEDIES: Mapping[Status, str] = MappingProxyType(
    {
        Status.REJECTED: "check the labels of the segments with the largest errors, or give a larger tau",
        Status.IMPROBABLE: f"{LOOK}; markings {BY_HAND}, or {KNOWN_CAMERA}; {LEFT_OUT}",
        Status.TOO_FEW_SEGMENTS: f"more markings in view, or {BY_HAND}",
        Status.DEGENERATE: f"a marking elsewhere in view, or {BY_HAND}, that is not parallel to the others",
        Status.NOT_CONVERGED: "check the labels; more iterations may help (criteria, in Python)",
        Status.IMPLAUSIBLE: f"check the labels, the field and its size; say {PICTURE}, if it was cropped or squashed",
    }
)


@dataclass(frozen=True)
class SuspectLabel:
    """A label that the rest of its frame contradicts.

    Examples
    --------
    >>> str(SuspectLabel("Goal left post left", "Goal left post right", 61.3))
    "'Goal left post left' lies 61 px off: 'Goal left post right' fits"
    """

    label: str
    """The label as given."""
    fits: str | None
    """The label whose segment is where the pixels are; None if there is none."""
    error_px: float
    """Root mean square distance of the pixels to the (infinite) line or circle of the given label: small if that runs
    through the pixels, but the segment itself is elsewhere on it."""

    def __post_init__(self) -> None:
        """Check what may come from a file.

        Raises
        ------
        ValueError
            If something is of a wrong type.
        """
        expect(self.label, str, '"Goal left post left"')
        expect(self.fits, (str, type(None)), '"Goal left post right"')
        number(self.error_px, "error_px")

    def __str__(self) -> str:
        fits = "no other label fits" if self.fits is None else f"{self.fits!r} fits"
        where = f"lies {self.error_px:.0f} px off" if self.error_px > BESIDE else "ends elsewhere on the same line"
        return f"{self.label!r} {where}: {fits}"


class NoCameraError(ValueError):
    """Error on using the camera of a calibration without one: it has the reason, and advice."""

    def __init__(self, status: Status, message: str) -> None:
        super().__init__(expect(status, Status, "Status.DEGENERATE"), message)
        self.status, self.reason, self.remedy = status, message, REMEDIES.get(status, "")

    def __str__(self) -> str:
        return f"there is no camera: {self.reason} ({self.status}). What would help: {self.remedy}"
