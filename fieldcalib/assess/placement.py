"""The placement of pictures in a frame, if they are not whole frames with square pixels.

A camera is calibrated in a frame with square pixels and the principal point near the middle. A squashed picture is
stretched to such a frame, a cropped one is put in its position, black borders are left out. The calibrated camera is
then expressed in the picture's own pixels.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fieldcalib._checks import expect, whole_number
from fieldcalib._types import Array
from fieldcalib.assess.findings import Finding, findings_from_json
from fieldcalib.assess.result import Calibration, with_findings
from fieldcalib.geometry.camera import Camera, checked_image_size
from fieldcalib.problem.labelled_pixels import Pixels

LARGEST_CORNER = 1_000_000  # pixels


@dataclass(frozen=True)
class Crop:
    """A part of a frame."""

    frame_size: tuple[int, int]
    corner: tuple[int, int]
    """Pixel of the frame at the first pixel of the part."""

    def __str__(self) -> str:
        """The crop in the notation of the command line."""
        (width, height), (x, y) = self.frame_size, self.corner
        return f"{width}x{height}+{x}+{y}"


@dataclass(frozen=True)
class Placement:
    """Position of pictures of one size in their frame: ``xy_frame = scale * xy + corner``.

    Examples
    --------
    The right half of a frame of 1920 x 1080, squashed to a square:

    >>> placement = Placement((540, 540), (960, 1080), Crop((1920, 1080), (960, 0)))
    >>> placement.frame_size, placement.to_frame({"Middle line": [(10.0, 20.0)]})
    ((1920, 1080), {'Middle line': array([[977.77777778,  40.        ]])})
    """

    size: tuple[int, int]
    """Width and height of the pictures."""
    display_size: tuple[int, int]
    """Width and height at which their pixels are square."""
    crop: Crop | None

    @property
    def frame_size(self) -> tuple[int, int]:
        """Width and height of the frame."""
        return self.display_size if self.crop is None else self.crop.frame_size

    @property
    def is_whole(self) -> bool:
        """Whether the pictures are unchanged frames."""
        return self.size == self.display_size == self.frame_size

    @property
    def scale(self) -> Array:
        """Pixels at the display size per pixel of the picture, along x and y."""
        return np.divide(self.display_size, self.size)

    @property
    def corner(self) -> tuple[int, int]:
        """Pixel of the frame at the first pixel of the picture."""
        return (0, 0) if self.crop is None else self.crop.corner

    def to_frame(self, pixels: Pixels) -> Pixels:
        """Labelled pixels of a picture as pixels of the frame."""
        return {label: self.scale * xy + self.corner for label, xy in pixels.items()}

    def image_in_frame(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The frame with the picture in its position, black elsewhere."""
        import cv2

        if self.is_whole:
            return image
        # not cv2.resize, which maps corners of pixels: (0, 0) is the middle of the first one
        M = np.column_stack([np.diag(self.scale), self.corner])
        return np.asarray(cv2.warpAffine(image, M, self.frame_size, flags=cv2.INTER_LINEAR), dtype=np.uint8)

    def from_frame(self, calibration: Calibration) -> Calibration:
        """A calibration of the frame with its cameras converted to the picture's pixels; errors stay in the frame's."""
        if self.is_whole or calibration.camera is None:
            return calibration
        others = tuple(map(self._camera, calibration.alternatives))
        return replace(calibration, camera=self._camera(calibration.camera), alternatives=others)

    def _camera(self, camera: Camera) -> Camera:
        return camera.cropped(self.corner, self.display_size).scaled(self.size)


class InFrame(NamedTuple):
    """Pixels of a picture in the frame in which its camera was solved: ``xy_frame = scale * xy + corner``."""

    scale: Array
    corner: Array

    @classmethod
    def of(cls, shown: Camera, solved: Camera) -> InFrame:
        """The pixels of one camera in those of the other, which differs in its image only.

        Examples
        --------
        >>> solved = Camera.from_angles(0.0, 1.35, 0.0, 1400.0, (0.0, 66.0, -16.0), (1138, 640))
        >>> in_frame = InFrame.of(solved.scaled((640, 640)), solved)
        >>> in_frame.of_picture((320.0, 100.0)), in_frame.of_frame((569.0, 100.0))
        (array([569., 100.]), array([320., 100.]))
        """
        if shown.image_size == solved.image_size:
            return cls(np.ones(2), np.zeros(2))
        scale = np.diagonal(solved.K)[:2] / np.diagonal(shown.K)[:2]
        return cls(scale, solved.principal_point - scale * shown.principal_point)

    def of_picture(self, xy: ArrayLike) -> Array:
        """Pixels (..., 2) of the picture as pixels of the frame."""
        return np.asarray(self.scale * np.asarray(xy, dtype=float) + self.corner)

    def of_frame(self, xy: ArrayLike) -> Array:
        """Pixels (..., 2) of the frame as pixels of the picture."""
        return np.asarray((np.asarray(xy, dtype=float) - self.corner) / self.scale)


@dataclass(frozen=True)
class Shape:
    """Shape of the frames of a clip: black borders, and pixels that are not square.

    Examples
    --------
    >>> shape = Shape(Placement((1280, 960), (1280, 960), Crop((1280, 720), (0, -120))), "without borders")
    >>> shape == Shape.from_dict(shape.to_dict())
    True
    """

    placement: Placement
    message: str = ""
    """Message that is appended to that of each frame."""
    findings: tuple[Finding, ...] = ()
    """Findings that are added to those of each frame."""

    @property
    def doubts(self) -> tuple[str, ...]:
        """Sentences of the findings that speak against the cameras."""
        return tuple(str(one) for one in self.findings if one.what.is_against)

    def in_picture(self, calibration: Calibration) -> Calibration:
        """A calibration of a frame with its cameras converted to the picture's pixels; errors stay in the frame's."""
        if calibration.camera is None:
            return calibration
        found = self.placement.from_frame(calibration)
        message = "; ".join(filter(None, (found.message, self.message)))
        return with_findings(replace(found, message=message), *self.findings)

    def to_dict(self) -> dict[str, Any]:
        """Everything, for `json.dumps`."""
        one = self.placement
        part = None if one.crop is None else [list(one.crop.frame_size), list(one.crop.corner)]
        said = {"message": self.message, "findings": [one.to_dict() for one in self.findings]}
        return {"size": list(one.size), "display_size": list(one.display_size), "crop": part, **said}

    @classmethod
    def from_dict(cls, record: Mapping[str, Any]) -> Shape:
        """The inverse of `to_dict`."""
        size, display_size = (checked_image_size(record[name]) for name in ("size", "display_size"))
        part = None if record["crop"] is None else _crop_from_record(*record["crop"])
        return cls(
            Placement(size, display_size, part),
            expect(record["message"], str, '"without borders"'),
            findings_from_json(record["findings"] if "findings" in record else record["complaints"]),
        )


def _crop_from_record(frame_size: Any, corner: Any) -> Crop:
    x, y = (whole_number(one, "the corner of a crop", -LARGEST_CORNER) for one in corner)
    return Crop(checked_image_size(frame_size), (x, y))
