"""Systems of tied frames: sparse matrices of many frames give what dense ones of few give, in far less memory."""

import tracemalloc

import numpy as np
import pytest

from fieldcalib.problem import coupled_frames
from fieldcalib.problem.cost_term import Coupling
from fieldcalib.problem.coupled_frames import solved, spread_and_solved

OWN = 4


def system(count, rng, ties=3):
    """A symmetric, positive definite system, in which each frame is tied to some before it, also twice to one."""
    second = np.repeat(np.arange(1, count), ties)
    first = np.maximum(second - rng.integers(1, 13, size=len(second)), 0)
    J = rng.normal(size=(len(first), 2, 6, OWN)) * 10.0 ** rng.uniform(-2.0, 2.0, size=OWN)
    blocks = np.zeros((count, OWN, OWN))
    squares = np.swapaxes(J, 2, 3) @ J
    np.add.at(blocks, first, squares[:, 0])
    np.add.at(blocks, second, squares[:, 1])
    blocks += np.eye(OWN)
    return blocks, Coupling(first, second, np.swapaxes(J[:, 0], 1, 2) @ J[:, 1])


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def both(blocks, coupling, between, rights):
    spread, found = spread_and_solved(blocks, coupling, between, rights)
    return solved(blocks, coupling, rights[0]), spread, *found


def test_many_frames_are_solved_as_few_are(monkeypatch, rng):
    blocks, coupling = system(70, rng)
    between = system(70, rng)[0]
    rights = rng.normal(size=(70, OWN, 7)), rng.normal(size=(70, OWN, 2))
    dense = both(blocks, coupling, between, rights)
    monkeypatch.setattr(coupled_frames, "MOST_DENSE", 0)
    monkeypatch.setattr(coupled_frames, "AT_ONCE", 16)
    sparse = both(blocks, coupling, between, rights)
    assert len(dense) == len(sparse) == 4
    for few, many in zip(dense, sparse, strict=True):
        assert few.shape == many.shape
        np.testing.assert_allclose(many, few, rtol=1e-8, atol=1e-10 * np.max(np.abs(few)))


def peak_of(function, *arguments):
    """The result of a function, and the bytes that it held at most."""
    tracemalloc.start()
    try:
        return function(*arguments), tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_memory_grows_with_the_number_of_frames(rng):
    """Dense matrices of 3000 frames take a gigabyte each."""
    blocks, coupling = system(3000, rng)
    found, peak = peak_of(solved, blocks, coupling, np.ones((3000, OWN, 3)))
    assert found.shape == (3000, OWN, 3)
    assert peak < 2**26


@pytest.mark.slow
def test_so_does_that_of_their_errors(rng):
    blocks, coupling = system(3000, rng)
    (spread, _), peak = peak_of(spread_and_solved, blocks, coupling, blocks, [np.ones((3000, OWN, 3))])
    assert spread.shape == (3000, OWN, OWN)
    assert peak < 2**28


def test_a_singular_system_is_told(monkeypatch):
    pair = Coupling(np.array([0]), np.array([1]), np.array([[[2.0]]]))
    blocks, right = np.full((2, 1, 1), 2.0), np.ones((2, 1, 1))
    for most in (9, 0):
        monkeypatch.setattr(coupled_frames, "MOST_DENSE", most)
        with pytest.raises(np.linalg.LinAlgError):
            solved(blocks, pair, right)
