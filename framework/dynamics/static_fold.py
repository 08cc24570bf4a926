"""Where the springs of a robot at rest give way: the fold of its deflections as the springs get softer.

At both ends of a motion the platform is at rest, whatever the law. With springs 1 / eps times as stiff as
those of the robot, deflections l = eps v are in balance if F(v, eps) = 0. These n_e equations for n_e + 1
unknowns define a curve that begins at eps = 0. If eps has a maximum below 1 on the curve, the deflections
that are connected with the rigid robot do not reach the robot's own springs.

The curve is followed by pseudo-arclength continuation: H. B. Keller in Applications of Bifurcation Theory,
Academic Press 1977.
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
FIRST_STEP, LEAST_STEP, MAX_STEP = 0.05, 1e-5, 1.0  # of arclength in (v / (v_unit u), log eps)
STEP_GROWTH = 2.0  # of the next step, after a step that succeeded
MAX_POINTS = 400  # of the curve
MAX_CORRECTIONS = 8  # Newton steps from a predicted point to the curve
LEAST_COSINE = 0.8  # between neighbouring tangents


class _CurvePoint(NamedTuple):
    """A point of the curve with its unit tangent; both (n_e + 1,).

    The coordinates are (v / (v_unit u), log eps), where u (n_e,) are the `spring_units`.
    """

    coordinates: Array
    tangent: Array


class _RestCurve(NamedTuple):
    """The curve of deflections eps v in balance at rest at s, over the compliance eps.

    `v_unit` is a typical size of v, by which coordinates are divided.
    """

    branch: Branch
    s: float
    v_unit: float = 1.0

    def _balance(self, coordinates: Array) -> LoadedBalance:
        """Compute the balance of the robot at rest at coordinates (v / (v_unit u), log eps), (n_e + 1,)."""
        branch = self.branch
        s = np.array([self.s])
        compliance = np.exp(coordinates[-1])
        deflections = compliance * self.v_unit * coordinates[None, :-1] * spring_units(branch.robot)
        x = branch.path(s)
        at_rest = DeflectedMotion(s, x, 0.0 * x, 0.0 * x, deflections, 0.0 * deflections, 0.0 * deflections)
        return evaluate_balance(
            branch.robot, at_rest, branch.guess(s), wrenches=branch.wrenches, stiffer=1.0 / compliance
        )

    def residual(self, coordinates: Array) -> tuple[Array, Array]:
        """Compute F (n_e,) and dF/d(coordinates) (n_e, n_e + 1), both divided by the largest load.

        F = Y' load with load = r + K l / eps: r are the forces without springs, K is the stiffness, and the
        columns of Y (f, n_e) are the motions that loops and locked motors allow (see `LoadedBalance`). With
        l = eps v, K l / eps = K v does not depend on eps. So dF/dv = eps Y' dload/dl and dF/d(log eps) =
        eps Y' (dr/dl) v. All deflections and their derivatives are in `spring_units`.
        """
        robot = self.branch.robot
        balance = self._balance(coordinates)
        compliance = np.exp(coordinates[-1])
        load_slopes = deflection_slopes(robot, balance, 1)[0]  # dload/dl (f, n_e) of the one pose
        springs = range(robot.n_e)  # the first of the f rows
        r_slopes = load_slopes.copy()  # dr/dl (f, n_e)
        r_slopes[springs, springs] -= robot.stiffness * spring_units(robot) ** 2 / compliance
        by_coordinates = np.column_stack([load_slopes, r_slopes @ coordinates[:-1]])  # (f, n_e + 1)
        slopes = compliance * self.v_unit * balance.Y[0].T @ by_coordinates
        largest_load = balance.largest_load or 1.0  # without a load nothing deflects
        return balance.F[0] / largest_load, slopes / largest_load

    def correct(self, coordinates: Array, along: Array) -> _CurvePoint | None:
        """Find the point of the curve nearest to `coordinates` by Newton's method with least steps.

        None if the method does not converge.

        Args:
            coordinates: (n_e + 1,) of a `_CurvePoint`, near the curve.
            along: (n_e + 1,) a direction; the tangent of the result points to its side.
        """
        try:
            for _ in range(MAX_CORRECTIONS):
                F, slopes = self.residual(coordinates)
                if np.abs(F).max() <= FOLD_MISFIT:
                    tangent = np.linalg.svd(slopes)[2][-1]  # null space of the slopes
                    return _CurvePoint(coordinates, tangent * np.sign(tangent @ along))
                # the least step: there is one unknown more than equations
                coordinates = coordinates - np.linalg.lstsq(slopes, F, rcond=None)[0]
        except (NoAnswer, np.linalg.LinAlgError):
            pass
        return None


def find_static_fold(branch: Branch, s: float) -> float | None:
    """Find the compliance at which deflections at rest at s turn back, over that of the springs.

    Returns:
        A number below 1; None if the curve reaches the springs of the robot, or if continuation fails.
    """
    softer = np.append(np.zeros(branch.robot.n_e), 1.0)  # the direction of softer springs
    # a first point with v_unit = 1, of which the size of v is taken as the unit
    point = _RestCurve(branch, s).correct(np.log(FIRST_COMPLIANCE) * softer, softer)
    if point is None:
        return None
    v = point.coordinates[:-1]
    v_unit = float(np.abs(v).max()) or 1.0
    curve = _RestCurve(branch, s, v_unit)
    point = curve.correct(np.append(v / v_unit, point.coordinates[-1]), softer)
    step = FIRST_STEP
    for _ in range(MAX_POINTS):
        if point is None or point.coordinates[-1] >= 0.0:  # log eps >= 0: the springs are reached
            return None
        following = curve.correct(point.coordinates + step * point.tangent, point.tangent)
        if following is None or following.tangent @ point.tangent < LEAST_COSINE:
            step *= 0.5
            if step < LEAST_STEP:
                return None
        elif following.tangent[-1] > 0.0:  # log eps still grows
            point = following
            step = min(STEP_GROWTH * step, MAX_STEP)
        elif step > FIRST_STEP:
            step = FIRST_STEP  # close in on the maximum of log eps
        else:
            return _turning_compliance(point, following)
    return None


def _turning_compliance(first: _CurvePoint, second: _CurvePoint) -> float | None:
    """Interpolate log eps between two points by a parabola; return its largest eps, None if not below 1.

    A parabola over the arclength h with slopes a and -b at its ends rises by h a^2 / (2 (a + b)).

    Args:
        first, second: successive points, in front of the maximum of log eps and behind it.
    """
    length = np.linalg.norm(second.coordinates - first.coordinates)
    first_slope = first.tangent[-1]
    rise = 0.5 * length * first_slope**2 / (first_slope - second.tangent[-1])
    highest = first.coordinates[-1] + rise
    return float(np.exp(highest)) if highest < 0.0 else None
