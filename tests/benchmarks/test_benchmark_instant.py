"""What one instant, a stack of a thousand and one update of the pose cost. Prints, asserts nothing about
time: `make bench`.

Against the bare inverse dynamics of the open tree, pinocchio's RNEA, on the same states.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import dynamics_at, forward_kinematics, plan_scene

pytestmark = pytest.mark.benchmark
ROBOTS = {"five_bar": "C", "delta": "cross", "gough_stewart": "turn"}


def least(run: Callable[[], object], repeats: int) -> float:
    """Least time of the processor [us]."""
    spent = []
    for _ in range(repeats):
        start = time.process_time()
        run()
        spent.append(time.process_time() - start)
    return 1e6 * min(spent)


@pytest.mark.parametrize("name", ROBOTS)
def test_an_instant_a_stack_and_a_stream(name, capsys):
    robot = robots.load(name)
    plan = plan_scene(robot, ROBOTS[name])
    t = np.linspace(0.0, 0.9 * plan.crossings[0].time, 1000)
    q, dx, ddx = plan.dynamics.configuration(t), plan.platform(t, 1), plan.platform(t, 2)
    stack = dynamics_at(robot, q, dx=dx, ddx=ddx)
    np.testing.assert_allclose(stack.torque, plan.torque(t), atol=1e-9 * np.abs(stack.torque).max())
    states, data = list(zip(*map(list, (stack.q, stack.v, stack.a)), strict=True)), robot.model.createData()
    pose = forward_kinematics(robot, robot.actuated_coordinates(q[:1])[0], near=q[0])
    ahead = robot.actuated_coordinates(q[:1])[0] + 1e-3

    def bare() -> None:
        for state in states:
            pin.rnea(robot.model, data, *state)

    floor = least(bare, 20)
    whole = least(lambda: dynamics_at(robot, q, dx=dx, ddx=ddx), 20)
    one = least(lambda: dynamics_at(robot, q[300], dx=dx[300], ddx=ddx[300]), 300)
    carried = least(lambda: dynamics_at(robot, q[300], dx=dx[300], ddx=ddx[300]).reactions, 300)
    update = least(lambda: forward_kinematics(robot, ahead, near=pose), 300)
    with capsys.disabled():
        print(
            f"\n  {name}: torque at one instant {one:.0f} us (goal 300 for the 5R), with joint reactions "
            f"{carried:.0f} us; 1000 instants {whole / 1e3:.1f} ms, {whole / floor:.1f} times the bare RNEA "
            f"(goal 10); one update of the pose {update:.0f} us (goal 300)"
        )
