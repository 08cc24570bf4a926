"""Forces that a motion along a path requires, as coefficients of 1, s'^2, s" and s'.

On a path all coordinates of the undeformed robot are functions of s. With their derivatives q' and q" by s,

    v = q' s',     a = q" s'^2 + q' s",     r = static + centrifugal s'^2 + inertial s" + damping s'.

The motion at s' = 1 and s" = 0 gives all coefficients. Its inertial forces are the centrifugal ones; at rest
with the accelerations q' they are those of s". A difference of forces with and without motion would lose
digits where gravity is large. All coefficients are smooth through Type 2 singularities.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.dynamics.forces import damping_forces, inertial_forces, static_forces
from framework.kinematics.continuation.branch import Branch
from framework.kinematics.linearised_loops import LinearisedLoops
from framework.kinematics.motion_rates import Motion, motion_at
from framework.numerics.arrays import Array


class PathForces(NamedTuple):
    """Generalised forces (T, nv) of the open tree at T poses of a path, springs at rest."""

    static: Array  # of weight, springs and external wrenches
    centrifugal: Array  # of inertia, per s'^2
    inertial: Array  # of inertia, per s"
    damping: Array  # per s'
    motion: Motion  # at s' = 1 and s" = 0

    @staticmethod
    def compute(branch: Branch, s: Array, closed: LinearisedLoops) -> PathForces:
        """Compute the forces at the closed poses `closed` of a branch at s (T,)."""
        robot, path = branch.robot, branch.path
        motion = motion_at(robot, closed, path(s, 1), path(s, 2))
        rates, rest = motion.v, np.zeros(motion.v.shape)
        wrenches = branch.wrenches.evaluate(robot, closed.frames, s)
        return PathForces(
            static=static_forces(robot, closed.q, wrenches),
            centrifugal=inertial_forces(robot, motion),
            inertial=inertial_forces(robot, Motion(motion.q, rest, rates, motion.linearised)),
            damping=damping_forces(robot, closed.q, rates),
            motion=motion,
        )
