"""Side of the field on which the camera of a picture stands: as the user says, else the main side by convention.

A field turned by 180 degrees about its centre mark is the same field, and a camera turned with it takes the same
picture. A person's labels name the ends of the field and so decide between the two cameras. A network names the ends
as seen from the main side (`fieldcalib.fields.field`), and a search finds either camera. Such a camera is therefore
placed on the main side, with the turned camera as its alternative, unless the user says on which side it is: by name,
by its position or rotation, or by a prior whose stands are all on one side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from fieldcalib._types import Array, Float32
from fieldcalib.assess.result import Calibration
from fieldcalib.fields.field import (
    MAIN,
    OPPOSITE,
    SIDES,
    Field,
    Side,
    looks_the_same_turned,
    side_of,
    side_of_stand,
    turned_camera,
    turned_stand,
    unlike_turned,
)
from fieldcalib.fields.traits import CameraDistribution
from fieldcalib.geometry.camera import Camera
from fieldcalib.io.image_files import Image
from fieldcalib.localize import Network
from fieldcalib.solve.request import GivenCamera, Task
from fieldcalib.solve.solver_options import ALL, CalibrationFlags, Prior, checked_prior

_F = CalibrationFlags


def twin_of(camera: Camera, field: Field) -> Camera | None:
    """Turn a camera by 180 degrees about the centre mark; None if the field looks different from there.

    Examples
    --------
    >>> from fieldcalib.fields import tennis
    >>> camera = Camera.from_angles(1.5, 1.3, 0.0, 1400.0, (-32.0, 1.0, -9.0), (960, 540))
    >>> twin_of(camera, tennis()).C.tolist()
    [32.0, -1.0, -9.0]
    """
    return turned_camera(camera) if looks_the_same_turned(field) else None


def with_twin(calibration: Calibration, field: Field) -> Calibration:
    """Add the camera on the other side to a calibration as its first alternative."""
    if calibration.camera is None:
        return calibration
    twin = twin_of(calibration.camera, field)
    return calibration if twin is None else replace(calibration, alternatives=(twin, *calibration.alternatives))


@dataclass(frozen=True)
class TurnedNetwork:
    """A network that names the ends of the field as seen from the opposite side: left and right are exchanged."""

    network: Network
    field: Field

    @property
    def classes(self) -> Sequence[str]:
        """Class of each probability map."""
        return tuple(self.field.symmetric.get(name, name) for name in self.network.classes)

    def __call__(self, images: Sequence[Image]) -> Float32:
        """Probabilities (N, K, h, w) of the K classes."""
        return self.network(images)


@dataclass(frozen=True)
class CameraSide:
    """The side of the field that the cameras of pictures stand on."""

    side: Side | None
    """None for an object without sides: turned by 180 degrees it looks different."""
    is_said: bool
    """Whether the side follows from what the user gave; otherwise from the convention."""

    @classmethod
    def of(cls, task: Task, side: Side | None = None) -> CameraSide:
        """Take the side that is named, else the side of the task's given camera or prior, else the main side.

        Raises
        ------
        ValueError
            If `side` is not a side, contradicts the camera or the prior, or the object has no sides.
        """
        if side is not None and not (isinstance(side, str) and side in SIDES):
            raise ValueError(f"side must be {' or '.join(map(repr, SIDES))}, got {side!r}")
        field = task.field
        if field is None or not looks_the_same_turned(field):
            if side is not None:
                why = "" if field is None else f", which it does not for {unlike_turned(field)[0]!r}"
                raise ValueError(f"side={side!r} is of a field that looks the same from both sides{why}: leave it out")
            return cls(None, is_said=False)
        told = _told(field, task.given, task.chosen_flags, task.prior)
        if None not in (side, told) and side != told:
            raise ValueError(f"side={side!r}, but the camera or its prior is on the {told} side: leave one of them out")
        said = side or told
        return cls(said or MAIN, is_said=said is not None)

    @property
    def is_open(self) -> bool:
        """Whether the side is unknown, so that the camera on the other side is as likely."""
        return self.side is not None and not self.is_said

    def task(self, task: Task) -> Task:
        """Restrict a task to this side; on the opposite side, the default prior is the main side's stands, turned."""
        field = task.field
        if self.side != OPPOSITE or task.prior != ALL or field is None:
            return replace(task, side=self.side)
        stands = tuple(turned_stand(stand) for stand in field.stands if side_of_stand(stand, field) == MAIN)
        return replace(task, prior=stands, side=self.side)

    def network(self, network: Network, field: Field | None) -> Network:
        """Rename the labels of a network to name the ends of the field as seen from this side."""
        return network if self.side != OPPOSITE or field is None else TurnedNetwork(network, field)

    def with_alternatives(self, calibration: Calibration, field: Field | None) -> Calibration:
        """Add the camera on the other side to a calibration as an alternative, if the side is unknown."""
        return calibration if field is None or not self.is_open else with_twin(calibration, field)


def _told(field: Field, given: GivenCamera, flags: CalibrationFlags, prior: Prior) -> Side | None:
    """Side that the given position or rotation, or all stands of the prior, are on; None if they do not decide it."""
    if given.tvec is not None and flags & (_F.CALIB_FIX_POSITION | _F.CALIB_USE_EXTRINSIC_GUESS):
        return side_of(given.camera((2, 2)).C, field)
    if given.rvec is not None and flags & _F.CALIB_FIX_ROTATION:
        return _side_looking(given.camera((2, 2)).angles[0], field)
    if prior is None:
        return None
    sides = {side_of_stand(stand, field) for stand in checked_prior(prior, field)}
    return sides.pop() if len(sides) == 1 else None


def _side_looking(pan: float, field: Field) -> Side:
    """Side of the stand whose range of pan fits a pan (radians) best."""
    stands: Sequence[CameraDistribution] = field.stands or tuple(field.named_stands.values())
    low, high = np.radians([stand.pan for stand in stands]).T
    away: Array = np.abs(np.angle(np.exp(1j * (pan - 0.5 * (low + high))))) / (high - low)
    return side_of_stand(stands[int(np.argmin(away))], field)
