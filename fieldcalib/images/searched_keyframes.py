"""Keyframes of a clip that are searched for a court: those that are found tell where the tripod of the others is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from dataclasses import field as attribute

from fieldcalib.assess.result import Calibration
from fieldcalib.images.clip_problem import ClipOptions
from fieldcalib.images.court_search import search_courts
from fieldcalib.images.place_search import search_from
from fieldcalib.images.pooled_place import place_of
from fieldcalib.images.views import Place
from fieldcalib.io.image import Image

MOST_REFUSED = 40  # keyframes without a court that are kept, to be searched again when more is known


@dataclass(frozen=True, eq=False)
class SearchedKeyframes:
    """Keyframes by their numbers, as far as they were searched."""

    options: ClipOptions
    found: Mapping[int, Calibration] = attribute(default_factory=dict)
    """Accepted cameras."""
    refused: Mapping[int, Image] = attribute(default_factory=dict)
    """Images in which no court was found."""

    @property
    def place(self) -> Place | None:
        """Where the tripod stands; None if that is not known, or the camera moves."""
        field = self.options.task.field
        if field is None or "centre" not in self.options.shared:
            return None
        return place_of(list(self.found.values()))

    def searched(self, images: Mapping[int, Image]) -> SearchedKeyframes:
        """Search further keyframes from the place of the tripod, if it is known, and where that fails from anywhere."""
        after = self
        for t, image in images.items():
            calibration = after._from_place(image) or search_courts(after.options.task, [image])[0]
            if calibration.accepted:
                after = replace(after, found={**after.found, t: calibration})
            elif len(after.refused) < MOST_REFUSED:
                after = replace(after, refused={**after.refused, t: image})
        return after

    def searched_again(self) -> SearchedKeyframes:
        """Search the refused keyframes from the place that the others tell."""
        again = {t: self._from_place(image) for t, image in self.refused.items()}
        return replace(
            self, found={**self.found, **{t: one for t, one in again.items() if one is not None}}, refused={}
        )

    def _from_place(self, image: Image) -> Calibration | None:
        """An accepted camera at the place of the tripod; None if there is none."""
        place, field = self.place, self.options.task.field
        if place is None or field is None:
            return None
        found = search_from(self.options.task, field, image, place)
        return found if found.accepted else None
