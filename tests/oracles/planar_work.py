"""Virtual work of the parts of a planar robot of three legs, by differences with fifty digits."""

from collections.abc import Callable

import mpmath as mp
import numpy as np

from framework import CrossingPlan


def assert_virtual_work(plan: CrossingPlan, bodies: Callable, gear: mp.mpf, within: float) -> None:
    """Assert that the torques do the work of all masses, at the one crossing as elsewhere."""
    (crossing,) = plan.crossings
    beside = [crossing.time - 1e-3, crossing.time, crossing.time + 1e-3]
    for t in [*(plan.duration * np.array([0.0, 0.2, 0.4, 0.8, 0.93])), *beside]:
        work, J = work_and_jacobian(bodies, gear, *(plan.platform(t, order) for order in range(3)))
        np.testing.assert_allclose(J.T @ plan.torque(t), work, atol=within)
    # and at the crossing this work vanishes along the motion that the motors do not hold
    work, _ = work_and_jacobian(bodies, gear, *(plan.platform(crossing.time, order) for order in range(3)))
    assert abs(work @ crossing.twist) < 1e-10


def work_and_jacobian(bodies: Callable, gear: mp.mpf, x, dx, ddx) -> tuple[np.ndarray, np.ndarray]:
    """Return (3,) that J' tau on the motor side must equal, and J = d(motor angles)/dx (3, 3).

    D'Alembert: `bodies(x)` has inertia and coordinate of every moving part, so that the kinetic energy is the
    sum of 0.5 m dy^2; the motors' coordinates are the fourth, the eighth and the twelfth.
    """
    with mp.workdps(50):
        x, dx, ddx = ([mp.mpf(float(v)) for v in values] for values in (x, dx, ddx))
        h = mp.mpf("1e-15")

        def at(t):
            moved = [a + b * t + c * t**2 / 2 for a, b, c in zip(x, dx, ddx, strict=True)]
            return [value for _, value in bodies(moved)]

        inertia = [m for m, _ in bodies(x)]
        ahead, here, back = at(h), at(0), at(-h)
        acceleration = [(a - 2 * b + c) / h**2 for a, b, c in zip(ahead, here, back, strict=True)]
        work, J = np.zeros(3), np.zeros((3, 3))
        for k in range(3):
            ends = [[v + (sign * h if j == k else 0) for j, v in enumerate(x)] for sign in (1, -1)]
            up, down = ([value for _, value in bodies(end)] for end in ends)
            slope = [(a - b) / (2 * h) for a, b in zip(up, down, strict=True)]
            work[k] = sum(m * a * d for m, a, d in zip(inertia, acceleration, slope, strict=True))
            J[:, k] = [gear * slope[3 + 4 * leg] for leg in range(3)]
        return work, J
