"""Readers of foreign dialects. Open `recognise` first, which recognises a dialect and calls its reader.

Readers make the records of `framework.model.description`, or raise a RobotFileError that names the element.

Dialects
    urdf                URDF with loops, in several syntaxes
    gepetto             a YAML of loops beside a URDF
    mjcf, mujoco_model  MuJoCo's models, compiled by MuJoCo itself
    sdf, sdf_scope      SDFormat: its joints, and its nested names and poses
    pinocchio_model     a model of pinocchio in memory, with constraint models

Shared by all readers
    urdf_tree           a tree that readers edit, with lists of loops, motors and forces
    describe            from the tree to the records: locks, motors, options, proposals
"""

from framework.model.readers.recognise import DIALECTS, parse_any, read_any

__all__ = ["DIALECTS", "parse_any", "read_any"]
