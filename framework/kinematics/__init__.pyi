from framework.kinematics.assembly import Configuration
from framework.kinematics.continuation.branch import Branch
from framework.kinematics.continuation.forward_kinematics import (
    ForwardPose,
    PoseStack,
    follow_motors,
    forward_kinematics,
    forward_kinematics_stack,
)
from framework.kinematics.continuation.pose_search import NearestPose
from framework.kinematics.continuation.tracking import assemble, track_path
from framework.kinematics.diagnostics.diagnosis import Diagnosis, check_robot
from framework.kinematics.external_wrenches import AppliedWrench, ExternalWrenches
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.mechanism import Mechanism
from framework.kinematics.motion_rates import Motion, motion_at
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.platform import FramePlatform, JointPlatform
from framework.kinematics.tree_model import Coordinates, JointLimit, positions_beyond_limits
from framework.kinematics.velocity_matrices import (
    KinematicDerivatives,
    PoseSlopes,
    VelocityMatrices,
    kinematic_derivatives,
)

__all__ = [
    "AppliedWrench",
    "Branch",
    "Configuration",
    "Coordinates",
    "Diagnosis",
    "ExternalWrenches",
    "ForwardPose",
    "FramePlatform",
    "JointLimit",
    "JointPlatform",
    "KinematicDerivatives",
    "Mechanism",
    "Motion",
    "NearestPose",
    "ParallelRobot",
    "PoseSlopes",
    "PoseStack",
    "VelocityMatrices",
    "assemble",
    "check_robot",
    "close_loops",
    "follow_motors",
    "forward_kinematics",
    "forward_kinematics_stack",
    "kinematic_derivatives",
    "motion_at",
    "positions_beyond_limits",
    "track_path",
]
