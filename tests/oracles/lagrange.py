"""Lagrange's equations of a platform's coordinates, by complex steps through closed-form energies."""

from collections.abc import Callable

import numpy as np

H = 1e-30


def platform_force(
    kinetic: Callable[[np.ndarray, np.ndarray], complex],
    potential: Callable[[np.ndarray], complex],
    x: np.ndarray,
    dx: np.ndarray,
    ddx: np.ndarray,
) -> np.ndarray:
    """What the motors must do on the coordinates (n,): d/dt dT/dx' - dT/dx + dU/dx.

    Args:
        kinetic: T(x, x'), analytic in both and quadratic in x' [J].
        potential: U(x), analytic [J].
        x, dx, ddx: coordinates and their derivatives by time (n,).
    """
    axes = np.eye(len(x))

    def momentum(y: np.ndarray, dy: np.ndarray) -> np.ndarray:  # exact because T is quadratic in the rates
        return np.array([(kinetic(y, dy + e) - kinetic(y, dy - e)) / 2 for e in axes])

    rate = momentum(x + 1j * H * dx, dx + 1j * H * ddx).imag / H
    steps = [x + 1j * H * e for e in axes]
    return rate + np.array([(potential(y) - kinetic(y, dx)).imag / H for y in steps])
