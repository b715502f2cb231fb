"""How high the middle of a field may be above its touchlines, as frames of one camera tell it together.

Frames are solved on a level field. To first order their labels put the crown h off that, with a variance v that has the
noise of the pixels and the freedom of all that the frames share in it. A priori a share of the fields is level, and in
the others it is normal around 0 with variance p (`fieldcalib.fields.traits.Crown`): there h is normal with variance
``p + v``, which weighs both anew, and leaves the second moment ``(p / (p + v))^2 h^2 + p v / (p + v)``. The cameras
stay those of a level field, and that moment goes into their covariance.
"""

from __future__ import annotations

import numpy as np

from fieldcalib.assess.shared import ReducedSystem
from fieldcalib.assess.size_evidence import possible_values
from fieldcalib.fields.traits import Crown


def moment_of_crown(system: ReducedSystem, crown: Crown) -> float:
    """Second moment of the crown of the field that frames see, square metres.

    Parameters
    ----------
    system : ReducedSystem
        Of what the frames share and, last, of the crown.
    crown : Crown
        What is known a priori.
    """
    offset = -system.inverse[-1:, -1] * system.gradient[-1]  # with a gradient of 0 by all other parameters
    weights, sigma = crown.possibilities
    found = possible_values(offset, system.covariance[-1:, -1:], np.asarray(weights), np.reshape(sigma, (-1, 1)))
    posterior = np.exp(found.log - np.max(found.log))
    return float(posterior @ found.moments[:, 0, 0] / np.sum(posterior))
