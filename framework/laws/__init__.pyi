from framework.laws.curves import Arc, Polyline, Spline
from framework.laws.law import Condition, Ends, ExactLaw, Law, MotionLaw, PlannedLaw, law_derivatives
from framework.laws.optimal_law import OptimalLaw
from framework.laws.path import HIGHEST_ORDER, Line, Path, time_derivatives

__all__ = [
    "HIGHEST_ORDER",
    "Arc",
    "Condition",
    "Ends",
    "ExactLaw",
    "Law",
    "Line",
    "MotionLaw",
    "OptimalLaw",
    "Path",
    "PlannedLaw",
    "Polyline",
    "Spline",
    "law_derivatives",
    "time_derivatives",
]
