from framework.catalogue import load_robot
from framework.control.control_cycle import ControlCycle
from framework.dynamics.forward_dynamics import forward_dynamics
from framework.dynamics.inverse_dynamics import inverse_dynamics
from framework.dynamics.platform_wrench import platform_limits
from framework.dynamics.pointwise_dynamics import dynamics_at, dynamics_derivatives
from framework.dynamics.result import InverseDynamics
from framework.errors import (
    FrameworkError,
    InvalidInput,
    LimitsExceeded,
    LoadedJoint,
    LostWorkers,
    MissingPackage,
    NoAnswer,
    NoLaw,
    NotAssembled,
    NotConverged,
    NotIdentified,
    OutOfReach,
    OutputError,
    RobotFileError,
    SingularPath,
    SingularPose,
    SingularReference,
    SpringsTooSoft,
    Type1Singularity,
    Type2Singularity,
    UnboundedTorque,
    UncontrolledMotions,
)
from framework.fidelity.capacity import largest_load
from framework.fidelity.fidelity_study import FidelityStudy, fidelity_study
from framework.kinematics.continuation.forward_kinematics import (
    follow_motors,
    forward_kinematics,
    forward_kinematics_stack,
)
from framework.kinematics.continuation.tracking import assemble, track_path
from framework.kinematics.diagnostics.diagnosis import check_robot
from framework.kinematics.mechanism import Mechanism
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.velocity_matrices import velocity_matrices
from framework.laws.curves import Arc, Polyline, Spline
from framework.laws.law import Condition, Law
from framework.laws.path import Line
from framework.planning.chain import chain_plans
from framework.planning.joint_path import JointPath
from framework.planning.plan import plan_crossing
from framework.planning.plan_study import plan_study
from framework.planning.result import CrossingPlan
from framework.planning.saved import load_plan
from framework.planning.scenes import plan_scene
from framework.proofs.singular_paving import SingularPaving, pave_singularities
from framework.simulation.simulate import Simulation, simulate
from framework.singularity.points_on_path import SingularPoint, locate_singularities
from framework.singularity.pose_classes import classify
from framework.singularity.traced_locus import trace_locus

__all__ = [
    "Arc",
    "Condition",
    "ControlCycle",
    "CrossingPlan",
    "FidelityStudy",
    "FrameworkError",
    "InvalidInput",
    "InverseDynamics",
    "JointPath",
    "Law",
    "LimitsExceeded",
    "Line",
    "LoadedJoint",
    "LostWorkers",
    "Mechanism",
    "MissingPackage",
    "NoAnswer",
    "NoLaw",
    "NotAssembled",
    "NotConverged",
    "NotIdentified",
    "OutOfReach",
    "OutputError",
    "ParallelRobot",
    "Polyline",
    "RobotFileError",
    "Simulation",
    "SingularPath",
    "SingularPaving",
    "SingularPoint",
    "SingularPose",
    "SingularReference",
    "Spline",
    "SpringsTooSoft",
    "Type1Singularity",
    "Type2Singularity",
    "UnboundedTorque",
    "UncontrolledMotions",
    "assemble",
    "chain_plans",
    "check_robot",
    "classify",
    "dynamics_at",
    "dynamics_derivatives",
    "fidelity_study",
    "follow_motors",
    "forward_dynamics",
    "forward_kinematics",
    "forward_kinematics_stack",
    "inverse_dynamics",
    "largest_load",
    "load_plan",
    "load_robot",
    "locate_singularities",
    "pave_singularities",
    "plan_crossing",
    "plan_scene",
    "plan_study",
    "platform_limits",
    "simulate",
    "trace_locus",
    "track_path",
    "velocity_matrices",
]
