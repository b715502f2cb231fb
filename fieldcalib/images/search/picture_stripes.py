"""Cache of what a search finds in a picture: its stripes, lines and ellipses once, ranked cameras once per field."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

from fieldcalib._types import IntArray
from fieldcalib.fields.field import Field
from fieldcalib.images.search.cameras_from_ellipses import circles_of
from fieldcalib.images.search.court_ranking import Curves, Ranked, rank_cameras, rank_from_above
from fieldcalib.images.search.ellipses import Ellipse, find_ellipses
from fieldcalib.images.search.long_lines import LongLines, long_lines
from fieldcalib.images.search.straightened import Bend, bend_of
from fieldcalib.images.search.stripe_likelihood import StripeMaps
from fieldcalib.images.search.stripes import StripeColours, Stripes, at_working_size, find_stripes
from fieldcalib.io.image import Image

LINES = 16  # long lines used for hypotheses: 15 do as well as 26
ELLIPSES = 6  # ellipses used for hypotheses: on ice there are also ellipses of letters


@dataclass(frozen=True, eq=False)
class PictureToSearch:
    """A picture to be searched for one or more fields; its stripes are found once."""

    image: Image
    """(height, width, 3), blue, green, red."""
    _found: dict[bool, PictureStripes] = field(default_factory=dict, repr=False)

    def stripes(self, *, lighter: bool) -> PictureStripes:
        """Stripes of the picture that are lighter than the ground, or darker."""
        if lighter not in self._found:
            self._found[lighter] = PictureStripes.of(at_working_size(self.image), lighter=lighter)
        return self._found[lighter]


@dataclass(frozen=True, eq=False)
class PictureStripes:
    """Stripes of a picture, all or those of one paint, and what follows from them."""

    seen: Stripes
    """Stripes at their pixels in the picture."""
    straight: Stripes
    """Stripes at their pixels in the picture without its distortion."""
    colours: StripeColours
    bend: Bend
    """Distortion of the picture."""
    _ranked: dict[tuple[Field, bool], Ranked] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, image: Image, *, lighter: bool, bend: Bend | None = None) -> PictureStripes:
        """Find the stripes of an image of the working size, and its distortion from them unless `bend` is given."""
        stripes = find_stripes(image, lighter=lighter)
        bend = bend or bend_of(stripes)
        return cls(stripes, bend.straight(stripes), StripeColours.of(image, stripes), bend)

    def take(self, index: IntArray) -> PictureStripes:
        """Select stripes by index."""
        return PictureStripes(self.seen.take(index), self.straight.take(index), self.colours.take(index), self.bend)

    @cached_property
    def unbent(self) -> PictureStripes:
        """The stripes if the lens had no distortion."""
        return self.with_bend(0.0)

    def with_bend(self, a: float) -> PictureStripes:
        """Assume another distortion of the picture (`Bend.a`)."""
        bend = replace(self.bend, a=a)
        return PictureStripes(self.seen, bend.straight(self.seen), self.colours, bend)

    @cached_property
    def lines(self) -> LongLines:
        """Long lines of the picture without distortion."""
        return long_lines(self.straight, LINES)

    @cached_property
    def ellipses(self) -> tuple[Ellipse, ...]:
        """Ellipses of the picture without distortion."""
        return find_ellipses(self.straight, ELLIPSES)

    @cached_property
    def maps(self) -> StripeMaps:
        """Tables of likelihood ratios in the picture."""
        return StripeMaps.of(self.seen)

    @cached_property
    def straight_maps(self) -> StripeMaps:
        """Tables of likelihood ratios in the picture without distortion."""
        return self.maps if self.bend.a == 0.0 else StripeMaps.of(self.straight)

    def curves(self, court: Field) -> Curves:
        """Long lines, and ellipses if the field has circles; finding ellipses takes 0.1 s."""
        return self.lines, self.ellipses if len(circles_of(court)) else ()

    def ranked_from_above(self, court: Field) -> Ranked:
        """Rank the cameras that look down on a field."""
        return rank_from_above(self.lines, self.straight_maps, court, self.bend)

    def ranked(self, court: Field, *, are_cut_out: bool) -> Ranked:
        """Rank the cameras for a field, once; `are_cut_out` as in `rank_cameras`."""
        if (court, are_cut_out) not in self._ranked:
            ranked = rank_cameras(self.curves(court), self.straight_maps, court, self.bend, are_cut_out=are_cut_out)
            self._ranked[court, are_cut_out] = ranked
        return self._ranked[court, are_cut_out]
