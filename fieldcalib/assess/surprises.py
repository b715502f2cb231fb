"""Unusual estimates: parameters far from their prior, or fixed at values that the labels contradict."""

from __future__ import annotations

import numpy as np

from fieldcalib.assess.uncertainty import Uncertainty
from fieldcalib.assess.words import Finding, What
from fieldcalib.problem.prior import is_whole_shape

UNUSUAL = 2.8  # z-score under the prior: 1 in 200 if it is normal; 8 of 728 annotated frames have one above 2.5
CONTRADICTED = 5.0  # standard deviations between a fixed value and the labels' one: up to 4.4 on annotated frames
# Standard deviations between a given value and the labels' one. Of 2,768 random frames (data_tools.random_frames) with
# right values and otherwise good, 2 are beyond.
CONTRADICTS_GIVEN = 3.0
LEAST_ASPECT = 0.02  # log aspect: annotation and resampling cause less
LEAST_SQUASH = 0.08  # log aspect: other pictures that are shown as 16:9 come from 16:10 (0.105) or 4:3 (0.29)
LEAST_LENS = 0.01  # relative displacement at the corner by k2
LEAST_SIZE = 0.1  # probability of the given size of the field
# Errors of given values: the least one that is worth a word, and the standard deviation of wrong values. In radians,
# log focal length, metres, shares of the width of the picture, and relative displacement at the corner.
WRONG_GIVEN = {
    **dict.fromkeys(("pan", "tilt", "roll"), (0.01, 0.1)),
    "log f": (0.03, 0.3),
    **dict.fromkeys("xyz", (0.5, 10.0)),
    **dict.fromkeys(("cx", "cy"), (0.01, 0.1)),
    "a1": (LEAST_LENS, 0.1),
}
NAMES = {  # of parameters that may be unusual: as what they are told
    **{name: name for name in ("log f", "z", "roll", "tilt", "pan")},
    **dict.fromkeys("xy", "place"),
    **dict.fromkeys(("cx", "cy"), "principal point"),
    **dict.fromkeys(("a1", "b2"), "lens"),
}


def surprises(uncertainty: Uncertainty) -> tuple[Finding, ...]:
    """Find what is unusual about an estimate; nothing for an ordinary camera.

    Examples
    --------
    >>> from fieldcalib import Camera, calibrate_from_segments, soccer
    >>> truth = Camera.from_angles(0.2, 1.35, 0.0, 1400.0, (1.0, 65.0, -16.0), (960, 540))
    >>> labels = ("Side line top", "Side line right", "Big rect. right main", "Big rect. right top", "Circle right")
    >>> pixels = {label: truth.project(soccer()[label].sample(4.0)) for label in labels}
    >>> surprises(calibrate_from_segments(soccer(), pixels, (960, 540)).uncertainty)
    ()
    """
    found: dict[Finding, None] = {}  # an ordered set
    problem = uncertainty.problem
    if problem.prior is not None:
        names = np.array(problem.layout.names)[problem.free]
        for name, z in zip(names, problem.prior_residuals(uncertainty.evaluation.theta)[0], strict=True):
            if abs(z) > UNUSUAL and name in NAMES:
                found[Finding(What.UNUSUAL, NAMES[name])] = None
    whole = is_whole_shape(problem.layout.image_size)
    for name, least, what in (
        ("log aspect", LEAST_SQUASH if whole else LEAST_ASPECT, What.NOT_SQUARE),
        ("b2", LEAST_LENS, What.MORE_LENS),
    ):
        offset, sigma = uncertainty.offsets.get(name, (0.0, 1.0))
        if abs(offset) > max(least, CONTRADICTED * sigma):
            found[Finding(what)] = None
    contradicted = _contradicted(uncertainty)
    if contradicted is not None:
        found[Finding(What.CONTRADICTED, contradicted, (uncertainty.off_given[contradicted][0],))] = None
    given = problem.layout.field_size
    if uncertainty.size is not None and given is not None and uncertainty.size.as_given < LEAST_SIZE:
        length, width = np.clip(given.given + uncertainty.size.mean, *given.limits)
        found[Finding(What.OTHER_SIZE, numbers=(float(length), float(width)))] = None
    return tuple(found)


def _contradicted(uncertainty: Uncertainty) -> str | None:
    """The given value that the labels contradict most; None if they agree with all of them.

    One wrong value pulls all others with it: each is freed alone, under a prior around what was given. The score is
    the root of twice the fall of the cost, with the noise that is left after it (a t statistic): a wrong value makes
    the noise look larger than it is.
    """
    dof = uncertainty.dof
    scores = {}
    for name, (offset, sigma) in uncertainty.off_given.items():
        unit = uncertainty.layout.image_size[0] if name in ("cx", "cy") else 1.0
        least, wrong = (unit * value for value in WRONG_GIVEN[name])
        if abs(offset) > least:
            fall = abs(offset) * wrong / (sigma * np.hypot(sigma, wrong))
            scores[name] = fall * np.sqrt((dof - 1.0) / max(dof - fall**2, 1.0))
    most = max(scores, key=lambda name: scores[name], default=None)
    return most if most is not None and scores[most] > CONTRADICTS_GIVEN else None
