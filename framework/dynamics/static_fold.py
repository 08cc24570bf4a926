"""Where the springs of a robot at rest give way: the fold of its deflections as the springs get softer.

At both ends of a motion the platform is at rest, whatever the law. With springs 1 / s times as stiff as those
of the robot, deflections l are in balance if F(l, s) = Y' (s r + K l) = 0 (`loaded_balance`): softer springs
deflect as the robot's own do under a growing share s of the forces r. The curve begins at l = 0, s = 0. If s
has a maximum below 1 on the curve, the deflections that are connected with the rigid robot do not reach the
robot's own springs.
"""

from __future__ import annotations

import numpy as np

from framework.dynamics.loaded_balance import (
    DeflectedMotion,
    deflection_slopes,
    evaluate_balance,
    spring_units,
)
from framework.errors import NoAnswer
from framework.kinematics.continuation.arclength import (
    LOAD_STEP,
    CurveEquations,
    CurveReason,
    Curves,
)
from framework.kinematics.continuation.tracking import Branch
from framework.kinematics.frames import difference
from framework.numerics.arrays import Array, IntArray

FIRST_SHARE = 1e-9  # at which springs are at rest but for rounding; at 0 they would be infinitely stiff


def find_static_fold(branch: Branch, s: float) -> float | None:
    """Find the compliance at which deflections at rest at s turn back, over that of the springs.

    Returns:
        A number below 1; None if the curve reaches the springs of the robot, or if continuation fails.
    """
    robot = branch.robot
    place = np.array([s])
    x = branch.path(place)
    q_at_rest = branch.guess(place)
    units = spring_units(robot)  # (n_e,) in which loads and slopes are computed
    K = robot.stiffness * units**2  # (n_e,)
    per_column = robot.column_scale[robot.elastic] / units  # (n_e,) units per radian or robot length
    springs = slice(robot.n_e)  # the first of the f columns that move with locked motors

    def evaluate(q: Array, share: Array, _: IntArray) -> CurveEquations:
        """Evaluate F (1, n_e) over the largest stiffness, at q (1, nq) and the share (1,) of the forces.

        With l in springs 1 / s times as stiff, the balance is that of r + K l / s, s times smaller than F.
        """
        l = difference(robot, robot.neutral, q)[:, robot.elastic]  # noqa: E741
        at_rest = DeflectedMotion(place, x, 0.0 * x, 0.0 * x, l, 0.0 * l, 0.0 * l)
        try:
            balance = evaluate_balance(
                robot, at_rest, q_at_rest, wrenches=branch.wrenches, stiffer=1.0 / share[0]
            )
        except NoAnswer:  # the loops are torn: a shorter step is tried
            return CurveEquations(np.full(l.shape, np.nan), np.full((1, robot.n_e, robot.n_e + 1), np.nan))
        Y_rows = balance.Y[0].T  # (n_e, f)
        by_l = share * Y_rows @ deflection_slopes(robot, balance, 1)[0] * per_column  # (n_e, n_e)
        r_along_Y = balance.F[0] - Y_rows[:, springs] @ (K * l[0] / units / share)  # (n_e,)
        slopes = np.column_stack([by_l, r_along_Y])
        return CurveEquations(share * balance.F / K.max(), slopes[None] / K.max())

    first_share = np.array([FIRST_SHARE])
    end, reason = Curves(robot, robot.elastic, np.zeros((1, robot.nv)), evaluate).follow(
        q_at_rest,
        first_share,
        evaluate(q_at_rest, first_share, np.zeros(1, dtype=np.intp)),
        longest=np.full(1, LOAD_STEP),
        accept=lambda ends: (np.ones(len(ends.rows), dtype=bool),) * 2,
    )
    return float(end.share[0]) if reason[0] == CurveReason.TURNED else None
