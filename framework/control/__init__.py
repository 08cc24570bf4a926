"""Motor controllers that drive a planned crossing, and studies of their robustness to errors of the model.

    reference = reference_of(plan, period=1e-3)
    study = run_study(tuned_controller("lqr", reference), ControlLoop(), Spread(payload=0.05), runs=200)

Open `study` first (many runs), then `closed_loop` (one sampling period after the other).
`tuned_controller` makes one of `CONTROLLERS` for a plan, `run_closed_loop` drives robots that differ from the
model as `Spread` says, `run_study` draws and judges many of them, and `load_study` reads what `crossing
robustness --out` wrote. The controllers stand in `controllers`; friction and delay act between them and the
robot, and `run_store` keeps finished runs. `variation` draws robots, `reference` samples the plan, and
`study_setup` stores a study. A controller of one's own follows the protocol `Controller`. `ControlCycle`
(control_cycle) has the pose and the torques of one robot once a millisecond.
"""

from framework.control.closed_loop import ControlLoop, Run, run_closed_loop
from framework.control.control_cycle import ControlCycle
from framework.control.controllers import CONTROLLERS, Controller, Measurement, tuned_controller
from framework.control.reference import Reference, reference_of
from framework.control.study import Study, run_study
from framework.control.study_setup import StudySetup, load_study
from framework.control.variation import Spread, Variation, draw

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
