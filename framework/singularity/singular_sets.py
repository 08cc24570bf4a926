"""The kinds of singularity as blocks that lose rank, and their measure g with bounds over boxes of joints."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray, IntArray
from framework.kinematics.legs import legs
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.slope_bounds import Changes, Linearised
from framework.linalg.interval_newton import bordered_bounds
from framework.linalg.krawczyk import UP


class SingularSet(NamedTuple):
    """Poses in which a block of dF/dq loses rank, F = [platform - x ; loops]."""

    name: str  # type_2, or type_1 with the motors of the leg
    rows: IntArray  # (s,)
    columns: IntArray  # (s,) among the `moving` ones


def singular_sets(robot: ParallelRobot) -> tuple[SingularSet, ...]:
    """Type 2 first, then Type 1 of each leg, see `legs`."""
    n = robot.n
    loops, passive = np.arange(n, n + len(robot.loops.names)), np.arange(robot.n_a, len(robot.moving))
    of_legs = [
        SingularSet(
            f"type_1 of {' and '.join(leg.motors) or 'joints without a motor'}", leg.rows, leg.columns
        )
        for leg in legs(robot)
    ]
    return (SingularSet("type_2", loops, passive), *of_legs)


class Measure(NamedTuple):
    """g over S boxes."""

    valid: BoolArray  # (S,) a pose in the box is singular where g = 0, and there alone
    g: Array  # (S,) at the middle
    g_error: Array  # (S,)
    slope: Array  # (S, k) at the middle
    slope_changes: Array  # (S, k) within the box


def measure(which: SingularSet, at: Linearised, changes: Changes) -> Measure:
    """The bordered scalar g of a block, dg = -psi' dP eta (Govaerts 2000), over the boxes of `changes`."""
    rows, columns = which.rows[:, None], which.columns
    P, spread = at.slopes[:, rows, columns], changes.slopes[:, rows, columns]
    rounding = at.bounds.rounding
    bordered = bordered_bounds(P, spread, rounding)
    eta, psi = bordered.right[:, :-1], bordered.left[:, :-1]
    d_eta, d_psi = bordered.right_errors[:, :-1], bordered.left_errors[:, :-1]
    D = at.seconds[:, rows, columns]  # (S, s, s, k)
    more = changes.seconds[:, rows, columns] + rounding
    size, a_eta, a_psi = np.abs(D), np.abs(eta), np.abs(psi)
    slope = -np.einsum("si,sijl,sj->sl", psi, D, eta, optimize=True)
    slope_changes = UP * (
        np.einsum("si,sijl,sj->sl", a_psi, more, a_eta + d_eta, optimize=True)
        + np.einsum("si,sijl,sj->sl", a_psi, size, d_eta, optimize=True)
        + np.einsum("si,sijl,sj->sl", d_psi, size + more, a_eta + d_eta, optimize=True)
    )
    return Measure(bordered.valid, bordered.right[:, -1], bordered.g_error, slope, slope_changes)
