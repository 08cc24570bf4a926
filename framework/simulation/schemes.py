"""Two schemes for one step of fixed length, on a stack of runs.

Springs and damping enter implicitly, so stiff springs need no small steps. The loop equations are imposed on
the velocities, and each step also closes a share of the remaining gaps. Both schemes are of order 2 and solve

    [ M + h^2 K' + h D'   J' ] [    a    ]   [ forces ]
    [        J            0  ] [ -lambda ] = [ rates  ]

midpoint: the linear implicit midpoint rule. It needs one mass matrix per step and has no numerical damping.
extrapolated: the linear implicit Euler method with extrapolation: twice the result of two half steps minus
    that of one whole step. A coordinate without mass reaches its balance in one step. Vibrations too fast for
    the step decay, whereas they persist under the midpoint rule.
Source: Hairer, Lubich and Roche, The Numerical Solution of Differential-Algebraic Systems by Runge-Kutta
Methods, Springer 1989; Deuflhard, Hairer and Zugck 1987, DOI 10.1007/BF01400352, for the extrapolation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from framework.kinematics.frames import difference, integrate
from framework.numerics.arrays import Array
from framework.numerics.ordered_sums import matvec, solve
from framework.simulation.equations import spring_forces
from framework.simulation.terms import RobotStack

# share of the gap of a loop that one step closes: 6 - sqrt(32), the largest without overshoot
CLOSING_SHARE = 0.343


class State(NamedTuple):
    """Configuration q (nq,) and velocity v (nv,), or (R, nq) and (R, nv)."""

    q: Array
    v: Array


def stack_states(states: Sequence[State]) -> State:
    """Return K states (nq,), (nv,) as one stack (K, nq), (K, nv)."""
    q, v = zip(*states, strict=True)
    return State(np.array(q), np.array(v))


def _solve_accelerations(mass: Array, jacobian: Array, forces: Array, rates: Array) -> Array:
    """Solve M a - J' lambda = forces, J a = rates for accelerations a (R, nv).

    M is (R, nv, nv), J (R, m, nv). The accelerations of a run with singular equations are infinite.
    """
    runs, m, nv = jacobian.shape
    matrix = np.zeros((runs, nv + m, nv + m))
    matrix[:, :nv, :nv] = mass
    matrix[:, :nv, nv:] = jacobian.transpose(0, 2, 1)
    matrix[:, nv:, :nv] = jacobian
    return solve(matrix, np.concatenate([forces, rates], axis=1))[:, :nv]


def _implicit_mass(mass: Array, stack: RobotStack, h: float) -> Array:
    """Compute M + h D + h^2 K (R, nv, nv) for diagonal springs K and dampers D."""
    matrix = mass.copy()
    diagonal = range(mass.shape[1])
    matrix[:, diagonal, diagonal] += h**2 * stack.stiffness + h * stack.damping
    return matrix


def midpoint(stack: RobotStack, start: State, driven: Array, h: float) -> State:
    """Step by the linear implicit midpoint rule, h [s], under generalised forces `driven` (R, nv).

    All terms are evaluated in the predicted middle of the step. The equations are solved twice: the first
    acceleration is a guess that predicts the velocity in the middle, on which bias forces and the drift of
    the loops depend.
    """
    robot, (q, v) = stack.robots[0], start
    middle = integrate(robot, q, 0.5 * h * v)
    terms = stack.terms(middle, v)
    implicit_mass = _implicit_mass(terms.mass, stack, 0.5 * h)
    loop_rate = matvec(terms.jacobian, v)  # (R, m)
    drift = stack.drift(terms, v)
    # residuals (R, m) at q, by a Taylor series from the middle back to the start
    gap = terms.residual - 0.5 * h * loop_rate + 0.125 * h**2 * drift
    # both solutions have the same forces (R, nv) but for the bias, and the same loop equations but for drift
    forces = driven - spring_forces(robot, stack.stiffness, stack.rest, middle) - stack.damping * v
    closing = -loop_rate / h - CLOSING_SHARE * gap / h**2
    guess = _solve_accelerations(implicit_mass, terms.jacobian, forces - terms.bias, closing - 0.5 * drift)
    v_middle = v + 0.5 * h * guess
    terms = stack.with_velocities(terms, middle, v_middle)
    rates = closing - 0.5 * stack.drift(terms, v_middle)
    v_end = v + h * _solve_accelerations(implicit_mass, terms.jacobian, forces - terms.bias, rates)
    return State(integrate(robot, q, 0.5 * h * (v + v_end)), v_end)


def _step_by_euler(
    stack: RobotStack, start: State, driven: Array, h: float, closing_rate: Array | None = None
) -> tuple[State, Array]:
    """Step by the linear implicit Euler method, h [s]; return also the loops' closing rate (R, m).

    The equations are (M + h D + h^2 K) a = f and J (v + h a) = `closing_rate`. All terms are evaluated at
    q + h v, so that a part without mass is in balance after the step. By default the closing rate is such
    that the step closes CLOSING_SHARE of every gap.
    """
    robot, (q, v) = stack.robots[0], start
    predicted = integrate(robot, q, h * v)
    terms = stack.terms(predicted, v)
    if closing_rate is None:
        closing_rate = -CLOSING_SHARE * terms.residual / h
    implicit_mass = _implicit_mass(terms.mass, stack, h)
    springs = spring_forces(robot, stack.stiffness, stack.rest, predicted)
    forces = driven - terms.bias - springs - stack.damping * v
    loop_acceleration = (closing_rate - matvec(terms.jacobian, v)) / h
    v_end = v + h * _solve_accelerations(implicit_mass, terms.jacobian, forces, loop_acceleration)
    return State(integrate(robot, q, h * v_end), v_end), closing_rate


def extrapolate(stack: RobotStack, start: State, driven: Array, h: float) -> State:
    """Step by the extrapolated linear implicit Euler method, h [s], under generalised forces (R, nv).

    The result of the step is twice that of two half steps minus that of one whole step. Extrapolation
    requires that whole and half steps approach the same solution, so all of them close the loops at the same
    rate.
    """
    whole, closing_rate = _step_by_euler(stack, start, driven, h)
    half, _ = _step_by_euler(stack, start, driven, 0.5 * h, closing_rate)
    halves, _ = _step_by_euler(stack, half, driven, 0.5 * h, closing_rate)
    robot = stack.robots[0]
    correction = difference(robot, whole.q, halves.q)
    return State(integrate(robot, halves.q, correction), 2 * halves.v - whole.v)


Scheme = Callable[[RobotStack, State, Array, float], State]
SCHEMES: dict[str, Scheme] = {"midpoint": midpoint, "extrapolated": extrapolate}
