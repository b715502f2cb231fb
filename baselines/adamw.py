"""AdamW with a one-cycle learning rate schedule, for many small problems at once.

Adam with decoupled weight decay (Loshchilov, Hutter: Decoupled Weight Decay Regularization, ICLR 2019) whose learning
rate rises and falls once while its momentum falls and rises (Smith, Topin: Super-Convergence, 2019), with
PyTorch's default constants and those of the paper (section "Hyperparameters").
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fieldcalib._types import Array

LEARNING_RATE = 0.05  # at its largest
START_DIVISOR = 25.0  # the cycle starts at LEARNING_RATE / START_DIVISOR
END_DIVISOR = 1e4  # it ends at this start / END_DIVISOR
RISING = 0.5  # share of the steps in which the learning rate rises
MOMENTUM = (0.85, 0.95)  # beta1 at the largest learning rate, and at both ends of the cycle
BETA2 = 0.999
EPSILON = 1e-8
WEIGHT_DECAY = 0.01
LEAST_STEPS = 3  # the first, one that rises and one that falls


def one_cycle(steps: int) -> tuple[Array, Array]:
    """Learning rate and beta1 of each step, (steps,) each; they follow cosines between start, peak and end.

    Raises
    ------
    ValueError
        If there are fewer than three steps.

    Examples
    --------
    >>> rate, beta1 = one_cycle(2000)
    >>> rate[[0, 999, 1999]]
    array([2.e-03, 5.e-02, 2.e-07])
    >>> beta1[[0, 999, 1999]]
    array([0.95, 0.85, 0.95])
    """
    if steps < LEAST_STEPS:
        raise ValueError(f"steps must be at least {LEAST_STEPS}, a rise and a fall; got {steps}")
    peak, end = RISING * steps - 1.0, steps - 1.0
    start_rate = LEARNING_RATE / START_DIVISOR
    low, high = MOMENTUM
    step = np.arange(steps)
    risen = (1.0 - np.cos(np.pi * step / peak)) / 2.0  # 0 to 1
    fallen = (1.0 - np.cos(np.pi * (step - peak) / (end - peak))) / 2.0
    rising = step <= peak
    rate = np.where(
        rising,
        start_rate + (LEARNING_RATE - start_rate) * risen,
        LEARNING_RATE + (start_rate / END_DIVISOR - LEARNING_RATE) * fallen,
    )
    beta1 = np.where(rising, high + (low - high) * risen, low + (high - low) * fallen)
    return rate, beta1


def minimise(gradient: Callable[[Array], Array], z: Array, steps: int) -> Array:
    """Minimise from z by `steps` steps. Elements are independent, so many problems can share an array.

    With m and v the running means of the gradient and of its square, corrected for their initialisation at 0,

        z <- (1 - rate x WEIGHT_DECAY) z - rate m / (sqrt(v) + EPSILON).

    Parameters
    ----------
    gradient : callable
        Maps z to the derivative of the loss, which has the shape of z.
    z : array
        Initial value.
    steps : int
        Length of the cycle.

    Examples
    --------
    >>> minimise(lambda z: z - [1.0, -2.0], np.zeros(2), 1000).round(1)
    array([ 1., -2.])
    """
    m, v = np.zeros_like(z), np.zeros_like(z)
    for step, (rate, beta1) in enumerate(zip(*one_cycle(steps), strict=True), start=1):
        g = gradient(z)
        m = beta1 * m + (1.0 - beta1) * g
        v = BETA2 * v + (1.0 - BETA2) * np.square(g)
        direction = m / (1.0 - beta1**step) / (np.sqrt(v / (1.0 - BETA2**step)) + EPSILON)
        z = (1.0 - rate * WEIGHT_DECAY) * z - rate * direction
    return z
