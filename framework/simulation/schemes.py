"""One step of fixed length, for a stack of runs, and two ways to make it.

Springs and damping enter implicitly, so stiff ones cost no small steps; loops enter by their rates, with
a correction that takes what is open a share nearer each step. Both are of order 2 and solve

    [ M + h^2 K' + h D'   J' ] [    a    ]   [ forces ]
    [        J            0  ] [ -lambda ] = [ rates  ]

midpoint: the linear implicit midpoint rule. One mass matrix a step. No numerical damping.
extrapolated: twice the result of two half steps less that of one whole step of the linear implicit Euler
    method. A coordinate without mass finds its balance in one step, and vibrations too quick for the step die
    out, where the midpoint rule would let them ring.
Source: Hairer, Lubich and Roche, The Numerical Solution of Differential-Algebraic Systems by Runge-Kutta
Methods, Springer 1989; Deuflhard, Hairer and Zugck 1987, DOI 10.1007/BF01400352, for the extrapolation.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from framework.kinematics.frames import difference, integrate
from framework.numerics.arrays import Array
from framework.numerics.ordered_sums import matvec, solve
from framework.simulation.equations import spring_forces
from framework.simulation.terms import RobotStack

# Share of an open loop that one step closes: the largest without overshoot, 6 - sqrt(32).
CLOSING_SHARE = 0.343


class State(NamedTuple):
    """Configuration q (nq,) and velocity v (nv,), or (R, nq) and (R, nv)."""

    q: Array
    v: Array


def _solve_accelerations(mass: Array, jacobian: Array, forces: Array, rates: Array) -> Array:
    """Solve M a - J' lambda = forces, J a = rates for accelerations a (R, nv).

    M is (R, nv, nv), J (R, m, nv). Accelerations are infinite where the equations are singular.
    """
    runs, m, nv = jacobian.shape
    matrix = np.zeros((runs, nv + m, nv + m))
    matrix[:, :nv, :nv] = mass
    matrix[:, :nv, nv:] = jacobian.transpose(0, 2, 1)
    matrix[:, nv:, :nv] = jacobian
    return solve(matrix, np.concatenate([forces, rates], axis=1))[:, :nv]


def _implicit_mass(mass: Array, stack: RobotStack, by_spring: float, by_damping: float) -> Array:
    """Return M + by_spring K + by_damping D, (R, nv, nv).

    Springs K and dampers D stand on the diagonal.
    """
    matrix = mass.copy()
    diagonal = range(mass.shape[1])
    matrix[:, diagonal, diagonal] += by_spring * stack.stiffness + by_damping * stack.damping
    return matrix


def midpoint(stack: RobotStack, q: Array, v: Array, driven: Array, h: float) -> State:
    """Step by the linear implicit midpoint rule, h [s], under generalised forces `driven` (R, nv).

    All terms are taken in the predicted middle of the step. A first guess of the acceleration gives the
    velocity there, on which bias forces and the drift of the loops depend.
    """
    robot = stack.robots[0]
    middle = integrate(robot, q, 0.5 * h * v)
    terms = stack.terms(middle, v)
    implicit_mass = _implicit_mass(terms.mass, stack, 0.25 * h**2, 0.5 * h)
    loop_rate = matvec(terms.jacobian, v)  # (R, m)
    drift = stack.drift(terms, v)
    gap = terms.residual - 0.5 * h * loop_rate + 0.125 * h**2 * drift  # loop equations at q
    springs = spring_forces(robot, stack.stiffness, stack.rest, middle)
    steady = driven - springs - stack.damping * v
    closing = -loop_rate / h - CLOSING_SHARE * gap / h**2
    guess = _solve_accelerations(implicit_mass, terms.jacobian, steady - terms.bias, closing - 0.5 * drift)
    v_middle = v + 0.5 * h * guess
    terms = stack.with_velocities(terms, middle, v_middle)
    rates = closing - 0.5 * stack.drift(terms, v_middle)
    v_end = v + h * _solve_accelerations(implicit_mass, terms.jacobian, steady - terms.bias, rates)
    return State(integrate(robot, q, 0.5 * h * (v + v_end)), v_end)


def _step_by_euler(
    stack: RobotStack, start: State, driven: Array, h: float, closing_rate: Array | None = None
) -> tuple[State, Array]:
    """Step by the linear implicit Euler method, h [s]; return the rate (R, m) at which loops close too.

    The equations are (M + h D + h^2 K) a = f and J (v + h a) = closing rate, with all terms at q + h v, so
    that a part without mass is in balance after the step. Without a `closing_rate` loops close a share of
    their gap in the step.
    """
    robot, (q, v) = stack.robots[0], start
    predicted = integrate(robot, q, h * v)
    terms = stack.terms(predicted, v)
    if closing_rate is None:
        closing_rate = -CLOSING_SHARE * terms.residual / h
    implicit_mass = _implicit_mass(terms.mass, stack, h**2, h)
    springs = spring_forces(robot, stack.stiffness, stack.rest, predicted)
    forces = driven - terms.bias - springs - stack.damping * v
    loop_acceleration = (closing_rate - matvec(terms.jacobian, v)) / h
    v_end = v + h * _solve_accelerations(implicit_mass, terms.jacobian, forces, loop_acceleration)
    return State(integrate(robot, q, h * v_end), v_end), closing_rate


def extrapolate(stack: RobotStack, q: Array, v: Array, driven: Array, h: float) -> State:
    """Step by the linear implicit Euler method, extrapolated once.

    The result is twice that of two half steps less that of the whole. Extrapolation needs steps of different
    length toward one solution: all close the loops at one rate.
    """
    whole, closing_rate = _step_by_euler(stack, State(q, v), driven, h)
    half, _ = _step_by_euler(stack, State(q, v), driven, 0.5 * h, closing_rate)
    halves, _ = _step_by_euler(stack, half, driven, 0.5 * h, closing_rate)
    robot = stack.robots[0]
    error = difference(robot, whole.q, halves.q)
    return State(integrate(robot, halves.q, error), 2 * halves.v - whole.v)


Scheme = Callable[[RobotStack, Array, Array, Array, float], State]
SCHEMES: dict[str, Scheme] = {"midpoint": midpoint, "extrapolated": extrapolate}
