"""The singular locus in two of a robot's freedoms, as equations of a curve in the space of its joints.

Unknown are all k joints that move (motors and passive ones, radians and lengths of the robot). Equations: the
loops are closed, all freedoms but two are fixed, and g = 0, k - 1 in all. The solutions are curves, which go
on smoothly in joint space where the platform's plane shows an end, a corner or a point: through Type 1
singularities from one working mode into the next, through legs of zero length, around a self-motion.
g and its gradient are Govaerts': with P eta + b g = 0, c' eta = 1 and psi' P + g c' = 0, psi' b = 1,
dg = -psi' dP eta (Govaerts 2000, section 3.3).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from framework.errors import InvalidInput, check_choice
from framework.kinematics.frames import FrameStack, difference, integrate_columns
from framework.kinematics.inverse_kinematics import require_square
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.loop_matrices import equation_sizes, independent_loops_matrix, passive_matrix
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, IntArray
from framework.numerics.rotations import wrap_angles
from framework.singularity.bordered_system import Border, solve_bordered
from framework.singularity.type2 import has_signed_measure

# [rad, lengths] of central differences: errors of 1e-10 in slopes, none in what is solved
DIFFERENCE_STEP = 1e-5


class Evaluated(NamedTuple):
    """The equations of the locus at S configurations, for k joints that move."""

    values: Array  # (S, k - 1)
    slopes: Array  # (S, k - 1, k)
    P: Array  # (S, m, m)
    eta: Array  # (S, m) passive rates nearest to an escaping motion, c' eta = 1


@dataclass(frozen=True, eq=False)
class LocusEquations:
    """Closures, fixed freedoms and g of a robot as functions of its joints near any configuration."""

    robot: ParallelRobot
    x: Array  # (n,) the platform's coordinates in the slice
    motors: Array  # (n_a,) the motors' joints in the slice
    in_motors: bool  # whether freedoms are the motors; else the platform's coordinates
    free_names: tuple[str, str]  # of the two freedoms that are not fixed
    free: tuple[int, int]  # the two freedoms that are not fixed
    fixed: IntArray  # (n - 2,) the others

    @staticmethod
    def of(robot: ParallelRobot, q: Array, x: Array, free: tuple[str, str] | None) -> LocusEquations:
        """Return the equations of the slice through q (nq,), x (n,) in two freedoms.

        Args:
            free: two axes of the platform or two actuators, whose others are fixed; the two translations by
                default.

        Raises:
            InvalidInput: no such freedoms; the platform does not determine the joints; redundant motors or no
                passive joints, which leave no signed measure g.
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
        in_motors = free[0] in robot.actuator_names
        column_names = robot.actuator_names if in_motors else robot.axis_names
        if free[0] == free[1] or free[1] not in column_names:
            raise InvalidInput(f"free: needs two axes or two motors, got {', '.join(free)}")
        first, second = column_names.index(free[0]), column_names.index(free[1])
        return LocusEquations(
            robot=robot,
            x=x,
            motors=robot.actuated_coordinates(q[None])[0],
            in_motors=in_motors,
            free_names=free,
            free=(first, second),
            fixed=np.delete(np.arange(robot.n), [first, second]),
        )

    def move(self, q: Array, u: Array) -> Array:
        """Return the configurations (S, nq) after steps u (S, k) [rad, lengths] from q."""
        columns = self.robot.moving
        return integrate_columns(self.robot, q, columns, u * self.robot.column_scale[columns])

    def offsets(self, start: Array, q: Array) -> Array:
        """Compute offsets (..., k) of q (..., nq) from start (..., nq), hinges the short way round."""
        columns = self.robot.moving
        offset = difference(self.robot, start, q)[..., columns] / self.robot.column_scale[columns]
        turning = ~self.robot.sliding[columns]
        offset[..., turning] = wrap_angles(offset[..., turning])
        return offset

    def evaluate(self, q: Array, border: Border | None = None) -> Evaluated:
        """Evaluate the equations and their derivatives at q (S, nq).

        Each has its own border by default.
        """
        robot, count = self.robot, len(self._stencil)
        poses = self.move(np.repeat(q, count, axis=0), np.tile(self._stencil, (len(q), 1)))  # (S count, nq)
        linearised = linearised_at(robot, poses, None)
        centres = linearised.select(slice(None, None, count))  # at q itself
        loops = independent_loops_matrix(robot, centres)[:, :, robot.moving]  # (S, m, k)
        gaps = (centres.residual / equation_sizes(robot))[:, robot.n :]
        all_P = passive_matrix(robot, linearised).reshape(len(q), count, len(robot.following), -1)
        P = all_P[:, 0]  # (S, m, m)
        border = Border.of(P) if border is None else border
        eta, g = solve_bordered(P, border)  # (S, m, 1), (S, 1, 1)
        dg = _measure_slopes(P, border, eta[:, :, 0], _differences(all_P))  # (S, k)
        offsets = self._fixed_offsets(poses, linearised.frames).reshape(len(q), count, len(self.fixed))
        return Evaluated(
            values=np.concatenate([gaps, offsets[:, 0], g[:, 0]], axis=1),
            slopes=np.concatenate([loops, _differences(offsets).swapaxes(1, 2), dg[:, None]], axis=1),
            P=P,
            eta=eta[:, :, 0],
        )

    @cached_property
    def _stencil(self) -> Array:
        """Steps (2 k + 1, k) [rad, lengths] of central differences: none, all ahead, all back."""
        units = np.eye(len(self.robot.moving))
        return DIFFERENCE_STEP * np.concatenate([0.0 * units[:1], units, -units])

    def _fixed_offsets(self, poses: Array, frames: FrameStack) -> Array:
        """Compute the offsets (T, n - 2) of the fixed freedoms at poses (T, nq), without dimension."""
        robot, fixed = self.robot, self.fixed
        if self.in_motors:
            sliding, scale = robot.sliding[robot.actuated], robot.column_scale[robot.actuated]
            offset = robot.actuated_coordinates(poses) - self.motors
        else:
            sliding, scale = robot.translations, robot.platform_scale
            offset = robot.platform.coordinates(frames) - self.x
        offset, sliding = (offset / scale)[:, fixed], sliding[fixed]
        offset[:, ~sliding] = wrap_angles(offset[:, ~sliding])
        return offset


def _measure_slopes(P: Array, border: Border, eta: Array, dP: Array) -> Array:
    """Compute the gradient dg = -psi' dP eta (S, k) of g.

    dP (S, k, m, m) are the derivatives of P (S, m, m).
    """
    psi = solve_bordered(P.swapaxes(1, 2), Border(border.c, border.b)).eta[:, :, 0]
    return -np.matvec(np.matvec(dP, eta[:, None]), psi)


def _differences(values: Array) -> Array:
    """Compute derivatives (S, k, ...) by central differences of values (S, 2 k + 1, ...), see `_stencil`."""
    k = values.shape[1] // 2
    return (values[:, 1 : k + 1] - values[:, k + 1 :]) / (2 * DIFFERENCE_STEP)
