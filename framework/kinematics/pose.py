"""One assembled pose by the names of the robot file: joints, platform, modes, exceeded limits."""

from __future__ import annotations

from dataclasses import dataclass

from framework.kinematics.linearised_loops import assembled_at
from framework.kinematics.modes import mode_signs
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.kinematics.tree_model import positions_beyond_limits
from framework.numerics.arrays import Array, ArrayLike, Names


@dataclass(frozen=True)
class Pose:
    """An assembled pose: angles [rad] with whole turns of hinges, slides [m]."""

    robot: str
    flexibility: str
    platform: dict[str, float]  # by axis
    motor_joints: dict[str, float]  # joint side of the gears
    motor_angles: dict[str, float]  # motor side: gear ratio times joint position
    joints: dict[str, float]  # all joints of the URDF, actuated ones included
    working_mode: int  # sign, which changes at Type 1
    assembly_mode: int  # sign, which changes at Type 2
    closure_error: float  # largest residual of all loop equations, redundant ones included [m or rad]
    exceeded: dict[str, str]  # joints beyond their limits in the URDF, with position and limit


def describe_pose(robot: ParallelRobot, q: ArrayLike) -> Pose:
    """Describe an assembled configuration q (nq,): coordinates by name, modes, exceeded limits.

    Raises:
        InvalidInput: q has the wrong length, is not finite, or leaves the loops open.
    """
    expect_robot(robot)
    closed = assembled_at(robot, q)
    working_sign, assembly_sign = mode_signs(robot, closed.linearised)
    motors = robot.actuated_coordinates(closed.q)[0]
    return Pose(
        robot=robot.name,
        flexibility=robot.flexibility,
        platform=_name_values(robot.axis_names, closed.x[0]),
        motor_joints=_name_values(robot.actuator_names, motors),
        motor_angles=_name_values(robot.actuator_names, robot.gear_ratio * motors),
        joints=robot.reference_values(closed.q[0]),
        working_mode=int(working_sign[0]),
        assembly_mode=int(assembly_sign[0]),
        closure_error=float(closed.linearised.gap[0]),
        exceeded=positions_beyond_limits(robot.limits, closed.q),
    )


def _name_values(names: Names, values: Array) -> dict[str, float]:
    """Return values (k,) as a mapping by name."""
    return dict(zip(names, values.tolist(), strict=True))
