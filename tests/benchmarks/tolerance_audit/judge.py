"""Plans as held against the equations of motion, which know no tolerance of the framework.

At a grid of instants, and at and beside each crossing: all loops closed with their first two derivatives, and
no generalised force left, N' (RNEA - tau) = 0, over all coordinates (`tests.oracles.equations_of_motion`);
the platform on the path that was asked for, from its start to its end. So a law that misses condition (8)
shows itself at the crossing, where the motors cannot hold what is left.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework import CrossingPlan
from tests.oracles.equations_of_motion import defects

INSTANTS = 12
BESIDE = (0.0, 1e-7, -1e-5, 1e-3)  # of the duration, from a crossing


class Judgement(NamedTuple):
    """Defects of a plan, relative to the robot, to the terms of their equations, and to the path."""

    loops: float  # closures, over the robot's length, and their derivatives
    force: float
    path: float  # the platform's distance from the path, and of the path's ends, over its extent

    @property
    def worst(self) -> float:
        return max(self)


def judged(plan: CrossingPlan) -> Judgement:
    """Hold a plan against the equations of motion."""
    t = [*np.linspace(0.0, plan.duration, INSTANTS)]
    for crossing in plan.crossings:
        t += [crossing.time + offset * plan.duration for offset in BESIDE]
    t = np.clip(t, 0.0, plan.duration)
    motion, x = plan.dynamics.motion(t), plan.platform(t)
    left = defects(plan.robot, q=motion.q, v=motion.v, a=motion.a, torque=plan.torque(t), x=x)
    wanted = np.concatenate((plan.path(plan.law(t)), plan.path(np.array([0.0, 1.0]))))
    reached = np.concatenate((x, plan.platform(np.array([0.0, plan.duration]))))
    extent = np.ptp(wanted, axis=0).max()
    return Judgement(
        loops=max(left.open / max(plan.robot.length, 1.0), left.speed, left.acceleration),
        force=left.force,
        path=float(max(left.platform, np.abs(reached - wanted).max()) / extent),
    )
