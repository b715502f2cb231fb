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
# Fitted by `python -m data_tools.score_courts fit` to the best camera of 163 pairs of picture and field, 61 of them
# right: frames of courts and synthetic ones under their own field; soccer, courts and nonsense under other fields.
COEFFICIENTS = np.array([-23.63, 2.41, 0.2, 0.62, 0.76, 4.53, 2.83])
# Of an accepted camera. Each fitted without itself, 51 of the 61 right ones have it, and of the 102 wrong ones none:
# the most probable of these has 0.72.
LEAST_PROBABILITY = 0.8
NO_RIVAL = 100.0  # margin: a worse runner-up, or none, says more of the few lines in view than of the camera
LEAST_SCORE = 250.0  # of an accepted camera: three lines fit many cameras
FEW_EXPLAINED, RIVAL, LITTLE_PAINT, LITTLE = 0.85, 30.0, 0.7, 1.2  # from which on evidence is named as a doubt


@dataclass(frozen=True)
class CourtEvidence:
    """Evidence of the stripes in a picture for a camera."""

    score: float
    """Log likelihood ratio of the projected markings (`fieldcalib.images.stripe_likelihood`)."""
    mean: float
    """The same for each independent point in view whose paint should be found."""
    explained: float
    """Share of the long stripes on the field, of the colour of the markings, that lie on projected markings, those
    above the ground included."""
    long_stripes: int
    """Pixels of these stripes."""
    runner_up: float
    """Score of the best camera that projects the field elsewhere, as a share of this one's; 1 if that is as good."""
    paint: float
    """Share of the places along the markings in view that show paint (`fieldcalib.assess.markings`)."""
    visible: float
    """Share of the points in view whose paint should be found: far lines are too thin."""

    @property
    def features(self) -> Array:
        """What the probability is computed from, (7,): 1, logarithms of score and margin, the other shares, and whether
        nearly all long stripes are explained."""
        score, margin = np.log(max(self.score, 1.0)), np.log1p(min(self.margin, NO_RIVAL))
        nearly_all = float(self.explained > FEW_EXPLAINED)
        return np.array([1.0, score, self.mean, self.explained, margin, self.paint_shown, nearly_all])

    @property
    def paint_shown(self) -> float:
        """`paint` as a share of what should be found, at most 1."""
        return min(self.paint / max(self.visible, self.paint, 1e-9), 1.0)

    @property
    def margin(self) -> float:
        """By how much the score exceeds that of the runner-up, 0 or more."""
        return self.score * max(1.0 - self.runner_up, 0.0) if self.score > 0.0 else 0.0

    @property
    def probability(self) -> float:
        """Probability that the camera is right, by a logistic model; it knows that the camera was searched for."""
        return float(1.0 / (1.0 + np.exp(-self.features @ COEFFICIENTS)))

    @property
    def is_enough(self) -> bool:
        """Whether the camera is probable enough to be used."""
        return self.probability >= LEAST_PROBABILITY and self.score >= LEAST_SCORE

    @property
    def doubts(self) -> tuple[str, ...]:
        """Evidence against the camera, in words."""
        found = {
            "few of the field's lines are in view": self.score < LEAST_SCORE,
            f"only {100.0 * self.explained:.0f} % of the long lines on the field are markings of it": (
                self.explained < FEW_EXPLAINED
            ),
            "another camera explains the picture nearly as well": self.margin < RIVAL,
            f"only {100.0 * self.paint:.0f} % of the markings in view show paint": self.paint_shown < LITTLE_PAINT,
            "the picture has few lines where the markings are projected": self.mean < LITTLE,
        }
        return tuple(text for text, is_true in found.items() if is_true)


@dataclass(frozen=True, eq=False)
class Picture:
    """The stripes of a picture, prepared for the comparison with many cameras."""

    stripes: Stripes
    is_long: BoolArray
    """Which stripes lie on a long line, (N,)."""
    colours: StripeColours
    maps: StripeMaps

    def explained(self, field: Field, camera: Camera) -> tuple[float, int]:
        """Share of the long stripes on the field, of the paint's colour, that lie on markings; the number of them."""
        from scipy.spatial import cKDTree

        xy = self.stripes.xy[self.is_long]
        ground = camera.image_to_field(xy)[:, :2]
        on_field = np.all(np.abs(ground) < field.half_extent * (1.0 + MARGIN), axis=1)  # false for the sky
        spacing = SPACING * float(np.hypot(field.length, field.width))
        markings = np.concatenate([segment.sample(spacing) for segment in field.markings.values()])
        seen = camera.project(markings)
        seen = seen[np.all(np.isfinite(seen), axis=1)]
        if not np.any(on_field) or not len(seen):
            return 0.0, 0
        distance, _ = cKDTree(seen).query(xy[on_field], distance_upper_bound=EXPLAINED)
        explained = np.isfinite(distance)
        is_paint = explained | self.colours.take(np.flatnonzero(self.is_long)[on_field]).are_like(explained)
        return float(np.mean(explained[is_paint])), int(np.count_nonzero(is_paint))


def lying_on(stripes: Stripes, lines: LongLines) -> list[BoolArray]:
    """Which stripes lie on each long line, (N,) masks."""
    found = []
    for normal, offset in zip(lines.normal, lines.offset, strict=True):
        turn = stripes.angle - np.arctan2(normal[0], -normal[1])
        turn -= np.pi * np.round(turn / np.pi)
        found.append((np.abs(stripes.xy @ normal - offset) < ON_LINE) & (np.abs(turn) < ALONG_LINE))
    return found
