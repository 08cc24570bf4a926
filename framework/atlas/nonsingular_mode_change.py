"""A change of assembly mode without a singularity: one loop of the motors around a cusp of the locus.

In the space of the motors, between the two arms of the locus that meet at a cusp, three assembly modes share
the same motors. Two of them lie on the same side of the locus and are connected around the cusp (McAree and
Daniel 1999; Zein, Wenger and Chablat 2008). The motors start between the arms and run once around a circle in
the plane of the two free motors. Forward kinematics follows the pose and stops at any Type 2 singularity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from framework.errors import InvalidInput, NotAssembled
from framework.kinematics.continuation.forward_kinematics import follow_motors
from framework.kinematics.frames import difference
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, ReadOnlyArrays
from framework.numerics.rotations import whole_turns
from framework.proofs.assembly_modes import assembly_modes
from framework.singularity.traced_locus import LocusPoint, TracedLocus
from framework.singularity.type2 import singularity_measure
from framework.tolerances import DISTINCT_SOLUTIONS

CIRCLE_STEPS = 24  # of the motors around a circle
# [rad, robot lengths] radii of the circles that are tried in turn
CIRCLE_RADII = (0.04, 0.02, 0.01, 0.005, 0.0025)


@dataclass(frozen=True, eq=False)
class AssemblyModeChange(ReadOnlyArrays):
    """A loop of the motors that ends in another pose of the platform."""

    cusp: LocusPoint
    motors: Array  # (T, n_a) joint side; the last row equals the first
    q: Array  # (T, nq)
    x: Array  # (T, n)
    g: Array  # (T,) never zero

    @property
    def clearance(self) -> float:
        """Least |g| along the loop."""
        return float(np.abs(self.g).min())


def find_mode_change(locus: TracedLocus, cusp: LocusPoint) -> AssemblyModeChange | None:
    """Find the change of assembly mode around a cusp of a locus in two motors.

    The result is None if no circle leads from one assembly mode to another, because all circles meet other
    parts of the locus.

    Raises:
        InvalidInput: the locus was traced in platform coordinates, or the cusp is not one of its cusps.
    """
    robot = locus.robot
    if locus.free[0] not in robot.actuator_names:
        raise InvalidInput(f"locus: needs one that was traced in two motors of {robot.name}, see `free`")
    curves = [curve for curve in locus.curves if any(point is cusp for point in curve.cusps)]
    if not curves:
        raise InvalidInput("cusp: needs to be one of `locus.cusps`")
    curve = curves[0]
    free = [robot.actuator_names.index(name) for name in locus.free]  # the two motors
    scale = robot.column_scale[robot.actuated][free]
    # the cusp opens towards the midpoint between the points of the curve on both arms next to the cusp
    distance = np.linalg.norm(difference(robot, cusp.q, curve.q) / robot.column_scale, axis=1)
    nearest = int(np.clip(np.argmin(distance), 1, len(curve.q) - 2))  # with a neighbour on either side
    turns = whole_turns(curve.motors[nearest] - cusp.motors)  # by which the curve's angles may be off
    midpoint = 0.5 * (curve.motors[nearest - 1] + curve.motors[nearest + 1])
    opening_x, opening_y = (midpoint - (cusp.motors + turns))[free] / scale

    # the circle starts between the arms of the locus
    angle = np.arctan2(opening_y, opening_x) + np.linspace(0.0, 2 * np.pi, CIRCLE_STEPS + 1)
    unit_circle = np.column_stack([np.cos(angle), np.sin(angle)])  # (T, 2)
    for radius in CIRCLE_RADII:
        motors = np.repeat(cusp.motors[None], len(angle), axis=0)
        motors[:, free] += radius * scale * unit_circle
        motors[-1] = motors[0]  # exactly, without rounding
        change = _follow_circle(robot, cusp, motors)
        if change is not None:
            return change
    return None


def _follow_circle(robot: ParallelRobot, cusp: LocusPoint, motors: Array) -> AssemblyModeChange | None:
    """Follow motors (T, n_a) from the three assembly modes nearest to a cusp.

    Return the first change of mode; None if there is no change.
    """

    def distance(x: Array, y: Array) -> float:
        """Return the distance of platform coordinates x and y (n,) [robot lengths, rad]."""
        return float(np.linalg.norm((x - y) / robot.platform_scale))

    modes = assembly_modes(robot, motors[0]).modes
    # the three modes that meet at the cusp
    for mode in sorted(modes, key=lambda mode: distance(mode.x, cusp.x))[:3]:
        try:
            poses = list(follow_motors(robot, motors, near=mode.q))
        except NotAssembled:  # the circle meets the locus
            continue
        q = np.array([pose.q for pose in poses])  # (T, nq)
        x = np.array([pose.x for pose in poses])  # (T, n)
        if distance(x[-1], x[0]) > DISTINCT_SOLUTIONS:
            g = singularity_measure(robot, linearised_at(robot, q)).g
            return AssemblyModeChange(cusp, motors, q, x, g)
    return None
