"""How the cost of inverse dynamics grows with the number of loops. Prints only: `make bench`.

A row of N four-bars, N from 2 to 40 (and 80, to see where it goes): everything that one time node costs
(loops closed from the track's guess, velocities, accelerations, motor torques), against the bare pinocchio
calls without which it cannot be done, RNEA and joint Jacobians once a node. CPU time, so that other
processes do not show. Following the path, locating singularities and the certificate, done once a plan, are
in the column "whole call". Goals: no faster than linear growth, at most 30 times the bare calls.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

from framework import Law, ParallelRobot, inverse_dynamics, track_path
from framework.dynamics.elasticity import solve_deflections
from framework.numerics.chebyshev import TimeGrid
from framework.planning.scenes import scene_path
from robots.generators import n_four_bar as generator

pytestmark = pytest.mark.benchmark
LOOPS = (2, 3, 5, 10, 20, 40, 80)
GOAL = 40
NODES = 64
REPEATS = 15


def microseconds_a_node(run: Callable[[], object]) -> float:
    """Least CPU time of a run over the nodes."""
    spent = []
    for _ in range(REPEATS):
        start = time.process_time()
        run()
        spent.append(time.process_time() - start)
    return 1e6 * min(spent) / NODES


def test_growth_with_the_number_of_loops(tmp_path, capsys):
    law = Law.rest_to_rest(1.5, 2)
    grid = TimeGrid(np.array([0.0, law.duration]), NODES)
    rows = []
    for loops in LOOPS:
        robot = ParallelRobot.from_file(generator.write(tmp_path / str(loops), loops))
        path = scene_path(robot.description.scenes["swing"])
        branch = track_path(robot, path)
        motion = solve_deflections(branch, grid, lambda *_: law, "rigid", None, law).motion
        model, data = robot.model, robot.model.createData()

        def nodes(branch=branch) -> object:
            return solve_deflections(branch, grid, lambda *_: law, "rigid", None, law)

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
    joints = 2 * loops + 1
    growth = np.diff(np.log(ours)) / np.diff(np.log(joints))
    asked = loops <= GOAL
    overall = np.polyfit(np.log(joints[asked]), np.log(ours[asked]), 1)[0]
    later = np.log(ours[asked][-1] / ours[loops == 10][0]) / np.log(joints[asked][-1] / 21)
    with capsys.disabled():
        print("\n  row of N four-bars, inverse dynamics, microseconds a node")
        print("     N  joints    ours    bare   ratio  ours ~ joints^  whole call, ms  torque error, N m")
        for k in range(len(rows)):
            power = f"{growth[k - 1]:14.2f}" if k else " " * 14
            print(
                f"  {loops[k]:4.0f}  {joints[k]:6.0f}  {ours[k]:6.0f}  {floor[k]:6.1f}  "
                f"{ours[k] / floor[k]:6.1f}  {power}  {whole[k]:14.0f}  {errors[k]:17.1e}"
            )
        print(
            f"  N = 2 to {GOAL}: ours ~ joints^{overall:.2f} (from N = 10 on ^{later:.2f}), ratio at most "
            f"{(ours / floor)[asked].max():.1f}; goals: power at most 1, ratio at most 30"
        )
    assert errors.max() < 1e-9
