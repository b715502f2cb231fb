"""The options of `fieldcalib run` that say how frames are calibrated and drawn, checked once."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import Any

from fieldcalib.assess.placement import Placement
from fieldcalib.assess.result import Calibration
from fieldcalib.cli.declared import DeclaredPictures
from fieldcalib.cli.known_camera import KnownCamera
from fieldcalib.console.arguments import ESTIMATED
from fieldcalib.console.field_options import field_of, prior_of
from fieldcalib.console.network import NetworkOptions
from fieldcalib.draw.overlays import draw_calibration
from fieldcalib.fields.field import Field
from fieldcalib.io.image import Image
from fieldcalib.io.images import check_pixels
from fieldcalib.run_folder.images import ReadImage
from fieldcalib.solve.options import Prior


@dataclass(frozen=True)
class CalibrationOptions:
    """Options by which frames are calibrated and drawn."""

    field: Field
    prior: Prior
    known: KnownCamera
    pictures: DeclaredPictures
    network: NetworkOptions
    most_bytes: float
    most_pixels: float
    refine: bool
    estimate_size: bool
    """Whether the size of the field is estimated."""
    keep_rejected: bool
    show_paint: bool

    @classmethod
    def of(cls, options: argparse.Namespace) -> CalibrationOptions:
        """Take them from a command line.

        Raises
        ------
        ValueError
            If options contradict each other.
        """
        prior = prior_of(options)
        return cls(
            field_of(options),
            prior,
            KnownCamera.of(options),
            DeclaredPictures.of(options),
            NetworkOptions.of(options),
            options.most_bytes,
            options.most_pixels,
            options.refine,
            options.field_size == ESTIMATED,
            options.keep_rejected,
            options.show_paint,
        )

    @property
    def read(self) -> ReadImage:
        """Reader of images that refuses those that cannot lie in a frame as declared."""
        return ReadImage(self.most_bytes, self.most_pixels, self.placement)

    def placement(self, image: Image) -> Placement:
        """Placement of an image in its frame; a BrokenFileError if that is not possible."""
        placement = self.pictures.placement((image.shape[1], image.shape[0]))
        check_pixels(placement.frame_size, self.most_pixels)
        self.known.given(placement.frame_size)  # a BrokenFileError if it is of other images
        return placement

    def keywords(self, frame_size: tuple[int, int]) -> dict[str, Any]:
        """Keyword arguments that `calibrate_from_images`, `calibrate_video` and `Tracker` share."""
        return {
            **self.known.given(frame_size)._asdict(),
            "flags": self.known.flags,
            "prior": self.prior,
            "take_off_borders": self.pictures.crop_of is None,
            "estimate_aspect": self.pictures.is_aspect_estimated,
            "estimate_size": self.estimate_size,
        }

    def keeps(self, calibration: Calibration) -> bool:
        """Whether a camera is written."""
        return self.keep_rejected or bool(calibration)

    def drawn(self, image: Image, calibration: Calibration) -> Image:
        """An overlay of a calibration on its image."""
        return draw_calibration(image, calibration, calibration.field or self.field, show_paint=self.show_paint)
