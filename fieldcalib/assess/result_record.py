"""Calibrations as dicts for JSON: the keys of ``cameras.jsonl`` and ``solver.jsonl`` (``docs/reference/files.md``)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from fieldcalib._checks import expect, whole_number
from fieldcalib._json import from_json, reading, to_json
from fieldcalib.assess.camera_errors import CameraErrors, KnownErrors, NoErrors
from fieldcalib.assess.cropping_evidence import Declared
from fieldcalib.assess.findings import Finding, Status, SuspectLabel, findings_from_json
from fieldcalib.assess.paint_in_view import MarkingInView
from fieldcalib.assess.solved import Solved
from fieldcalib.fields.records import field_from_record, field_to_record
from fieldcalib.geometry.camera import Camera

if TYPE_CHECKING:
    from fieldcalib.assess.result import Calibration

ANGLE_NAMES = ("pan", "tilt", "roll")
VERSION = 1


def calibration_to_record(calibration: Calibration, found: Sequence[Finding]) -> dict[str, Any]:
    """`Calibration.to_dict`."""
    camera, field = calibration.camera, calibration.field
    errors, suspects = calibration.per_segment_errors, calibration.suspect_labels
    return {
        "status": str(calibration.status),
        "message": calibration.message,
        **({} if camera is None else _camera_to_record(camera)),
        **({} if np.isnan(calibration.rms) else {"rms_px": to_json(calibration.rms)}),
        "segment_errors_px": {label: to_json(error) for label, error in errors.items()},
        "suspect_labels": [{**asdict(one), "error_px": to_json(one.error_px)} for one in suspects],
        **({} if np.isnan(calibration.loss_ndc) else {"loss_ndc": to_json(calibration.loss_ndc)}),
        "alternatives": [_camera_to_record(other) for other in calibration.alternatives],
        "found": [one.to_dict() for one in found],
        "pixel_counts": dict(calibration.pixel_counts),
        "image_size": None if camera is None else list(camera.image_size),
        "field": None if field is None else field_to_record(field),
        **calibration.errors.to_record(),
        **({} if not calibration.markings else {"markings": [asdict(one) for one in calibration.markings]}),
        **({} if not calibration.are_annotated else {"are_annotated": True}),
        **({} if calibration.declared == Declared.NOTHING else {"declared": str(calibration.declared)}),
        "version": VERSION,
    }


def calibration_from_record(record: Mapping[str, Any]) -> dict[str, Any]:
    """The arguments of the `Calibration` of a record; a ValueError as that of `Calibration.from_dict`."""
    with reading(record, "calibration", VERSION):
        size = record["image_size"]
        return {
            "camera": None if size is None else _camera_from_record(record, size),
            "status": Status(record["status"]),
            "message": expect(record["message"], str, '"rms 1.00 px over 5 segments"'),
            "rms": float(from_json(record.get("rms_px"))),
            "loss_ndc": float(from_json(record.get("loss_ndc"))),
            "per_segment_errors": {
                label: float(from_json(error)) for label, error in record["segment_errors_px"].items()
            },
            "suspect_labels": tuple(
                SuspectLabel(one["label"], one["fits"], float(from_json(one["error_px"])))
                for one in record["suspect_labels"]
            ),
            "alternatives": tuple(_camera_from_record(other, size) for other in record["alternatives"]),
            "_found": findings_from_json(record["found"] if "found" in record else record["complaints"]),
            "pixel_counts": _pixel_counts_from_record(record),
            "field": None if record["field"] is None else field_from_record(record["field"]),
            "errors": _errors_from_record(record),
            "markings": tuple(MarkingInView(**one) for one in record.get("markings", ())),
            "are_annotated": bool(record.get("are_annotated", False)),
            "declared": Declared(record.get("declared", Declared.NOTHING)),
        }


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


def _pixel_counts_from_record(record: Mapping[str, Any]) -> dict[str, int]:
    counts = {
        label: whole_number(count, f"the count of {label!r}", 1) for label, count in record["pixel_counts"].items()
    }
    if not counts.keys() <= record["segment_errors_px"].keys():
        raise ValueError("expected 'segment_errors_px' of all labels of 'pixel_counts'")
    return counts


def _errors_from_record(record: Mapping[str, Any]) -> CameraErrors:
    if "errors" in record:
        return KnownErrors.from_dict(record["errors"])
    return NoErrors() if record["solved"] is None else Solved.from_dict(record["solved"])
