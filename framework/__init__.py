"""Parallel robots through their Type 2 singularities, from a URDF to torques that prove themselves.

Bring a robot (`load_robot`, by a name of the catalogue or the path of a robot file) and a path (`Line`,
`Arc`, `Spline`), and ask:

* `check_robot`: what a file describes, a `Mechanism` whose loops do not close, too;
* `assemble`, `forward_kinematics`, `track_path`: where its joints are;
* `velocity_matrices`: A, B and C of A v = B dq_a + C dq_e; `locate_singularities`: singular points of a path;
* `plan_crossing`, `plan_scene`: a motion law that passes, its torques and their proof, a `CrossingPlan`;
* `fidelity_study`: the least model of a robot that is enough for a motion, a `FidelityStudy`;
* `inverse_dynamics`: the torques of a law of one's own; `simulate`: where torques bring the robot;
* `dynamics_at`, `forward_dynamics`: from motion to torques and back at one instant or a stack of them, with
  what loops and joints carry, an `Instant`;
* `dynamics_derivatives`: exact derivatives of torques along the motion and the bodies' parameters;
* `ControlCycle`: pose and torques once a millisecond; `largest_load`: the largest push that still crosses.

Errors have one base, `FrameworkError`: `InvalidInput` when what was given cannot be right, `NoAnswer` when
the answer is no. Controllers and studies are in `framework.control`, identification in
`framework.identification`, figures in `framework.show.plots`, beams as springs in `framework.model.beams`,
derivatives of accelerations in `framework.dynamics.forward_derivatives`, `Stepper` and `Event` in
`framework.simulation`, torques without a proof in `framework.dynamics.finite_differences`.
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
        try:
            return getattr(public, name)
        except AttributeError:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}") from None

    def __dir__() -> list[str]:
        return sorted(import_module("framework.public").__all__)
