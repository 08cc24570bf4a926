from framework.model.beams import Material, Section, SplitBeam, beam_spring, beam_stiffness, split_beam
from framework.model.description import (
    FLEXIBILITIES,
    LEVELS,
    Actuator,
    Closure,
    Coupling,
    FrameWrench,
    JointDynamics,
    KeptLevel,
    Level,
    LineSpring,
    Platform,
    RobotDescription,
    Scene,
    Spring,
)
from framework.model.robot_file import read_robot_file
from framework.model.robot_file_writer import write_robot_file
from framework.model.urdf_elements import Joint, ParsedRobot, Tree

__all__ = [
    "FLEXIBILITIES",
    "LEVELS",
    "Actuator",
    "Closure",
    "Coupling",
    "FrameWrench",
    "Joint",
    "JointDynamics",
    "KeptLevel",
    "Level",
    "LineSpring",
    "Material",
    "ParsedRobot",
    "Platform",
    "RobotDescription",
    "Scene",
    "Section",
    "SplitBeam",
    "Spring",
    "Tree",
    "beam_spring",
    "beam_stiffness",
    "read_robot_file",
    "split_beam",
    "write_robot_file",
]
