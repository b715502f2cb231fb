"""What a calibration returns: the camera, how well it fits, and whether it is to be believed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from dataclasses import field as attribute
from enum import StrEnum
from functools import cached_property
from html import escape
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._json import from_json, to_json
from fieldcalib._types import Array
from fieldcalib.assess.camera_errors import CameraErrors, GroundError, KnownErrors
from fieldcalib.assess.cut_labels import log_ratio_of_cut
from fieldcalib.assess.datum import MARKINGS_IN_VIEW, RelativeTo
from fieldcalib.assess.markings import MarkingInView, paint_complaints, paint_contradicts, paint_share
from fieldcalib.assess.observability import Direction
from fieldcalib.assess.probability import (
    Evidence,
    evidence,
    probability_by_covariance,
    probability_given_paint,
    probability_right,
)
from fieldcalib.assess.solved import Solved
from fieldcalib.assess.surprises import LEAST_ASPECT, surprises
from fieldcalib.assess.uncertainty import Uncertainty
from fieldcalib.assess.whole_picture import CUT, SHAPE, SQUASHED_LOG_ODDS, Declared, seems_part
from fieldcalib.fields.field import Field
from fieldcalib.fields.records import field_from_record, field_to_record
from fieldcalib.geometry.camera import Camera

ANGLE_NAMES = ("pan", "tilt", "roll")
VERSION = 1  # of `Calibration.to_dict`

BESIDE = 5.0  # px: pixels that are nearer to a line lie on it
LEAST_PROBABILITY = 0.5  # of being right to the field's tolerance: else a camera is more probably wrong


class Verdict(StrEnum):
    """What to do with a calibration."""

    GOOD = "good"
    """Use it."""
    CHECK = "check"
    """Plausible, but something speaks against it, or too little for it: look at the frame."""
    REJECT = "reject"
    """Do not use it."""


class Status(StrEnum):
    """How a calibration ended. The best camera is given whatever the status says."""

    ACCEPTED = "accepted"
    REJECTED = "rejected by tau"
    """The loss in NDC is above the threshold that the user set."""
    IMPROBABLE = "probably wrong"
    """The probability that the camera is right is below the one that the user asked for, its image shows no lines
    where it has the markings, or, of a frame that others tell, the field in view is not known to 1 m."""
    TOO_FEW_SEGMENTS = "too few segments"
    """The labels give fewer equations than there are unknowns; the rest comes from the prior."""
    DEGENERATE = "degenerate"
    """Enough equations, but they leave a direction of the parameters open."""
    NOT_CONVERGED = "not converged"
    IMPLAUSIBLE = "implausible"
    """The best fit is no camera that could stand there."""


REMEDIES: Mapping[Status, str] = MappingProxyType(
    {
        Status.REJECTED: "check the labels of the segments with the largest errors, or give a larger tau",
        Status.IMPROBABLE: "look at the overlay; label markings by hand, or give what is known of the camera",
        Status.TOO_FEW_SEGMENTS: "more markings in view, or labelled by hand; frames around it tell its camera where "
        "it is one of a clip",
        Status.DEGENERATE: "a marking elsewhere in view, or labelled by hand, that is not parallel to the others",
        Status.NOT_CONVERGED: "check the labels, or allow more iterations (criteria)",
        Status.IMPLAUSIBLE: "check the labels, the field and its size; say if the picture was cropped or squashed",
    }
)
OFF_PAINT = "look at the overlay (run --show-paint); give --field-length and --field-width with --field-size known"
NOT_WHOLE_FRAMES = frozenset([CUT, SHAPE])
NOT_WHOLE = (
    "say what the picture is of: --crop-of for a part of a frame (its own size with +0+0 if nothing is cut off), "
    "--aspect or --display-size for a squashed one"
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
    """As given."""
    fits: str | None
    """The label whose segment is where the pixels are; None if there is none."""
    error_px: float
    """Root mean square distance of the pixels to the (infinite) line or circle of the given label: small if that runs
    through the pixels, but the segment itself is elsewhere on it."""

    def __str__(self) -> str:
        """For messages."""
        fits = "no other label fits" if self.fits is None else f"{self.fits!r} fits"
        where = f"lies {self.error_px:.0f} px off" if self.error_px > BESIDE else "ends elsewhere on the same line"
        return f"{self.label!r} {where}: {fits}"


@dataclass(frozen=True, eq=False)
class Calibration:
    """Result of a calibration. Unpacks to the five values of `cv2.calibrateCamera` for one view.

    Two are equal if all that `to_dict` writes is.

    Examples
    --------
    >>> import numpy as np
    >>> from fieldcalib import Camera, calibrate_from_segments, soccer
    >>> truth = Camera.from_angles(0.2, 1.35, 0.01, 1400.0, (1.0, 65.0, -16.0), (960, 540))
    >>> labels = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top")
    >>> pixels = {label: truth.project(soccer()[label].sample(9.0)) for label in labels}
    >>> rms, K, dist, rvec, tvec = calibrate_from_segments(soccer(), pixels, (960, 540), prior=None)
    >>> round(float(K[0, 0]), 3)
    1400.0
    """

    camera: Camera | None
    """None where there is nothing to calibrate from, or a closed form finds none."""
    status: Status
    message: str
    """The status in a sentence: why, and what would help."""
    rms: float
    """Root mean square distance of the pixels to the segments that they were fitted to, pixels; those of suspect labels
    to the segments that fit."""
    loss_ndc: float
    """The paper's segment reprojection loss, which tau is compared with (`fieldcalib.assess.ndc`, "tvcalib")."""
    per_segment_errors: Mapping[str, float]
    """Root mean square distance in pixels for each label as it was given, in the order of the input."""
    suspect_labels: tuple[SuspectLabel, ...] = ()
    """Labels that the rest of the frame contradicts: they were replaced by the ones that fit, or left out."""
    alternatives: tuple[Camera, ...] = ()
    """Cameras that fit the labels as well: the one on the other side, turned by 180 degrees about the centre mark."""
    complaints: tuple[str, ...] = ()
    """What the labels as given say against an accepted camera."""
    pixel_counts: Mapping[str, int] = attribute(default_factory=dict, repr=False)
    """Number of pixels of each label as it was given."""
    field: Field | None = attribute(default=None, repr=False)
    """What was calibrated against; None if that was no `Field`."""
    solved: Solved | None = attribute(default=None, repr=False)
    """What `uncertainty` is computed from; None where there is no camera, or it came from a closed form."""
    errors: KnownErrors | None = attribute(default=None, repr=False)
    """How far the camera may be off, where it was estimated with other frames and what was solved is not kept."""
    markings: tuple[MarkingInView, ...] = attribute(default=(), repr=False)
    """What the image shows of each painted marking in view; empty where no image was looked at."""
    are_annotated: bool = attribute(default=False, repr=False)
    """Whether somebody labelled the pixels, who followed markings to the border of the picture: labels that are neither
    weighted nor trusted."""
    declared: Declared = attribute(default=Declared.NOTHING, repr=False)
    """What the user has said of the picture: it is not doubted."""

    @classmethod
    def without_camera(cls, status: Status, message: str) -> Calibration:
        """What is returned where there is no camera to give."""
        return cls(None, status, message, float("nan"), float("nan"), {})

    @property
    def rms_as_labelled(self) -> float:
        """Root mean square distance of all pixels to the segments of their labels as given, pixels.

        NaN where there is no pixel.
        """
        if not self.pixel_counts:
            return float("nan")
        squares = [count * self.per_segment_errors[label] ** 2 for label, count in self.pixel_counts.items()]
        return float(np.sqrt(sum(squares) / sum(self.pixel_counts.values())))

    def __bool__(self) -> bool:
        """Whether there is a camera to use: the verdict is good or check."""
        return self.verdict is not Verdict.REJECT

    @property
    def accepted(self) -> bool:
        """Whether the verdict is not reject."""
        return self.status is Status.ACCEPTED

    @property
    def verdict(self) -> Verdict:
        """What to do with the camera; `reason` says why.

        Good is what is accepted without `concerns`. The probability behind it is computed when it is first asked for.
        """
        if not self.accepted:
            return Verdict.REJECT
        return Verdict.CHECK if self.concerns else Verdict.GOOD

    @property
    def reason(self) -> str:
        """Why the verdict is as it is."""
        return "; ".join([*self.concerns, self.message]) if self.accepted else self.message

    @cached_property
    def concerns(self) -> tuple[str, ...]:
        """What speaks against an accepted camera, or why nothing speaks for it, most important first."""
        if self.camera is None:
            return ()
        if not self.knows_errors:
            return ("its errors are not known, as it does not come from labelled pixels",)
        doubts = []
        if self.has_probability:
            probability = self.probability(level=True)  # a camera that lies on the paint is right, whatever the ground
            if not probability >= LEAST_PROBABILITY:
                doubts.append(f"right to {self._tolerance:g} m with a probability of {probability:.2f}")
        unusual = () if self.solved is None else surprises(self._solved_uncertainty)
        if not doubts and self.solved is not None and self.has_probability:
            cut = self._log_ratio_of_cut + SQUASHED_LOG_ODDS * self._was_squashed
            known = self._probability_by_labels(self._tolerance, size_known=True)
            doubts.extend(seems_part(self._solved_uncertainty, known, cut, self.declared))
        return (*paint_complaints(self.markings), *doubts, *unusual, *self.complaints)

    @property
    def remedy(self) -> str:
        """What would help, in the user's terms; empty where nothing is known, or needed.

        Of a camera that is not accepted it goes with the status. Otherwise it goes with markings that lie off their
        paint, with a picture that may be no whole frame or, where the size of the field is not visible, with metres
        that are from the markings in view: where positions from the centre are known to more than half a metre.

        Examples
        --------
        >>> Calibration.without_camera(Status.TOO_FEW_SEGMENTS, "no labelled pixels").remedy
        'more markings in view, or labelled by hand; frames around it tell its camera where it is one of a clip'
        """
        if not self.accepted:
            return REMEDIES[self.status]
        if any(one.is_off for one in self.markings):
            return OFF_PAINT
        if not NOT_WHOLE_FRAMES.isdisjoint(self.concerns):
            return NOT_WHOLE
        return self.uncertainty.remedy if self.camera is not None and self.knows_errors else ""

    @property
    def _was_squashed(self) -> bool:
        """Whether the picture has other pixels than the frame with square ones that was solved."""
        assert self.camera is not None
        (a, b), (c, d) = np.diagonal(self.camera.K)[:2], np.diagonal(self._solved_uncertainty.camera.K)[:2]
        return bool(abs(np.log(a * d / (b * c))) > LEAST_ASPECT)

    @property
    def _log_ratio_of_cut(self) -> float:
        """Of labels by hand, `fieldcalib.assess.cut_labels`."""
        if not self.are_annotated or self.solved is None or self.field is None:
            return 0.0
        pixels, _ = self.solved.evaluation.problem.observations.without_ends.unpacked(self.solved.frame)
        return log_ratio_of_cut(self.field, pixels, self._solved_uncertainty.camera)

    @property
    def knows_errors(self) -> bool:
        """Whether `uncertainty` is known."""
        return self.solved is not None or self.errors is not None

    @property
    def has_probability(self) -> bool:
        """Whether `probability` is known: of a camera fitted to labels of a field with a probability model."""
        return self.knows_errors and self.field is not None and self.field.probability is not None

    @property
    def uncertainty(self) -> CameraErrors:
        """How far the camera may be off; computed when it is first asked for.

        It is an `Uncertainty`, and for frames of a sequence the covariance alone.

        Raises
        ------
        ValueError
            If the camera was not fitted to labelled pixels.
        """
        return self._solved_uncertainty if self.errors is None else self._known_errors

    @cached_property
    def _known_errors(self) -> KnownErrors:
        assert self.errors is not None
        return self.errors.on(self.field)

    @cached_property
    def _solved_uncertainty(self) -> Uncertainty:
        if self.errors is not None:
            raise ValueError("expected a calibration of a single frame: of a sequence only the covariance is kept")
        if self.solved is None:
            raise ValueError(f"expected a calibration from labelled pixels, this one knows no errors: {self.message}")
        return self.solved.uncertainty.on(self.field)

    @property
    def covariance(self) -> Array:
        """Covariance (n, n) of the parameters, see `fieldcalib.assess.uncertainty.Uncertainty.covariance`."""
        return self.uncertainty.covariance

    @property
    def std_deviations(self) -> tuple[Array, Array]:
        """Standard deviations of the intrinsics (18, 1) and extrinsics (6, 1), as cv2.calibrateCameraExtended's."""
        return self.uncertainty.std_deviations_intrinsics, self.uncertainty.std_deviations_extrinsics

    @property
    def observability(self) -> tuple[Direction, ...]:
        """What the labels determine and what came from the prior, least determined first."""
        return self._solved_uncertainty.observability

    def field_uncertainty(self, xy: ArrayLike, *, relative_to: RelativeTo = MARKINGS_IN_VIEW) -> GroundError:
        """Errors in metres of the ground points seen at pixels (..., 2).

        By default they are relative to the markings in view: where one end of a pitch of unknown length is seen, places
        from the "centre mark" on are known to half of that only.
        """
        return self.uncertainty.at_image(xy, relative_to=relative_to)

    def probability(self, metres: float | None = None, *, size_known: bool = False, level: bool = False) -> float:
        """Probability that the camera is right: no point of the field in view is off by more than some metres.

        That is meant relative to the markings in view, see `field_uncertainty`. By default it is the field's
        `tolerance`, 1 m on a soccer pitch. Fitted on synthetic frames of the field, see
        `fieldcalib.assess.probability`; of frames of a sequence it follows from their covariance. NaN where no part of
        the field is in view or the camera does not come from labelled pixels, 0 where there is no camera or it is
        implausible: of 22 such ones on synthetic frames none was right. With `size_known` it is that if the field had
        just the given size: where it has another one, the camera may fit its image well and be wrong in metres. With
        `level` it is that if the ground were flat; otherwise it may be higher in the middle than at the touchlines
        (`fieldcalib.fields.crown`), where cameras of a flat one fit their image too. Of a single picture it also rests
        on the share of its markings where paint is seen.

        Raises
        ------
        ValueError
            If the object is no `Field`, or one without a probability model, or `metres` is not positive.

        Examples
        --------
        >>> from fieldcalib import Camera, calibrate_from_segments, soccer
        >>> truth = Camera.from_angles(0.2, 1.35, 0.01, 1400.0, (1.0, 65.0, -16.0), (960, 540))
        >>> labels = ("Side line top", "Side line right", "Big rect. right main", "Circle right")
        >>> pixels = {label: truth.project(soccer()[label].sample(9.0)) for label in labels}
        >>> calibration = calibrate_from_segments(soccer(), pixels, (960, 540))
        >>> calibration.probability(0.1) < 0.5 < calibration.probability(2.0)
        True
        """
        if metres is not None and not metres > 0.0:
            raise ValueError(f"metres must be positive, got {metres}")
        if self.camera is None:
            return 0.0
        if not self.knows_errors:
            return float("nan")
        if self.field is None:
            raise ValueError("expected a calibration of a Field: how much of another object is in view is not known")
        if self.field.probability is None:
            raise ValueError(
                "expected a calibration of a Field with a probability model, as soccer(): for this none was fitted, "
                "but its expected errors are in `uncertainty`"
            )
        if self.status is Status.IMPLAUSIBLE:
            return 0.0
        metres = self._tolerance if metres is None else metres
        if self.errors is not None:
            errors = self._known_errors.if_level if level else self._known_errors
            return probability_by_covariance(errors, self.field, metres)
        by_labels = self._probability_by_labels(metres, size_known=size_known, level=level)
        return probability_given_paint(by_labels, paint_share(self.markings)) if self.markings else by_labels

    def _probability_by_labels(self, metres: float, *, size_known: bool = False, level: bool = False) -> float:
        """`probability` of a single frame, whatever its image shows of the markings."""
        assert self.field is not None
        assert self.field.probability is not None
        if self.status is Status.IMPLAUSIBLE:
            return 0.0
        rows, weights = self._evidence[level or size_known]
        if size_known:
            rows, weights = rows[:1], np.ones(1)
        return probability_right(self.field.probability, rows, weights, metres) / (1 + len(self.alternatives))

    def doubted(self, least: float, metres: float | None = None, *, size_known: bool = False) -> Calibration:
        """The same, with the verdict that it is probably wrong if its `probability` is below `least`.

        What has no camera with an uncertainty, or was rejected already, stays as it is.

        Raises
        ------
        ValueError
            As `probability`.

        Examples
        --------
        >>> nothing = Calibration.without_camera(Status.TOO_FEW_SEGMENTS, "no labelled pixels")
        >>> nothing.doubted(0.5) is nothing
        True
        """
        if not self.knows_errors or self.status is Status.REJECTED:
            return self
        probability = self.probability(metres, size_known=size_known)
        if probability >= least:
            return self
        metres = self._tolerance if metres is None else metres
        doubt = f"right to {metres:g} m with a probability of {probability:.2f}, below {least:g}"
        return replace(self, status=Status.IMPROBABLE, message=f"{doubt}; {self.message}")

    def seen_in_image(self, markings: Sequence[MarkingInView]) -> Calibration:
        """Add what its image shows of the markings in view.

        A camera that was accepted is "probably wrong" if more of the paint lies beside its markings than on them.

        Examples
        --------
        >>> from fieldcalib import calibrate_from_homography
        >>> found = calibrate_from_homography([[8.0, 2, 480], [0, 3, 270], [0, 0.004, 1]], (960, 540))
        >>> found.seen_in_image([MarkingInView("Middle line", 300.0, 25, share=0.1, offset=21.4)]).message
        "most of the paint lies beside the markings: 'Middle line' lies 21 px beside its paint"
        """
        seen = replace(self, markings=tuple(markings))
        if not self.accepted or not paint_contradicts(markings):
            return seen
        reason = "; ".join(paint_complaints(markings))
        return replace(seen, status=Status.IMPROBABLE, message=f"most of the paint lies beside the markings: {reason}")

    @property
    def _tolerance(self) -> float:
        """Metres to which a camera of this field is right or wrong."""
        assert self.field is not None
        return self.field.tolerance

    @cached_property
    def _evidence(self) -> tuple[Evidence, Evidence]:
        """On any and on level ground."""
        assert self.field is not None
        (found,) = evidence([self._solved_uncertainty], self.field)
        return found

    @property
    def has_errors(self) -> bool:
        """Whether the errors were computed already."""
        return self.solved is None or "uncertainty" in vars(self.solved)

    def keep_uncertainty(self, uncertainty: Uncertainty) -> None:
        """Keep what was computed with that of other calibrations, see `fieldcalib.assess.compute_errors`."""
        assert self.solved is not None
        self.solved.uncertainty = uncertainty

    def keep_evidence(self, found: tuple[Evidence, Evidence]) -> None:
        """Keep what the probability rests on, on any and on level ground, see `fieldcalib.assess.compute_errors`."""
        vars(self)["_evidence"] = found

    def __iter__(self) -> Iterator[Any]:
        """``rms, K (3, 3), dist (1, 5), rvec (3, 1), tvec (3, 1)``, as `cv2.calibrateCamera` returns them.

        Raises
        ------
        ValueError
            If there is no camera.
        """
        if self.camera is None:
            raise ValueError(f"there is no camera to unpack: {self.message}")
        rvec, tvec, K, dist = self.camera.to_opencv()
        yield from (self.rms, K, dist, rvec, tvec)

    def to_dict(self) -> dict[str, Any]:
        """Everything as a dict for `json.dumps`, from which `from_dict` makes the calibration again.

        Keys are those of ``cameras.jsonl``, see ``docs/files.md``. The size model of a field is kept if this package
        builds the field, as `soccer`; a function of somebody else has no place in JSON. Numbers that are not finite
        are null (NaN), "inf" and "-inf"; an `rms` and a `loss_ndc` that are NaN are left out.

        Examples
        --------
        >>> import json
        >>> nothing = Calibration.without_camera(Status.TOO_FEW_SEGMENTS, "no labelled pixels")
        >>> Calibration.from_dict(json.loads(json.dumps(nothing.to_dict()))) == nothing
        True
        """
        return {
            "status": str(self.status),
            "message": self.message,
            **(_camera_to_record(self.camera) if self.camera is not None else {}),
            **({} if np.isnan(self.rms) else {"rms_px": to_json(self.rms)}),
            "segment_errors_px": {label: to_json(error) for label, error in self.per_segment_errors.items()},
            "suspect_labels": [{**asdict(one), "error_px": to_json(one.error_px)} for one in self.suspect_labels],
            **({} if np.isnan(self.loss_ndc) else {"loss_ndc": to_json(self.loss_ndc)}),
            "alternatives": [_camera_to_record(other) for other in self.alternatives],
            "complaints": list(self.complaints),
            "pixel_counts": dict(self.pixel_counts),
            "image_size": None if self.camera is None else list(self.camera.image_size),
            "field": None if self.field is None else field_to_record(self.field),
            "solved": None if self.solved is None else self.solved.to_dict(),
            **({} if self.errors is None else {"errors": self.errors.to_dict()}),
            **({} if not self.markings else {"markings": [asdict(one) for one in self.markings]}),
            **({} if not self.are_annotated else {"are_annotated": True}),
            **({} if self.declared == Declared.NOTHING else {"declared": str(self.declared)}),
            "version": VERSION,
        }

    @classmethod
    def from_dict(cls, record: Mapping[str, Any]) -> Calibration:
        """The calibration of a dict that `to_dict` made; keys that it does not know are passed over.

        Raises
        ------
        ValueError
            If the version is another one, a key is missing, or a value cannot be right.
        """
        version = record.get("version")
        if version != VERSION:
            raise ValueError(
                f"expected a calibration of version {VERSION}, got {version!r}: another fieldcalib wrote it, "
                f"use that or calibrate again"
            )
        try:
            size = record["image_size"]
            return cls(
                None if size is None else _camera_from_record(record, size),
                Status(record["status"]),
                record["message"],
                float(from_json(record.get("rms_px"))),
                float(from_json(record.get("loss_ndc"))),
                {label: float(from_json(error)) for label, error in record["segment_errors_px"].items()},
                tuple(
                    SuspectLabel(one["label"], one["fits"], float(from_json(one["error_px"])))
                    for one in record["suspect_labels"]
                ),
                tuple(_camera_from_record(other, size) for other in record["alternatives"]),
                tuple(record["complaints"]),
                dict(record["pixel_counts"]),
                None if record["field"] is None else field_from_record(record["field"]),
                None if record["solved"] is None else Solved.from_dict(record["solved"]),
                KnownErrors.from_dict(record["errors"]) if "errors" in record else None,
                tuple(MarkingInView(**one) for one in record.get("markings", ())),
                bool(record.get("are_annotated", False)),
                Declared(record.get("declared", Declared.NOTHING)),
            )
        except KeyError as error:
            raise ValueError(f"is no calibration: the key {error} is missing") from None
        except (TypeError, AttributeError, ValueError) as error:
            raise ValueError(f"is no calibration: {error}") from error

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Calibration):
            return NotImplemented
        return self is other or self.to_dict() == other.to_dict()

    def __reduce__(self) -> tuple[type[Calibration], tuple[Any, ...]]:
        return Calibration, tuple(getattr(self, one.name) for one in fields(self))  # without what follows from these

    def _repr_html_(self) -> str:
        """A table for notebooks."""
        rows = {"verdict": str(self.verdict), "reason": self.reason, "status": str(self.status)}
        if self.camera is not None:
            camera, degree = self.camera, "\N{DEGREE SIGN}"
            rows |= {
                "focal length": f"{camera.focal_length:.1f} px",
                "pan, tilt, roll": ", ".join(f"{angle:.2f}{degree}" for angle in np.degrees(camera.angles)),
                "position": ", ".join(f"{x:.2f}" for x in camera.C) + " m",
                "image size": "{} x {}".format(*camera.image_size),
                "rms": f"{self.rms:.2f} px",
            }
        if self.has_probability:
            rows[f"right to {self._tolerance:g} m"] = f"{self.probability():.2f}"
        cells = (f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in rows.items())
        return f"<table>{''.join(cells)}</table>"


def _camera_to_record(camera: Camera) -> dict[str, Any]:
    return {
        "K": to_json(camera.K),
        "dist": to_json(camera.dist[0]),
        "R": to_json(camera.R),
        "C": to_json(camera.C),
        "angles_degrees": dict(zip(ANGLE_NAMES, np.degrees(camera.angles).tolist(), strict=True)),
    }


def _camera_from_record(record: Mapping[str, Any], image_size: tuple[int, int]) -> Camera:
    return Camera(record["K"], record["R"], record["C"], image_size, record["dist"])
