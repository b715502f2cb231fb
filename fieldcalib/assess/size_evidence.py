"""The size of a field, estimated from one frame that was calibrated at the given size.

A priori the field has the given size, with some probability, or a size that is normal around it
(`fieldcalib.fields.traits`). To first order the labels of a frame give the difference delta of the true size from the
given one, with a covariance V from the noise of the pixels and the freedom of the camera. Under the k-th possibility,
of covariance S_k, delta is normal with covariance V + S_k. That gives the posterior probabilities of the possibilities,
and the second moment of the size under each,

    M_k = m m^T + S_k - S_k (V + S_k)^-1 S_k,        m = S_k (V + S_k)^-1 delta.

A frame that shows both touchlines determines the width; one that shows neither keeps the prior. Illegal sizes are
excluded: the probability of a possibility is multiplied by the legal share of its distribution, given the labels.

A label may be on another line, or a line of a picture may be an edge beside the paint. Each possibility comes with
every kind of such mistakes: delta is then less certain than V says, by the variance of what they do to the size.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fieldcalib._types import Array
from fieldcalib.fields.traits import SOCCER_SCALE

FAINT = 1e-6  # 1 / m^2: information that is added so that the system is regular
# Mistakes in the labels of a frame: how many frames have them for each one without, and standard deviations of fitted
# length, width and crown by them, metres. None; a label of another line, which biases the size of 1 in 50 frames with
# good cameras; and, in pictures, an edge beside the paint: of 600 rendered ones (`data_tools.pitches`) a tenth of the
# lengths and widths that are told, and a sixth of the crowns, are off by this (on soccer pitches).
MISTAKEN, BY_MISTAKE = np.array([1.0, 0.02, 0.11]), np.array([[0.0, 0.0, 0.0], [30.0, 30.0, 3.0], [2.5, 2.5, 0.15]])
LEAST_ROOM = 1.0  # m: the given size is always possible, even if it is illegal


@dataclass(frozen=True, eq=False)
class SizeEvidence:
    """Estimates of c quantities from one frame: length and width of its field, or these and its crown, or its crown."""

    offset: Array
    """Fitted quantities minus those around which the prior is, (c,) metres."""
    covariance: Array
    """Covariance of the offset, (c, c)."""
    width_of_cost: Array
    """Standard deviations of the quantities if the cost were their log likelihood, in units of the true ones, (c,)."""
    weights: Array
    """Probabilities of the possibilities, (K,): those without mistakes first, in the order of the prior."""
    mean: Array
    """Each expected quantity minus that of the prior, (c,), if it is another one and there are no mistakes."""
    moments: Array
    """Second moment of the true quantities minus the given ones under each possibility, (K, c, c)."""
    as_given: float
    """Probability that the field has the size around which the prior is."""
    level: float
    """Probability that its ground is level."""

    @property
    def moment(self) -> Array:
        """Second moment (c, c) over all possibilities."""
        return np.asarray(np.tensordot(self.weights, self.moments, axes=1))

    @classmethod
    def of(
        cls,
        information: Array,
        gradient: Array,
        spread: Array,
        prior: tuple[Array, Array],
        room: Array | None = None,
        shift: Array | float = 0.0,
        *,
        are_lines: bool = False,
        scale: float = SOCCER_SCALE,
    ) -> SizeEvidence:
        """Estimate the quantities of a frame.

        Parameters
        ----------
        information : (c, c) array
            Information of the labels about the quantities, with the camera free.
        gradient : (c,) array
            Gradient of the cost by the quantities.
        spread : (c, c) array
            Covariance of the gradient.
        prior : (K,) array, (K, c) array
            Probabilities and standard deviations of the possibilities.
        room : (2, 2) array, optional
            Legal deviations of length and width from those of the prior, down (first row) and up, metres.
        shift : (c,) array
            Given quantities minus those around which the prior is.
        are_lines : bool
            Whether the labels are lines that were found in a picture.
        scale : float
            Size of the part of the field that is usually in view, metres: mistakes about smaller fields are smaller.

        Examples
        --------
        >>> prior = np.array([0.7, 0.3]), np.array([[0.0, 0.0], [5.0, 5.0]])
        >>> silent = SizeEvidence.of(np.zeros((2, 2)), np.zeros(2), np.zeros((2, 2)), prior)
        >>> silent.weights.round(3), np.sqrt(np.diagonal(silent.moment)).round(2)  # sqrt(0.3) x 5 m
        (array([0.686, 0.294, 0.014, 0.006]), array([2.74, 2.74]))
        >>> certain = SizeEvidence.of(100.0 * np.eye(2), np.array([300.0, 0.0]), 100.0 * np.eye(2), prior)
        >>> certain.offset.round(1), certain.weights.round(3), certain.mean.round(1)  # 3 m shorter, to 0.1 m
        (array([-3.,  0.]), array([0.   , 0.998, 0.002, 0.001]), array([-3.,  0.]))
        """
        weights, sigmas = prior
        count, kinds = len(gradient), 3 if are_lines else 2
        inverse = np.linalg.inv(information + FAINT * np.eye(count))
        offset = shift - inverse @ gradient
        V = inverse @ (spread + FAINT * np.eye(count)) @ inverse
        by_mistake = BY_MISTAKE[:kinds] * (scale / SOCCER_SCALE, scale / SOCCER_SCALE, 1.0)
        off = np.square(by_mistake[:, :count] if count > 1 else by_mistake[:, 2:])
        mistaken = np.repeat(V + off[:, :, None] * np.eye(count), len(weights), axis=0)
        shares, every = np.outer(MISTAKEN[:kinds], weights).ravel(), np.tile(sigmas, (kinds, 1))
        found = possible_values(offset, mistaken, shares, every)
        log = found.log
        if room is not None:
            a_priori = _legal_share(np.zeros_like(every), np.square(every)[:, :, None] * np.eye(count), room)
            log = log + np.log(_legal_share(found.means, found.covariances, room) / a_priori)
        posterior = np.exp(log - np.max(log))
        posterior /= np.sum(posterior)
        kept = np.sum(posterior.reshape(kinds, -1), axis=0)
        sizes, crown = (sigmas[:, :2], sigmas[:, 2:]) if count > 1 else (sigmas[:, :0], sigmas)
        as_given, level = (float(kept @ np.all(some == 0.0, axis=1)) for some in (sizes, crown))
        of_others = (sigmas > 0.0) * posterior[: len(weights), None]
        mean = np.sum(of_others * found.means[: len(weights)], axis=0) / np.maximum(np.sum(of_others, axis=0), FAINT)
        by_cost, true = np.diagonal(inverse), np.maximum(np.diagonal(V), FAINT)
        width = np.sqrt(np.where(by_cost > 0.0, by_cost, true) / true)  # robust costs may be concave
        moments = found._replace(means=found.means - shift).moments
        return cls(offset, V, width, posterior, mean, moments, as_given, level)


class PossibleValues(NamedTuple):
    """Normal distributions of c quantities under each of K possibilities."""

    log: Array
    """Logarithms of the probabilities of the possibilities, up to a constant, (K,)."""
    means: Array
    """Means, (K, c)."""
    covariances: Array
    """Covariances, (K, c, c)."""

    @property
    def moments(self) -> Array:
        """Second moments, (K, c, c)."""
        return np.asarray(self.means[:, :, None] * self.means[:, None, :] + self.covariances)


def possible_values(offset: Array, V: Array, weights: Array, sigmas: Array) -> PossibleValues:
    """Update a mixture of normal priors around 0 by a measurement.

    Parameters
    ----------
    offset : (c,) array
        The measurement.
    V : (c, c) or (K, c, c) array
        Its covariance, that under each prior if they differ.
    weights, sigmas : (K,), (K, c) arrays
        Probabilities of the priors, and their standard deviations.
    """
    S = np.square(sigmas)[:, :, None] * np.eye(len(offset))
    total = V + S
    inverse = np.linalg.inv(total)
    shrunk = S @ inverse  # S (V + S)^-1
    distance = np.einsum("i,kij,j->k", offset, inverse, offset)
    log = np.log(weights) - 0.5 * (distance + np.linalg.slogdet(total)[1])
    return PossibleValues(log, shrunk @ offset, S - shrunk @ S)


def _legal_share(mean: Array, covariance: Array, room: Array) -> Array:
    """Share of K normal distributions in the legal range, (K,), as if length and width were independent."""
    from scipy.special import ndtr  # a slow import

    sigma = np.sqrt(np.maximum(np.diagonal(covariance, axis1=-2, axis2=-1), FAINT))
    low, high = np.minimum(room[0], -LEAST_ROOM), np.maximum(room[1], LEAST_ROOM)
    mean, sigma = mean[:, :2], sigma[:, :2]
    share = np.prod(ndtr((high - mean) / sigma) - ndtr((low - mean) / sigma), axis=-1)
    return np.asarray(np.maximum(share, np.finfo(float).tiny))
