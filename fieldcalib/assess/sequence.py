"""What the calibration of frames of one tripod returns: the frames, and what they share."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from dataclasses import field as attribute
from typing import Any, overload

import numpy as np

from fieldcalib._json import from_json, to_json
from fieldcalib._types import Array
from fieldcalib.assess.result import Calibration
from fieldcalib.fields.field import Field
from fieldcalib.fields.records import field_from_record, field_to_record
from fieldcalib.geometry.camera import Camera

VERSION = 1  # of `SequenceCalibration.to_dict`


@dataclass(frozen=True, eq=False)
class SequenceCalibration(Sequence[Calibration]):
    """The calibrations of frames of one tripod, and what the frames share.

    It is a sequence of `Calibration`, one for each frame. Their uncertainties are the frames' own marginals: what a
    frame alone leaves open, and what all frames together leave open of what they share.

    Examples
    --------
    >>> alone = SequenceCalibration((Calibration.without_camera("too few segments", "no labelled pixels"),))
    >>> len(alone), alone.cameras, alone.shared
    (1, [None], {})
    """

    frames: tuple[Calibration, ...] = attribute(repr=False)
    names: tuple[str, ...] = ()
    """Of the shared parameters (`fieldcalib.problem.layout`); none where no place of the tripod was found."""
    values: Array = attribute(default_factory=lambda: np.zeros(0), repr=False)
    """Their estimates, (S,)."""
    covariance: Array = attribute(default_factory=lambda: np.zeros((0, 0)), repr=False)
    """Their joint covariance, (S, S)."""
    field: Field | None = attribute(default=None, repr=False)
    """The field, of the estimated size; None if the object is no `Field`."""
    together: int = 0
    """Number of frames that the shared parameters were estimated from."""

    @overload
    def __getitem__(self, index: int) -> Calibration: ...

    @overload
    def __getitem__(self, index: slice) -> tuple[Calibration, ...]: ...

    def __getitem__(self, index: int | slice) -> Calibration | tuple[Calibration, ...]:
        return self.frames[index]

    def __len__(self) -> int:
        return len(self.frames)

    def __iter__(self) -> Iterator[Calibration]:
        return iter(self.frames)

    @property
    def cameras(self) -> list[Camera | None]:
        """Of the frames."""
        return [frame.camera for frame in self.frames]

    @property
    def shared(self) -> Mapping[str, tuple[float, float]]:
        """Estimate and standard deviation of each shared parameter, by name."""
        sigma = np.sqrt(np.diagonal(self.covariance))
        return {name: (float(v), float(s)) for name, v, s in zip(self.names, self.values, sigma, strict=True)}

    def to_dict(self) -> dict[str, Any]:
        """Everything as JSON, for `json.dumps`."""
        return {
            "version": VERSION,
            "frames": [frame.to_dict() for frame in self.frames],
            "names": list(self.names),
            "values": to_json(self.values),
            "covariance": to_json(self.covariance),
            "field": None if self.field is None else field_to_record(self.field),
            "together": self.together,
        }

    @classmethod
    def from_dict(cls, record: Mapping[str, Any]) -> SequenceCalibration:
        """The inverse of `to_dict`.

        Raises
        ------
        ValueError
            If the record is of another version.
        """
        if record.get("version") != VERSION:
            raise ValueError(f"expected a sequence of version {VERSION}, got {record.get('version')!r}")
        return cls(
            tuple(Calibration.from_dict(frame) for frame in record["frames"]),
            tuple(record["names"]),
            from_json(record["values"]),
            from_json(record["covariance"]).reshape(2 * (len(record["names"]),)),
            None if record["field"] is None else field_from_record(record["field"]),
            record["together"],
        )
