"""The table of all frames that an editor shows: verdicts, angles, and which frame to look at first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from fieldcalib.assess.findings import Verdict
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.result_record import ANGLE_NAMES

CONCERN = {Verdict.GOOD: 0.0, Verdict.CHECK: 0.4, Verdict.REJECT: 0.7}  # least concern by verdict
REST = 0.3  # of the concern, by the probability that the camera is right


class Row(NamedTuple):
    """What the table says about a frame."""

    verdict: str = ""
    reason: str = ""
    concern: float = 0.0
    """How much it needs a look, 0 to 1."""
    pan: float | None = None
    tilt: float | None = None
    roll: float | None = None
    """Degrees."""
    focal_length: float | None = None
    """Pixels."""
    basis: str = ""
    by_hand: bool = False

    @classmethod
    def of(cls, calibration: Calibration, basis: str = "", *, by_hand: bool = False) -> Row:
        """The row of a calibration."""
        probability = calibration.probability() if calibration.has_probability else float("nan")
        pan, tilt, roll, f = None, None, None, None
        if calibration.camera is not None:
            pan, tilt, roll = (round(angle, 4) for angle in np.degrees(calibration.camera.angles).tolist())
            f = round(calibration.camera.focal_length, 2)
        verdict = calibration.verdict
        concern = _concern(verdict, probability)
        return cls(str(verdict), calibration.reason, concern, pan, tilt, roll, f, basis, by_hand)

    @classmethod
    def of_line(cls, line: Mapping[str, Any]) -> Row:
        """The row of a line of ``cameras.jsonl``."""
        verdict = str(line.get("verdict", ""))
        known = line.get("probability_right_1m")
        probability = float("nan") if known is None else float(known)
        degrees, K = line.get("angles_degrees") or {}, line.get("K")
        pan, tilt, roll = (degrees.get(name) for name in ANGLE_NAMES)
        return cls(
            verdict,
            str(line.get("reason") or line.get("message", "")),
            _concern(Verdict(verdict), probability) if verdict else 1.0,
            pan,
            tilt,
            roll,
            None if K is None else float(K[0][0]),
            str(line.get("basis", "")),
        )


def _concern(verdict: Verdict, probability: float) -> float:
    """How much a frame needs a look, 0 to 1."""
    share = 1.0 - probability if np.isfinite(probability) else 0.5
    return round(CONCERN[verdict] + REST * share, 4)


@dataclass(frozen=True)
class Table:
    """Rows of all frames as columns, for JSON."""

    ids: Sequence[str]
    rows: Sequence[Row]

    def columns(self) -> dict[str, list[Any]]:
        """Values by the name of the column."""
        values = zip(*self.rows, strict=True) if self.rows else ((),) * len(Row._fields)
        return {"id": list(self.ids), **{name: list(one) for name, one in zip(Row._fields, values, strict=True)}}
