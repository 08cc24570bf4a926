"""Where the robot is singular under its loads: the singular point of the balance that its deflections are in.

Along a motion the deflections l solve F(t, l) = 0 (`loaded_balance`). A small change of them at a prescribed
platform changes F by F_l = Y' H Z: Y the motions with the motors locked and the platform free, Z those with
the platform held and the motors free, H the stiffness of springs and loads. Deflections are lost hold of
where F_l loses rank, a distance of the order of load over stiffness from where the geometry does (the root of
g, which knows no load). The platform's stiffness with locked motors, Y' H Y, vanishes elsewhere.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.dynamics.loaded_balance import Course, balance_along, deflection_slopes, spring_units
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

    In units of the springs; one regular matrix from the left for all instants, so that it is smooth in t.

    Raises:
        NotAssembled: the deflections tear the loops.
    """
    robot, law = result.robot, result.law
    s = law_derivatives(law, t)
    course = Course(
        s[0], *time_derivatives(result.path, s), *(result.deflection(t, order) for order in range(3))
    )
    balance = balance_along(robot, course, result.configuration(t), wrenches=result.wrenches)
    Y, changes = balance.Y, deflection_slopes(robot, balance, 1)
    stiffness = float((robot.stiffness * spring_units(robot) ** 2).max())
    return Y[len(t) // 2].T @ Y @ (Y.swapaxes(1, 2) @ changes) / stiffness


def loaded_point(result: InverseDynamics, time: float) -> LoadedPoint | None:
    """Find the singular point of the loaded robot near a geometric one that a motion meets at `time` [s].

    None for rigid robots and rigid geometry, which have no deflections to lose, and where none is found
    that is nearer to this crossing than to any other.
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
    moved, lengths = loaded - geometric, result.robot.translations
    distance = float(np.linalg.norm(moved[lengths] if lengths.any() else moved))
    return LoadedPoint(root.place, float(result.law(np.array([root.place]))[0]), distance)
