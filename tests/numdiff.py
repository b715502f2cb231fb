"""Central differences: what every analytic Jacobian of the package is compared with."""

import numpy as np


def central_differences(function, x, steps):
    """Jacobian of a function by the last axis of its argument, by central differences of fourth order.

    ``df/dx_k = (8 (f(x + h) - f(x - h)) - (f(x + 2h) - f(x - 2h))) / 12h`` with h = `steps[k]` along x_k

    Parameters
    ----------
    function : callable
        Takes arrays of the shape of `x`; leading axes are a batch whose members do not touch each other.
    x : (..., n) array
    steps : float or (n,) array
        The truncation error falls with the fourth power of a step, rounding grows with its inverse.

    Returns
    -------
    (..., n) array
        The shape of ``function(x)``, and one column for each component of `x`.
    """
    x = np.asarray(x, dtype=float)
    columns = []
    for axis, h in zip(np.eye(x.shape[-1]), np.broadcast_to(steps, x.shape[-1:]), strict=True):
        near = function(x + h * axis) - function(x - h * axis)
        far = function(x + 2.0 * h * axis) - function(x - 2.0 * h * axis)
        columns.append((8.0 * near - far) / (12.0 * h))
    return np.stack(columns, axis=-1)


def column_errors(jacobian, numeric, floor):
    """Relative error (..., n) of each column of Jacobians (..., m, n): ``|J_k - N_k| / (|N_k| + floor)``.

    `floor`, in the unit of the columns, is the length below which a column counts as nothing.
    """
    length = np.linalg.norm(numeric, axis=-2)
    return np.linalg.norm(jacobian - numeric, axis=-2) / (length + floor)
