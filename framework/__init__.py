"""Motions of parallel robots through their Type 2 singularities, with torques that are proved finite.

Read first `load_robot`, then `plan_crossing` and its example, then `CrossingPlan`, which is what comes back.

A robot, a path, and where the joints are:

* `load_robot`: a `ParallelRobot`, by its name in the catalogue or by its file; `check_robot`: what a file
  describes, also a `Mechanism` whose loops do not close;
* `Line`, `Arc`, `Spline`, `Polyline`: paths of the platform; `JointPath`: one given in joints;
* `assemble`, `forward_kinematics`, `track_path`: the joints of a pose, and along a path;
  `forward_kinematics_stack`, `follow_motors`: of many motor angles at once, and as encoder samples come;
* `velocity_matrices`: A, B and C of A v = B dq_a + C dq_e.

Singularities:

* `locate_singularities`: those on a path, each a `SingularPoint`; `classify`: every kind at one pose;
* `trace_locus`: the curves that they form; `pave_singularities`: all of a robot, proved, a `SingularPaving`.

Plans:

* `plan_crossing`, `plan_scene`: a motion law that passes, its torques and their proof; `load_plan`: a saved
  plan;
* `chain_plans`: plans one after the other as one motion, such as a plan and one that begins on its way;
* `simulate`: where torques bring the robot, a `Simulation`;
* `plan_study`: one motion planned for many values of a robot's parameters;
* `fidelity_study`: the least model that is enough for a motion, a `FidelityStudy`;
* `largest_load`: the largest push that still crosses.

Dynamics without a plan:

* `inverse_dynamics`: torques of a law of one's own, such as a `Law` through `Condition`s, an
  `InverseDynamics`;
* `dynamics_at`, `forward_dynamics`: from motion to torques and back, with what loops and joints carry;
* `dynamics_derivatives`: how torques change with the motion and with the bodies' parameters;
* `platform_limits`: forces and speeds that the motors can give; `ControlCycle`: pose and torques once a
  millisecond.

Errors have one base, `FrameworkError`: `InvalidInput` when what was given cannot be right, `NoAnswer` when
the answer is no. `framework.errors` has one for each reason.

Beyond these names, each package has its own, with the records that its functions return; nothing that lies
deeper is public:

* `framework.laws`: paths and laws, and what those of one's own have to be; `framework.model`: what a robot
  file says, springs from a beam's section;
* `framework.kinematics`: poses of many motor angles at once, derivatives of a pose along motors and springs;
  `framework.singularity`: records of points, classes and curves; a robot moved by hand;
* `framework.dynamics`: stiffness, loads, derivatives of accelerations, torques without a proof;
  `framework.planning`: what a plan consists of, what condition (8) asks of a law, bounds that no law passes;
* `framework.proofs`: all assembly and working modes, proved; `framework.atlas`: maps, margins, the nearest
  pose to one out of reach, dimensions, a way from one assembly mode to another;
* `framework.control`: controllers on robots that differ from their model, and studies of many;
  `framework.simulation`: events and single steps; `framework.fidelity`: the least model that is enough;
* `framework.identification`: calibration of the geometry, identification of masses and friction;
* `framework.files`: files for other programs; `framework.show`: figures, pages, pictures in notebooks;
* `framework.catalogue`: robots by name; `framework.numerics`: series in time, types of arrays.
"""

from framework.lazy_names import lazy_names
from framework.moved_modules import install

__getattr__, __dir__ = lazy_names(__name__, __file__)
install()
