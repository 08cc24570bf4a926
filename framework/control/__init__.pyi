from framework.control.closed_loop import ControlLoop, Run, Spread, Variation, draw, run_closed_loop
from framework.control.control_cycle import ControlCycle
from framework.control.controllers import (
    CONTROLLERS,
    Controller,
    Measurement,
    Reference,
    RobotState,
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
    "RobotState",
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
