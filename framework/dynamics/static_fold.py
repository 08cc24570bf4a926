"""Where the springs of a robot at rest give way: the fold of its deflections as the springs get softer.

At both ends of a motion the platform is at rest, whatever the law. With springs 1 / eps times as stiff as
those of the robot, deflections l = eps v are in balance if F(v, eps) = 0: n_e equations for n_e + 1 unknowns,
a curve from eps = 0 on. If eps turns back on it before 1, the branch of deflections that is connected with
the rigid robot does not reach the robot's own springs.

The curve is followed by pseudo-arclength: H. B. Keller in Applications of Bifurcation Theory, Academic Press
1977.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.dynamics.loaded_balance import (
    DeflectedMotion,
    LoadedBalance,
    deflection_slopes,
    evaluate_balance,
    spring_units,
)
from framework.errors import NoAnswer
from framework.kinematics.continuation.tracking import Branch
from framework.numerics.arrays import Array
from framework.tolerances import FOLD_MISFIT

FIRST_COMPLIANCE = 1e-4  # over that of the springs
FIRST_STEP, LEAST_STEP, MAX_STEP, STEP_GROWTH = 0.05, 1e-5, 0.2, 1.3  # of arclength in (v, log eps)
MAX_POINTS = 400
MAX_CORRECTIONS = 8
LEAST_COSINE = 0.8  # between neighbouring tangents


class _CurvePoint(NamedTuple):
    """A point (v / size, log eps) (n_e + 1,) of the curve, with its unit tangent."""

    coordinates: Array
    tangent: Array


class _RestCurve(NamedTuple):
    """The curve of deflections in balance at rest at s; `size` is the unit of v."""

    branch: Branch
    s: float
    size: float = 1.0

    def _balance(self, coordinates: Array) -> LoadedBalance:
        """Compute the balance at a point."""
        robot, s = self.branch.robot, np.array([self.s])
        compliance = np.exp(coordinates[-1])
        deflections = compliance * self.size * coordinates[None, :-1] * spring_units(robot)
        x = self.branch.path(s)
        at_rest = DeflectedMotion(s, x, 0.0 * x, 0.0 * x, deflections, 0.0 * deflections, 0.0 * deflections)
        return evaluate_balance(
            robot, at_rest, self.branch.guess(s), wrenches=self.branch.wrenches, stiffer=1.0 / compliance
        )

    def residual(self, coordinates: Array) -> tuple[Array, Array]:
        """Compute F (n_e,) and its slopes (n_e, n_e + 1) by the coordinates, over the largest load.

        F = Y' (r + K l / eps): dF/dv = eps Y' dload/dl, and dF/d(log eps) = eps Y' (dr/dl) v.
        """
        robot, balance = self.branch.robot, self._balance(coordinates)
        compliance = np.exp(coordinates[-1])
        by_load = deflection_slopes(robot, balance, 1)[0]  # (f, n_e), springs among the load
        by_weight = by_load.copy()
        by_weight[range(robot.n_e), range(robot.n_e)] -= (
            robot.stiffness * spring_units(robot) ** 2 / compliance
        )
        Y = balance.Y[0]
        slopes = compliance * self.size * Y.T @ np.column_stack([by_load, by_weight @ coordinates[:-1]])
        size = balance.size or 1.0  # without a load nothing deflects
        return balance.F[0] / size, slopes / size

    def correct(self, coordinates: Array, along: Array) -> _CurvePoint | None:
        """Return the point of the curve beside coordinates, its tangent towards `along`; None without one."""
        try:
            for _ in range(MAX_CORRECTIONS):
                F, slopes = self.residual(coordinates)
                if np.abs(F).max() <= FOLD_MISFIT:
                    tangent = np.linalg.svd(slopes)[2][-1]
                    return _CurvePoint(coordinates, tangent * np.sign(tangent @ along))
                coordinates = coordinates - np.linalg.lstsq(slopes, F, rcond=None)[0]
        except (NoAnswer, np.linalg.LinAlgError):
            pass
        return None


def find_static_fold(branch: Branch, s: float) -> float | None:
    """Find the compliance, over that of the robot's springs, at which deflections at rest at s turn back.

    Returns:
        A number below 1; None if the curve reaches the springs of the robot, or is lost on the way.
    """
    softer = np.append(np.zeros(branch.robot.n_e), 1.0)
    point = _RestCurve(branch, s).correct(np.log(FIRST_COMPLIANCE) * softer, softer)
    if point is None:
        return None
    size = float(np.abs(point.coordinates[:-1]).max()) or 1.0
    curve = _RestCurve(branch, s, size)
    point = curve.correct(np.append(point.coordinates[:-1] / size, point.coordinates[-1]), softer)
    step = FIRST_STEP
    for _ in range(MAX_POINTS):
        if point is None or point.coordinates[-1] >= 0.0:
            return None
        following = curve.correct(point.coordinates + step * point.tangent, point.tangent)
        if following is None or following.tangent @ point.tangent < LEAST_COSINE:
            step *= 0.5
            if step < LEAST_STEP:
                return None
            continue
        if following.tangent[-1] <= 0.0:
            return _turning_compliance(point, following)
        point, step = following, min(STEP_GROWTH * step, MAX_STEP)
    return None


def _turning_compliance(first: _CurvePoint, second: _CurvePoint) -> float | None:
    """Return the largest compliance between two points, by a parabola of log eps; None from 1 on.

    With the slopes a and -b at its ends a parabola of arclength h rises by h a^2 / (2 (a + b)).
    """
    length = np.linalg.norm(second.coordinates - first.coordinates)
    rise, fall = first.tangent[-1], second.tangent[-1]
    highest = first.coordinates[-1] + 0.5 * length * rise**2 / (rise - fall)
    return float(np.exp(highest)) if highest < 0.0 else None
