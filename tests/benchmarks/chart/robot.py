"""The robots, the path and the motions that the stages are about, from the catalogue."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from framework import Condition, Law, Line, ParallelRobot, inverse_dynamics, track_path
from framework.catalogue import robot_file
from framework.dynamics.elasticity import pass_at_rest
from framework.dynamics.forces import motor_torque, tree_forces
from framework.kinematics import Branch, Motion, close_loops, motion_at
from framework.laws import MotionLaw, time_derivatives
from framework.numerics import Array, TimeGrid
from tests.benchmarks.chart import closed_form
from tests.benchmarks.chart.bare import BareRobot, solve_each
from tests.benchmarks.chart.bare import Motion as BareMotion
from tests.benchmarks.chart.closed_form import ExactMotion

MASSES = {"five_bar": 0.0, "five_bar_heavy": 1.0}  # of each crank and rod [kg]
DURATION, CROSSING_TIME = float(closed_form.DURATION), float(closed_form.CROSSING_TIME)  # [s]
CROSSING_SPEED = float(closed_form.CROSSING_SPEED)  # [1/s]
SIZE = 128  # points of the series of torques: twice what they need
Torque = Callable[[Array], Array]  # times (T,) [s] -> motor torques (T, 2) [N m]
Solve = Callable[[Array, Array], Array]  # P' (T, m, m) and r (T, m) -> lambda (T, m) with P' lambda = r


@cache
def robot(name: str = "five_bar", flexibility: str = "rigid") -> ParallelRobot:
    """A robot of the catalogue."""
    return ParallelRobot.from_file(robot_file(name), flexibility=flexibility)


@cache
def path() -> Line:
    """Scene C's."""
    start, end = ([float(c) for c in point] for point in (closed_form.START, closed_form.END))
    return Line(start, end)


@cache
def branch() -> Branch:
    """The path as followed by the rigid robot."""
    return track_path(robot(), path())


@cache
def bare() -> BareRobot:
    """The robot without the framework."""
    return BareRobot(robot(), branch().guess(np.zeros(1))[0])


def exact(name: str = "five_bar", *, offset: float = 0.0) -> ExactMotion:
    """The reference for a robot of the catalogue, condition (8) imposed `offset` off the singular point."""
    return closed_form.motion(MASSES[name], offset=offset)


@cache
def law(name: str = "five_bar", *, offset: float = 0.0) -> Law:
    """The reference's law as the framework has laws: the same conditions, in floats."""
    wanted = exact(name, offset=offset)
    inner = [
        Condition(CROSSING_TIME, order, float(wanted.law(closed_form.CROSSING_TIME, order)))
        for order in range(3)
    ]
    return Law.rest_to_rest(DURATION, 2, inner)


class Planned:
    """Torques and places of scene C as Chebyshev series."""

    def __init__(self, motion: ExactMotion) -> None:
        nodes = np.cos(np.pi * (np.arange(SIZE) + 0.5) / SIZE)
        times = 0.5 * DURATION * (nodes + 1.0)
        self.torques, self.places = (
            np.asarray(chebyshev.chebfit(nodes, values, SIZE - 1), dtype=float)
            for values in (motion.torque(times), motion.platform(times))
        )

    def torque(self, t: ArrayLike) -> Array:
        """(T, 2) [N m], motor side."""
        return _series(self.torques, t)

    def platform(self, t: ArrayLike, order: int = 0, /) -> Array:
        """(T, 2) [m]."""
        return _series(self.places, t)


def _series(coefficients: Array, t: ArrayLike) -> Array:
    local = np.clip(np.asarray(t, dtype=float) * (2.0 / DURATION) - 1.0, -1.0, 1.0)
    return np.asarray(np.cos(np.arccos(local)[..., None] * np.arange(len(coefficients))) @ coefficients)


@cache
def planned(link: float, payload: float = float(closed_form.PAYLOAD)) -> Planned:
    """The reference's torques and path, for masses of each link and of the payload [kg]."""
    return Planned(closed_form.motion(link, payload=payload))


@dataclass(frozen=True, eq=False)
class SceneC:
    """The rigid robot on its path under a law, and the ways to its torques that some stages compare."""

    law: MotionLaw

    def platform(self, times: Array) -> list[Array]:
        """x, x', x" (T, 2) at times (T,)."""
        return time_derivatives(path(), [self.law(times, order) for order in range(3)])

    def nodes(self, count: float) -> Torque:
        """Ours: on Chebyshev nodes."""
        grid = TimeGrid.clear_of(np.array([CROSSING_TIME]), np.array([0.0, DURATION]), round(count))
        state, _ = pass_at_rest(branch(), grid, self.law, np.empty(0))
        return grid.fit(motor_torque(robot(), state.motion, state.forces.joint_torque))

    def proved(self, tolerance: float) -> Torque:
        """Ours: singular points located, condition (8) checked, the error estimated."""
        return inverse_dynamics(robot(), path(), self.law, tolerance=tolerance).torque

    def bare_motion(self, times: Array, start: Array | None = None) -> BareMotion:
        """The joints by pinocchio and numpy alone, from `start` if not from where the path starts."""
        x, dx, ddx = self.platform(times)
        return bare().motion(x, dx, ddx, start)

    def bare_torques(self, times: Array, guess: Array | None = None) -> Array:
        """(T, 2) at each instant for itself, by pinocchio and numpy alone: as `BareRobot.motion`."""
        x, dx, ddx = self.platform(times)
        return bare().torques(bare().motion(x, dx, ddx, guess=guess))

    def guess(self, times: Array) -> Array:
        """Joints (T, 4) near those of the path as followed."""
        return branch().guess(self.law(times))

    def motion(self, times: Array) -> Motion:
        """All joints, loops closed in one stack."""
        x, dx, ddx = self.platform(times)
        closed = close_loops(robot(), x, self.guess(times))
        return motion_at(robot(), closed, dx, ddx)

    def pointwise(self, times: Array, solve: Solve = solve_each) -> Array:
        """Torques (T, 2) at each instant for itself: tau = r_a - J_a' lambda, P' lambda = r_p."""
        given, motion = robot(), self.motion(times)
        r, rows = tree_forces(given, motion), motion.linearised.closures
        multipliers = solve(rows[:, :, given.following].transpose(0, 2, 1), r[:, given.following])
        joint = r[:, given.actuated] - np.einsum("tma,tm->ta", rows[:, :, given.actuated], multipliers)
        return motor_torque(given, motion, joint)
