"""Stage c: model no more than a scene needs. Error of the motion over time of planning, by level of model.

The torques of each level drive the full elastic simulation from rest, without feedback, as those of
`crossing fidelity` do; the error is the platform's largest distance from the motion, over the length of the
path. A level without a point loses the platform. What a level costs is the plan of the scene with its model.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any

import robots
from framework import CrossingPlan, FidelityStudy, fidelity_study
from framework.fidelity.predicted_level import options_of_level, request_without_geometry, robot_at_level
from framework.model import LEVELS, Level
from framework.planning import plan_request
from tests.benchmarks.chart.measure import Judged, Method, Row, Setting, Stage, singles

SCENES = {"five_bar": "C", "five_bar_heavy": "C", "delta": "cross"}


@cache
def study(name: str) -> FidelityStudy:
    """The errors of all levels in the scene of a robot."""
    return fidelity_study(robots.load(name), SCENES[name])


def _planned(name: str, level: Level, _: Setting) -> Callable[[], CrossingPlan]:
    description = robots.load(name).description
    robot = robot_at_level(description, level)
    options: dict[str, Any] = {"smoothness": options_of_level(description, level.name)["smoothness"]}
    request = request_without_geometry(robot, SCENES[name], **options)
    return lambda: plan_request(robot, replace(request, geometry=level.geometry))


def judge(method: Method, _setting: Setting, _plan: CrossingPlan) -> Judged:
    """The error of the level's motion, over the length of the path."""
    name, level = method.name.split("-")
    known = {one.level.name: one for one in study(name).levels}[level]
    if known.reason:
        raise ArithmeticError(known.reason)
    return Judged(known.platform)


def _remark(rows: Sequence[Row]) -> str:
    lost: dict[str, list[str]] = {}
    for row in rows:
        if row.note:
            name, level = row.method.split("-")
            lost.setdefault(name, []).append(level)
    words = [f"of {name} by {' and '.join(levels)}" for name, levels in lost.items()]
    return f"Platforms that are lost: {', '.join(words)}." if words else ""


def _methods(name: str) -> list[Method]:
    return [
        Method(
            f"{name}-{level.name}",
            level.name,
            partial(_planned, name, level),
            level.summary,
            "plans",
            singles(1),
            panel=f"scene {SCENES[name]} of {name}",
        )
        for level in LEVELS
    ]


STAGE = Stage(
    name="levels",
    title="Model no more than a scene needs",
    reference="forward simulation of the fullest model under the level's torques",
    error="error of the motion, over the path's length  [1]",
    methods=tuple(method for name in SCENES for method in _methods(name)),
    judge=judge,
    goals=(1e-2, 1e-4),
    remark=_remark,
)
