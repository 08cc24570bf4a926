"""A change of assembly mode without a singularity: the motors led once around a cusp of the locus.

Next to a cusp, between the two arms of the locus in the space of the motors, three assembly modes belong to
the same motors; two of them lie on the same side of the locus and are joined around the cusp (McAree and
Daniel 1999; Zein, Wenger and Chablat 2008). The motors begin between the arms and go once round on a circle
in the plane of the two free motors; forward kinematics follows the pose and stops at any Type 2 singularity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from framework.errors import InvalidInput, NotAssembled
from framework.kinematics.continuation.forward_kinematics import forward_kinematics
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, ReadOnlyArrays
from framework.numerics.rotations import whole_turns
from framework.proofs.assembly_modes import assembly_modes
from framework.singularity.traced_locus import LocusCurve, LocusPoint, TracedLocus
from framework.singularity.type2 import singularity_measure
from framework.tolerances import DISTINCT_SOLUTIONS

CIRCLE_STEPS = 24  # on the circle
# [rad, lengths] of circles that are tried, the largest first
CIRCLE_RADII = (0.04, 0.02, 0.01, 0.005, 0.0025)


@dataclass(frozen=True, eq=False)
class AssemblyModeChange(ReadOnlyArrays):
    """A closed course of the motors that ends in another pose of the platform."""

    cusp: LocusPoint
    motors: Array  # (T, n_a) joint side; the last are the first
    q: Array  # (T, nq)
    x: Array  # (T, n)
    g: Array  # (T,) never zero

    @property
    def clearance(self) -> float:
        """Least |g| on the course."""
        return float(np.abs(self.g).min())


def find_mode_change(locus: TracedLocus, cusp: LocusPoint) -> AssemblyModeChange | None:
    """Find the change of assembly mode around a cusp of a locus in two motors.

    None where no circle leads from one assembly mode to another, because it meets another part of the locus.

    Raises:
        InvalidInput: the locus was traced in coordinates of the platform, or has no such cusp.
    """
    robot = locus.robot
    if locus.free[0] not in robot.actuator_names:
        raise InvalidInput(f"locus: needs one that was traced in two motors of {robot.name}, see `free`")
    curve = _curve_of(locus, cusp)
    free = [robot.actuator_names.index(name) for name in locus.free]
    scale = robot.column_scale[robot.actuated][free]
    inside = _opening_direction(robot, curve, cusp)[free] / scale
    start = float(np.arctan2(inside[1], inside[0]))
    angle = start + np.linspace(0.0, 2 * np.pi, CIRCLE_STEPS + 1)
    for radius in CIRCLE_RADII:
        motors = np.repeat(cusp.motors[None], len(angle), axis=0)
        motors[:, free] += radius * scale * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        motors[-1] = motors[0]
        change = _follow_circle(robot, cusp, motors)
        if change is not None:
            return change
    return None


def _curve_of(locus: TracedLocus, cusp: LocusPoint) -> LocusCurve:
    """Return the curve of the locus that has this cusp."""
    for curve in locus.curves:
        if any(point is cusp for point in curve.cusps):
            return curve
    raise InvalidInput("cusp: needs to be one of `locus.cusps`")


def _opening_direction(robot: ParallelRobot, curve: LocusCurve, cusp: LocusPoint) -> Array:
    """Compute the direction (n_a,) of the motors into which a cusp opens."""
    scale = robot.column_scale if robot.model.nq == robot.model.nv else 1.0
    distance = np.linalg.norm((curve.q - cusp.q) / scale, axis=1)
    k = int(np.clip(np.argmin(distance), 1, len(curve.q) - 2))
    offset = curve.motors[k] - cusp.motors
    turns = np.where(np.abs(offset) > 3, whole_turns(offset), 0.0)
    return 0.5 * (curve.motors[k - 1] + curve.motors[k + 1]) - (cusp.motors + turns)


def _follow_circle(robot: ParallelRobot, cusp: LocusPoint, motors: Array) -> AssemblyModeChange | None:
    """Follow motors (T, n_a) from the modes beside the cusp; return the first change."""
    scale = robot.platform_scale
    modes = assembly_modes(robot, motors[0]).modes
    nearest = sorted(modes, key=lambda mode: float(np.linalg.norm((mode.x - cusp.x) / scale)))[:3]
    for first in nearest:
        q, x = [first.q], [first.x]
        try:
            for target in motors[1:]:
                pose = forward_kinematics(robot, target, near=q[-1])
                q.append(pose.q)
                x.append(pose.x)
        except NotAssembled:
            continue
        if np.linalg.norm((x[-1] - x[0]) / scale) > DISTINCT_SOLUTIONS:
            poses = np.array(q)
            g = singularity_measure(robot, linearised_at(robot, poses, None)).g
            return AssemblyModeChange(cusp, motors, poses, np.array(x), g)
    return None
