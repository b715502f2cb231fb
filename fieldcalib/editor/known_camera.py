"""What a person knows of a camera, of its field, and of the shape of the picture."""

from __future__ import annotations

from dataclasses import dataclass, replace
from reprlib import repr as short
from typing import Any

import numpy as np

from fieldcalib._checks import is_number, truth
from fieldcalib.assess.placement import Placement
from fieldcalib.fields.field import Field
from fieldcalib.solve.solver_options import LENS_FLAGS, CalibrationFlags
from fieldcalib.solve.squashed_pictures import LEAST_RATIO, shown_as

LONGEST = 1e6  # px: focal length of a picture 8000 wide that shows 1 m at 100 m
FARTHEST = 1e4  # m: of the camera from the centre mark


@dataclass(frozen=True)
class Known:
    """What a person knows of a camera and a field; None is estimated."""

    focal_length: float | None = None
    """Pixels of the picture, along rows."""
    position: tuple[float, float, float] | None = None
    """Metres from the centre mark, y towards the main stand, z down."""
    principal_point: bool = False
    """Whether it is the middle of the image."""
    lens: str = "k1"
    """A name of `LENS_FLAGS`."""
    field_size: tuple[float, float] | None = None
    """Length and width, metres."""
    aspect: float | None = None
    """Width / height at which the picture is shown with square pixels: 16 / 9 for one that was squashed from it."""

    def __post_init__(self) -> None:
        if not isinstance(self.lens, str) or self.lens not in LENS_FLAGS:
            raise ValueError(f"lens must be one of {', '.join(map(repr, LENS_FLAGS))}, got {short(self.lens)}")
        values = {
            "focal_length": _number(self.focal_length),
            "position": _above_ground(_numbers(self.position, 3, "position", "x, y, z in metres")),
            "principal_point": bool(truth(self.principal_point, "principal_point")),
            "field_size": _numbers(self.field_size, 2, "field_size", "length and width in metres"),
        }
        for name, value in values.items():  # as plain numbers, which JSON has
            object.__setattr__(self, name, value)
        if self.aspect is not None and not (is_number(self.aspect) and LEAST_RATIO <= self.aspect <= 1.0 / LEAST_RATIO):
            raise ValueError(
                f"aspect must be the width / height at which the picture is shown, from {LEAST_RATIO:g} to "
                f"{1.0 / LEAST_RATIO:g} as 16 / 9, or None, got {short(self.aspect)}"
            )

    def of(self, field: Field) -> Field:
        """The field in its known size; a ValueError if it cannot have that."""
        return field if self.field_size is None else replace(field.resized(*self.field_size), size_known=True)

    def placement(self, image_size: tuple[int, int]) -> Placement:
        """The placement of a picture in a frame with square pixels: as it is, unless the aspect is known."""
        shown = image_size if self.aspect is None else shown_as(image_size, self.aspect)
        return Placement(image_size, shown, None)

    def arguments(self, placement: Placement) -> dict[str, Any]:
        """Keyword arguments of `calibrate_from_segments` for pixels of the frame in which a picture lies."""
        F = CalibrationFlags
        flags, found = LENS_FLAGS[self.lens], dict[str, Any]()
        if self.focal_length is not None:
            middle = np.divide(placement.frame_size, 2.0)
            f = self.focal_length * float(placement.scale[0])  # along rows, as `Camera.focal_length`
            found["camera_matrix"] = np.array([[f, 0.0, middle[0]], [0.0, f, middle[1]], [0.0, 0.0, 1.0]])
            flags |= F.CALIB_FIX_FOCAL_LENGTH
        if self.position is not None:
            found["rvec"], found["tvec"] = np.zeros(3), -np.array(self.position)
            flags |= F.CALIB_FIX_POSITION
        if self.principal_point:
            flags |= F.CALIB_FIX_PRINCIPAL_POINT
        return {"flags": flags, **found}


def _number(focal_length: Any) -> float | None:
    """A checked focal length."""
    if focal_length is None:
        return None
    if not (is_number(focal_length) and 0.0 < focal_length <= LONGEST):
        got = short(focal_length)
        raise ValueError(f"focal_length must be a number of pixels up to {LONGEST:g}, or None, got {got}")
    return float(focal_length)


def _numbers(values: Any, count: int, name: str, what: str) -> Any:
    """As many checked numbers as expected, or None."""
    if values is None:
        return None
    is_list = isinstance(values, tuple | list) or (isinstance(values, np.ndarray) and values.ndim == 1)
    is_list = is_list and len(values) == count and all(map(is_number, values))
    if not is_list or not all(abs(value) <= FARTHEST for value in values):
        raise ValueError(f"{name} must be {what}, at most {FARTHEST:g} each, or None, got {short(values)}")
    return tuple(float(value) for value in values)


def _above_ground(position: Any) -> Any:
    """The position, checked: z is negative upwards."""
    if position is not None and not position[2] < 0.0:
        raise ValueError(f"position must be above the ground, where z is negative: x, y, z in metres, got {position}")
    return position
