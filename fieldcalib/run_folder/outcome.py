"""The outcome of a frame: its line in cameras.jsonl and its files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import field as attribute
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np

from fieldcalib._types import Array
from fieldcalib.assess.findings import What
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.result_record import ANGLE_NAMES
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.formats import CAMERAS
from fieldcalib.io.image import Image
from fieldcalib.io.results import BROKEN
from fieldcalib.problem.layout import ANGLES, CENTER, LOG_F

SQUASHED = (What.NOT_SQUARE, What.WAS_SQUASHED)
METRES = (0.5, 1.0)  # tolerances of the probabilities in cameras.jsonl
SIZE_KEYS = ("field_length", "field_width", "field_standard_deviations")


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
    """Whether the labels say that the pixels are not square."""
    files: Mapping[str, bytes] = attribute(default_factory=dict)
    """Content by name."""
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
        """The outcome of a frame that cannot be read."""
        return cls({"id": item.id, "status": BROKEN, "message": problem}, complaint=f"{item.path}: {problem}")

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
        """The outcome of a calibration; its camera, if it has one, gets a file if `keeps`.

        `eq3` is the paper's loss, `details` are more keys of the line.
        """
        written = dict(files)
        if keeps and calibration.camera is not None:
            written |= camera_file(id, calibration.camera)
        squashed = calibration.has_finding(*SQUASHED)
        return cls(calibration_line(id, calibration, eq3) | dict(details), squashed, written, picture=picture)


def kind_of(line: Mapping[str, Any]) -> tuple[str, str]:
    """What is most against the camera of a frame's line, and which marking it is about; its status if nothing is."""
    first: Mapping[str, str] = next(iter(line.get("findings", ())), {})
    return first.get("what", line["status"]), first.get("about", "")


def camera_file(id: str, camera: Camera) -> dict[str, bytes]:
    """Content of the file of a camera, by its name."""
    return {CAMERAS.file_name(id): (CAMERAS.write(camera) + "\n").encode()}


def is_squashed(line: Mapping[str, Any]) -> bool:
    """Whether a frame's line of cameras.jsonl says that the pixels of the picture are not square."""
    return has_finding(line, *SQUASHED)


def has_finding(line: Mapping[str, Any], *what: What) -> bool:
    """Whether a frame's line of cameras.jsonl has one of some findings; lines of earlier versions have none."""
    return any(one.get("what") in what for one in line.get("findings", ()))


def calibration_line(id: str, calibration: Calibration, eq3: float | None) -> dict[str, Any]:
    """The line of a frame in cameras.jsonl."""
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
    """The size of the field, where it was estimated from the frame."""
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
    """A number for JSON, which has neither infinity nor NaN."""
    return float(value) if np.isfinite(value) else None
