"""Constants of Levenberg-Marquardt, for the NumPy code and the compiled code."""

LEAST_DAMPING, LARGEST_DAMPING = 1e-12, 1e10
SETTLED = 0.1  # share of the tolerance: a smaller predicted decrease is not tried
STILL = 1e-14  # share of the cost: a smaller change is rounding
LEAST_DIAGONAL = 1e-12  # keeps the system regular if nothing determines a parameter
