"""The compound score: accuracy and completeness in one number."""

from __future__ import annotations

from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from fieldcalib._checks import number, one_of, real_array

CompoundScore: TypeAlias = Literal["printed", "tables"]
WEIGHTS = (0.5, 0.35, 0.15)  # of AC@5, AC@10, AC@20


def compound_score(
    accuracies: ArrayLike, completeness: float, kind: CompoundScore = "printed", *, share: float = 1.0
) -> float:
    """CS: ``(1 - exp(-4 CR)) (0.5 AC@5 + 0.35 AC@10 + 0.15 AC@20)`` (paper, section "Metrics").

    The paper's tables do not follow this formula: the code that made them assigns the weights to the thresholds in the
    order 20, 10, 5, and for SN-Calib-test-center counts completeness over all 2719 images of the test split, of which
    1454 show the main camera. "tables" is that variant; `share` is 1454 / 2719 there, and 1 for WC14.

    Parameters
    ----------
    accuracies : (3,) array_like
        AC@5, AC@10, AC@20, 0..1.
    completeness : float
        CR, 0..1.
    kind : {"printed", "tables"}
        The formula as printed, or the one that made the paper's tables.
    share : float
        Share of the whole dataset that the evaluated frames make up, for "tables".

    Returns
    -------
    float
        0..1.

    Raises
    ------
    ValueError
        If there are not three accuracies, a number is not in 0..1, or `kind` is not valid.

    Examples
    --------
    TVCalib on ground truth segments of SN-Calib-test-center; the paper's table has 75.5:

    >>> round(100 * compound_score([0.653, 0.842, 0.926], 1.0), 1)
    74.6
    >>> round(100 * compound_score([0.653, 0.842, 0.926], 1.0, "tables", share=1454 / 2719), 1)
    75.5
    """
    one_of(kind, get_args(CompoundScore), "kind")
    values = real_array(accuracies)
    if values.shape != (3,):
        raise ValueError(f"expected AC@5, AC@10 and AC@20, got an array of shape {values.shape}")
    if number(completeness, "completeness") == 0.0:
        return 0.0  # without predictions the accuracies are NaN
    given = np.array([*values, completeness, number(share, "share")])
    if not np.all((given >= 0.0) & (given <= 1.0)):
        raise ValueError(f"expected ratios in 0..1, got {given.tolist()}; divide percentages by 100")
    if kind == "tables":
        values, completeness = values[::-1], completeness * share
    return float((1.0 - np.exp(-4.0 * completeness)) * (values @ WEIGHTS))
