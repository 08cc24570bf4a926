"""Poses measured of robots whose joint origins are off their files' by a machine shop's errors."""

import numpy as np

from framework import ParallelRobot
from framework.identification import Recording
from framework.identification.geometry import Geometry, parametrise_geometry
from framework.kinematics.continuation.forward_kinematics import forward_kinematics_stack

TRACKER = 2e-5  # [m]
PLANAR = ("five_bar", "three_rrr")


def off_by(robot: ParallelRobot, seed: int, *, length: float = 1e-3, angle: float = np.radians(1.0)):
    """A geometry, parameters up to so much off (of planar robots in the plane), and the robot with them."""
    geometry = parametrise_geometry(robot)
    random = np.random.default_rng(seed)
    values = np.where(geometry.turning, angle, length) * random.uniform(-1, 1, len(geometry.names))
    if robot.name in PLANAR:  # out of it their loops would not close
        values.reshape(-1, 6)[:, 2:5] = 0.0
    return geometry, values, with_geometry(geometry, values)


def with_geometry(geometry: Geometry, values: np.ndarray) -> ParallelRobot:
    return ParallelRobot.from_description(geometry.description(values))


def poses(
    true: ParallelRobot, nominal: ParallelRobot, count: int, seed: int, noise: float = TRACKER
) -> Recording:
    """Platform poses and angles of passive joints at random motor angles, where both robots can be."""
    random = np.random.default_rng(seed)
    start = nominal.actuated_coordinates(nominal.reference.q[None])[0]
    reach = 0.2 * nominal.column_scale[nominal.actuated]
    q_a = start + reach * random.uniform(-1, 1, (3 * count, nominal.n_a))
    kept: list[tuple[np.ndarray, ...]] = []  # of each pose q_a, x, q
    for drawn in q_a.reshape(3, count, nominal.n_a):
        stacks = [forward_kinematics_stack(robot, drawn) for robot in (true, nominal)]
        refused = {row for stack in stacks for row in stack.refused}
        rows = [k for k in range(count) if k not in refused and stacks[0].clearance[k] > 0.01]
        kept += zip(drawn[rows], stacks[0].x[rows], stacks[0].q[rows], strict=True)
        if len(kept) >= count:
            break
    q_a, x, q = map(np.array, zip(*kept[:count], strict=True))
    x += noise * true.platform_scale / true.length * random.standard_normal(x.shape)
    passive = true.coordinates.positions(q)[:, true.passive]
    names = [
        *(f"motor_angle_{joint}" for joint in nominal.actuator_names),
        *(f"platform_{axis}" for axis in nominal.axis_names),
        *(f"joint_{true.coordinates.name_of(int(column))}" for column in true.passive),
    ]
    return Recording("poses", tuple(names), np.column_stack([q_a * nominal.gear_ratio, x, passive]))


def only(data: Recording, *prefixes: str) -> Recording:
    """The columns that begin so."""
    kept = [k for k, name in enumerate(data.names) if name.startswith(prefixes)]
    return Recording(data.source, tuple(data.names[k] for k in kept), data.values[:, kept])
