"""What the robot is: its description, its springs, its URDF and the tables of its loops."""

from framework.model.robot_file import read_robot_file

__all__ = ["read_robot_file"]
