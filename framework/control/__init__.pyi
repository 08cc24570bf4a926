from framework.control.closed_loop import Run, run_closed_loop
from framework.control.control_cycle import ControlCycle
from framework.control.controllers import Controller, Measurement, RobotState, Tuning
from framework.control.linear_model import CoordinateChoice, LinearModel, linearise_plan
from framework.control.prediction import LoopPrediction, predict, predict_by_sensors, suggest_sensors
from framework.control.reference import Reference, reference_of
from framework.control.robust_plan import RobustPlan, plan_robustly
from framework.control.run_table import TableController
from framework.control.sensors import ControlLoop
from framework.control.study import (
    CONTROLLERS,
    SensorTrial,
    Study,
    StudySetup,
    load_study,
    run_study,
    tuned_controller,
)
from framework.control.table import controller_table
from framework.control.variations import Spread, Variation, draw

__all__ = [
    "CONTROLLERS",
    "ControlCycle",
    "ControlLoop",
    "Controller",
    "CoordinateChoice",
    "LinearModel",
    "LoopPrediction",
    "Measurement",
    "Reference",
    "RobotState",
    "RobustPlan",
    "Run",
    "SensorTrial",
    "Spread",
    "Study",
    "StudySetup",
    "TableController",
    "Tuning",
    "Variation",
    "controller_table",
    "draw",
    "linearise_plan",
    "load_study",
    "plan_robustly",
    "predict",
    "predict_by_sensors",
    "reference_of",
    "run_closed_loop",
    "run_study",
    "suggest_sensors",
    "tuned_controller",
]
