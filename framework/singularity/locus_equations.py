"""The singular locus in two freedoms of a robot, as equations of a curve in joint space.

The unknowns u are the positions of all k moving joints: motors, then passive joints, in radians and robot
lengths. The k - 1 equations are the loop equations, fixed values of all freedoms but two, and g = 0. The
solutions are curves that are smooth in joint space even where their image in the platform's plane has an end,
a corner or an isolated point. They pass through Type 1 singularities from one working mode to the next,
through legs of zero length, and around self-motions. P are the passive columns of the loop equations, with
the border (b, c) of `bordered_system`. With P eta + b g = 0, c' eta = 1 and psi' P + g c' = 0, psi' b = 1,
the gradient of g is dg = -psi' dP eta (Govaerts 2000, section 3.3).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from framework.errors import InvalidInput, check_choice
from framework.kinematics.frames import FrameStack, difference, integrate_columns
from framework.kinematics.inverse_kinematics import require_square
from framework.kinematics.linearised_loops import (
    equation_sizes,
    independent_loops_matrix,
    linearised_at,
    passive_matrix,
)
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, IntArray
from framework.numerics.rotations import wrap_angles
from framework.singularity.bordered_system import Border, solve_bordered
from framework.singularity.type2 import has_signed_measure

# [rad, lengths] of central differences. Slopes have errors of 1e-10, which affect convergence, not the
# solution.
DIFFERENCE_STEP = 1e-5


class Evaluated(NamedTuple):
    """The equations of the locus at S configurations, for k moving joints."""

    values: Array  # (S, k - 1)
    slopes: Array  # (S, k - 1, k)
    P: Array  # (S, m, m)
    eta: Array  # (S, m) passive rates closest to an escaping motion, c' eta = 1

    @property
    def passive_g_slopes(self) -> Array:
        """Derivatives (S, m) of g, the last equation, along the passive joints, the last unknowns."""
        return self.slopes[:, -1, -self.eta.shape[1] :]


@dataclass(frozen=True, eq=False)
class LocusEquations:
    """The equations of the locus in a slice: two freedoms of the robot vary, the others are fixed."""

    robot: ParallelRobot
    x: Array  # (n,) platform coordinates of a pose in the slice
    motors: Array  # (n_a,) motor joints of this pose, joint side
    in_motors: bool  # whether the freedoms are the motors; else they are the platform's coordinates
    free_names: tuple[str, str]  # names of the two varying freedoms
    free: tuple[int, int]  # indices of the two varying freedoms among the motors or the coordinates
    fixed: IntArray  # (n - 2,) indices of the fixed freedoms

    @staticmethod
    def of(robot: ParallelRobot, q: Array, x: Array, free: tuple[str, str] | None) -> LocusEquations:
        """Return the equations of the slice through q (nq,), x (n,) in two freedoms.

        Args:
            free: two axes of the platform or two actuators; the other axes or actuators are fixed. By default
                the two translations of the platform.

        Raises:
            InvalidInput: the robot has no such freedoms; the platform does not determine the joints; or g has
                no sign, because motors are redundant or no joint is passive.
        """
        require_square(robot)
        if not has_signed_measure(robot):
            raise InvalidInput(f"{robot.name}: a locus needs passive joints and one motor for each freedom")
        names = robot.axis_names + robot.actuator_names
        if free is None:
            chosen = (0, 1) if robot.n == 2 else tuple(np.flatnonzero(robot.translations).tolist())
            if len(chosen) != 2:
                raise InvalidInput(f"free: name two axes or two motors of {robot.name}: {', '.join(names)}")
            free = (robot.axis_names[chosen[0]], robot.axis_names[chosen[1]])
        for name in free:
            check_choice("freedom", name, names)
        first, second = free
        in_motors = first in robot.actuator_names
        freedoms = robot.actuator_names if in_motors else robot.axis_names
        if first == second or second not in freedoms:
            raise InvalidInput(f"free: needs two axes or two motors, got {first}, {second}")
        indices = freedoms.index(first), freedoms.index(second)
        return LocusEquations(
            robot=robot,
            x=x,
            motors=robot.actuated_coordinates(q[None])[0],
            in_motors=in_motors,
            free_names=free,
            free=indices,
            fixed=np.delete(np.arange(robot.n), indices),
        )

    def move(self, q: Array, u: Array) -> Array:
        """Return the configurations (S, nq) after steps u (S, k) [rad, lengths] from q (S, nq)."""
        columns = self.robot.moving
        return integrate_columns(self.robot, q, columns, u * self.robot.column_scale[columns])

    def offsets(self, start: Array, q: Array) -> Array:
        """Compute offsets (..., k) of q (..., nq) from start (..., nq), angles within half a turn."""
        columns = self.robot.moving
        offset = difference(self.robot, start, q)[..., columns] / self.robot.column_scale[columns]
        turning = ~self.robot.sliding[columns]
        offset[..., turning] = wrap_angles(offset[..., turning])
        return offset

    def evaluate(self, q: Array, border: Border | None = None) -> Evaluated:
        """Evaluate the equations and their derivatives at S configurations q (S, nq).

        The derivatives of P and of the fixed freedoms are central differences over the c poses of a stencil.

        Args:
            border: (S, m, 1) of P; by default each configuration has the border of its own P.
        """
        robot = self.robot
        c = len(self._stencil)
        poses = self.move(np.repeat(q, c, axis=0), np.tile(self._stencil, (len(q), 1)))  # (S c, nq)
        linearised = linearised_at(robot, poses, None)
        centres = linearised.select(slice(None, None, c))  # at q itself: the first pose of each stencil
        loop_slopes = independent_loops_matrix(robot, centres)[:, :, robot.moving]  # (S, m, k)
        gaps = (centres.residual / equation_sizes(robot))[:, robot.n :]

        all_P = passive_matrix(robot, linearised).reshape(len(q), c, len(robot.following), -1)
        P = all_P[:, 0]  # (S, m, m)
        border = Border.of(P) if border is None else border
        solution = solve_bordered(P, border)
        eta = solution.eta[:, :, 0]  # (S, m)
        dg = _measure_slopes(P, border, eta, _differences(all_P))  # (S, k)

        offsets = self._fixed_offsets(poses, linearised.frames).reshape(len(q), c, len(self.fixed))
        offset_slopes = _differences(offsets).swapaxes(1, 2)  # (S, n - 2, k)
        return Evaluated(
            values=np.concatenate([gaps, offsets[:, 0], solution.G[:, 0]], axis=1),
            slopes=np.concatenate([loop_slopes, offset_slopes, dg[:, None]], axis=1),
            P=P,
            eta=eta,
        )

    @cached_property
    def _stencil(self) -> Array:
        """Steps (c, k) [rad, lengths], c = 2 k + 1: zero, then each unknown ahead, then each back."""
        units = np.eye(len(self.robot.moving))
        return DIFFERENCE_STEP * np.vstack([np.zeros(len(units)), units, -units])

    def _fixed_offsets(self, poses: Array, frames: FrameStack) -> Array:
        """Compute the dimensionless offsets (T, n - 2) of the fixed freedoms at poses (T, nq)."""
        robot = self.robot
        if self.in_motors:
            is_sliding = robot.sliding[robot.actuated]
            offset = (robot.actuated_coordinates(poses) - self.motors) / robot.column_scale[robot.actuated]
        else:
            is_sliding = robot.translations
            offset = (robot.platform.coordinates(frames) - self.x) / robot.platform_scale
        offset[:, ~is_sliding] = wrap_angles(offset[:, ~is_sliding])
        return offset[:, self.fixed]


def _measure_slopes(P: Array, border: Border, eta: Array, dP: Array) -> Array:
    """Compute dg = -psi' dP eta (S, k) from derivatives dP (S, k, m, m) of P."""
    psi = solve_bordered(P.swapaxes(1, 2), Border(border.c, border.b)).eta[:, :, 0]
    return -np.matvec(np.matvec(dP, eta[:, None]), psi)


def _differences(values: Array) -> Array:
    """Compute derivatives (S, k, ...) by central differences of values (S, c, ...) on the stencil."""
    k = values.shape[1] // 2  # c = 2 k + 1: centre, k poses ahead, k poses back
    return (values[:, 1 : k + 1] - values[:, k + 1 :]) / (2 * DIFFERENCE_STEP)
