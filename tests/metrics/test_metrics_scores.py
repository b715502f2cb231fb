"""The compound score, against the formula and the paper's tables."""

import numpy as np
import pytest

from fieldcalib.metrics import compound_score

SN_CENTER = 1454 / 2719  # share of the test split that shows the main camera

# AC@5, @10, @20, CR, CS in percent, of the paper's tables.
TABLES = {
    "SN-Calib-test-center, cameras": (
        SN_CENTER,
        [
            (68.7, 88.0, 96.1, 92.8, 76.9),
            (65.3, 84.2, 92.6, 100.0, 75.5),
            (53.7, 77.5, 88.4, 80.3, 65.1),
            (48.1, 68.5, 84.6, 79.8, 60.2),
            (57.6, 81.7, 93.2, 93.7, 72.6),
            (54.8, 78.5, 90.4, 100.0, 71.4),
            (40.6, 63.2, 80.4, 79.6, 55.9),
            (34.4, 64.6, 81.3, 66.6, 52.0),
        ],
    ),
    "SN-Calib-test-center, homographies": (
        SN_CENTER,
        [
            (65.0, 85.4, 95.6, 92.8, 75.5),
            (61.7, 81.6, 92.0, 100.0, 73.9),
            (57.3, 76.0, 83.7, 100.0, 68.0),
            (61.1, 81.2, 89.4, 80.3, 67.5),
            (54.7, 69.9, 81.6, 97.6, 64.4),
            (56.5, 74.3, 86.3, 79.8, 63.6),
        ],
    ),
    "WC14-test, cameras": (
        1.0,
        [
            (64.4, 86.7, 96.0, 100.0, 86.4),
            (52.8, 78.8, 91.3, 90.9, 79.0),
            (48.1, 78.9, 91.5, 90.9, 78.4),
            (32.0, 54.0, 73.1, 73.7, 57.1),
            (39.9, 71.9, 90.5, 100.0, 75.0),
            (28.1, 60.6, 80.8, 78.5, 63.0),
        ],
    ),
    "WC14-test, homographies": (
        1.0,
        [
            (62.7, 84.9, 95.5, 100.0, 85.3),
            (54.1, 82.9, 92.4, 100.0, 81.8),
            (39.2, 57.4, 72.1, 89.8, 60.3),
        ],
    ),
}


@pytest.mark.parametrize("table", TABLES)
def test_the_papers_tables(table):
    """To a digit of the table: its AC and CR are rounded too."""
    share, rows = TABLES[table]
    for *ratios, cr, cs in rows:
        ac = np.divide(ratios, 100.0)
        assert 100.0 * compound_score(ac, cr / 100.0, "tables", share=share) == pytest.approx(cs, abs=0.1)
        assert abs(100.0 * compound_score(ac, cr / 100.0) - cs) > 0.5  # the printed formula gives something else


def test_the_printed_formula():
    expected = (1.0 - np.exp(-4.0 * 0.9)) * (0.5 * 0.2 + 0.35 * 0.4 + 0.15 * 0.6)
    assert compound_score((0.2, 0.4, 0.6), 0.9) == pytest.approx(expected)
    assert compound_score((0.2, 0.4, 0.6), 0.9, "printed", share=0.5) == pytest.approx(expected)
    assert compound_score((1.0, 1.0, 1.0), 0.0) == 0.0
    assert compound_score((np.nan, np.nan, np.nan), 0.0) == 0.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0.1, 0.2], 1.0), r"expected AC@5, AC@10 and AC@20, got an array of shape \(2,\)"),
        (([65.3, 84.2, 92.6], 1.0), r"expected ratios in 0..1, .*; divide percentages by 100"),
        (([0.6, 0.8, 0.9], 100.0), "divide percentages by 100"),
        (([0.6, 0.8, 0.9], -0.1), "expected ratios in 0..1"),
        (([0.6, np.nan, 0.9], 0.5), "expected ratios in 0..1"),
        (([0.6, 0.8, 0.9], 1.0, "paper"), "kind must be one of printed, tables, got 'paper'"),
    ],
)
def test_wrong_input(arguments, message):
    with pytest.raises(ValueError, match=message):
        compound_score(*arguments)
