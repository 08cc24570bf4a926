"""A robot of several loops along a path, and the ways to its torques that some stages compare."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from scipy.interpolate import make_interp_spline

from framework import Condition, Law, Line, ParallelRobot, inverse_dynamics, track_path
from framework.dynamics.elasticity import solve_deflections
from framework.dynamics.forces import motor_torque, tree_forces
from framework.kinematics.continuation.tracking import Branch
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.motion_rates import Motion, motion_at
from framework.laws.law import MotionLaw
from framework.laws.path import time_derivatives
from framework.numerics.arrays import Array
from framework.numerics.chebyshev import TimeGrid
from tests.benchmarks.chart import robot as given
from tests.benchmarks.chart.bare import FLAT, IN_SPACE, BareRobot
from tests.benchmarks.chart.bare import Motion as BareMotion
from tests.benchmarks.chart.measure import relative_error
from tests.benchmarks.chart.virtual_work import Crossings, crossings

PLATFORMS = {"delta": (0, 1, 2), "gough_stewart": (0, 1, 2, 3, 4, 5), "three_rpr": (0, 1, 5)}

Torque = Callable[[Array], Array]  # times (T,) [s] -> motor torques (T, n_a) [N m]
Solve = Callable[[Array, Array], Array]  # P' (T, m, m) and r (T, m) -> lambda (T, m) with P' lambda = r


def direct(matrix: Array, right: Array) -> Array:
    """Gauss's elimination."""
    return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0])


@dataclass(frozen=True, eq=False)
class Along:
    """A robot on its path under a law, and how to judge torques.

    singular: instants that nodes keep clear of [s].
    """

    branch: Branch
    law: MotionLaw
    singular: tuple[float, ...]
    exact: Torque
    bare: BareRobot

    @property
    def robot(self) -> ParallelRobot:
        return self.branch.robot

    @cached_property
    def checked(self) -> tuple[Array, Array]:
        """Instants (T,), also as near to the singular ones as 1 us, and the exact torques there."""
        near = [t + side * 10.0**-k for t in self.singular for k in range(1, 7) for side in (-1, 1)]
        times = np.sort(np.concatenate([np.linspace(0.0, self.law.duration, 24), near]))
        return times, self.exact(times)

    def error(self, torque: Torque) -> float:
        """The largest error over the largest torque."""
        times, exact = self.checked
        return relative_error(torque(times), exact)

    def platform(self, times: Array) -> list[Array]:
        """x, x', x" (T, n) at times (T,)."""
        return time_derivatives(self.branch.path, [self.law(times, order) for order in range(3)])

    def nodes(self, count: float) -> Torque:
        """Ours: on Chebyshev nodes."""
        ends, law = np.array([0.0, self.law.duration]), self.law
        grid = TimeGrid.clear_of(np.array(self.singular), ends, round(count))
        state = solve_deflections(self.branch, grid, lambda *_: law, "rigid", law)
        return grid.fit(motor_torque(self.robot, state.motion, state.forces.joint_torque))

    def proved(self, tolerance: float) -> Torque:
        """Ours: singular points located, condition (8) checked, the error estimated."""
        return inverse_dynamics(self.robot, self.branch.path, self.law, tolerance=tolerance).torque

    def stacks(self, samples: float, degree: float) -> Torque:
        """Pointwise in stacks: loops closed by ours, a dense solve at each instant."""
        return self.table(self.pointwise, samples, degree)

    def pinocchio(self, samples: float, degree: float) -> Torque:
        """Pointwise by pinocchio and numpy alone."""
        return self.table(self.bare_torques, samples, degree)

    def bare_motion(self, times: Array, start: Array | None = None) -> BareMotion:
        """The joints by pinocchio and numpy alone, from `start` if not from where the path starts."""
        x, dx, ddx = self.platform(times)
        return self.bare.motion(x, dx, ddx, start)

    def bare_torques(self, times: Array) -> Array:
        """(T, n_a) at each instant for itself, by pinocchio and numpy alone."""
        return self.bare.torques(self.bare_motion(times))

    def table(self, torque: Torque, samples: float, degree: float) -> Torque:
        """Read by a spline."""
        times = np.linspace(0.0, self.law.duration, round(samples))
        return make_interp_spline(times, torque(times), k=round(degree))

    def motion(self, times: Array) -> Motion:
        """All joints, loops closed in one stack."""
        x, dx, ddx = self.platform(times)
        closed = close_loops(self.robot, x, self.branch.guess(self.law(times)))
        return motion_at(self.robot, closed, dx, ddx)

    def pointwise(self, times: Array, solve: Solve = direct) -> Array:
        """Torques (T, n_a) at each instant for itself: tau = r_a - J_a' lambda, P' lambda = r_p."""
        robot, motion = self.robot, self.motion(times)
        r, rows = tree_forces(robot, motion), motion.linearised.closures
        multipliers = solve(rows[:, :, robot.following].transpose(0, 2, 1), r[:, robot.following])
        joint = r[:, robot.actuated] - np.einsum("tma,tm->ta", rows[:, :, robot.actuated], multipliers)
        return motor_torque(robot, motion, joint)


@cache
def massless_legs(name: str) -> ParallelRobot:
    """A robot of the catalogue of which only the platform has mass."""
    description = given.robot(name).description
    root = ElementTree.fromstring(description.urdf_text)
    for link in root.iter("link"):
        inertial = link.find("inertial")
        if inertial is not None and link.get("name") != "platform":
            link.remove(inertial)
    text = ElementTree.tostring(root, encoding="unicode")
    return ParallelRobot.from_description(replace(description, urdf_text=text))


@cache
def crossing(name: str, count: int = 1) -> Along:
    """Through the singular points of `virtual_work.crossings`."""
    exact: Crossings = crossings(name, count)
    robot = massless_legs(name)
    branch = track_path(robot, Line(*([float(c) for c in end] for end in exact.ends)))
    inner = [
        Condition(float(t), order, float(value))
        for t, values in exact.conditions
        for order, value in enumerate(values)
    ]
    law = Law.rest_to_rest(float(exact.duration), 2, inner)
    axes = FLAT if name == "three_rpr" else IN_SPACE
    bare = BareRobot(robot, branch.guess(np.zeros(1))[0], axes, PLATFORMS[name])
    return Along(branch, law, tuple(float(t) for t, _ in exact.conditions), exact.torque, bare)
