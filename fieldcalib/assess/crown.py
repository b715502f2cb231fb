"""The crown of a field, the height of its middle above the touchlines, estimated from frames of one camera together.

Frames are solved on a level field. To first order their labels give an estimate h of the crown with a variance v from
the noise of the pixels and the freedom of all shared parameters. A priori a share of the fields is level; the crown of
the others is normal around 0 with variance p (`fieldcalib.fields.traits.Crown`). So h has variance v on a level field
and ``p + v`` on the others, which gives the posterior probabilities of both; the second moment of the crown of the
others is ``(p / (p + v))^2 h^2 + p v / (p + v)``. The cameras stay those of a level field; the second moment over both
enters their covariance.
"""

from __future__ import annotations

import numpy as np

from fieldcalib.assess.shared import ReducedSystem
from fieldcalib.assess.size_evidence import possible_values
from fieldcalib.fields.traits import Crown


def moment_of_crown(system: ReducedSystem, crown: Crown) -> float:
    """Posterior second moment of the crown of a field, square metres.

    Parameters
    ----------
    system : ReducedSystem
        Normal equations of the shared parameters and, last, the crown.
    crown : Crown
        Prior distribution.
    """
    offset = -system.inverse[-1:, -1] * system.gradient[-1]  # the gradient by all other parameters is 0
    weights, sigma = crown.possibilities
    found = possible_values(offset, system.covariance[-1:, -1:], np.asarray(weights), np.reshape(sigma, (-1, 1)))
    posterior = np.exp(found.log - np.max(found.log))
    return float(posterior @ found.moments[:, 0, 0] / np.sum(posterior))
