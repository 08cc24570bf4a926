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
    deflection_slopes,
    evaluate_balance,
    spring_units,
)
from framework.dynamics.result import InverseDynamics
from framework.errors import NoAnswer
from framework.laws.law import law_derivatives
from framework.laws.path import time_derivatives
from framework.numerics.arrays import Array
from framework.singularity.bordered_system import root_of_g
from framework.tolerances import SAME_PLACE

MAX_STEP_SHARE = 0.5  # of the time to the nearest other crossing, the largest Newton step


class LoadedPoint(NamedTuple):
    """A singular point of the loaded robot on its path, met by the motion at `time` [s]."""

    time: float
    s: float
    distance: float  # from the geometric singular point [m], or [rad] for a platform that only turns


def loaded_tangent(result: InverseDynamics, t: Array) -> Array:
    """Compute the tangent F_l = dF/dl (T, n_e, n_e) at instants t (T,) [s], over the springs' stiffness.

    F is the balance of the deflections l along the motion of a deformed robot. F_l is in units of the
    springs. It is multiplied from the left by a regular matrix that makes it smooth in t.

    Raises:
        NotAssembled: the deflections tear the loops.
    """
    robot = result.robot
    s = law_derivatives(result.law, t)  # s and two time derivatives, (T,) each
    deflections = [result.deflection(t, order) for order in range(3)]
    prescribed = DeflectedMotion(s[0], *time_derivatives(result.path, s), *deflections)
    balance = evaluate_balance(robot, prescribed, result.configuration(t), wrenches=result.wrenches)
    Y = balance.Y
    F_l = Y.swapaxes(1, 2) @ deflection_slopes(robot, balance, orders=1)
    stiffness = float((robot.stiffness * spring_units(robot) ** 2).max())
    # the basis Y may jump between instants: Y_0' Y refers all to the basis Y_0 of the middle one
    return Y[len(t) // 2].T @ Y @ F_l / stiffness


def loaded_point(result: InverseDynamics, time: float) -> LoadedPoint | None:
    """Find the singular point of the loaded robot near a geometric one that is crossed at `time` [s].

    None for rigid robots and rigid geometry, which have no deflections to solve for. Also None unless
    Newton's method converges to a root that is nearer to this crossing than to any other.
    """
    if result.geometry == "rigid" or not result.robot.n_e:
        return None
    times = np.array([crossing.time for crossing in result.crossings])
    others = times[np.abs(times - time) > SAME_PLACE * result.duration]  # instants of the other crossings
    longest_step = MAX_STEP_SHARE * np.abs(others - time).min(initial=np.inf)  # [s]
    try:
        root = root_of_g(
            lambda t: loaded_tangent(result, t), time, high=result.duration, longest=longest_step
        )
    except NoAnswer:
        return None
    distance_to_others = np.abs(others - root.place).min(initial=np.inf)  # [s]
    if not root.converged or distance_to_others <= abs(root.place - time):
        return None
    geometric, loaded = result.platform(np.array([time, root.place]))
    offset, translations = loaded - geometric, result.robot.translations
    distance = float(np.linalg.norm(offset[translations] if translations.any() else offset))
    return LoadedPoint(root.place, float(result.law(np.array([root.place]))[0]), distance)
