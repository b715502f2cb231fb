"""What one frame says about the size of its field, which is calibrated at the given one.

A priori the field has the given size, with a probability, or one that is normal around it (`fieldcalib.fields.traits`).
To first order the labels of a frame put the size delta off the given one, with a covariance V that has the noise of the
pixels and the freedom of the camera in it. Under the k-th possibility, of covariance S_k, delta is normal with V + S_k:
that weighs the possibilities anew, and leaves of the size the second moment

    M_k = m m^T + S_k - S_k (V + S_k)^-1 S_k,        m = S_k (V + S_k)^-1 delta.

A frame that shows both touchlines knows the width; one that cannot tell keeps what was known before.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fieldcalib._types import Array

FAINT = 1e-6  # 1 / m^2: information that keeps what no label tells in the system


@dataclass(frozen=True, eq=False)
class SizeEvidence:
    """What one frame says about length and width of its field."""

    offset: Array
    """Of the size that fits best from the given one, (2,) metres."""
    covariance: Array
    """Of that, (2, 2)."""
    weights: Array
    """Probabilities of the possibilities, (K,)."""
    moments: Array
    """Second moments of the true size around the given one under each, (K, 2, 2)."""

    @property
    def moment(self) -> Array:
        """Second moment over all possibilities, (2, 2)."""
        return np.asarray(np.tensordot(self.weights, self.moments, axes=1))

    @classmethod
    def of(cls, information: Array, gradient: Array, spread: Array, prior: tuple[Array, Array]) -> SizeEvidence:
        """The evidence of a frame.

        Parameters
        ----------
        information : (2, 2) array
            Of the labels about the size, the camera following.
        gradient : (2,) array
            Of the cost by the size.
        spread : (2, 2) array
            Covariance of that gradient.
        prior : (K,) array, (K, 2) array
            Probabilities and standard deviations of the possibilities.

        Examples
        --------
        >>> prior = np.array([0.7, 0.3]), np.array([[0.0, 0.0], [5.0, 5.0]])
        >>> silent = SizeEvidence.of(np.zeros((2, 2)), np.zeros(2), np.zeros((2, 2)), prior)
        >>> silent.weights.round(3), np.sqrt(np.diagonal(silent.moment)).round(2)  # sqrt(0.3) x 5 m
        (array([0.7, 0.3]), array([2.74, 2.74]))
        >>> certain = SizeEvidence.of(100.0 * np.eye(2), np.array([300.0, 0.0]), 100.0 * np.eye(2), prior)
        >>> certain.offset.round(1), certain.weights.round(3)  # 3 m shorter, to 0.1 m
        (array([-3.,  0.]), array([0., 1.]))
        """
        weights, sigmas = prior
        inverse = np.linalg.inv(information + FAINT * np.eye(2))
        offset = -inverse @ gradient
        V = inverse @ (spread + FAINT * np.eye(2)) @ inverse
        S = np.square(sigmas)[:, :, None] * np.eye(2)
        total = V + S
        shrunk = S @ np.linalg.inv(total)  # S (V + S)^-1
        mean = shrunk @ offset
        moments = mean[:, :, None] * mean[:, None, :] + S - shrunk @ S
        distance = np.einsum("i,kij,j->k", offset, np.linalg.inv(total), offset)
        log = np.log(weights) - 0.5 * (distance + np.linalg.slogdet(total)[1])
        posterior = np.exp(log - np.max(log))
        return cls(offset, V, posterior / np.sum(posterior), moments)
