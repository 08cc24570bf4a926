"""Readers of other loop dialects. Open `recognise` first: it tells dialects apart and calls their readers.

All make the records of `framework.model.description`, or raise a RobotFileError that names the element.

Dialects
    urdf                URDF, whose loops are written in many ways
    gepetto             a YAML of loops beside a URDF
    mjcf, mujoco_model  MuJoCo's models, compiled by MuJoCo itself
    sdf                 SDFormat

What they share
    urdf_tree           what all write into: an open URDF, with loops, motors and forces
    describe            the records of that: what moves, what acts, what a file does not say
"""

from framework.model.readers.recognise import DIALECTS, parse_any, read_any
from framework.model.robot_file_writer import write_robot_file

__all__ = ["DIALECTS", "parse_any", "read_any", "write_robot_file"]
