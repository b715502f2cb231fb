"""The result of a calibration: the camera, its fit, and a verdict on it.

Calibrations as dicts for JSON: the keys of ``cameras.jsonl`` and ``solver.jsonl`` (``docs/reference/files.md``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from dataclasses import field as attribute
from functools import cached_property
from reprlib import repr as short
from textwrap import shorten
from typing import Any
from warnings import warn

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._html import table
from fieldcalib._json import from_json, reading, to_json
from fieldcalib._types import Array, ReadOnlyDict, expect, number, positive, truth, whole_number
from fieldcalib.assess.advice import (
    IF_ON_PAINT,
    MENDED_LABELS,
    MORE_LABELS,
    NOTHING,
    Advice,
    NoCameraError,
    Remedy,
    remedy_of,
)
from fieldcalib.assess.camera_errors import CameraErrors, KnownErrors, NoErrors, Picture, Solved
from fieldcalib.assess.estimate import MARKINGS_IN_VIEW, Estimate, GroundError, RelativeTo
from fieldcalib.assess.findings import Finding, Status, SuspectLabel, Verdict, What, findings_from_json, in_words
from fieldcalib.assess.observability import Direction
from fieldcalib.assess.paint_in_view import MarkingInView, checked_markings, contradiction, paint_findings, paint_share
from fieldcalib.assess.probability import errors_given_paint, probability_given_paint
from fieldcalib.fields.field import Field, terrain_of
from fieldcalib.fields.records import field_from_record, field_to_record
from fieldcalib.geometry.camera import CAMERA_TITLES, Camera, camera_cells
from fieldcalib.problem.picture_shape import SURE, Declared, Placement

VERSION = 1

MOST_LETTERS = 60  # of the reason in a line of a console
LEAST_PROBABILITY = 0.5  # of being right to the field's tolerance: below it the camera is more probably wrong


@dataclass(frozen=True, eq=False, repr=False)
class Calibration:
    """Result of a calibration. Unpacks to the five values of `cv2.calibrateCamera` for one view.

    Failures are values too: a rejected calibration is false. Without a camera `camera` is None, and all that needs one
    (unpacking, `required_camera`, `K`, `project`, `image_to_field`, and the errors from `uncertainty` on) raises a
    `NoCameraError` with the reason and a remedy.

    Two calibrations are equal if their `to_dict` are equal.

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
    >>> calibrate_from_segments(soccer(), {}, (960, 540)).K  # doctest: +ELLIPSIS
    Traceback (most recent call last):
        ...
    fieldcalib.assess.advice.NoCameraError: there is no camera: no labelled pixels: nothing to calibrate from ...
    """

    camera: Camera | None
    """None if there is nothing to calibrate from, or a closed form has no solution."""
    status: Status
    message: str
    """The reason for the status and, if known, advice, in a sentence."""
    rms: float
    """Root mean square distance of the pixels to the segments that they were fitted to, pixels; for suspect labels
    these are the segments that fit them."""
    _loss: float | Callable[[], float]
    """`loss_ndc`, or the function that computes it, which takes a tenth of the time of a single frame."""
    per_segment_errors: Mapping[str, float]
    """Root mean square distance in pixels for each given label, in the order of the input; read-only."""
    suspect_labels: tuple[SuspectLabel, ...] = ()
    """Labels that the rest of the frame contradicts: they were replaced by labels that fit, or left out."""
    alternatives: tuple[Camera, ...] = ()
    """Cameras that are as good: the one turned by 180 degrees about the centre mark, where nothing tells on which side
    of the field the camera is (`fieldcalib.fields.field`)."""
    _found: tuple[Finding, ...] = attribute(default=())
    """Findings that do not follow from the other attributes, see `findings`."""
    pixel_counts: Mapping[str, int] = attribute(default_factory=dict)
    """Number of pixels of each given label; read-only."""
    field: Field | None = attribute(default=None)
    """The field that was calibrated against; None if the object is not a `Field`."""
    errors: CameraErrors = attribute(default_factory=NoErrors)
    """Errors of the camera: `Solved` for a frame by itself, `KnownErrors` for a frame of a sequence, `NoErrors` for a
    homography or without a camera."""
    markings: tuple[MarkingInView, ...] = attribute(default=())
    """Paint that the image shows of each marking in view; empty if no image was examined."""
    are_annotated: bool = attribute(default=False)
    """Whether a person labelled the pixels, following markings to the border of the picture: true for labels that are
    neither weighted nor trusted."""
    declared: Declared = attribute(default=Declared.NOTHING)
    """Statements of the user about the picture, which are not doubted."""

    def __post_init__(self) -> None:
        for name in ("per_segment_errors", "pixel_counts"):
            object.__setattr__(self, name, ReadOnlyDict(expect(getattr(self, name), Mapping, "{label: number}")))

    @classmethod
    def without_camera(cls, status: Status, message: str, *findings: Finding) -> Calibration:
        """A calibration that found no camera."""
        return cls(None, status, message, float("nan"), float("nan"), {}, _found=findings)

    @property
    def required_camera(self) -> Camera:
        """The camera.

        Raises
        ------
        NoCameraError
            If there is none. All methods below that need a camera raise it too.
        """
        if self.camera is None:
            raise NoCameraError(self.status, self.message)
        return self.camera

    @property
    def K(self) -> Array:
        """Intrinsic matrix (3, 3) of the camera."""
        return self.required_camera.K

    def project(self, X: ArrayLike) -> Array:
        """Pixels (..., 2) of world points (..., 3), as `Camera.project`."""
        return self.required_camera.project(X)

    def image_to_field(self, xy: ArrayLike) -> Array:
        """Ground points (..., 3) seen at pixels (..., 2), as `Camera.image_to_field`.

        Warns
        -----
        UserWarning
            If `xy` is a single pixel and no ground is seen there; in arrays such points are NaN.
        """
        X = self.required_camera.image_to_field(xy, terrain=terrain_of(self.field))
        if X.ndim == 1 and np.isnan(X[0]):
            warn(f"no ground is seen at pixel {short(xy)}: it is above the horizon, or beyond the lens", stacklevel=2)
        return X

    @cached_property
    def loss_ndc(self) -> float:
        """The paper's segment reprojection loss, which is compared with tau (`fieldcalib.assess.ndc`, "tvcalib").

        NaN for frames of a sequence.
        """
        return float(self._loss() if callable(self._loss) else self._loss)

    @property
    def solved(self) -> Solved | None:
        """The problem of a frame that was solved by itself; None for other frames."""
        return self.errors if isinstance(self.errors, Solved) else None

    @property
    def rms_as_labelled(self) -> float:
        """Root mean square distance of all pixels to the segments of their given labels, pixels.

        NaN without pixels.
        """
        if not self.pixel_counts:
            return float("nan")
        with np.errstate(over="ignore"):  # infinite errors are possible too
            squares = [count * np.square(self.per_segment_errors[label]) for label, count in self.pixel_counts.items()]
            return float(np.sqrt(sum(squares) / sum(self.pixel_counts.values())))

    def __bool__(self) -> bool:
        """Whether there is a camera to use: the verdict is good or check."""
        return self.accepted

    @property
    def accepted(self) -> bool:
        """Whether the status is "accepted": the verdict is then good or check."""
        return self.status is Status.ACCEPTED

    @property
    def verdict(self) -> Verdict:
        """The verdict on the camera; `reason` says why.

        An accepted camera without evidence against it is good. The probability that this depends on is computed when
        first used.
        """
        if not self.accepted:
            return Verdict.REJECT
        return Verdict.CHECK if self._against else Verdict.GOOD

    @property
    def reason(self) -> str:
        """Reason for the verdict: what speaks against the camera, the most important first, suspect labels, `message`.

        The message of a camera that is not accepted is the reason itself, and comes first.
        """
        message, suspects = Finding(What.SAID, self.message), {one.label for one in self.suspect_labels}
        if not self.accepted:
            return in_words(message, *self.suspect_labels)
        of_suspects = {(What.SUSPECTS, ""), *((What.STRAY, label) for label in suspects)} if suspects else ()
        against = (one for one in self._against if (one.what, one.about) not in of_suspects)
        return in_words(*against, *self.suspect_labels, message)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What is known of the camera beside its numbers: what speaks against it, the most important first, then notes.

        Each says what it is (`What`), and which marking and numbers it is about; its sentence is in `reason`.
        """
        return (*self._against, *(one for one in self._found if not one.what.is_against))

    def has_finding(self, *what: What) -> bool:
        """Whether one of some findings was made.

        Examples
        --------
        >>> Calibration.without_camera(Status.IMPROBABLE, "", Finding(What.SEARCHED)).has_finding(What.SEARCHED)
        True
        """
        return any(one.what in what for one in self.findings)

    @cached_property
    def _against(self) -> tuple[Finding, ...]:
        """Evidence against a camera, most important first."""
        against = tuple(one for one in self._found if one.what.is_against)
        if self.camera is None or any(one.what.explains_all for one in against):
            return against
        if not self.errors.are_known:
            return self.errors.doubts(None)
        improbable, picture = list[Finding](), None
        if self.field is not None and self.has_probability:
            tolerance = self.field.tolerance
            probability = float(np.nan_to_num(self.probability()))  # NaN where no part of the field is in view
            least = self._least_in_picture
            if not probability >= (LEAST_PROBABILITY if least is None else least):
                improbable.append(Finding(What.IMPROBABLE, numbers=(tolerance, probability)))
                solved = None if self.solved is None else self.solved.uncertainty
                if solved is not None and solved.told_crown and not solved.off_given:  # a wrong value bends lines too
                    improbable.append(Finding(What.NOT_LEVEL, numbers=(solved.told_crown,)))
            elif self.solved is not None:
                known = self._probability_by_labels(self.field, tolerance, size_known=True)
                sure = SURE if least is None else least
                picture = Picture(self.camera, self.field, known, self.declared, self.are_annotated, sure)
        return (*paint_findings(self.markings), *improbable, *self.errors.doubts(picture), *against)

    @property
    def _least_in_picture(self) -> float | None:
        """Least probability of a good camera that was found in a picture alone; None if it is that of labels."""
        in_picture = bool(self.markings) and self.solved is not None and not self.are_annotated
        model = None if self.field is None else self.field.probability
        return model.least_in_picture if in_picture and model is not None else None

    @property
    def remedy(self) -> str:
        """Advice in plain words; empty where none is known, or needed; see `advice`.

        For a rejected camera it follows from the status. For an accepted one it concerns markings that lie off their
        paint, suspect labels, a picture that may be a part of a frame, a view of which only the ground is known, or a
        field whose size is not visible, so that positions relative to the centre mark are not known to half a metre;
        what else is "check" is to be looked at, or needs more labels.

        Examples
        --------
        >>> Calibration.without_camera(Status.TOO_FEW_SEGMENTS, "no labelled pixels").remedy
        'more markings in view, or labelled by hand'
        """
        return self._remedy.text

    @property
    def advice(self) -> tuple[Advice, ...]:
        """What the `remedy` asks for: ``fieldcalib.assess.how(calibration.advice)`` says by which arguments."""
        return self._remedy.advice

    @property
    def _remedy(self) -> Remedy:
        found = remedy_of(self.status, self.findings, self.field, are_annotated=self.are_annotated)
        wrong = dict.fromkeys(one.label for one in self.suspect_labels)
        wrong |= dict.fromkeys(
            one.about for one in self.findings if one.what in (What.STRAY, What.MISSED, What.OUTSIDE) and one.about
        )
        if found == MENDED_LABELS and wrong:
            return Remedy(f"correct {', '.join(map(repr, wrong))}, or leave {'it' if len(wrong) == 1 else 'them'} out")
        if found is not NOTHING or not self.accepted:
            return found
        said = self.uncertainty.remedy if self.camera is not None and self.knows_errors else ""
        if said and not self.has_finding(What.IMPROBABLE):
            return Remedy(said, (Advice.FIELD_SIZE,))
        if self.verdict is Verdict.GOOD:
            return NOTHING
        return MORE_LABELS if self.are_annotated else IF_ON_PAINT

    @property
    def knows_errors(self) -> bool:
        """Whether `uncertainty` is known."""
        return self.errors.are_known

    @property
    def has_probability(self) -> bool:
        """Whether `probability` is known: the camera was fitted to labels of a field with a probability model."""
        return self.knows_errors and self.field is not None and self.field.probability is not None

    @cached_property
    def uncertainty(self) -> Estimate:
        """The estimated camera with its errors, which are computed when first used.

        It is an `Uncertainty` for a frame by itself, `KnownErrors` (the covariance alone) for a frame of a sequence.
        Where the markings of an image show less paint than usual, its errors are larger than the labels say, as the
        probability is lower (`fieldcalib.assess.probability.errors_given_paint`).

        Raises
        ------
        ValueError
            If the camera was not fitted to labelled pixels.
        """
        if self.camera is None:
            raise NoCameraError(self.status, self.message)
        model = None if self.field is None else self.field.probability
        if self.solved is None or not self.markings or model is None:
            return self.errors.on(self.field)
        return self.solved.on(self.field).widened(errors_given_paint(model, paint_share(self.markings)))

    @property
    def covariance(self) -> Array:
        """Covariance (n, n) of the parameters, see `fieldcalib.assess.estimate.Estimate.covariance`."""
        return self.uncertainty.covariance

    @property
    def std_deviations(self) -> tuple[Array, Array]:
        """Standard deviations of intrinsics (18, 1) and extrinsics (6, 1), as from cv2.calibrateCameraExtended."""
        return self.uncertainty.std_deviations_intrinsics, self.uncertainty.std_deviations_extrinsics

    @property
    def observability(self) -> tuple[Direction, ...]:
        """Directions of the parameters with the share that comes from the labels, least determined first.

        Raises
        ------
        ValueError
            If only the covariance is known, as for frames of a sequence.
        """
        return self.uncertainty.observability

    def field_uncertainty(self, xy: ArrayLike, *, relative_to: RelativeTo = MARKINGS_IN_VIEW) -> GroundError:
        """Errors in metres of the ground points seen at pixels (..., 2).

        By default they are relative to the markings in view. Where one end of a pitch of unknown length is seen, errors
        relative to the "centre mark" contain half of the error of that length.
        """
        return self.uncertainty.at_image(xy, relative_to=relative_to)

    def probability(self, metres: float | None = None, *, size_known: bool = False) -> float:
        """Probability that the camera is right: no point of the field in view is off by more than `metres`.

        Positions are relative to the markings in view, see `field_uncertainty`, and to the side of the field where
        that is open: then the camera that is turned by 180 degrees is in `alternatives`. For a single frame the
        probability comes from a model that was fitted to synthetic frames of the field
        (`fieldcalib.assess.probability`) and, if its image was examined, from the share of the markings that show
        paint; for a frame of a sequence it follows from the covariance. It is NaN where no part of the field is in view
        or the camera does not come from labelled pixels, and 0 where there is no camera or an implausible one: of 22
        implausible ones on synthetic frames none was right.

        Parameters
        ----------
        metres : float, optional
            By default the field's `tolerance`, 1 m on a soccer pitch.
        size_known : bool
            Whether to assume that the field has the given size, on its given ground. If it has another one, a camera
            may fit its image well and be wrong in metres.

        Raises
        ------
        ValueError
            If the object is not a `Field` with a probability model, or `metres` is not positive.

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
        metres = None if metres is None else float(positive(metres, "metres"))
        size_known = truth(size_known, "size_known")
        if self.camera is None or not self.knows_errors:
            return 0.0 if self.camera is None else float("nan")
        if self.field is None:
            raise ValueError("expected a calibration of a Field: how much of another object is in view is not known")
        if self.field.probability is None:
            raise ValueError(
                "expected a calibration of a Field with a probability model, as soccer(): for this none was fitted, "
                "but its expected errors are in `uncertainty`"
            )
        metres = self.field.tolerance if metres is None else metres
        by_labels = self._probability_by_labels(self.field, metres, size_known=size_known)
        if self.solved is None or not self.markings:
            return by_labels
        return probability_given_paint(by_labels, paint_share(self.markings))

    def _probability_by_labels(self, field: Field, metres: float, *, size_known: bool = False) -> float:
        """`probability` without the evidence of the image."""
        if self.status is Status.IMPLAUSIBLE:
            return 0.0
        probability = self.errors.probability(field, metres, size_known=size_known)
        is_open = any(one.what is What.OTHER_SIDE for one in self._found)
        return probability / (1 + is_open)  # the turned camera fits as well

    def seen_in_image(self, markings: Sequence[MarkingInView]) -> Calibration:
        """Add the paint that the image shows of the markings in view.

        An accepted camera becomes "probably wrong" if more of the paint lies beside its markings than on them.

        Examples
        --------
        >>> from fieldcalib import calibrate_from_homography
        >>> found = calibrate_from_homography([[8.0, 2, 480], [0, 3, 270], [0, 0.004, 1]], (960, 540))
        >>> found.seen_in_image([MarkingInView("Middle line", 300.0, 25, share=0.1, offset=21.4)]).message
        "most of the paint lies beside the markings: 'Middle line' lies 21 px beside its paint"
        """
        seen = replace(self, markings=checked_markings(markings))
        reason = contradiction(markings)
        return replace(seen, status=Status.IMPROBABLE, message=reason) if self.accepted and reason else seen

    def __repr__(self) -> str:
        if self.camera is None:
            return f"Calibration({self.verdict}, no camera: {shorten(self.message, MOST_LETTERS)})"
        x, y, z = self.camera.C
        f = f"f={self.camera.focal_length:.0f} px, C=({x:.1f}, {y:.1f}, {z:.1f}) m"
        rms = "" if np.isnan(self.rms) else f", rms {self.rms:.2f} px"  # of a keyframe's camera in a clip
        return f"Calibration({self.verdict}, {f}{rms})"

    def __iter__(self) -> Iterator[Any]:
        """``rms, K (3, 3), dist (1, 5), rvec (3, 1), tvec (3, 1)``, as `cv2.calibrateCamera` returns them."""
        rvec, tvec, K, dist = self.required_camera.to_opencv()
        yield from (self.rms, K, dist, rvec, tvec)

    def to_dict(self) -> dict[str, Any]:
        """The calibration as a dict for `json.dumps`; the inverse is `from_dict`.

        Keys are those of ``cameras.jsonl``, see ``docs/reference/files.md``. The size model of a field is kept if this
        package builds the field, as `soccer`; a user's function cannot be written to JSON. Numbers that are not finite
        are null (NaN), "inf" and "-inf"; an `rms` or a `loss_ndc` of NaN is left out.

        Examples
        --------
        >>> import json
        >>> nothing = Calibration.without_camera(Status.TOO_FEW_SEGMENTS, "no labelled pixels")
        >>> Calibration.from_dict(json.loads(json.dumps(nothing.to_dict()))) == nothing
        True
        """
        camera, field = self.camera, self.field
        errors, suspects = self.per_segment_errors, self.suspect_labels
        return {
            "status": str(self.status),
            "message": self.message,
            **({} if camera is None else _without_size(camera)),
            **({} if np.isnan(self.rms) else {"rms_px": to_json(self.rms)}),
            "segment_errors_px": {label: to_json(error) for label, error in errors.items()},
            "suspect_labels": [{**asdict(one), "error_px": to_json(one.error_px)} for one in suspects],
            **({} if np.isnan(self.loss_ndc) else {"loss_ndc": to_json(self.loss_ndc)}),
            "alternatives": [_without_size(other) for other in self.alternatives],
            "found": [one.to_dict() for one in self._found],
            "pixel_counts": dict(self.pixel_counts),
            "image_size": None if camera is None else list(camera.image_size),
            "field": None if field is None else field_to_record(field),
            **self.errors.to_record(),
            **({} if not self.markings else {"markings": [asdict(one) for one in self.markings]}),
            **({} if not self.are_annotated else {"are_annotated": True}),
            **({} if self.declared == Declared.NOTHING else {"declared": str(self.declared)}),
            "version": VERSION,
        }

    @classmethod
    def from_dict(cls, record: Mapping[str, Any]) -> Calibration:
        """The calibration of a dict of `to_dict`; unknown keys are ignored.

        Raises
        ------
        ValueError
            If the version is another one, a key is missing, or a value is invalid.
        """
        with reading(record, "calibration", VERSION):
            size = record["image_size"]
            field = None if record["field"] is None else field_from_record(record["field"])
            said = record["suspect_labels"]
            suspects = [SuspectLabel(one["label"], one["fits"], float(from_json(one["error_px"]))) for one in said]
            return cls(
                camera=None if size is None else Camera.from_dict(record),
                status=Status(record["status"]),
                message=expect(record["message"], str, '"rms 1.00 px over 5 segments"'),
                rms=float(from_json(record.get("rms_px"))),
                _loss=float(from_json(record.get("loss_ndc"))),
                per_segment_errors={label: float(from_json(px)) for label, px in record["segment_errors_px"].items()},
                suspect_labels=tuple(suspects),
                alternatives=tuple(Camera.from_dict({**other, "image_size": size}) for other in record["alternatives"]),
                _found=findings_from_json(record["found"] if "found" in record else record["complaints"]),
                pixel_counts=_pixel_counts_from_record(record),
                field=field,
                errors=_errors_from_record(record, field),
                markings=tuple(MarkingInView(**one) for one in record.get("markings", ())),
                are_annotated=bool(record.get("are_annotated", False)),
                declared=Declared(record.get("declared", Declared.NOTHING)),
            )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Calibration):
            return NotImplemented
        return self is other or self.to_dict() == other.to_dict()

    def __reduce__(self) -> tuple[type[Calibration], tuple[Any, ...]]:
        known = replace(self, _loss=self.loss_ndc)  # a number, which can be pickled
        return Calibration, tuple(getattr(known, one.name) for one in fields(known))  # without cached values

    def _repr_html_(self) -> str:
        """The field with what the camera sees of it, and a table, for notebooks."""
        rows = {"verdict": str(self.verdict), "reason": self.reason, "status": str(self.status)}
        if self.camera is not None:
            camera = self.camera
            rows |= dict(zip(CAMERA_TITLES, camera_cells(camera), strict=True))
            rows |= {
                "image size": "{} x {}".format(*camera.image_size),
                "rms": "unknown" if np.isnan(self.rms) else f"{self.rms:.2f} px",
            }
        if self.field is not None and self.has_probability:
            up_to = ", if the side is right" * bool(self.alternatives)
            rows[f"right to {self.field.tolerance:g} m"] = f"{self.probability():.2f}{up_to}"
        picture = "" if self.field is None or self.camera is None else self.field.as_svg([self.camera])
        return picture + table(rows)


def doubted(
    calibration: Calibration, least: float, metres: float | None = None, *, size_known: bool = False
) -> Calibration:
    """The calibration, with the status "probably wrong" if its `probability` is below `least`.

    A calibration without known errors, or one that is rejected already, is returned unchanged.

    Raises
    ------
    ValueError
        As in `Calibration.probability`.

    Examples
    --------
    >>> nothing = Calibration.without_camera(Status.TOO_FEW_SEGMENTS, "no labelled pixels")
    >>> doubted(nothing, 0.5) is nothing
    True
    """
    number(least, "least")
    if not calibration.knows_errors or calibration.status is Status.REJECTED:
        return calibration
    probability = calibration.probability(metres, size_known=size_known)
    if probability >= least or calibration.field is None:
        return calibration
    metres = calibration.field.tolerance if metres is None else metres
    doubt = f"right to {metres:g} m with a probability of {probability:.2f}, below {least:g}"
    return replace(calibration, status=Status.IMPROBABLE, message=f"{doubt}; {calibration.message}")


def found_of(calibration: Calibration) -> tuple[Finding, ...]:
    """What labels and frames around it say of a camera, and where it comes from; `with_findings` adds to it."""
    return calibration._found


def with_findings(calibration: Calibration, *findings: Finding) -> Calibration:
    """The calibration with further findings."""
    return replace(calibration, _found=(*calibration._found, *findings))


def in_picture(calibration: Calibration, placement: Placement, *findings: Finding) -> Calibration:
    """The calibration of a frame, with its cameras in pixels of a picture and with findings on how this lies in it.

    Its errors stay those of the frame.
    """
    if calibration.camera is None or (placement.is_whole and not findings):
        return calibration
    camera, *others = map(placement.camera_in_picture, (calibration.camera, *calibration.alternatives))
    said = (calibration.message, placement.borders, *(str(one) for one in findings if not one.what.is_against))
    message = "; ".join(filter(None, said))
    return with_findings(replace(calibration, camera=camera, alternatives=tuple(others), message=message), *findings)


def _without_size(camera: Camera) -> dict[str, Any]:
    return {key: value for key, value in camera.to_dict().items() if key != "image_size"}


def _pixel_counts_from_record(record: Mapping[str, Any]) -> dict[str, int]:
    counts = {
        label: whole_number(count, f"the count of {label!r}", 1) for label, count in record["pixel_counts"].items()
    }
    if not counts.keys() <= record["segment_errors_px"].keys():
        raise ValueError("expected 'segment_errors_px' of all labels of 'pixel_counts'")
    return counts


def _errors_from_record(record: Mapping[str, Any], field: Field | None) -> CameraErrors:
    if "errors" in record:
        return KnownErrors.from_dict(record["errors"]).on(field)
    return NoErrors() if record["solved"] is None else Solved.from_dict(record["solved"])
