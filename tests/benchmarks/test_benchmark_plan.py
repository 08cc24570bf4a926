"""CPU time of whole plans, and against what. Prints, asserts nothing about time: `make bench`.

A whole plan, and the bare pinocchio calls that it makes: the same number, on the configurations of its
motion. On a shared machine the ratio to the bare calls of the same run tells more than the time.
"""

import time
from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import CrossingPlan, NoAnswer, plan_scene
from framework.model.description import FLEXIBILITIES

pytestmark = pytest.mark.benchmark
GOAL = 60.0  # ms, of every plan of the catalogue


def milliseconds(run: Callable[[], object], repeats: int) -> float:
    """Median CPU time."""
    spent = []
    for _ in range(repeats):
        start = time.process_time()
        run()
        spent.append(time.process_time() - start)
    return 1e3 * float(np.median(spent))


class Counted:
    """A pinocchio function that counts its calls."""

    def __init__(self, monkeypatch, name: str) -> None:
        self.calls, self.function = 0, getattr(pin, name)
        monkeypatch.setattr(pin, name, self)

    def __call__(self, *arguments):
        self.calls += 1
        return self.function(*arguments)


CALLS = ("computeJointJacobians", "updateFramePlacements", "computeForwardKinematicsDerivatives", "rnea")


def bare_calls(plan: CrossingPlan, scene: str) -> tuple[dict[str, int], Callable[[], None]]:
    """How often planning this scene calls pinocchio, and these calls alone."""
    robot = plan.robot
    with pytest.MonkeyPatch.context() as patch:
        counted = {name: Counted(patch, name) for name in CALLS}
        plan_scene(robot, scene)
    calls = {name: counter.calls for name, counter in counted.items()}
    model, data = robot.model, robot.model.createData()
    q, v, a = motion(plan)

    def bare() -> None:
        nodes = len(q)
        for k in range(calls["computeJointJacobians"]):
            pin.computeJointJacobians(model, data, q[k % nodes])
        for _ in range(calls["updateFramePlacements"]):
            pin.updateFramePlacements(model, data)
        for k in range(calls["computeForwardKinematicsDerivatives"]):
            pin.computeForwardKinematicsDerivatives(model, data, q[k % nodes], v[k % nodes], a[k % nodes])
        for k in range(calls["rnea"]):
            pin.rnea(model, data, q[k % nodes], v[k % nodes], a[k % nodes])

    return calls, bare


def motion(plan: CrossingPlan) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, velocities and accelerations at as many instants as the plan has nodes."""
    t = plan.duration * np.linspace(0, 1, plan.certificate.nodes)
    return plan.configuration(t), plan.velocity(t), plan.velocity(t, 2)


@pytest.mark.parametrize("flexibility", FLEXIBILITIES)
def test_plans_of_the_catalogue(flexibility, capsys):
    rows = []
    for name in robots.CATALOGUE:
        robot = robots.load(name, flexibility=flexibility)
        for scene in robot.description.scenes:
            try:
                plan = plan_scene(robot, scene)
            except NoAnswer:
                continue
            calls, bare = bare_calls(plan, scene)
            spent = milliseconds(lambda robot=robot, scene=scene: plan_scene(robot, scene), 5)
            rows.append((spent, spent / milliseconds(bare, 5), f"{name} {scene}", sum(calls.values())))
    rows.sort()
    middle = [np.median([row[k] for row in rows]) for k in range(2)]
    with capsys.disabled():
        print(
            f"\n  {flexibility}: median {middle[0]:.1f} ms, {middle[1]:.1f} times the bare calls",
            *(
                f"  {scene:32} {spent:7.1f} ms {ratio:6.1f} times {count:6} bare calls"
                f"{'  above the goal' if spent > GOAL else ''}"
                for spent, ratio, scene, count in rows
            ),
            sep="\n",
        )
    assert rows
