"""The shift of a singular point along its path by deflections of the springs.

The singular point of a deflected robot depends on the deflections, which depend on the motion. At rest no
static deflection exists near a Type 2 singularity, because the motors cannot balance loads along t_s. So
without a motion only the derivative is known. From g(s, q_e) = 0 it is ds/dq_e = -(dg/dq_e) / (dg/ds).
"""

from __future__ import annotations

import numpy as np

from framework.kinematics.continuation.tracking import Branch
from framework.kinematics.frames import integrate_columns
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.linearised_loops import type2_matrix
from framework.numerics.arrays import Array
from framework.singularity.bordered_system import bordered_solution
from framework.singularity.points_on_path import SingularPoint

DIFFERENCE_STEP = 1e-5  # of s, or of deflections [rad, robot lengths], for central differences
SHIFT_ROUNDING = 1e-14  # in s; a smaller shift by one DIFFERENCE_STEP is rounding


def spring_shift(branch: Branch, point: SingularPoint) -> Array:
    """Compute the shift ds/dq_e (n_e,) [1/m, 1/rad] of a singular point by deflections.

    The result is NaN if several motions escape at once, or if the path touches the locus without crossing it.
    Small deflections split such a point or remove it instead of shifting it.
    """
    robot = branch.robot
    n_e = robot.n_e
    if not n_e or point.corank > 1 or point.contact != "transversal":
        return np.full(n_e, np.nan)
    steps = DIFFERENCE_STEP * robot.column_scale[robot.elastic]
    s_back, s_ahead = np.clip([point.s - DIFFERENCE_STEP, point.s + DIFFERENCE_STEP], 0.0, 1.0)
    # poses: each spring deflected one way at the point, each the other way; springs at rest ahead, and back
    deflections = np.vstack([np.diag(steps), -np.diag(steps), np.zeros((2, n_e))])
    s = np.append(np.full(2 * n_e, point.s), [s_ahead, s_back])
    guess = integrate_columns(robot, branch.guess(s), robot.elastic, deflections)
    closed = close_loops(robot, branch.path(s), guess)
    g = bordered_solution(type2_matrix(robot, closed.linearised), border_of=-1).g
    g_plus, g_minus, at_rest = np.split(g, [n_e, 2 * n_e])
    dg_ds = (at_rest[0] - at_rest[1]) / (s_ahead - s_back)
    shift = -(g_plus - g_minus) / (2 * steps) / dg_ds  # -(dg/dq_e) / (dg/ds)
    return np.where(np.abs(shift * steps) < SHIFT_ROUNDING, 0.0, shift)
