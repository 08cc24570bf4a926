"""The solids of a robot in a picture: the visuals of its URDF, sticks for bodies without one, and motors.

A motor is a drum on a turning joint or around a leg that stretches, and a block on a rail.

A joint's axis has the joint, a `place` (3,) on the line and the direction `axis` (3,).
"""

from __future__ import annotations

import numpy as np

from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.placements import JointAxis, carried_axis, joint_axis
from framework.model.visuals import Color, Shape, read_visuals
from framework.numerics.arrays import Array, IntArray

STICK_COLOR: Color = (0.45, 0.52, 0.60, 1.0)
JOINT_COLOR: Color = (0.75, 0.76, 0.78, 1.0)
MAX_SURFACE_POINTS = 3000  # of one shape


def body_shapes(robot: ParallelRobot) -> list[Shape]:
    """Return the visuals of the URDF, meshes thinned, and sticks for other bodies."""
    shapes = []
    for shape in read_visuals(robot.description, robot.model):
        if shape.vertices is not None and shape.faces is not None:
            vertices, faces = thin_mesh(shape.vertices, shape.faces)
            shape = shape._replace(vertices=vertices, faces=faces)
        shapes.append(shape)
    return shapes + _stick_shapes(robot, {shape.node for shape in shapes})


def thin_mesh(vertices: Array, faces: IntArray) -> tuple[Array, IntArray]:
    """Thin a mesh: merge the vertices (m, 3) in each cell of a grid into their mean; return vertices, faces.

    Faces (F, 3) are indices of the vertices. Those that have lost a corner are left out.
    """
    low = vertices.min(axis=0)
    edge = max(np.linalg.norm(np.ptp(vertices, axis=0)) / 40, 1e-12)  # 40 cells along the diagonal
    cells = np.floor((vertices - low) / edge).astype(np.int64)
    _, inverse, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    inverse = inverse.ravel()  # the cell of each vertex
    mean = np.stack([np.bincount(inverse, coordinate) / count for coordinate in vertices.T], axis=1)
    corners = inverse[faces]  # (F, 3)
    differ = np.diff(np.sort(corners, axis=1), axis=1).all(axis=1)  # a triangle still has three corners
    return mean, np.unique(corners[differ], axis=0)


def surface_points(shape: Shape, spacing: float) -> Array:
    """Return points (m, 3) on a shape's surface in its node's frame, `spacing` [m] apart."""
    if shape.vertices is not None and shape.faces is not None:
        local = np.concatenate([shape.vertices, shape.vertices[shape.faces].mean(axis=1)])
        local = local[:: 1 + len(local) // MAX_SURFACE_POINTS]
    else:
        _, middle, longest = np.sort(2 * shape.half_edges / spacing)  # edges, in spacings
        # two points for each square of the grid on six faces, all as large as the largest
        count = int(min(MAX_SURFACE_POINTS, 12 * (longest + 1) * (middle + 1)))
        # a spiral of golden angles on the unit sphere
        height = (2 * np.arange(count) + 1) / count - 1
        angle = np.pi * (3 - np.sqrt(5)) * np.arange(count)
        radius = np.sqrt(1 - height**2)
        sphere = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)
        # pushed outward onto the cube or the cylinder about this sphere, then scaled
        if shape.kind == "box":
            sphere /= np.abs(sphere).max(axis=1, keepdims=True)
        elif shape.kind == "cylinder":
            sphere /= np.maximum(radius, np.abs(height))[:, None]
        local = shape.half_edges * sphere
    return shape.to_node(local)


def _stick_shapes(robot: ParallelRobot, with_visuals: set[int]) -> list[Shape]:
    """Return cylinders between joints and spheres at joints for nodes that are not in `with_visuals`."""
    model = robot.model
    radius = 0.012 * robot.length
    shapes = []
    for node in range(model.njoints):
        if node in with_visuals:
            continue
        ends = [model.jointPlacements[j].translation for j in model.children[node]]
        ends += [
            model.frames[frame].placement.translation
            for frame in robot.frames
            if model.frames[frame].parentJoint == node
        ]
        for end in ends:
            length = float(np.linalg.norm(end))
            if node and length > 0.03 * robot.length:  # no stick between joints that nearly coincide
                placement = placement_with_z_along(0.5 * end, end)
                shapes.append(Shape(node, "cylinder", (radius, length), placement, STICK_COLOR))
        if node and ends:
            shapes.append(Shape(node, "sphere", (1.3 * radius,), np.eye(4), JOINT_COLOR))
    return shapes


def placement_with_z_along(place: Array, axis: Array) -> Array:
    """Return a placement (4, 4) at `place` (3,) with z along `axis` (3,), x and y anywhere across z."""
    z = axis / np.linalg.norm(axis)
    base_axis = np.eye(3)[np.argmin(np.abs(z))]  # least parallel to z, so that x is not zero
    x = np.cross(base_axis, z)
    x /= np.linalg.norm(x)
    placement = np.eye(4)
    placement[:3] = np.stack([x, np.cross(z, x), z, place], axis=1)
    return placement


MOTOR_RADIUS = 0.06  # radius of a motor, over the size of the robot in a picture
PICTURE_SIZE = 0.7  # size of the robot in a picture, over the robot's length
IDLE_MOTOR_COLOR = (0.83, 0.84, 0.86, 1.0)  # color of a motor without torque, as on the page


def motor_shapes(robot: ParallelRobot, shapes: list[Shape]) -> list[Shape]:
    """Return a solid for each motor, on the motor's node; `shapes` are the bodies."""
    size = PICTURE_SIZE * robot.length
    axes = [joint_axis(robot, int(column)) for column in robot.actuated]
    motors = []
    for column, axis in zip(robot.actuated, axes, strict=True):
        bodies = [shape for shape in shapes if shape.node == axis.joint]
        distances = [np.linalg.norm(axis.place - other.place) for other in axes if other is not axis]
        is_shared = min(distances, default=size) < 0.01 * size  # other motors are at the same place
        if not robot.sliding[column]:
            # motors at one place would hide each other: each is drawn about a cylinder of its own body
            motors.append(_drum_motor(axis, bodies if is_shared else [], size))
        elif axis.joint != 0:  # not the base: the rail is a leg
            # a drum around a leg that stretches, wider than the leg's tube
            tube = max((shape.size[0] for shape in bodies if shape.kind == "cylinder"), default=0.0)
            radius = max(0.6 * MOTOR_RADIUS * size, 1.5 * tube)
            length = 3.0 * radius
            motors.append(
                _motor_shape(axis, "cylinder", (radius, length), axis.place + 1.2 * length * axis.axis)
            )
        else:
            rail = carried_axis(robot, int(column))
            width, length = 1.1 * MOTOR_RADIUS * size, 1.8 * MOTOR_RADIUS * size  # of a block
            motors.append(_motor_shape(rail, "box", (width, width, length), rail.place))
    return motors


def _motor_shape(axis: JointAxis, kind: str, size: tuple[float, ...], place: Array) -> Shape:
    """Return the solid of a motor at a place (3,), along its joint's axis."""
    return Shape(axis.joint, kind, size, placement_with_z_along(place, axis.axis), IDLE_MOTOR_COLOR)


def _drum_motor(axis: JointAxis, shapes: list[Shape], size: float) -> Shape:
    """Return the drum of a motor that turns a joint.

    The drum is around the farthest of the cylinders among `shapes` on the joint's axis, or else at the joint.
    `size` [m] is that of the robot in the picture.
    """
    farthest = 0.0  # [m] along the axis, from the joint
    radius = MOTOR_RADIUS * size
    for shape in shapes:
        offset = shape.placement[:3, 3] - axis.place
        along = float(offset @ axis.axis)
        aside = np.linalg.norm(offset - along * axis.axis)
        if shape.kind == "cylinder" and aside < 0.05 * size and abs(along) > abs(farthest):
            farthest = along
            radius = 1.15 * shape.size[0]  # a little more than that of the cylinder
    return _motor_shape(axis, "cylinder", (radius, 1.3 * radius), axis.place + farthest * axis.axis)
