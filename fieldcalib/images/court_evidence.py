"""What a camera that was searched for explains of the stripes of its picture, and what it leaves unexplained."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fieldcalib._types import Array, BoolArray
from fieldcalib.fields.field import Field
from fieldcalib.geometry.camera import Camera
from fieldcalib.images.stripe_likelihood import StripeMaps
from fieldcalib.localize.long_lines import LongLines
from fieldcalib.localize.stripe_colours import StripeColours
from fieldcalib.localize.stripes import Stripes

EXPLAINED = 6.0  # px from a projected marking
ON_LINE, ALONG_LINE = 3.0, np.radians(8.0)  # px and angle: stripes of a long line
SPACING = 1.0 / 320.0  # distance of the points of markings, in units of the field's diagonal
MARGIN = 0.02  # of the half extent: markings at the border of the field belong to it
# Fitted by `python -m data_tools.score_courts fit` to the cameras found in 605 pictures, in 291 of which one is right:
# frames of clips, rinks, a hall, synthetic frames and rendered views of measured cameras under their own field; courts,
# rinks and soccer under other fields.
COEFFICIENTS = np.array([-6.52, 1.94, 9.95, -8.09, 0.73, 3.97, -0.52, -0.88, -3.71])
# Of an accepted camera. In 328 pictures of their own field (`data_tools.score_courts`) 289 first cameras are right; of
# these 272 are accepted from here on, 268 from 0.75 on, of the wrong ones 7 by either, and none of 256 of other fields.
LEAST_PROBABILITY = 0.65
LEAST_SCORE = 250.0  # three lines fit many cameras: with a lower one the markings in view must show their paint
UNKNOWN = 0.5  # share of painted markings where the paint of none should be visible
LEAST_MEAN, LEAST_MISFIT = 0.2, 0.05  # smaller ones tell no more
MOST_RIVAL = 1.3  # of the runner-up
MOST_OFF = 3  # markings off their paint: more tell no more
FEW_EXPLAINED, RIVAL, LITTLE_PAINT, LITTLE, FEW_CONFIRMED = 0.85, 0.9, 0.7, 1.2, 4  # from which on evidence is a doubt


@dataclass(frozen=True)
class CourtEvidence:
    """Evidence of the stripes in a picture for a camera."""

    score: float
    """Log likelihood ratio of the projected markings (`fieldcalib.images.stripe_likelihood`)."""
    mean: float
    """The same for each independent point in view whose paint should be found."""
    explained: float
    """Share of the long stripes on the field, of the colour of the markings, that lie on projected markings, those
    above the ground included; by their contrast, since the grain of wood is striped too."""
    runner_up: float
    """Score of the best camera of the search that projects the field elsewhere, as a share of this one's."""
    paint: float
    """Share of the places along the markings in view that show paint (`fieldcalib.assess.markings`)."""
    visible: float
    """Share of the points in view whose paint should be found: far lines are too thin."""
    confirmed: int
    """Number of markings that show paint nearly everywhere, at enough places."""
    painted: float
    """Share of the markings in view whose paint should be visible that show it nearly everywhere; `UNKNOWN` if there
    are none, since far lines of large fields are thin."""
    off: int
    """Number of markings that lie beside their paint, or that show none."""
    misfit: float
    """Root mean square distance of the lines from their markings, pixels of a 960 x 540 image."""
    is_above: bool
    """Whether the camera stands above the field, as few do."""

    @property
    def features(self) -> Array:
        """What the odds are computed from, (9,): 1 and the evidence; mean, confirmed and misfit as logarithms."""
        mean, runner_up = np.log(max(self.mean, LEAST_MEAN)), min(self.runner_up, MOST_RIVAL)
        confirmed, misfit = np.log1p(self.confirmed), np.log(max(self.misfit, LEAST_MISFIT))
        off, above = min(self.off, MOST_OFF), float(self.is_above)
        return np.array([1.0, mean, self.explained, runner_up, confirmed, self.painted, off, misfit, above])

    @property
    def odds(self) -> float:
        """Odds of the camera against that none of those that were refined is right."""
        return float(np.exp(self.features @ COEFFICIENTS))

    @property
    def is_enough(self) -> bool:
        """Whether it is enough for a probability to be believed."""
        return self.score >= LEAST_SCORE or self._paint_shown >= LITTLE_PAINT

    @property
    def doubts(self) -> tuple[str, ...]:
        """Evidence against the camera, in words."""
        found = {
            "few of the field's lines are in view": self.score < LEAST_SCORE or self.confirmed < FEW_CONFIRMED,
            f"only {100.0 * self.explained:.0f} % of the long lines on the field are markings of it": (
                self.explained < FEW_EXPLAINED
            ),
            "another camera explains the picture nearly as well": self.runner_up > RIVAL,
            f"only {100.0 * self.paint:.0f} % of the markings in view show paint": self._paint_shown < LITTLE_PAINT,
            "the picture has few lines where the markings are projected": self.mean < LITTLE,
        }
        return tuple(text for text, is_true in found.items() if is_true)

    @property
    def _paint_shown(self) -> float:
        """`paint` as a share of what should be found, at most 1."""
        return min(self.paint / max(self.visible, self.paint, 1e-9), 1.0)


def probabilities(odds: Array, are_alike: BoolArray) -> Array:
    """Probability (N,) of each of N cameras that were searched for in a picture, one of which may be right, or none.

    It is ``sum of the odds of those like it / (1 + sum of all odds)``.

    Parameters
    ----------
    odds : (N,) array
        `CourtEvidence.odds`.
    are_alike : (N, N) array of bool
        Which cameras project the field about alike, each camera with itself too.

    Examples
    --------
    >>> probabilities(np.array([8.0, 1.0]), np.eye(2, dtype=bool)).tolist()
    [0.8, 0.1]
    """
    return np.asarray(are_alike @ odds / (1.0 + np.sum(odds)))


@dataclass(frozen=True, eq=False)
class Picture:
    """The stripes of a picture, prepared for the comparison with many cameras."""

    stripes: Stripes
    is_long: BoolArray
    """Which stripes lie on a long line, (N,)."""
    colours: StripeColours
    maps: StripeMaps

    def explained(self, field: Field, camera: Camera) -> float:
        """Share of the long stripes on the field, of the paint's colour, that lie on markings, by their contrast."""
        from scipy.spatial import cKDTree

        xy = self.stripes.xy[self.is_long]
        ground = camera.image_to_field(xy)[:, :2]
        on_field = np.all(np.abs(ground) < field.half_extent * (1.0 + MARGIN), axis=1)  # false for the sky
        spacing = SPACING * float(np.hypot(field.length, field.width))
        markings = np.concatenate([segment.sample(spacing) for segment in field.markings.values()])
        seen = camera.project(markings)
        seen = seen[np.all(np.isfinite(seen), axis=1)]
        if not np.any(on_field) or not len(seen):
            return 0.0
        distance, _ = cKDTree(seen).query(xy[on_field], distance_upper_bound=EXPLAINED)
        explained = np.isfinite(distance)
        is_paint = explained | self.colours.take(np.flatnonzero(self.is_long)[on_field]).are_like(explained)
        contrast = np.where(is_paint, self.stripes.contrast[self.is_long][on_field], 0.0)
        return float(np.sum(contrast[explained]) / np.sum(contrast))


def lying_on(stripes: Stripes, lines: LongLines) -> list[BoolArray]:
    """Which stripes lie on each long line, (N,) masks."""
    found = []
    for normal, offset in zip(lines.normal, lines.offset, strict=True):
        turn = stripes.angle - np.arctan2(normal[0], -normal[1])
        turn -= np.pi * np.round(turn / np.pi)
        found.append((np.abs(stripes.xy @ normal - offset) < ON_LINE) & (np.abs(turn) < ALONG_LINE))
    return found
