"""Motor controllers for a planned crossing, and studies of their robustness to model errors.

    reference = reference_of(plan, period=1e-3)
    study = run_study(tuned_controller("lqr", reference), ControlLoop(), Spread(payload=0.05), runs=200)

Open `study` first (many runs), then `closed_loop` (the loop over sampling periods).

* `controllers`: the plan at the sampling instants, a `Reference`; `tuned_controller` makes one of
  `CONTROLLERS` for it; other controllers follow the protocol `Controller`;
* `closed_loop`: random robots that differ from the model as `Spread` says; `run_closed_loop` drives them,
  with friction and delay between controller and robot;
* `study`: `run_study` draws robots and judges their runs, `run_store` stores finished runs, `load_study`
  reads a study that `crossing robustness --out` wrote;
* `control_cycle`: `ControlCycle` computes pose and torques of one robot once a millisecond.
"""

from framework.control.closed_loop import ControlLoop, Run, Spread, Variation, draw, run_closed_loop
from framework.control.control_cycle import ControlCycle
from framework.control.controllers import (
    CONTROLLERS,
    Controller,
    Measurement,
    Reference,
    reference_of,
    tuned_controller,
)
from framework.control.study import Study, StudySetup, load_study, run_study

__all__ = [
    "CONTROLLERS",
    "ControlCycle",
    "ControlLoop",
    "Controller",
    "Measurement",
    "Reference",
    "Run",
    "Spread",
    "Study",
    "StudySetup",
    "Variation",
    "draw",
    "load_study",
    "reference_of",
    "run_closed_loop",
    "run_study",
    "tuned_controller",
]
