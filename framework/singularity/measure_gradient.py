"""The gradient of the measure g in joint space, and the shift of singular points by deflections.

With the border (b, c) of `bordered_system`, P eta + b g = 0, c' eta = 1 and psi' P + g c' = 0, psi' b = 1.
The gradient of g is therefore dg = -psi' dP eta (Govaerts 2000, section 3.3).

The singular points of a deflected robot depend on the deflections, which depend on the motion. At rest no
static deflection exists near a Type 2 singularity, because the motors cannot balance loads along t_s. So
without a motion only the derivative of the shift is known.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.kinematics.closures import loop_curvature
from framework.kinematics.continuation.branch import Branch
from framework.kinematics.linearised_loops import LinearisedLoops, passive_matrix, passive_motion
from framework.kinematics.motion_rates import joint_rates
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array
from framework.singularity.bordered_system import Border, solve_bordered
from framework.singularity.points_on_path import SingularPoint
from framework.tolerances import SAME_PLACE


class MeasureGradient(NamedTuple):
    """The bordered scalar g of a square P and its gradient, at T configurations."""

    g: Array  # (T,)
    eta: Array  # (T, n_p) dimensionless passive rates closest to an escaping motion, c' eta = 1
    by_q: Array  # (T, nv) dg/dq [1/rad, 1/m]


def measure_gradient(robot: ParallelRobot, linearised: LinearisedLoops, border: Border) -> MeasureGradient:
    """Compute g and dg/dq (T, nv) at configurations with a square P.

    In dg = -psi' dP eta, psi' dP are the changes of the loop forces on the passive joints under constant
    multipliers psi.

    Args:
        border: b and c of P, (n_p, 1) for all configurations or (T, n_p, 1).
    """
    P = passive_matrix(robot, linearised)
    solution = solve_bordered(P, border)
    eta = solution.eta[:, :, 0]  # (T, n_p)
    transposed_border = Border(border.c, border.b)
    psi = solve_bordered(P.swapaxes(1, 2), transposed_border).eta[:, :, 0]  # (T, n_p)
    multipliers = psi / (robot.loop_lengths * robot.structure.row_sizes)  # of the loop equations with units
    force_changes = loop_curvature(robot, robot.loops, linearised.frames, multipliers)  # (T, nv, nv)
    by_q = -np.vecmat(passive_motion(robot, eta), force_changes)
    return MeasureGradient(solution.G[:, 0, 0], eta, by_q)


def spring_shift(branch: Branch, point: SingularPoint) -> Array:
    """Compute the shift ds/dq_e (n_e,) [1/m, 1/rad] of a singular point by deflections q_e.

    From g(s, q_e) = 0 it is -(dg/dq_e) / (dg/ds), with the loops closed. The result is NaN if several motions
    escape at once, or if the path touches the locus without crossing it. Small deflections split such a point
    or remove it instead of shifting it.
    """
    robot = branch.robot
    n_e = robot.n_e
    if not n_e or point.corank > 1 or point.contact != "transversal":
        return np.full(n_e, np.nan)
    linearised = branch.close(np.array([point.s])).linearised
    border = Border.of(passive_matrix(robot, linearised))
    gradient = measure_gradient(robot, linearised, border).by_q[0]  # dg/dq (nv,)

    # slopes of g along the path, and along each deflection with the platform at rest
    path_twist = robot.platform.path_twist(branch.path, point.s)
    path_rates = joint_rates(robot, linearised, path_twist[None])[0]  # dq/ds (nv,)
    platform_at_rest = np.zeros((n_e, 1, robot.n))
    unit_deflections = np.eye(n_e)[:, None]
    spring_rates = joint_rates(robot, linearised, platform_at_rest, unit_deflections)[:, 0]  # (n_e, nv)
    shift = -(spring_rates @ gradient) / (path_rates @ gradient)
    # shifts are compared with rounding for a deflection of one radian or robot length
    is_rounding = np.abs(shift * robot.column_scale[robot.elastic]) < SAME_PLACE
    return np.where(is_rounding, 0.0, shift)
