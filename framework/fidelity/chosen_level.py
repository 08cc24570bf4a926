"""Choose the level of fidelity to plan a motion with: the level stated in its scene, or a predicted one.

A scene may state the level that a study found by simulation (`fidelity_study`). For other motions the
indicators (`fidelity_indicators`) predict the level from the plan of the rigid robot, without simulation.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from framework.errors import InvalidInput, NoAnswer
from framework.fidelity.fidelity_indicators import (
    Indicators,
    compute_indicators,
    compute_level_motions,
    robot_at_level,
)
from framework.fidelity.model_comparison import measure_fall
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.path import Path
from framework.model.description import FLEXIBILITIES, RobotDescription
from framework.model.fidelity_levels import LEVELS, LEVELS_BY_NAME
from framework.planning.plan import plan_request
from framework.planning.request import SMOOTHNESS, Request
from framework.planning.scenes import scene_request

TOLERANCE = 0.01  # default of the allowed error, as a share of the path's length and of the peak torque


class ChosenLevel(NamedTuple):
    """The least level that is enough for a motion, with the evidence.

    level: name of the level.
    tolerance: allowed error, as a share of the path's length and of the peak torque.
    simulated: whether a study found the level by simulation; otherwise the level is predicted.
    error: predicted error, as such a share; None for a simulated level, and for the highest level, which is
        the reference.
    """

    level: str
    tolerance: float
    simulated: bool
    error: float | None

    @property
    def sentence(self) -> str:
        """The level and the evidence, in a sentence."""
        percent = f"{100 * self.tolerance:g} %"
        if self.simulated:
            return f"{self.level} is enough for {percent}, as the scene keeps"
        if self.error is None:
            return (
                f"{self.level}, the fullest: predicted, not simulated, others are off by more than {percent}"
            )
        return f"{self.level} for {percent}, off by {100 * self.error:.2g} %: predicted, not simulated"


def scene_level(description: RobotDescription, scene: str) -> ChosenLevel | None:
    """Return the level that a scene states, if any."""
    stated = description.scenes.get(scene)
    if stated is None or stated.fidelity is None:
        return None
    return ChosenLevel(stated.fidelity.level, stated.fidelity.tolerance, simulated=True, error=None)


def predict_level(
    description: RobotDescription, path: Path | str, *, tolerance: float = TOLERANCE, **options: Any
) -> ChosenLevel:
    """Predict the least level that is enough for a motion, from the indicators.

    Args:
        path: path to follow, or the name of a scene.
        tolerance: allowed error, as a share of the path's length and of the peak torque.
        options: options of `plan_crossing` except geometry, since each level has its own.

    Raises:
        InvalidInput: an option is invalid.
    """
    indicators = predict_errors(description, path, **options)
    level = indicators.choose_level(tolerance)
    error = None if level == LEVELS[-1].name else indicators.error[level]
    return ChosenLevel(level, tolerance, simulated=False, error=error)


def predict_errors(description: RobotDescription, path: Path | str, **options: Any) -> Indicators:
    """Compute the indicators of a motion; options as for `predict_level`.

    Raises:
        InvalidInput: an option is invalid.
    """
    rigid = LEVELS_BY_NAME["rigid"]
    robot = robot_at_level(description, rigid)
    smoothness = options.pop("smoothness", None) or SMOOTHNESS[bool(description.springs)]
    request = request_without_geometry(robot, path, smoothness=smoothness, **options)
    try:
        plan = plan_request(robot, request)
        motions = compute_level_motions(description, plan, rigid)
        _fall, control = measure_fall(plan.dynamics)
        return compute_indicators(motions, control)
    except NoAnswer:
        return Indicators.of({})


def request_without_geometry(robot: ParallelRobot, path: Path | str, **options: Any) -> Request:
    """Return the request for a path or a scene's name, without a geometry option.

    Raises:
        InvalidInput: the options contain a geometry, or an option is invalid.
    """
    if options.get("geometry") is not None:
        raise InvalidInput("geometry: each level of fidelity has its own; leave it out")
    if isinstance(path, str):
        return scene_request(robot, path, **options)
    return Request.of(robot, path, **options)


def options_of_level(description: RobotDescription, name: str) -> dict[str, Any]:
    """Return the options with which to plan at a level: flexibility, geometry, smoothness.

    Levels below `rigid` are planned with all bodies, since fewer bodies would not make planning faster.
    """
    level = LEVELS_BY_NAME[name]
    flexibility = description.least_flexibility(level.flexibility)
    return {
        "flexibility": flexibility,
        "geometry": "rigid" if flexibility == FLEXIBILITIES[0] else level.geometry,
        "smoothness": SMOOTHNESS[bool(description.active_springs(FLEXIBILITIES[-1]))],
    }
