"""Poses from random motor angles, robot by robot: found, on the right branch, or refused with a reason.

    python -m tests.benchmarks.random_poses [ROBOT ...] [--poses 10000]

Every set of motor angles is at least a tenth away from the reference, in radians and robot lengths, by the
motor that turns most. What arrives is closed again from beside by the inverse kinematics, which is another
Newton's method on other unknowns, and is led from the reference once more in 64 small steps without any
certificate, for the branch (where the two differ, in steps a 64th as long: beside a singularity 64 are too
few). What is refused is counted by the class of its error.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from typing import NamedTuple

import numpy as np

import robots
from framework import ParallelRobot
from framework.kinematics.closures import loop_equations
from framework.kinematics.continuation.forward_kinematics import motors_are_free
from framework.kinematics.continuation.pose_stack import forward_kinematics_stack
from framework.kinematics.frames import frames_at
from framework.kinematics.inverse_kinematics import close_each
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.loop_matrices import type1_matrix

FARTHEST = 0.15  # [rad, robot lengths] of the motor that turns most; the least is 0.1
SMALL_STEPS = 64
LAST_PASSES = 6  # of Newton's method at the end: beside a singularity two are too few
SAME = 1e-6  # [rad, robot lengths] between two ways to a pose of one branch
ASIDE = 1e-3  # [rad, robot lengths] from a pose, where the inverse kinematics begins, unless Type 1 is near


class Evidence(NamedTuple):
    """What was found of one robot."""

    poses: int
    arrived: int
    refused: Counter[str]  # by class of the error
    open: float  # largest loop equation of a pose [rad, robot lengths]
    error: float  # largest distance to the inverse kinematics' pose over condition [rad, robot lengths]
    off_branch: int  # poses that small steps do not lead to
    clearance: float  # least one of a pose, over that of the reference


def evidence(robot: ParallelRobot, poses: int, *, seed: int = 0) -> Evidence:
    """Random motor angles of one robot whose motors move one by one."""
    rng = np.random.default_rng(seed)
    turns = rng.standard_normal((poses, robot.n_a))
    turns *= rng.uniform(0.1, FARTHEST, (poses, 1)) / np.abs(turns).max(axis=1, keepdims=True)
    turns = turns * robot.column_scale[robot.actuated]
    start = robot.reference.q
    q_a = robot.actuated_coordinates(start[None]) + turns
    found = forward_kinematics_stack(robot, q_a)
    there = ~np.isnan(found.q).any(axis=1)
    q, scale = found.q[there], robot.column_scale
    rows = robot.rows
    gaps = loop_equations(rows, frames_at(robot, q)).residual / np.where(rows.rotation, 1.0, robot.length)
    # where a leg is nearly stretched the next working mode is as near as the least singular value is small
    legs = type1_matrix(robot, linearised_at(robot, q, found.x[there]))
    legs = np.linalg.svd(legs, compute_uv=False)[:, -1]
    aside = np.minimum(ASIDE, 0.1 * legs)[:, None] * rng.uniform(-1, 1, q.shape)
    again = close_each(robot, found.x[there], q + aside * scale)
    apart = np.abs((again.q - q) / scale).max(axis=1)
    on_reference = _conditions(robot, start[None])[0]
    off = np.abs((in_small_steps(robot, turns[there], SMALL_STEPS) - q) / scale).max(axis=1) > SAME
    finer = in_small_steps(robot, turns[there][off], 64 * SMALL_STEPS)
    off[off] = np.abs((finer - q[off]) / scale).max(axis=1, initial=0.0) > SAME
    conditions = np.minimum(_conditions(robot, q), legs)
    return Evidence(
        poses=poses,
        arrived=int(there.sum()),
        refused=Counter(type(error).__name__ for error in found.refused.values()),
        open=float(np.abs(gaps).max(initial=0.0)),
        error=float((apart[again.closed] * conditions[again.closed]).max(initial=0.0)),
        off_branch=int(off.sum()),
        clearance=float((found.clearance[there] / on_reference).min(initial=np.inf)),
    )


def _conditions(robot: ParallelRobot, q: np.ndarray) -> np.ndarray:
    """Least singular values (T,) of the loop equations along the passive joints, in radians and lengths."""
    lengths = np.where(robot.loops.rotation, 1.0, robot.length)[:, None]
    jacobian = loop_equations(robot.loops, frames_at(robot, q)).jacobian / lengths * robot.column_scale
    values = np.linalg.svd(jacobian[:, :, robot.following], compute_uv=False)
    return np.asarray(values.min(axis=1, initial=1.0))


def in_small_steps(robot: ParallelRobot, turns: np.ndarray, count: int) -> np.ndarray:
    """Configurations (T, nq) to which `count` steps of Euler lead from the reference, closed by Newton."""
    q = np.repeat(robot.reference.q[None], len(turns), axis=0)
    moved = np.zeros((len(turns), robot.model.nv))
    for k in range(count):
        moved[:, robot.actuated] = turns / count
        moved[:, robot.following] = 0.0
        loops = loop_equations(robot.loops, frames_at(robot, q))
        driven = np.einsum("tmv,tv->tm", loops.jacobian, moved)
        moved[:, robot.following] = _passive(robot, loops.jacobian, driven)
        q = q + moved
        for _ in range(2 if k < count - 1 else LAST_PASSES):
            loops = loop_equations(robot.loops, frames_at(robot, q))
            q[:, robot.following] += _passive(robot, loops.jacobian, loops.residual)
    return q


def _passive(robot: ParallelRobot, jacobian: np.ndarray, gap: np.ndarray) -> np.ndarray:
    """The step (T, n_p) of the passive joints that closes a gap (T, m) to first order."""
    return -np.linalg.solve(jacobian[:, :, robot.following], gap[..., None])[..., 0]


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="*", default=list(robots.CATALOGUE))
    parser.add_argument("--poses", type=int, default=10_000)
    options = parser.parse_args()
    heads = ("poses", "arrived", "open", "error", "off", "clear", "s")
    print(f"{'robot':20}" + "".join(f"{head:>9}" for head in heads) + "  refused")
    for name in options.robots:
        robot = robots.load(name)
        if not motors_are_free(robot):
            print(f"{name:20}  its {robot.n_a} motors drive {robot.n} freedoms: none moves while others rest")
            continue
        start = time.process_time()
        found = evidence(robot, options.poses)
        refused = ", ".join(f"{count} {kind}" for kind, count in found.refused.items()) or "none"
        print(
            f"{name:20}{found.poses:9}{found.arrived:9}{found.open:9.1e}{found.error:9.1e}{found.off_branch:9}"
            f"{found.clearance:9.2g}{time.process_time() - start:9.0f}  {refused}",
            flush=True,
        )


if __name__ == "__main__":
    main()
