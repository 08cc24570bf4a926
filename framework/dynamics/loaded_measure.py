"""The singular point of an elastic robot under its loads, where the balance of deflections loses rank.

Along a motion the deflections l solve F(t, l) = 0 (`loaded_balance`). With a prescribed platform, F has the
derivative F_l = Y' H Z. Y spans the motions with locked motors and free platform, Z those with fixed platform
and free motors, and H is the stiffness of springs and loads. The motors lose control of deflections where F_l
loses rank. The distance from the geometric singular point, the root of g without loads, is of the order of
load over stiffness. The platform's stiffness with locked motors, Y' H Y, vanishes at yet another point.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.dynamics.loaded_balance import (
    DeflectedMotion,
    LoadedBalance,
    constraint_rows,
    deflection_slopes,
    evaluate_balance,
    spring_units,
)
from framework.dynamics.result import InverseDynamics
from framework.errors import NoAnswer
from framework.kinematics.continuation.tracking import Branch
from framework.laws.law import law_derivatives
from framework.laws.path import time_derivatives
from framework.numerics.arrays import Array
from framework.singularity.bordered_system import root_of_g
from framework.tolerances import SAME_PLACE

FIRST_DEFLECTION = 1e-6  # largest deflection, in spring units, of differences about the undeformed robot
MAX_STEP_SHARE = 0.5  # of the time to the nearest other crossing, the largest Newton step


class LoadedPoint(NamedTuple):
    """A singular point of the loaded robot on its path, met by the motion at `time` [s]."""

    time: float
    s: float
    distance: float  # from the geometric singular point [m], or [rad] for a platform that only turns


def loaded_tangent(result: InverseDynamics, t: Array) -> Array:
    """Compute the tangent F_l = dF/dl (T, n_e, n_e) at instants t (T,) [s], over the springs' stiffness.

    F(l) = Y' load = 0 is the balance of the deflections l along the motion of a deformed robot: the columns
    of Y (T, f, n_e) span the motions with locked motors, in which the load does no work. F_l is in units of
    the springs, and is multiplied from the left by a regular matrix that makes it smooth in t.

    Raises:
        NotAssembled: the deflections tear the loops.
    """
    robot = result.robot
    s = law_derivatives(result.law, t)  # s and two time derivatives, (T,) each
    deflections = [result.deflection(t, order) for order in range(3)]
    prescribed = DeflectedMotion(s[0], *time_derivatives(result.path, s), *deflections)
    balance = evaluate_balance(robot, prescribed, result.configuration(t), wrenches=result.wrenches)
    Y = balance.Y
    load_slopes = deflection_slopes(robot, balance, orders=1)  # (T, f, n_e)
    F_l = Y.swapaxes(1, 2) @ load_slopes
    stiffness = float((robot.stiffness * spring_units(robot) ** 2).max())
    # the basis Y may jump between instants: Y_0' Y refers all to the basis Y_0 of the middle one
    return Y[len(t) // 2].T @ Y @ F_l / stiffness


def loaded_point(result: InverseDynamics, time: float) -> LoadedPoint | None:
    """Find the singular point of the loaded robot near the undeformed one crossed at `time` [s].

    There the `loaded_tangent` is singular: g, by which it differs from a singular matrix, has a root. None
    for rigid robots and rigid geometry, which have no deflections to solve for. Also None unless Newton's
    method converges to a root that is nearer to this crossing than to any other.
    """
    if result.geometry == "rigid" or not result.robot.n_e:
        return None
    times = np.array([crossing.time for crossing in result.crossings])
    others = times[np.abs(times - time) > SAME_PLACE * result.duration]  # instants of the other crossings
    longest_step = MAX_STEP_SHARE * np.abs(others - time).min(initial=np.inf)  # [s]
    try:
        t, converged = root_of_g(
            lambda t: loaded_tangent(result, t), time, high=result.duration, longest=longest_step
        )
    except NoAnswer:
        return None
    distance_to_others = np.abs(others - t).min(initial=np.inf)  # [s]
    if not converged or distance_to_others <= abs(t - time):
        return None
    geometric, loaded = result.platform(np.array([time, t]))
    offset, translations = loaded - geometric, result.robot.translations
    distance = float(np.linalg.norm(offset[translations] if translations.any() else offset))
    return LoadedPoint(t, float(result.law(np.array([t]))[0]), distance)


class Softening(NamedTuple):
    """The measure g + eps h of the loaded tangent to first order in the compliance eps of the springs."""

    g: Array  # (T,) of the undeformed robot, zero where it is singular
    h: Array  # (T,)


def measure_softening(branch: Branch, motion: DeflectedMotion) -> Softening:
    """Compute the measure (T,) of the loaded tangent along a motion, to first order in the compliance.

    The measure is det [eps H | C'] with the stiffness H of springs and loads (see `loaded_tangent`) and the
    constraints C of loops and locked motors. At eps = 1 the springs are those of the robot. To first order,
    deflections are eps K^-1 w, where w are the spring forces of the undeformed robot; eps H is then K plus
    eps times the stiffness of its loads. The deflections of `motion` are zero.

    Raises:
        NotAssembled: the path leaves the workspace.
    """
    robot = branch.robot
    units = spring_units(robot)
    stiffness = robot.stiffness * units**2  # K (n_e,), in spring units
    rigid = evaluate_balance(robot, motion, branch.guess(motion.s), wrenches=branch.wrenches)
    to_springs = rigid.Y[:, : robot.n_e].swapaxes(1, 2)  # (T, n_e, n_e)
    w = -np.linalg.solve(to_springs, rigid.F[..., None])[..., 0]  # F + (rows of springs in Y)' w = 0
    deflections = w / stiffness
    # a compliance that is small enough for a forward difference; without a load nothing deflects
    eps = FIRST_DEFLECTION / (np.abs(deflections).max() or 1.0)
    deflected = motion._replace(l=eps * deflections * units)
    balance = evaluate_balance(robot, deflected, rigid.motion.q, wrenches=branch.wrenches, stiffer=1.0 / eps)
    unit = stiffness.max()  # the measures are determinants, which would overflow
    g = _tangent_measure(branch, rigid, np.diag(stiffness / unit)[None])
    g_eps = _tangent_measure(branch, balance, eps / unit * deflection_slopes(robot, balance, orders=1))
    return Softening(g, (g_eps - g) / eps)


def _tangent_measure(branch: Branch, balance: LoadedBalance, stiffness: Array) -> Array:
    """Compute det [stiffness | C'] (T,), with f = n_e + c rows and columns.

    Args:
        balance: gives the constraints C (T, c, f).
        stiffness: (T, f, n_e), or (1, n_e, n_e) of the springs alone, whose further rows are zero.
    """
    constraints = constraint_rows(branch.robot, balance.motion.linearised).swapaxes(1, 2)  # (T, f, c)
    matrix = np.zeros((*constraints.shape[:2], constraints.shape[1]))
    n_e = branch.robot.n_e
    matrix[:, : stiffness.shape[1], :n_e] = stiffness
    matrix[:, :, n_e:] = constraints
    return np.linalg.det(matrix)
