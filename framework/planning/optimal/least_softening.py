"""The law that softens an elastic robot least, to first order in the compliance of its springs.

It estimates whether a law can cross with deflections in balance; it proves nothing.

Beside a crossing, the force x along the null vector satisfies eps a x^2 + b s x + alpha = 0 with the
compliance eps of the springs, the measure g = b s of the robot and the load alpha that it cannot hold. There
are two solutions if 4 eps a alpha < (b s)^2, and none beyond this fold. At the fold, the measure g + eps h of
the loaded robot has fallen to half of g. So, to first order, deflections in balance need

    rho = -eps h / g <= 1/2        everywhere along the path.

To first order h is affine in the squared speed z = (d sigma/dt)^2 of the law and in u = z'/2, and the law of
least rho is the solution of a linear program in the coefficients y of z. At a crossing rho is 0 / 0;
-eps h g / (g^2 + delta^2) takes its place.
"""

from __future__ import annotations

import numpy as np

from framework.dynamics.loaded_balance import DeflectedMotion
from framework.dynamics.loaded_measure import Softening, measure_softening
from framework.errors import NotAssembled
from framework.laws.path import time_derivatives
from framework.numerics.arrays import Array
from framework.numerics.cone_program import Affine, AffineRows, ConeProgram, Unsolved, solve_cone_program
from framework.planning.optimal.law_problem import LawProblem
from framework.planning.optimal.least_cost import first_cells
from framework.planning.optimal.optimal_task import Task
from framework.planning.optimal.speed_program import SpeedProgram
from framework.planning.refusals import LeastSoftening
from framework.tolerances import SOFTENING_NEAR_CROSSING

LEAST_SQUARED_SPEED = 0.02  # lower bound of z times the duration squared
MAX_ENTRY = 1e3  # of rows; those with larger entries are scaled down for the solver


def find_least_softening(problem: LawProblem, duration: float) -> LeastSoftening | None:
    """Find the law with the least largest softening rho along the path; None if none is found.

    rho is the share by which loads lower the robot's measure g of the distance from Type 2, to first order in
    the compliance of the springs. The law, z = (d sigma/dt)^2 with coefficients y (n,), solves the linear
    program: minimise rho_max such that rho_max >= rho at M points, z >= a least value, and condition (8),
    t_s . W_p = 0, holds at the crossings.

    Args:
        problem: an elastic robot's problem with z as one series.
        duration: [s], the unit of time; y has the unit duration^-2.

    Returns:
        The largest rho of this law and its place s.
    """
    program = SpeedProgram.on_cells(problem, first_cells(problem))
    unit = duration**-2
    # conditions on y / unit, each row scaled to a largest entry of 1, for the solver
    matrix, offset = program.solved_conditions
    sizes = matrix.largest()  # (k,)
    sizes[sizes == 0.0] = 1.0  # of a condition that every law meets
    conditions = AffineRows({"y": matrix.scale(1.0 / sizes)}, offset / (unit * sizes))

    # rho = slopes y + offset at the M points, divided by what makes the rows' entries small for the solver
    try:
        softening = _softening_rows(problem.task, program)
    except (NotAssembled, np.linalg.LinAlgError):  # the deflections tear the loops; a point is singular
        return None
    slopes = unit * softening.matrix  # (M, n)
    divisor = np.maximum(1.0, np.abs(slopes).max(axis=1) / MAX_ENTRY)  # (M,)
    below_max = AffineRows(
        {"y": -slopes / divisor[:, None], "rho_max": 1.0 / divisor[:, None]}, -softening.offset / divisor
    )

    # z > 0, as a law must advance: the program needs a positive bound, below the z of ends in motion
    ends = problem.specification.ends
    is_moving = list(ends.moving)
    speeds = ends.derivatives(1)[is_moving, 0] / problem.task.phi(np.array([0.0, 1.0])[is_moving], 1)
    least_z = min([LEAST_SQUARED_SPEED, *(0.5 * speeds**2 / unit)])
    positive = program.positive_rows
    above_least = AffineRows({"y": positive}, np.full(positive.shape[0], -least_z))

    unknowns, cost = {"y": program.basis.size, "rho_max": 1}, {"rho_max": np.ones(1)}
    optimum = solve_cone_program(
        ConeProgram(unknowns, cost, equal=[conditions], nonnegative=[above_least, below_max])
    )
    if isinstance(optimum, Unsolved):
        return None
    rho = slopes @ optimum["y"] + softening.offset  # (M,)
    worst = np.array([rho.argmax()])
    s = problem.task.phi(problem.sigma(program.xi[worst]))
    return LeastSoftening(float(s[0]), float(rho.max()))


def _softening_rows(task: Task, program: SpeedProgram) -> Affine:
    """Compute rho at the M points of a program as an affine function of the coefficients y (n,) of z.

    The softening h is affine in z and u = z'/2, h = h_0 + h_z z + h_u u. Its values at three pairs (z, u)
    give h_0 = h(0, 0), h_z = h(1, 0) - h(0, 0) and h_u = h(1, 1) - h(1, 0).
    """
    sigma = program.problem.sigma(program.xi)
    g, h_rest = _measure_at(task, sigma, 0.0, 0.0)
    h_at_z = _measure_at(task, sigma, 1.0, 0.0).h
    h_at_z_and_u = _measure_at(task, sigma, 1.0, 1.0).h
    # values of z and u as rows (M, n) on y; u = dz/dsigma / 2 by the chain rule through xi
    z = program.basis.matrix(program.xi)
    u = program.basis.matrix(program.xi, 1).scale(0.5 * task.stretch(sigma, 1))
    h = z.scale(h_at_z - h_rest) + u.scale(h_at_z_and_u - h_at_z)
    delta = SOFTENING_NEAR_CROSSING * np.abs(g).max()
    weight = -g / (g**2 + delta**2)  # -1 / g away from the crossings
    return Affine(h.scale(weight).toarray(), weight * h_rest)


def _measure_at(task: Task, sigma: Array, z: float, u: float) -> Softening:
    """Compute the measure g and its softening h, each (M,), at sigma (M,) with springs at rest.

    Args:
        z: (d sigma/dt)^2 [1/s^2] at all points.
        u: d2 sigma/dt2 [1/s^2] at all points.
    """
    phi, dphi, ddphi = (task.phi(sigma, order) for order in range(3))
    s = [phi, dphi * np.sqrt(z), ddphi * z + dphi * u]  # with two time derivatives
    x, dx, ddx = time_derivatives(task.branch.path, s)
    rest = np.zeros((len(sigma), task.robot.n_e))
    return measure_softening(task.branch, DeflectedMotion(phi, x, dx, ddx, rest, rest, rest))
