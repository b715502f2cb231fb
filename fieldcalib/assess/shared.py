"""How well frames together determine what they share."""

from __future__ import annotations

import numpy as np

from fieldcalib._types import Array
from fieldcalib.assess.noise import Noise
from fieldcalib.problem.evaluation import Evaluation
from fieldcalib.problem.levenberg_marquardt import eliminated


def shared_covariance(evaluation: Evaluation, sigma: Array, kappa: Array) -> tuple[Array, Array]:
    """Covariance (S, S) of the shared parameters of one group of frames, and the inverse of their curvature.

    The sandwich of `fieldcalib.assess.uncertainty`, the frames' own parameters following the shared ones. Noise is
    independent from frame to frame, but a line that is painted elsewhere is so in every frame: that stays, however
    many frames there are. What links the frames has weights that are one over its variance.

    Parameters
    ----------
    evaluation : Evaluation
        Of T frames at the solution.
    sigma : (T,) array
        Standard deviation of the pixels as the robust loss lets it through.
    kappa : (T,) array
        By which the loss bends less than the Gauss-Newton Hessian says.

    References
    ----------
    Triggs et al.: Bundle Adjustment - A Modern Synthesis, 2000, section 6.1 (the Schur complement).
    """
    shared = evaluation.problem.layout.shared
    information = kappa[:, None, None] * evaluation.information
    prior = np.zeros_like(information)
    if evaluation.problem.prior is not None:
        diagonal = np.arange(len(shared))
        prior[:, diagonal, diagonal] = 1.0 / np.square(evaluation.pulling_prior_sigma)
    hessian = information + prior + evaluation.links_hessian
    following, _ = eliminated(hessian, evaluation.gradient, ~shared, evaluation.coupling)
    # L takes errors of the gradient to those by the shared parameters, with the cameras following
    L = np.zeros((len(hessian), int(np.count_nonzero(shared)), len(shared)))
    L[:, :, ~shared], L[:, :, shared] = -np.swapaxes(following, 1, 2), np.eye(L.shape[1])
    noise = Noise(evaluation)
    pull = evaluation.pull * noise.relative_sigma
    between = np.square(sigma)[:, None, None] * noise.covariance(evaluation.JT, pull, pull) + prior
    inverse = np.linalg.inv(np.sum(L @ hessian[:, :, shared], axis=0))
    painted = np.sum(L @ noise.by_line(evaluation.JT, evaluation.pull), axis=0)
    spread = np.sum(L @ (between + evaluation.links_hessian) @ np.swapaxes(L, 1, 2), axis=0) + painted @ painted.T
    if evaluation.coupling is not None:
        first, second, blocks = evaluation.coupling
        crossed = np.sum(L[first][:, :, ~shared] @ blocks @ np.swapaxes(L[second][:, :, ~shared], 1, 2), axis=0)
        spread += crossed + crossed.T
    return inverse @ spread @ inverse, inverse


def by_considered(evaluation: Evaluation, kappa: Array, inverse: Array) -> Array:
    """How errors of the shared parameters follow those of what is kept at an uncertain value, (S, c).

    Parameters
    ----------
    evaluation : Evaluation
        Of T frames at the solution.
    kappa : (T,) array
        As in `shared_covariance`, which gives `inverse` too.
    inverse : (S, S) array
    """
    layout = evaluation.problem.layout
    own = ~layout.shared
    hessian = evaluation.hessian + (kappa - 1.0)[:, None, None] * evaluation.information
    by_kept = evaluation.derivatives(layout.considered)
    border = kappa[:, None, None] * ((evaluation.JT * evaluation.pull[:, None]) @ np.swapaxes(by_kept, 1, 2))
    following, _ = eliminated(hessian, evaluation.gradient, own, evaluation.coupling)
    right = border[:, layout.shared] - np.swapaxes(following, 1, 2) @ border[:, own]
    return np.asarray(-inverse @ np.sum(right, axis=0))


def gradients_by_shared(evaluation: Evaluation, kappa: Array) -> Array:
    """Gradients (T, S) of the cost of each frame's labels by the shared parameters, its own following them.

    At the solution their sum vanishes, but for what the prior and links of the frames pull.

    Parameters
    ----------
    evaluation : Evaluation
        Of T frames at the solution.
    kappa : (T,) array
        As in `shared_covariance`.
    """
    shared = evaluation.problem.layout.shared
    hessian = evaluation.hessian + (kappa - 1.0)[:, None, None] * evaluation.information
    following, _ = eliminated(hessian, evaluation.gradient, ~shared, evaluation.coupling)
    gradient = (evaluation.JT @ (evaluation.pull * evaluation.r)[..., None])[..., 0]
    through_own = (np.swapaxes(following, 1, 2) @ gradient[:, ~shared, None])[..., 0]
    return np.asarray(gradient[:, shared] - through_own)
