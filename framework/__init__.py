"""Motions of parallel robots through their Type 2 singularities, with torques that are proved finite.

Read first `load_robot`, then `plan_crossing` and its example, then `CrossingPlan`, which is what comes back.

A robot, a path, and where the joints are:

* `load_robot`: a `ParallelRobot`, by its name in the catalogue or by its file; `check_robot`: what a file
  describes, also a `Mechanism` whose loops do not close;
* `Line`, `Arc`, `Spline`, `Polyline`: paths of the platform;
* `assemble`, `forward_kinematics`, `track_path`: the joints of a pose, and along a path;
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

Beyond these names:

* `framework.control`: controllers on robots that differ from their model, and studies of many;
  `framework.simulation`: events and single steps;
* `framework.identification`: calibration of the geometry, identification of masses and friction;
  `framework.kinematics.velocity_matrices`: also the derivatives of a pose along them;
* `framework.laws.law`, `framework.laws.path`: what laws and paths of one's own have to be;
* `framework.model.beams`: springs from a beam's section; `framework.dynamics.stiffness`,
  `framework.dynamics.loading`: what they do;
* `framework.atlas.workspace_map`, `framework.atlas.nearest`, `framework.atlas.design_study`: maps, margins
  and the nearest pose to one out of reach, dimensions;
  `framework.atlas.nonsingular_mode_change`: a way from one assembly mode to another;
  `framework.proofs.assembly_modes`: all modes of given motors, proved;
* `framework.kinematics.continuation.forward_kinematics`: poses of many motor angles at once;
  `framework.dynamics.forward_dynamics`: derivatives of accelerations;
  `framework.dynamics.finite_differences`: torques without a proof;
* `framework.show.plots`, `framework.show.map`, `framework.show.drawing`: figures;
  `framework.show.jupyter`: robots and plans in notebooks;
* `framework.catalogue`: robots by name.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from framework.public import *  # noqa: F403
else:

    def __getattr__(name: str) -> Any:
        """Return a public name; all are imported when the first is asked for.

        The command line begins here, and has to hear Ctrl-C before half a second of imports has passed.
        """
        public = import_module("framework.public")
        names = {"__all__": public.__all__, **{each: getattr(public, each) for each in public.__all__}}
        globals().update(names)
        try:
            return names[name]
        except KeyError:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}") from None

    def __dir__() -> list[str]:
        return sorted(import_module("framework.public").__all__)
