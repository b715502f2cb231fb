"""The estimation problem: observations, parameters, robust losses, residuals with their Jacobian, solvers."""
