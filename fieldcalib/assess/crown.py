"""How high the middle of a field may be above its touchlines, as frames of one camera tell it together.

Frames are solved on a level field. To first order their labels put the crown h off that, with a variance v that has the
noise of the pixels and the freedom of all that the frames share in it. A priori a share of the fields is level, and in
the others it is normal around 0 with variance p (`fieldcalib.fields.traits.Crown`): there h is normal with variance
``p + v``, which weighs both anew, and leaves the second moment ``(p / (p + v))^2 h^2 + p v / (p + v)``. The cameras
stay those of a level field, and that moment goes into their covariance.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fieldcalib._types import Array
from fieldcalib.assess.misfit import inflation
from fieldcalib.assess.shared import shared_covariance
from fieldcalib.problem.evaluation import Evaluation
from fieldcalib.problem.layout import Role
from fieldcalib.problem.prior import GaussianPrior


def moment_of_crown(evaluation: Evaluation, sigma: Array, kappa: Array) -> float:
    """Second moment of the crown of the field that frames see, square metres.

    Parameters
    ----------
    evaluation : Evaluation
        Of T frames at their common solution, in a layout that considers the crown.
    sigma, kappa : (T,) arrays
        As in `fieldcalib.assess.shared.shared_covariance`.
    """
    problem = evaluation.problem
    size = problem.layout.field_size
    assert size is not None
    assert size.crown is not None
    prior = problem.prior  # each frame has one, but they see one field: what is known of it comes in below, once
    if prior is not None:
        prior = GaussianPrior(prior.mean, np.where(problem.layout.is_crown, np.inf, prior.sigma))
    layout = problem.layout.with_roles(Role.SHARED, "crown")
    freed = evaluation.of(replace(problem, layout=layout, prior=prior))
    covariance, inverse = shared_covariance(freed, sigma, kappa)
    variance = inflation(freed, covariance, inverse, kappa) * covariance[-1, -1]
    offset = -inverse[-1, -1] * np.sum(freed.gradient[:, -1])  # with a gradient of 0 by all other parameters
    weights, sigma_of_crown = size.crown.possibilities
    before = np.square(sigma_of_crown)
    log = np.log(weights) - 0.5 * (np.square(offset) / (before + variance) + np.log(before + variance))
    posterior = np.exp(log - np.max(log))
    share = before / (before + variance)
    return float(posterior @ (np.square(share * offset) + share * variance) / np.sum(posterior))
