"""The singular point of an elastic robot under its loads: where the balance of its deflections loses rank.

Along a motion the deflections l solve F(t, l) = 0 (`loaded_balance`). A small change of them at a prescribed
platform changes F by F_l = Y' H Z: Y the motions with the motors locked and the platform free, Z those with
the platform held and the motors free, H the stiffness of springs and loads. Deflections are lost hold of
where F_l loses rank, a distance of the order of load over stiffness from where the geometry does (the root of
g, which knows no load). The platform's stiffness with locked motors, Y' H Y, vanishes elsewhere.
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

MAX_STEP_SHARE = 0.5  # of the time to the next crossing, that a step of Newton's method may take


class LoadedPoint(NamedTuple):
    """A singular point of the loaded robot on its path, met by the motion at `time` [s]."""

    time: float
    s: float
    distance: float  # [m], or [rad] of a platform that only turns: from the geometric singular point


def loaded_tangent(result: InverseDynamics, t: Array) -> Array:
    """Compute F_l (T, n_e, n_e) at instants t (T,) of a motion of a deformed robot, over its stiffness.

    In units of the springs. F_l is multiplied from the left by a regular matrix that makes it smooth in t.

    Raises:
        NotAssembled: the deflections tear the loops.
    """
    robot, law = result.robot, result.law
    s = law_derivatives(law, t)
    deflections = [result.deflection(t, order) for order in range(3)]
    prescribed = DeflectedMotion(s[0], *time_derivatives(result.path, s), *deflections)
    balance = evaluate_balance(robot, prescribed, result.configuration(t), wrenches=result.wrenches)
    Y = balance.Y
    F_l = Y.swapaxes(1, 2) @ deflection_slopes(robot, balance, 1)
    stiffness = float((robot.stiffness * spring_units(robot) ** 2).max())
    # Y is orthonormal at each instant by itself: Y_0' Y refers all to the basis Y_0 of the middle instant
    return Y[len(t) // 2].T @ Y @ F_l / stiffness


def loaded_point(result: InverseDynamics, time: float) -> LoadedPoint | None:
    """Find the singular point of the loaded robot near a geometric one that a motion meets at `time` [s].

    None for rigid robots and rigid geometry, which have no deflections to lose; None too unless Newton's
    method converges to a root that is nearer to this crossing than to any other.
    """
    if result.geometry == "rigid" or not result.robot.n_e:
        return None
    times = np.array([crossing.time for crossing in result.crossings])
    others = times[np.abs(times - time) > SAME_PLACE * result.duration]
    longest = MAX_STEP_SHARE * np.abs(others - time).min(initial=np.inf)
    try:
        root = root_of_g(lambda t: loaded_tangent(result, t), time, high=result.duration, longest=longest)
    except NoAnswer:
        return None
    if not root.converged or np.abs(others - root.place).min(initial=np.inf) <= abs(root.place - time):
        return None
    geometric, loaded = result.platform(np.array([time, root.place]))
    offset, translations = loaded - geometric, result.robot.translations
    distance = float(np.linalg.norm(offset[translations] if translations.any() else offset))
    return LoadedPoint(root.place, float(result.law(np.array([root.place]))[0]), distance)
