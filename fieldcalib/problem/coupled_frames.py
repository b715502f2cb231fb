"""Linear systems of all own parameters of frames that are tied to one another.

The matrix has a block for each frame and one for each pair of tied frames. Those are few: a frame is tied to a few
keyframes near it. Of many frames the matrix is factored as a sparse one, so that memory and time grow with their number
and not with its square and cube: dense matrices of 3000 frames take a gigabyte each. Small ones are solved as dense
matrices.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from fieldcalib._types import Array
from fieldcalib.problem.cost_term import Coupling

MOST_DENSE = 2000  # unknowns: a dense matrix of 32 MB
AT_ONCE = 64  # frames whose columns of the inverse are held at once


def solved(blocks: Array, coupling: Coupling, right: Array) -> Array:
    """Solve the system of B frames with o own parameters each, for the right-hand sides (B, o, n).

    Parameters
    ----------
    blocks : (B, o, o) array
        Diagonal of the symmetric, positive definite matrix.
    coupling : Coupling
        Blocks beside it.
    right : (B, o, n) array

    Raises
    ------
    numpy.linalg.LinAlgError
        If the matrix is singular.

    Examples
    --------
    >>> pair = Coupling(np.array([0]), np.array([1]), np.array([[[1.0]]]))
    >>> solved(np.array([[[2.0]], [[2.0]]]), pair, np.array([[[3.0]], [[3.0]]])).ravel().tolist()
    [1.0, 1.0]
    """
    B, o = blocks.shape[:2]
    stacked = right.reshape(B * o, -1)
    if B * o > MOST_DENSE:
        return np.asarray(_sparse_solver(blocks, coupling)(stacked)).reshape(right.shape)
    return np.asarray(np.linalg.solve(_dense(blocks, coupling), stacked)).reshape(right.shape)


def spread_and_solved(
    blocks: Array, coupling: Coupling, between: Array, rights: Sequence[Array]
) -> tuple[Array, list[Array]]:
    """Covariance (B, o, o) of each frame's solution, and the solutions for right-hand sides (B, o, n).

    With A the matrix of the system and C the covariance of a right-hand side, which is `between` (B, o, o) on its
    diagonal and the coupling beside it, these are the blocks on the diagonal of ``A^-1 C A^-1``.
    """
    B, o = blocks.shape[:2]
    stacked = [right.reshape(B * o, -1) for right in rights]
    if B * o > MOST_DENSE:
        solve, C = _sparse_solver(blocks, coupling), _sparse(between, coupling)
        spread = np.empty((B, o, o))
        for begin in range(0, B, AT_ONCE):
            count = min(AT_ONCE, B - begin)
            columns = np.zeros((B * o, count * o))
            columns[begin * o : (begin + count) * o] = np.eye(count * o)
            columns = solve(columns)  # of A^-1
            inverse, moved = (np.moveaxis(one.reshape(B * o, count, o), 1, 0) for one in (columns, C @ columns))
            spread[begin : begin + count] = np.swapaxes(inverse, 1, 2) @ moved
        found = [solve(one) for one in stacked]
    else:
        whole = np.linalg.inv(_dense(blocks, coupling))
        of_pairs = (whole @ _dense(between, coupling) @ whole).reshape(B, o, B, o)
        spread = of_pairs[np.arange(B), :, np.arange(B)]
        found = [whole @ one for one in stacked]
    return spread, [one.reshape(right.shape) for one, right in zip(found, rights, strict=True)]


def _dense(blocks: Array, coupling: Coupling) -> Array:
    """The matrix (B o, B o) with the blocks (B, o, o) on its diagonal and those of the coupling beside it."""
    B, o = blocks.shape[:2]
    whole = np.zeros((B, B, o, o))
    whole[np.arange(B), np.arange(B)] = blocks
    np.add.at(whole, (coupling.first, coupling.second), coupling.blocks)
    np.add.at(whole, (coupling.second, coupling.first), np.swapaxes(coupling.blocks, 1, 2))
    return np.swapaxes(whole, 1, 2).reshape(B * o, B * o)


def _sparse(blocks: Array, coupling: Coupling) -> Any:
    """The same matrix as a sparse one of columns."""
    from scipy.sparse import coo_matrix

    B, o = blocks.shape[:2]
    first = np.concatenate([np.arange(B), coupling.first, coupling.second])
    second = np.concatenate([np.arange(B), coupling.second, coupling.first])
    values = np.concatenate([blocks, coupling.blocks, np.swapaxes(coupling.blocks, 1, 2)])
    row, column = (np.broadcast_to(one, values.shape).ravel() for one in _indices(first, second, o))
    return coo_matrix((values.ravel(), (row, column)), shape=(B * o, B * o)).tocsc()  # adds up repeated ones


def _indices(first: Array, second: Array, o: int) -> tuple[Array, Array]:
    within = np.arange(o)
    return (first[:, None] * o + within)[:, :, None], (second[:, None] * o + within)[:, None, :]


def _sparse_solver(blocks: Array, coupling: Coupling) -> Callable[[Array], Array]:
    from scipy.sparse.linalg import splu

    try:
        # for symmetric, positive definite matrices: the order of the unknowns by A + A^T, pivots on the diagonal
        factors = splu(
            _sparse(blocks, coupling),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError as error:
        raise np.linalg.LinAlgError(str(error)) from None
    return factors.solve  # type: ignore[no-any-return]
