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
    ParsedRobot,
    Platform,
    RobotDescription,
    Scene,
    Spring,
)
from framework.model.robot_file import read_robot_file
from framework.model.robot_file_writer import write_robot_file

__all__ = [
    "FLEXIBILITIES",
    "LEVELS",
    "Actuator",
    "Closure",
    "Coupling",
    "FrameWrench",
    "JointDynamics",
    "KeptLevel",
    "Level",
    "Material",
    "ParsedRobot",
    "Platform",
    "RobotDescription",
    "Scene",
    "Section",
    "SplitBeam",
    "Spring",
    "beam_spring",
    "beam_stiffness",
    "read_robot_file",
    "split_beam",
    "write_robot_file",
]
