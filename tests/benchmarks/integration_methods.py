"""Our integrators, and pinocchio's constrained dynamics with RK4, as methods of the work-precision chart.

`methods(name, flexibility)` maps names to methods on scene C of the 5R; `Method.run(setting)` with a
tolerance or a step [s] gives the wall time of the integration [s] and the largest distance of the payload
from the planned path over the run [m]. Models, start and tables of torques are made beforehand; calling
back for the torque of a step counts. tests/benchmarks/witness_methods.py has the same for other simulators.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

import robots
from framework import CrossingPlan, NotConverged, plan_scene
from framework.kinematics.frames import frames_at
from tests.benchmarks.chart.integrators import (
    Case,
    Prepared,
    collocation,
    contact_runge_kutta,
    explicit,
    fixed_steps,
)


class Method(NamedTuple):
    """`run(setting)` gives (seconds, error); `settings` are tolerances or steps, coarse to fine."""

    run: Callable[[float], tuple[float, float]]
    settings: tuple[float, ...]


def methods(name: str, flexibility: str) -> dict[str, Method]:
    """For a robot of the catalogue with the scene C: five_bar or five_bar_heavy."""
    plan = plan_scene(robots.load(name, flexibility=flexibility), "C")
    case = Case(plan.robot, plan.torque, plan.duration, plan.dynamics.configuration(0.0)[0])
    steps = tuple(1.5 / count for count in (75, 150, 300, 600, 1500, 3000))
    found = {
        f"ours, Radau IIA of {stages} stages": _measured(
            plan, collocation(case, stages), tuple(10.0**power for power in powers)
        )
        for stages, powers in ((5, (-2, -4, -6)), (10, (-2, -4, -6, -8, -10)), (16, (-4, -6, -8, -10, -12)))
    }
    found["ours, fixed steps"] = _measured(plan, fixed_steps(case), steps)
    if flexibility == "rigid" and name != "five_bar":  # both divide by the mass matrix of the tree
        few = tuple(1.5 / count for count in (6, 8, 12, 16, 24, 32, 48, 64))
        found["ours, explicit of order 8"] = _measured(plan, explicit(case), few)
        found["pin.constraintDynamics, RK4"] = _measured(plan, contact_runge_kutta(case), steps)
    return found


def _measured(plan: CrossingPlan, prepared: Prepared, settings: tuple[float, ...]) -> Method:
    def run(setting: float) -> tuple[float, float]:
        made_ready = prepared(setting)
        began = time.perf_counter()
        try:
            course = made_ready()
        except NotConverged:
            return np.nan, np.inf
        seconds = time.perf_counter() - began
        if not np.all(np.isfinite(course.q)):
            return seconds, np.inf
        place = plan.robot.platform.coordinates(frames_at(plan.robot, course.q))
        return seconds, float(np.linalg.norm(place - plan.platform(course.times), axis=1).max())

    return Method(run, settings)
