"""The law that softens an elastic robot least: whether any law can cross with deflections in balance.

Beside a crossing, the force x along the null vector satisfies eps a x^2 + b s x + alpha = 0 with the
compliance eps of the springs, the measure g = b s of the robot and the load alpha that it cannot hold. There
are two solutions if 4 eps a alpha < (b s)^2, and none beyond this fold. At the fold, the measure g + eps h of
the loaded robot has fallen to half of g. So deflections in balance need

    rho = -eps h / g <= 1/2        everywhere along the path.

To first order h is affine in the squared speed z of the law and in its slope, and the law of least rho is the
solution of a linear program. At a crossing rho is 0 / 0; -eps h g / (g^2 + delta^2) takes its place.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array, diags_array

from framework.dynamics.loaded_balance import DeflectedMotion
from framework.dynamics.loaded_measure import measure_softening
from framework.laws.path import time_derivatives
from framework.numerics.arrays import Array
from framework.numerics.cone_program import AffineRows, ConeProgram, Unsolved, solve_cone_program
from framework.planning.optimal.law_problem import LawProblem
from framework.planning.optimal.least_cost import first_cells
from framework.planning.optimal.optimal_task import Task
from framework.planning.optimal.speed_program import SpeedProgram
from framework.planning.refusals import LeastSoftening

CROSSING_SHARE = 0.06  # delta over the largest |g| of the path
LEAST_SQUARED_SPEED = 0.02  # z of all laws, times the duration squared
MAX_ENTRY = 1e3  # of rows; those with larger entries are scaled down for the solver


class _SofteningRows(NamedTuple):
    """rho at M points as matrix @ y + offset, where y are the coefficients of z."""

    matrix: Array  # (M, n)
    offset: Array  # (M,)


def find_least_softening(problem: LawProblem, duration: float) -> LeastSoftening | None:
    """Find the least rho of all laws that meet condition (8), to first order; None if the solver fails.

    Args:
        problem: an elastic robot's problem with z as one series.
        duration: [s], the unit of time.
    """
    program = SpeedProgram.on_cells(problem, first_cells(problem))
    rho = _softening_rows(problem.task, program)
    unit = duration**-2
    conditions = program.conditions
    size = np.abs(conditions.matrix).max(axis=1).toarray().ravel()
    entries = np.maximum(1.0, unit * np.abs(rho.matrix).max(axis=1) / MAX_ENTRY)[:, None]
    positive = program.positive_rows
    optimum = solve_cone_program(
        ConeProgram(
            {"y": program.basis.size, "rho": 1},
            {"rho": np.ones(1)},
            equal=[
                AffineRows(
                    {"y": diags_array(1.0 / size) @ conditions.matrix}, conditions.offset / size / unit
                )
            ],
            nonnegative=[
                AffineRows({"y": positive}, np.full(positive.shape[0], -LEAST_SQUARED_SPEED)),
                AffineRows(
                    {"y": csr_array(-unit * rho.matrix / entries), "rho": csr_array(1.0 / entries)},
                    -rho.offset / entries[:, 0],
                ),
            ],
        )
    )
    if isinstance(optimum, Unsolved):
        return None
    values = unit * rho.matrix @ optimum["y"] + rho.offset
    worst = int(values.argmax())
    s = problem.task.phi(problem.sigma(program.xi[worst : worst + 1]))
    return LeastSoftening(float(s[0]), float(values[worst]))


def _softening_rows(task: Task, program: SpeedProgram) -> _SofteningRows:
    """Compute rho at the points of a program, as rows on the coefficients of z."""
    sigma = program.problem.sigma(program.xi)
    s = [task.phi(sigma, order) for order in range(3)]  # and two derivatives by sigma
    measures = []
    for root_z, u in ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)):
        in_time = [s[0], s[1] * root_z, s[2] * root_z**2 + s[1] * u]  # dphi/dt, d2phi/dt2
        x = time_derivatives(task.branch.path, in_time)
        undeflected = np.zeros((len(sigma), task.robot.n_e))
        motion = DeflectedMotion(s[0], *x, undeflected, undeflected, undeflected)
        measures.append(measure_softening(task.branch, motion))
    at_rest, with_z, with_both = (measure.h for measure in measures)
    g = measures[0].g
    weight = -g / (g**2 + (CROSSING_SHARE * np.abs(g).max()) ** 2)
    z = program.basis.matrix(program.xi)
    u_rows = diags_array(0.5 * task.stretch(sigma, 1)) @ program.basis.matrix(program.xi, 1)
    h = diags_array(with_z - at_rest) @ z + diags_array(with_both - with_z) @ u_rows
    return _SofteningRows((diags_array(weight) @ h).toarray(), weight * at_rest)
