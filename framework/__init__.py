"""Parallel robots through their Type 2 singularities, from a URDF to torques that prove themselves."""

from framework.control.closed_loop import Loop, run_closed_loop
from framework.control.controllers import tuned_controller
from framework.control.reference import reference_of
from framework.control.study import run_study
from framework.control.variation import Spread
from framework.crossing.plan import plan_crossing, uncertified_law
from framework.crossing.result import CrossingPlan
from framework.crossing.saved import load_plan
from framework.crossing.scenes import plan_scene, scene_path
from framework.dynamics.finite_differences import finite_difference_torques
from framework.dynamics.inverse_dynamics import inverse_dynamics
from framework.dynamics.result import InverseDynamics
from framework.errors import (
    InvalidInput,
    NoAnswer,
    NoLaw,
    NotAssembled,
    NotConverged,
    OutOfReach,
    SingularPath,
    Type1Singularity,
    UnboundedTorque,
)
from framework.kinematics.diagnostics import check_robot
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tracking import assemble, track_path
from framework.kinematics.velocity_matrices import VelocityMatrices, velocity_matrices
from framework.motion.law import Condition, Law
from framework.motion.path import Arc, Line, Spline
from framework.simulation import Event, Simulation, Stepper, simulate
from framework.singularity.points_on_path import SingularPoint, locate_singularities

__all__ = [
    "Arc",
    "Condition",
    "CrossingPlan",
    "Event",
    "InvalidInput",
    "InverseDynamics",
    "Law",
    "Line",
    "Loop",
    "NoAnswer",
    "NoLaw",
    "NotAssembled",
    "NotConverged",
    "OutOfReach",
    "ParallelRobot",
    "Simulation",
    "SingularPath",
    "SingularPoint",
    "Spline",
    "Spread",
    "Stepper",
    "Type1Singularity",
    "UnboundedTorque",
    "VelocityMatrices",
    "assemble",
    "check_robot",
    "finite_difference_torques",
    "inverse_dynamics",
    "load_plan",
    "locate_singularities",
    "plan_crossing",
    "plan_scene",
    "reference_of",
    "run_closed_loop",
    "run_study",
    "scene_path",
    "simulate",
    "track_path",
    "tuned_controller",
    "uncertified_law",
    "velocity_matrices",
]
