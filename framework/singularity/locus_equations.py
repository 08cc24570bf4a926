"""The singular locus in two freedoms of a robot, as equations of a curve in joint space.

The unknowns u are the positions of all k moving joints: motors, then passive joints, in radians and robot
lengths. The k - 1 equations are the loop equations, fixed values of all freedoms but two, and g = 0. The
solutions are curves that are smooth in joint space even where their image in the platform's plane has an end,
a corner or an isolated point. They pass through Type 1 singularities from one working mode to the next,
through legs of zero length, and around self-motions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.errors import InvalidInput, check_choice
from framework.kinematics.frames import difference, integrate_columns
from framework.kinematics.inverse_kinematics import require_square
from framework.kinematics.linearised_loops import (
    LinearisedLoops,
    equation_sizes,
    independent_loops_matrix,
    linearised_at,
    passive_matrix,
)
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, IntArray
from framework.numerics.rotations import wrap_angles
from framework.singularity.bordered_system import Border
from framework.singularity.measure_gradient import measure_gradient
from framework.singularity.type2 import has_signed_measure

MAX_JOINT_STEP = 0.5  # [rad, robot lengths] in a Newton step that is to stay near its start


class Evaluated(NamedTuple):
    """The equations of the locus and their derivatives at S configurations, for k moving joints."""

    values: Array  # F (S, k - 1), dimensionless: m loop equations, offsets of the fixed freedoms, then g
    slopes: Array  # dF/du (S, k - 1, k)
    P: Array  # (S, m, m) passive columns of the loop equations, dimensionless
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
        """Return the equations of the slice through an assembled pose in two freedoms.

        Args:
            q, x: configuration (nq,) and platform coordinates (n,) of the pose.
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

        Args:
            border: (S, m, 1) of P; by default each configuration has the border of its own P.
        """
        robot = self.robot
        linearised = linearised_at(robot, q, None)
        P = passive_matrix(robot, linearised)
        measure = measure_gradient(robot, linearised, Border.of(P) if border is None else border)
        gaps = (linearised.residual / equation_sizes(robot))[:, robot.n :]
        slopes = [
            independent_loops_matrix(robot, linearised),
            self._offset_slopes(linearised) * robot.column_scale,
            measure.by_q[:, None] * robot.column_scale,
        ]
        return Evaluated(
            values=np.concatenate([gaps, self._fixed_offsets(linearised), measure.g[:, None]], axis=1),
            slopes=np.concatenate(slopes, axis=1)[:, :, robot.moving],
            P=P,
            eta=measure.eta,
        )

    def _fixed_offsets(self, linearised: LinearisedLoops) -> Array:
        """Compute the dimensionless offsets (S, n - 2) of the fixed freedoms from their values."""
        robot = self.robot
        if self.in_motors:
            is_sliding = robot.sliding[robot.actuated]
            motors = robot.actuated_coordinates(linearised.frames.q)
            offset = (motors - self.motors) / robot.column_scale[robot.actuated]
        else:
            is_sliding = robot.translations
            offset = (robot.platform.coordinates(linearised.frames) - self.x) / robot.platform_scale
        offset[:, ~is_sliding] = wrap_angles(offset[:, ~is_sliding])
        return offset[:, self.fixed]

    def _offset_slopes(self, linearised: LinearisedLoops) -> Array:
        """Compute the derivatives (S, n - 2, nv) of the offsets by q, exact where the loops are closed."""
        robot = self.robot
        if self.in_motors:
            slopes = np.diag(1.0 / robot.column_scale)[robot.actuated[self.fixed]]
            return np.broadcast_to(slopes, (len(linearised.residual), *slopes.shape))
        x = robot.platform.coordinates(linearised.frames)
        dx_dq = np.linalg.solve(robot.platform.rate_matrix(x), linearised.platform)  # E dx = v, (S, n, nv)
        return (dx_dq / robot.platform_scale[:, None])[:, self.fixed]
