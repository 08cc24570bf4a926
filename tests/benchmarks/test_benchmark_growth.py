"""How the cost of inverse dynamics grows with the number of loops. Prints only: `make bench`.

A row of N four-bars, N from 2 to 40: everything that one time node costs (loops closed, velocities,
accelerations, forces), against the bare pinocchio calls without which it cannot be done, RNEA and joint
Jacobians once a node. Goals: no faster than linear growth, at most 30 times the bare calls.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

from framework import Law, ParallelRobot, inverse_dynamics, scene_path
from framework.dynamics.elasticity import settle
from framework.kinematics.tracking import track_path
from framework.motion.chebyshev import TimeGrid
from robots.generators import n_four_bar as generator

pytestmark = pytest.mark.benchmark
LOOPS = (2, 3, 5, 10, 20, 40)
NODES = 64
REPEATS = 9


def microseconds_a_node(run: Callable[[], object]) -> float:
    """Least wall time of a run over the nodes: what the machine can do when nobody else uses it."""
    spent = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        run()
        spent.append(time.perf_counter() - start)
    return 1e6 * min(spent) / NODES


def test_growth_with_the_number_of_loops(tmp_path, capsys):
    law = Law.rest_to_rest(1.5, 2)
    grid = TimeGrid(np.array([0.0, law.duration]), NODES)
    rows = []
    for loops in LOOPS:
        robot = ParallelRobot.from_file(generator.write(tmp_path / str(loops), loops))
        path = scene_path(robot.description.scenes["swing"])
        track = track_path(robot, path)
        motion = settle(track, grid, lambda *_: law, "rigid", None, law).motion
        model, data = robot.model, robot.model.createData()

        def nodes(track=track) -> object:
            return settle(track, grid, lambda *_: law, "rigid", None, law)

        def bare(model=model, data=data, motion=motion) -> None:
            for q, v, a in zip(motion.q, motion.v, motion.a, strict=True):
                pin.computeJointJacobians(model, data, q)
                pin.rnea(model, data, q, v, a)

        started = time.perf_counter()
        found = inverse_dynamics(robot, path, law)
        whole = time.perf_counter() - started
        inertia, arm = (loops + 1) / 3 + loops, (loops + 1) / 2 + loops
        x, ddx = found.platform(grid.times), found.platform(grid.times, 2)
        exact = (3.3e-3 + inertia / 100) * ddx - 9.81 * arm * np.sin(x) / 100
        error = np.abs(found.torque(grid.times) - exact).max()
        rows.append((loops, microseconds_a_node(nodes), microseconds_a_node(bare), 1e3 * whole, error))
    loops, ours, floor, whole, errors = np.array(rows).T
    growth = np.diff(np.log(ours)) / np.diff(np.log(2 * loops + 1))
    with capsys.disabled():
        print("\n  row of N four-bars, inverse dynamics, microseconds a node")
        print("     N  joints    ours    bare   ratio  ours ~ joints^  whole call, ms  torque error, N m")
        for k in range(len(rows)):
            power = f"{growth[k - 1]:14.2f}" if k else " " * 14
            print(
                f"  {loops[k]:4.0f}  {2 * loops[k] + 1:6.0f}  {ours[k]:6.0f}  {floor[k]:6.1f}  "
                f"{ours[k] / floor[k]:6.0f}  {power}  {whole[k]:14.0f}  {errors[k]:17.1e}"
            )
        print("  goals: ratio at most 30, power at most 1")
    assert errors.max() < 1e-9
