"""What exact derivatives cost and how far differences are from them, for every robot: `make bench`.

Differences are central ones over `dynamics_at`, of second order with the step that loses the fewest digits,
all poses in one stack: the quickest way to them that our public calls give. Errors of both are distances from
differences of eighth order, over the largest entry.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest

import robots
from framework import dynamics_at, dynamics_derivatives
from tests.dynamics.test_dynamics_derivatives import closed_at, slopes, state_of
from tests.robots.every_robot import CASES

pytestmark = pytest.mark.benchmark
ROUNDS, SECOND_ORDER_STEP = 10, 6e-6  # the cube root of rounding


def least(run: Callable[[], object]) -> float:
    """Least time of the processor [ms]."""
    times = []
    for _ in range(ROUNDS):
        begun = time.process_time()
        run()
        times.append(time.process_time() - begun)
    return 1e3 * min(times)


@pytest.mark.parametrize("case", [case for case in CASES if case[1] != "flexible_joints"], ids="-".join)
def test_derivatives_and_differences(case, capsys):
    robot = robots.load(case[0], flexibility=case[1])
    x, bent, dx, ddx, wrenches = state_of(robot)
    n, q = robot.n, closed_at(robot, x[None], bent[None])[0]
    sizes, point = np.tile(robot.platform_scale, 3), np.concatenate([x, dx, ddx])

    def torques(points: np.ndarray) -> np.ndarray:
        at = closed_at(robot, points[:, :n], np.repeat(bent[None], len(points), axis=0))
        return dynamics_at(
            robot, at, dx=points[:, n : 2 * n], ddx=points[:, 2 * n :], wrenches=wrenches
        ).torque

    def differences() -> np.ndarray:
        steps = SECOND_ORDER_STEP * np.diag(sizes)
        ends = torques(np.concatenate([point + steps, point - steps])).reshape(2, 3 * n, -1)
        return (ends[0] - ends[1]).T / (2 * SECOND_ORDER_STEP * sizes)

    def ours() -> np.ndarray:
        found = dynamics_derivatives(robot, q, dx=dx, ddx=ddx, wrenches=wrenches)
        return np.concatenate([found.torque_x, found.torque_dx, found.torque_ddx], axis=1)

    stack = np.repeat(q[None], 100, axis=0)
    expected = slopes(torques, point, sizes) * sizes
    errors = [
        np.abs(values * sizes - expected).max() / np.abs(expected).max() for values in (ours(), differences())
    ]
    alone, apart = least(ours), least(differences)
    together = least(lambda: dynamics_derivatives(robot, stack, dx=dx, ddx=ddx, wrenches=wrenches)) / len(
        stack
    )
    with capsys.disabled():
        print(
            f"\n{'-'.join(case):32} error {errors[0]:.0e}, {alone:6.2f} ms, of 100 {together:6.3f} ms; "
            f"differences {errors[1]:.0e}, {apart:6.2f} ms"
        )
