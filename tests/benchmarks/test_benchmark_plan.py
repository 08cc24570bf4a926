"""How long one plan of the deformed flexible_links 5R takes, and against what. Prints, asserts nothing
about time: `make bench`.

Whole plan, the bare pinocchio calls that it makes (the same number, on the same configurations), and
the naive way: 1501 samples, finite differences of the motor angles, no proof.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import plan_scene
from framework.dynamics.finite_differences import finite_difference_torques
from tests.oracles import five_bar as oracle

pytestmark = pytest.mark.benchmark
REPEATS = 15


def milliseconds(run: Callable[[], object]) -> float:
    """Median wall time."""
    spent = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        run()
        spent.append(time.perf_counter() - start)
    return 1e3 * float(np.median(spent))


class Counted:
    """A pinocchio function that counts its calls."""

    def __init__(self, monkeypatch, name: str) -> None:
        self.calls, self.function = 0, getattr(pin, name)
        monkeypatch.setattr(pin, name, self)

    def __call__(self, *arguments):
        self.calls += 1
        return self.function(*arguments)


CALLS = (
    "computeJointJacobians",
    "updateFramePlacements",
    "computeForwardKinematicsDerivatives",
    "rnea",
)


def test_plan_of_the_deformed_five_bar(capsys):
    robot = robots.load("five_bar", flexibility="flexible_links")
    plan = plan_scene(robot, "C")  # also fills the caches of the robot, as a second plan finds them
    with pytest.MonkeyPatch.context() as patch:
        counted = {name: Counted(patch, name) for name in CALLS}
        plan_scene(robot, "C")
    calls = {name: counter.calls for name, counter in counted.items()}

    model, data = robot.model, robot.model.createData()
    t = plan.dynamics.torques.edges[-1] * np.linspace(0, 1, plan.certificate.nodes)
    q, v, a = plan.dynamics.configuration(t), plan.dynamics.velocity(t), plan.dynamics.velocity(t, 2)

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

    def once() -> None:
        for k in range(len(q)):
            pin.computeJointJacobians(model, data, q[k])
            pin.rnea(model, data, q[k], v[k], a[k])

    def naive() -> object:
        return finite_difference_torques(robot, plan.path, plan.law)

    ours, floor, one_pass, raw = (
        milliseconds(run) for run in (lambda: plan_scene(robot, "C"), bare, once, naive)
    )
    times = np.linspace(0.0, 1.5, 1501)
    exact = oracle.torques(oracle.solve("C", "flexible_links", "deformed"), times)
    error = np.abs(plan.torque(times) - exact).max()
    difference = np.abs(naive().torque - exact)
    inside = np.abs(times - 1.0) > 0.01
    with capsys.disabled():
        print(
            f"\n  plan of the deformed flexible_links 5R, scene C, {plan.certificate.nodes} nodes, "
            f"{plan.certificate.passes} passes"
            f"\n  in process            {ours:8.2f} ms   torque error {error:.1e} N m (goal 20 ms)"
            f"\n  its pinocchio calls   {floor:8.2f} ms   ratio {ours / floor:.1f} (goal 15): "
            + ", ".join(f"{name} {count}" for name, count in calls.items())
            + f"\n  one pass, bare        {one_pass:8.2f} ms   ratio {ours / one_pass:.0f}: Jacobians, RNEA "
            f"once on each node"
            f"\n  naive way, its law    {raw:8.2f} ms   ratio {raw / ours:.1f} of ours, torque error "
            f"{difference.max():.1e} N m, {difference[inside].max():.1e} away from the crossing"
        )
    assert error < 1e-9
    assert difference.max() > 1e3 * error
