"""Places of players in rendered clips."""

import numpy as np
import pytest

from data_tools.feet import errors_of


@pytest.mark.slow  # a clip is rendered and calibrated
def test_players_are_where_they_say():
    off, sigma = errors_of(102)
    assert len(off) > 100
    assert np.median(np.linalg.norm(off, axis=1)) < 0.15
    assert np.all(np.mean(np.abs(off) < 2.0 * sigma, axis=0) > 0.85)
