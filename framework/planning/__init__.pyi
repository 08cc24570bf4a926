from framework.planning.feasibility import (
    Feasibility,
    OptimalDurations,
    feasibility_at,
    feasibility_on_path,
    optimal_durations,
)
from framework.planning.joint_path import choose_joint_path, flip_legs, with_platform_joints
from framework.planning.motion_table import Column, MotionTable
from framework.planning.motor_use import MotorUse
from framework.planning.neglected_effects import NeglectedEffect
from framework.planning.optimal.peak_bound import PeakBound, bound_plan
from framework.planning.options import PlanOptions
from framework.planning.plan import plan_crossing, plan_request, uncertified_law
from framework.planning.plan_study import PlanStudy
from framework.planning.request import Request
from framework.planning.result import Crossing, CrossingPlan, Optimality
from framework.planning.saved import load_plan, save_plan
from framework.planning.scenes import plan_scene, scene, scene_path, scene_request
from framework.singularity.points_on_path import Condition8

__all__ = [
    "Column",
    "Condition8",
    "Crossing",
    "CrossingPlan",
    "Feasibility",
    "MotionTable",
    "MotorUse",
    "NeglectedEffect",
    "OptimalDurations",
    "Optimality",
    "PeakBound",
    "PlanOptions",
    "PlanStudy",
    "Request",
    "bound_plan",
    "choose_joint_path",
    "feasibility_at",
    "feasibility_on_path",
    "flip_legs",
    "load_plan",
    "optimal_durations",
    "plan_crossing",
    "plan_request",
    "plan_scene",
    "save_plan",
    "scene",
    "scene_path",
    "scene_request",
    "uncertified_law",
    "with_platform_joints",
]
