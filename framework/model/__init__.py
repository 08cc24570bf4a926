"""What the robot is: its description, its springs, its pinocchio model and index sets."""

from framework.model.parallel_robot import ParallelRobot, expect_robot
from framework.model.robot_file import read_robot_file

__all__ = ["ParallelRobot", "expect_robot", "read_robot_file"]
