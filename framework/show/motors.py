"""The motors as shapes: drums on turning joints and on legs that stretch, blocks on rails."""

from __future__ import annotations

import numpy as np

from framework.arrays import Array
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.placements import carried_axis, joint_axis
from framework.model.visuals import Shape
from framework.show.shapes import body_shapes, placed

MOTOR_RADIUS = 0.06  # radius of a motor, over the radius of the picture
IDLE_MOTOR_COLOR = (0.83, 0.84, 0.86, 1.0)  # of a motor without torque, as on the page
DRUM_OFFSET = 1.2  # from the foot of a leg that stretches to the middle of its drum, in lengths of the drum


def motor_shapes(robot: ParallelRobot, shapes: list[Shape] | None = None, size: float = 0.0) -> list[Shape]:
    """Return a solid for each motor, on its node; `shapes` are the bodies, `size` the picture's radius."""
    shapes = body_shapes(robot) if shapes is None else shapes
    size = size or 0.7 * robot.length
    axes = [joint_axis(robot, int(column)) for column in robot.actuated]
    motors = []
    edges: tuple[float, ...]
    for k, (node, place, axis) in enumerate(axes):
        radius, slides = MOTOR_RADIUS * size, robot.sliding[robot.actuated[k]]
        kind, edges = "cylinder", (radius, 1.3 * radius)
        carried = [shape for shape in shapes if shape.node == node]
        if slides and node:
            place, edges = _drum_on_leg(place, axis, carried, size)
        elif slides:
            node, place, axis = carried_axis(robot, int(robot.actuated[k]))
            kind, edges = "box", (1.1 * radius, 1.1 * radius, 1.8 * radius)
        elif any(
            j != k and np.linalg.norm(place - other.place) < 0.01 * size for j, other in enumerate(axes)
        ):
            place, radius = _housing(place, axis, carried, size)
            edges = (radius, 1.3 * radius)
        motors.append(Shape(node, kind, edges, placed(place, axis), IDLE_MOTOR_COLOR))
    return motors


def _drum_on_leg(
    foot: Array, axis: Array, shapes: list[Shape], size: float
) -> tuple[Array, tuple[float, ...]]:
    """Return place, radius and length of the drum about a leg that stretches: wider than its tube."""
    tube = max((shape.size[0] for shape in shapes if shape.kind == "cylinder"), default=0.0)
    radius = max(0.6 * MOTOR_RADIUS * size, 1.5 * tube)
    length = 3.0 * radius
    return foot + DRUM_OFFSET * length * axis, (radius, length)


def _housing(place: Array, axis: Array, shapes: list[Shape], size: float) -> tuple[Array, float]:
    """Return place and radius of a motor whose axis meets others: its node's farthest cylinder on it."""
    farthest, radius = 0.0, MOTOR_RADIUS * size
    for shape in shapes:
        offset = shape.placement[:3, 3] - place
        along = float(offset @ axis)
        beside = np.linalg.norm(offset - along * axis)
        if shape.kind == "cylinder" and beside < 0.05 * size and abs(along) > abs(farthest):
            farthest, radius = along, 1.15 * shape.size[0]
    return place + farthest * axis, radius
