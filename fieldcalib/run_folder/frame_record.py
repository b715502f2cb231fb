"""The outcome of a frame, its line in cameras.jsonl and its files; and the list of frames to look at.

The list (`ToLookAt`) is printed at the end of a run: the first few frames whose verdict is not good, with their
reasons, and where to find the others.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from dataclasses import field as attribute
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np

from fieldcalib._progress import counted
from fieldcalib._types import Array
from fieldcalib.assess.findings import Advice, Remedy, Tool, Verdict, What, how
from fieldcalib.assess.result import ANGLE_NAMES, Calibration
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.formats import CAMERAS
from fieldcalib.io.image_files import Image
from fieldcalib.io.results import broken_line
from fieldcalib.problem.layout import ANGLES, CENTER, LOG_F

SQUASHED = (What.NOT_SQUARE, What.WAS_SQUASHED)
METRES = (0.5, 1.0)  # tolerances of the probabilities in cameras.jsonl
SIZE_KEYS = ("field_length", "field_width", "field_standard_deviations")

NAMED = 5  # number of stretches of frames that are listed


class Item(Protocol):
    """A frame to be worked on: a file, or a frame of a video."""

    @property
    def id(self) -> str:
        """Name of the frame."""

    @property
    def path(self) -> Path | str:
        """File of the frame, for messages."""


@dataclass(frozen=True)
class Outcome:
    """The results of a frame that are written."""

    line: Mapping[str, Any]
    """The frame's line of cameras.jsonl; it has the keys id and status."""
    squashed: bool = False
    """Whether there is a finding that the pixels are not square."""
    files: Mapping[str, bytes] = attribute(default_factory=dict)
    """Contents of the files of the frame, by name."""
    complaint: str = ""
    """A line for stderr: which file is broken, and why."""
    picture: Image | None = None
    """Picture for the overlay video."""
    is_written: bool = False
    """Whether an earlier part of the run has written it."""

    @property
    def id(self) -> str:
        """Name of the frame."""
        return str(self.line["id"])

    @classmethod
    def broken(cls, item: Item, problem: str) -> Outcome:
        """Make the outcome of a frame that cannot be read."""
        return cls(broken_line(item.id, problem), complaint=f"{item.path}: {problem}")

    @classmethod
    def of(
        cls,
        id: str,
        calibration: Calibration,
        *,
        keeps: bool,
        eq3: float | None = None,
        details: Mapping[str, Any] = MappingProxyType({}),
        files: Mapping[str, bytes] = MappingProxyType({}),
        picture: Image | None = None,
    ) -> Outcome:
        """Make the outcome of a calibration; its camera, if it has one, gets a file if `keeps`.

        `eq3` is TVCalib's loss, `details` are more keys of the line.
        """
        written = dict(files)
        if keeps and calibration.camera is not None:
            written |= camera_file(id, calibration.camera)
        squashed = calibration.has_finding(*SQUASHED)
        return cls(calibration_line(id, calibration, eq3) | dict(details), squashed, written, picture=picture)


def kind_of(line: Mapping[str, Any]) -> tuple[str, str]:
    """Most serious finding in a frame's line, and the marking it is about; without findings the status and ""."""
    first: Mapping[str, str] = next(iter(line.get("findings", ())), {})
    return first.get("what", line["status"]), first.get("about", "")


def camera_file(id: str, camera: Camera) -> dict[str, bytes]:
    """Content of the file of a camera, by its name."""
    return {CAMERAS.file_name(id): (CAMERAS.write(camera) + "\n").encode()}


def is_squashed(line: Mapping[str, Any]) -> bool:
    """Whether a frame's line of cameras.jsonl says that the pixels of the picture are not square."""
    return has_finding(line, *SQUASHED)


def has_finding(line: Mapping[str, Any], *what: What) -> bool:
    """Whether a frame's line of cameras.jsonl has any of some findings; lines of earlier versions have none."""
    return any(one.get("what") in what for one in line.get("findings", ()))


def calibration_line(id: str, calibration: Calibration, eq3: float | None) -> dict[str, Any]:
    """Make the line of a frame in cameras.jsonl."""
    line: dict[str, Any] = {"id": id, "status": str(calibration.status), "message": calibration.message}
    line |= {"verdict": str(calibration.verdict), "reason": calibration.reason, "remedy": calibration.remedy}
    line["findings"] = [one.to_dict() for one in calibration.findings]
    line["advice"] = [str(one) for one in calibration.advice]
    line |= calibration.to_dict()
    if calibration.camera is not None:
        line |= {"rms_as_labelled_px": _number(calibration.rms_as_labelled), "loss_ndc_eq3": eq3}
    if calibration.camera is not None and calibration.knows_errors:
        line["standard_deviations"] = _standard_deviations(calibration.camera, calibration.covariance)
    line |= _estimated_size(calibration)
    if calibration.has_probability:
        line |= {f"probability_right_{metres:g}m": _number(calibration.probability(metres)) for metres in METRES}
    return line


def _estimated_size(calibration: Calibration) -> dict[str, Any]:
    """Size of the field with standard deviations, if it was estimated from the frame; else empty."""
    layout = None if calibration.solved is None else calibration.uncertainty.layout
    if calibration.field is None or layout is None or not np.any(layout.free[layout.field_size_block]):
        return {}
    size = calibration.field.length, calibration.field.width
    deviations = np.sqrt(np.diagonal(calibration.covariance))[layout.field_size_block]
    return dict(zip(SIZE_KEYS, (*size, deviations.tolist()), strict=True))


def _standard_deviations(camera: Camera, covariance: Array) -> dict[str, Any]:
    sigma = np.sqrt(np.diagonal(covariance))
    degrees = map(_number, np.degrees(sigma[ANGLES]))
    return {
        "focal_length_px": _number(camera.focal_length * sigma[LOG_F]),
        "C": [_number(metres) for metres in sigma[CENTER]],
        "angles_degrees": dict(zip(ANGLE_NAMES, degrees, strict=True)),
    }


def _number(value: float) -> float | None:
    """Convert a number for JSON, which has neither infinity nor NaN: these become None."""
    return float(value) if np.isfinite(value) else None


@dataclass(frozen=True)
class Stretch:
    """Consecutive frames whose reasons differ at most in their numbers."""

    first: str
    """Id of the first frame."""
    verdict: str
    reason: str
    """Reason of the first frame."""
    kind: str = ""
    """Kind of the reason, without numbers; successive frames of one kind make a stretch."""
    count: int = 1

    def __str__(self) -> str:
        """Format for stderr."""
        others = f" and {self.count - 1} after it" if self.count > 1 else ""
        return f"{self.first}{others}: {self.verdict}, {self.reason}"


@dataclass
class ToLookAt:
    """Collects the frames of a run whose verdict is not good.

    Examples
    --------
    >>> from fieldcalib.assess.findings import Finding, What
    >>> seen = ToLookAt()
    >>> seen.add("000000", "good", "rms 0.45 px over 5 segments")
    >>> for id, px in ("000001", 9.0), ("000002", 7.0):
    ...     found = Finding(What.OFF_PAINT, "Middle line", (px,))
    ...     seen.add(id, "check", f"{found}; rms 0.5 px over 5 segments", kind="off paint Middle line")
    >>> print(seen.message("out/cameras.jsonl"))
    2 frames to look at (all reasons and remedies: out/cameras.jsonl):
      000001 and 1 after it: check, 'Middle line' lies 9 px beside its paint
    >>> seen.add("000003", "reject", "too few", "more markings in view, or labelled by hand", [Advice.BY_HAND])
    >>> print(seen.message("out/cameras.jsonl").splitlines()[-1])
      what would help: more markings in view, or labelled by hand; on the command line: fieldcalib open
    >>> seen.add("000004", "check", "a softer picture", "the whole frame")
    >>> print(seen.message("out/cameras.jsonl").splitlines()[-1])
      what would help 000004: the whole frame
    """

    stretches: list[Stretch] = attribute(default_factory=list)
    """First stretches of frames that are not good."""
    count: int = 0
    """Number of all frames that are not good."""
    named: int = 0
    """Number of frames in `stretches`."""
    remedies: dict[Remedy, dict[str, None]] = attribute(default_factory=dict)
    """Remedies of the frames in `stretches`, in order, each with the first frames of its stretches."""
    _is_next: bool = False

    def add(
        self, id: str, verdict: str, reason: str, remedy: str = "", advice: Iterable[Advice] = (), kind: str = ""
    ) -> None:
        """Add the next frame; a frame without a verdict, which could not be read, is skipped."""
        if not verdict or verdict == Verdict.GOOD:
            self._is_next = False
            return
        self.count += 1
        last = self.stretches[-1] if self._is_next else None
        if last is not None and (last.verdict, last.kind) == (verdict, kind):
            self.stretches[-1] = replace(last, count=last.count + 1)
        elif len(self.stretches) < NAMED:
            self.stretches.append(Stretch(id, verdict, reason.partition("; ")[0], kind))
        else:
            self._is_next = False
            return
        self._is_next = True
        self.named += 1
        if remedy:
            self.remedies.setdefault(Remedy(remedy, tuple(advice)), {})[self.stretches[-1].first] = None

    def message(self, *where: str) -> str:
        """Format the list of frames, and where to find all of them; empty if all are good."""
        if not self.count:
            return ""
        head = f"{counted(self.count, 'frame')} to look at (all reasons and remedies: {', '.join(where)}):"
        rest = [f"and {self.count - self.named} more"] if self.count > self.named else []
        help = []
        for remedy, ids in self.remedies.items():
            whom = f" {', '.join(ids)}" if len(self.remedies) > 1 else ""
            said = how(remedy.advice, Tool.COMMAND)
            help.append(f"what would help{whom}: {remedy.text}{f'; on the command line: {said}' if said else ''}")
        return "\n  ".join([head, *map(str, self.stretches), *rest, *help])
