from framework.control.by_name import CONTROLLERS, Tuning, tuned_controller
from framework.control.closed_loop import Run, run_closed_loop
from framework.control.control_cycle import ControlCycle
from framework.control.controllers import Controller, Measurement, RobotState
from framework.control.linear_model import LinearModel, linearise_plan
from framework.control.prediction import Prediction, predict, predict_by_sensors, suggest_sensors
from framework.control.reference import Reference, reference_of
from framework.control.sensors import ControlLoop
from framework.control.study import Study, StudySetup, load_study, run_study
from framework.control.variations import Spread, Variation, draw

__all__ = [
    "CONTROLLERS",
    "ControlCycle",
    "ControlLoop",
    "Controller",
    "LinearModel",
    "Measurement",
    "Prediction",
    "Reference",
    "RobotState",
    "Run",
    "Spread",
    "Study",
    "StudySetup",
    "Tuning",
    "Variation",
    "draw",
    "linearise_plan",
    "load_study",
    "predict",
    "predict_by_sensors",
    "reference_of",
    "run_closed_loop",
    "run_study",
    "suggest_sensors",
    "tuned_controller",
]
