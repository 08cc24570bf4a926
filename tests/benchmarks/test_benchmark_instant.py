"""What one instant, a stack of a thousand, their way back and one update of the pose cost. Prints, asserts
nothing about time: `make bench`.

As multiples of the bare inverse dynamics of the open tree, pinocchio's RNEA, on the same states in the same
run, in turn: how quick a processor is, and what else it does, falls out.
"""

import time
from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import dynamics_at, forward_dynamics, forward_kinematics, plan_scene

pytestmark = pytest.mark.benchmark
ROBOTS = {"five_bar": "C", "delta": "cross", "gough_stewart": "turn"}


ROUNDS = 20


def least(runs: dict[str, tuple[Callable[[], object], int]]) -> dict[str, float]:
    """Least times of the processor [us], all taken in turn; each with how often it is run in a round."""
    times = dict.fromkeys(runs, np.inf)
    for _ in range(ROUNDS):
        for name, (run, repeats) in runs.items():
            for _ in range(repeats):
                start = time.process_time()
                run()
                times[name] = min(times[name], 1e6 * (time.process_time() - start))
    return times


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

    one = {"dx": dx[300], "ddx": ddx[300]}
    runs = {
        "bare": (bare, 2),
        "stack": (lambda: dynamics_at(robot, q, dx=dx, ddx=ddx), 2),
        "back": (lambda: forward_dynamics(robot, q, stack.v, stack.torque), 1),
        "instant": (lambda: dynamics_at(robot, q[300], **one), 30),
        "reactions": (lambda: dynamics_at(robot, q[300], **one).reactions, 30),
        "one back": (lambda: forward_dynamics(robot, q[300], stack.v[300], stack.torque[300]), 30),
        "update": (lambda: forward_kinematics(robot, ahead, near=pose), 30),
    }
    found = least(runs)
    floor = found["bare"]
    with capsys.disabled():
        print(
            f"\n  {name}: torque at one instant {found['instant']:.0f} us (goal 300 for the 5R), with joint "
            f"reactions {found['reactions']:.0f} us, forward dynamics {found['one back']:.0f} us;\n    one "
            f"update of the pose {found['update']:.0f} us (goal 300); 1000 instants "
            f"{found['stack'] / 1e3:.1f} ms, {found['stack'] / floor:.1f} times the bare RNEA (goal 10),\n"
            f"    forward dynamics {found['back'] / floor:.1f} times"
        )
