"""The motors as shapes: drums on turning joints and on legs that stretch, blocks on rails."""

from __future__ import annotations

import numpy as np

from framework.arrays import Array
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.placements import JointAxis, carried_axis, joint_axis
from framework.model.visuals import Shape
from framework.show.shapes import body_shapes, placement_along

MOTOR_RADIUS = 0.06  # radius of a motor, over the radius of the picture
IDLE_MOTOR_COLOR = (0.83, 0.84, 0.86, 1.0)  # of a motor without torque, as on the page
DRUM_OFFSET = 1.2  # from the foot of a leg that stretches to the middle of its drum, in lengths of the drum


def motor_shapes(robot: ParallelRobot, shapes: list[Shape] | None = None, size: float = 0.0) -> list[Shape]:
    """Return a solid for each motor, on its node; `shapes` are the bodies, `size` the picture's radius."""
    shapes = body_shapes(robot) if shapes is None else shapes
    size = size or 0.7 * robot.length
    axes = [joint_axis(robot, int(column)) for column in robot.actuated]
    motors = []
    for column, axis in zip(robot.actuated, axes, strict=True):
        distances = [np.linalg.norm(axis.place - other.place) for other in axes if other is not axis]
        if robot.sliding[column] and not axis.joint:
            motors.append(_block(carried_axis(robot, int(column)), size))
            continue
        carried = [shape for shape in shapes if shape.node == axis.joint]
        if robot.sliding[column]:
            motors.append(_drum_on_leg(axis, carried, size))
        else:
            motors.append(_drum(axis, carried if min(distances, default=size) < 0.01 * size else [], size))
    return motors


def _block(axis: JointAxis, size: float) -> Shape:
    """Return the block of a motor on a rail."""
    radius = MOTOR_RADIUS * size
    edges = (1.1 * radius, 1.1 * radius, 1.8 * radius)
    return Shape(axis.joint, "box", edges, placement_along(axis.place, axis.axis), IDLE_MOTOR_COLOR)


def _drum_on_leg(axis: JointAxis, shapes: list[Shape], size: float) -> Shape:
    """Return the drum about a leg that stretches, wider than the leg's tube."""
    tube = max((shape.size[0] for shape in shapes if shape.kind == "cylinder"), default=0.0)
    radius = max(0.6 * MOTOR_RADIUS * size, 1.5 * tube)
    length = 3.0 * radius
    placement = placement_along(axis.place + DRUM_OFFSET * length * axis.axis, axis.axis)
    return Shape(axis.joint, "cylinder", (radius, length), placement, IDLE_MOTOR_COLOR)


def _drum(axis: JointAxis, shapes: list[Shape], size: float) -> Shape:
    """Return the drum of a motor that turns a joint, in the housing among `shapes` if any."""
    place, radius = _housing(axis.place, axis.axis, shapes, size)
    placement = placement_along(place, axis.axis)
    return Shape(axis.joint, "cylinder", (radius, 1.3 * radius), placement, IDLE_MOTOR_COLOR)


def _housing(place: Array, axis: Array, shapes: list[Shape], size: float) -> tuple[Array, float]:
    """Return place and radius of a motor whose axis meets others: its farthest cylinder on the axis."""
    farthest, radius = 0.0, MOTOR_RADIUS * size
    for shape in shapes:
        offset = shape.placement[:3, 3] - place
        along = float(offset @ axis)
        beside = np.linalg.norm(offset - along * axis)
        if shape.kind == "cylinder" and beside < 0.05 * size and abs(along) > abs(farthest):
            farthest, radius = along, 1.15 * shape.size[0]
    return place + farthest * axis, radius
