"""One assembled pose in the words of the robot file: joints by their names, modes, limits."""

from __future__ import annotations

from dataclasses import dataclass

from framework.kinematics.linearised_loops import assembled_at
from framework.kinematics.modes import mode_signs
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.kinematics.tree_model import positions_beyond_limits
from framework.numerics.arrays import ArrayLike


@dataclass(frozen=True)
class Pose:
    """An assembled pose. Angles in [rad], slides in [m]; hinges count whole turns."""

    robot: str
    flexibility: str
    platform: dict[str, float]  # by axis
    motor_joints: dict[str, float]  # joint side of the gears
    motor_angles: dict[str, float]  # motor side: gear ratio times the joint
    joints: dict[str, float]  # all joints of the URDF, those with motors too
    working_mode: int  # sign; changes at Type 1
    assembly_mode: int  # sign; changes at Type 2
    closure_error: float  # largest loop equation, redundant ones too [m or rad]
    exceeded: dict[str, str]  # positions beyond the limits of the URDF


def describe_pose(robot: ParallelRobot, q: ArrayLike) -> Pose:
    """Describe an assembled configuration q (nq,) by names, modes and limits.

    Raises:
        InvalidInput: q has the wrong length, is not finite, or leaves the loops open.
    """
    expect_robot(robot)
    closed = assembled_at(robot, q)
    working, assembly = (int(sign[0]) for sign in mode_signs(robot, closed.linearised))
    motors = robot.actuated_coordinates(closed.q)[0]
    return Pose(
        robot=robot.name,
        flexibility=robot.flexibility,
        platform=dict(zip(robot.axis_names, map(float, closed.x[0]), strict=True)),
        motor_joints=dict(zip(robot.actuator_names, map(float, motors), strict=True)),
        motor_angles=dict(zip(robot.actuator_names, map(float, robot.gear_ratio * motors), strict=True)),
        joints=robot.reference_values(closed.q[0]),
        working_mode=working,
        assembly_mode=assembly,
        closure_error=float(closed.linearised.gap[0]),
        exceeded=positions_beyond_limits(robot.limits, closed.q),
    )
