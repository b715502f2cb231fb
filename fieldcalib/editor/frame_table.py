"""The table of all frames that an editor shows: verdicts, angles, and which frame to look at first.

Which frame of a clip to mend next: one that helps as many others as possible.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from fieldcalib.assess.findings import Verdict
from fieldcalib.assess.result import Calibration
from fieldcalib.assess.result_record import ANGLE_NAMES
from fieldcalib.editor.fitting import network_marks
from fieldcalib.fields.field import Field
from fieldcalib.io.files import BrokenFileError
from fieldcalib.localize import Network
from fieldcalib.run_folder.frame_source import FrameSource

CONCERN = {Verdict.GOOD: 0.0, Verdict.CHECK: 0.4, Verdict.REJECT: 0.7}  # least concern by verdict
REST = 0.3  # of the concern, by the probability that the camera is right

LOOKED_AT = 9  # frames of a stretch in which markings are counted
BESIDE_MENDED = 5  # frames around one that was mended already, whose view is nearly the same


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


def next_frame(frames: FrameSource, rows: Sequence[Row], field: Field, network: Network | None) -> int | None:
    """The frame to mend next; None if all are good.

    It is in the stretch of frames whose cameras are not good that gives most cause for concern in all, and there the
    one that shows most markings: its labels determine the camera, and matches hand it on to its neighbours. Without a
    network it is in the middle.
    """
    stretches = sorted(_stretches(rows), key=lambda stretch: -sum(rows[n].concern for n in stretch))
    if not stretches:
        return None
    mended = np.array([n for n, row in enumerate(rows) if row.by_hand])
    far: list[int] = [n for n in stretches[0] if not len(mended) or np.min(np.abs(mended - n)) > BESIDE_MENDED]
    candidates = far or [*stretches[0]]
    middle: int = candidates[len(candidates) // 2]
    if network is None:
        return middle
    spread = np.linspace(0, len(candidates) - 1, min(len(candidates), LOOKED_AT)).round().astype(int)
    counts: dict[int, int] = {candidates[k]: _markings(frames, candidates[k], field, network) for k in spread.tolist()}
    return max(counts, key=lambda n: (counts[n], -abs(n - middle)))


def _stretches(rows: Sequence[Row]) -> Iterator[list[int]]:
    """Runs of frames that were not mended and whose cameras are not good."""
    run: list[int] = []
    for n, row in enumerate(rows):
        if row.verdict == Verdict.GOOD or row.by_hand:
            if run and row.verdict == Verdict.GOOD:
                yield run
                run = []
        else:
            run.append(n)
    if run:
        yield run


def _markings(frames: FrameSource, number: int, field: Field, network: Network) -> int:
    """How many markings the network finds in a frame; none where it cannot be read."""
    try:
        return len(network_marks(field, frames.image(number), network).pixels)
    except BrokenFileError:
        return 0
