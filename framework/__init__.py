"""Parallel robots through their Type 2 singularities, from a URDF to torques that prove themselves.

Bring a robot (`ParallelRobot.from_file`, or `robots.load` for the catalogue) and a path (`Line`, `Arc`,
`Spline`), and ask:

* `check_robot`: what a file describes, a `Mechanism` whose loops do not close, too;
* `assemble`, `forward_kinematics`, `track_path`: where its joints are;
* `velocity_matrices`: A, B and C of A v = B dq_a + C dq_e; `locate_singularities`: singular points of a path;
* `plan_crossing`, `plan_scene`: a motion law that passes, its torques and their proof, a `CrossingPlan`;
* `inverse_dynamics`: the torques of a law of one's own; `dynamics_at`: what is carried at one instant;
  `simulate`: where torques bring the robot.

Errors have one base, `FrameworkError`: `InvalidInput` when what was given cannot be right, `NoAnswer` when
the answer is no. Controllers and studies are in `framework.control`, figures in `framework.show.plots`,
beams as springs in `framework.model.beams`, `Stepper` and `Event` in `framework.simulation`, torques without
a proof in `framework.dynamics.finite_differences`.
"""

from framework.crossing.plan import plan_crossing
from framework.crossing.result import CrossingPlan
from framework.crossing.saved import load_plan
from framework.crossing.scenes import plan_scene
from framework.dynamics.instant import dynamics_at
from framework.dynamics.inverse_dynamics import inverse_dynamics
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
    OutOfReach,
    OutputError,
    RobotFileError,
    SingularPath,
    SingularPose,
    SingularReference,
    Type1Singularity,
    Type2Singularity,
    UnboundedTorque,
    UncontrolledMotions,
)
from framework.kinematics.diagnostics import check_robot
from framework.kinematics.forward_kinematics import forward_kinematics
from framework.kinematics.mechanism import Mechanism
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tracking import assemble, track_path
from framework.kinematics.velocity_matrices import velocity_matrices
from framework.motion.law import Condition, Law
from framework.motion.path import Arc, Line, Spline
from framework.simulation import Simulation, simulate
from framework.singularity.points_on_path import SingularPoint, locate_singularities

__all__ = [
    "Arc",
    "Condition",
    "CrossingPlan",
    "FrameworkError",
    "InvalidInput",
    "InverseDynamics",
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
    "OutOfReach",
    "OutputError",
    "ParallelRobot",
    "RobotFileError",
    "Simulation",
    "SingularPath",
    "SingularPoint",
    "SingularPose",
    "SingularReference",
    "Spline",
    "Type1Singularity",
    "Type2Singularity",
    "UnboundedTorque",
    "UncontrolledMotions",
    "assemble",
    "check_robot",
    "dynamics_at",
    "forward_kinematics",
    "inverse_dynamics",
    "load_plan",
    "locate_singularities",
    "plan_crossing",
    "plan_scene",
    "simulate",
    "track_path",
    "velocity_matrices",
]
