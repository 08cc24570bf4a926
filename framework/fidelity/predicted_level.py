"""The level of fidelity to plan a motion with: the level stated in its scene, or a predicted one.

A scene may state the level that a study found by simulation (`fidelity_study`). For other motions the level
is predicted from the plan of the rigid robot, without simulation. All levels follow one motion, each with the
torques that its model needs along this motion. The torques of a level lack the effects that the level leaves
out, so that a real platform would leave the motion. So a level has two errors, which are estimated here:

* of torque: the difference of the level's torques from those of the highest level, divided by their peak;
* of the platform: the displacement under the missing wrench, which is G' times the difference of the torques
  (`dynamics.open_loop`), plus the distance of the two levels' motions, divided by the path's length.

Both are finite at Type 2: each level meets its own condition (8), and the equations of the displacement are
regular there.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from framework.dynamics.open_loop import (
    GROWTH_INSTANTS,
    ErrorDynamics,
    MotorControl,
    error_dynamics,
    fall_exponent,
    open_loop_error,
)
from framework.dynamics.platform_wrench import platform_wrench
from framework.dynamics.pointwise_dynamics import motor_inertia
from framework.dynamics.result import InverseDynamics
from framework.errors import InvalidInput, NoAnswer
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.path import Path
from framework.model.description import FLEXIBILITIES, LEVELS, LEVELS_BY_NAME, Level, RobotDescription
from framework.model.urdf_edits import with_bodies
from framework.numerics.fields import positive
from framework.planning.neglected_effects import ModelOnMotion
from framework.planning.plan import plan_request
from framework.planning.request import SMOOTHNESS, Request, largest_by_unit, path_length
from framework.planning.result import CrossingPlan
from framework.planning.scenes import scene_request

TOLERANCE = 0.01  # default of the allowed error, as a share of the path's length and of the peak torque
STEPS = 8 * (GROWTH_INSTANTS - 1)  # integration steps of the platform's error
STEP_ERRORS = (1e-3, 1e-5)  # error of an integration step of a simulation over the tolerance, tried in turn
OWN_ERROR = 0.1  # platform error over the tolerance under the plan's torques: above, steps are shortened
# Time constants of the fall in a motion, above which motors have controllers. Without controllers the error
# of the shortest steps would grow beyond OWN_ERROR.
MAX_FALL = float(np.log(OWN_ERROR / STEP_ERRORS[-1]))


# ------------------------------------------------------------------ the choice


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
        """The level, the allowed error in per cent, and the evidence, in a sentence.

        In the text, a scene "keeps" the level that its robot file states, which was found by simulation. The
        highest level is called "the fullest". It is chosen where the errors of all others exceed the
        tolerance, and its own error is not known.
        """
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
    positive("tolerance", tolerance)
    indicators = predict_errors(description, path, **options)
    level = indicators.choose_level(tolerance)
    error = None if level == LEVELS[-1].name else indicators.error[level]
    return ChosenLevel(level, tolerance, simulated=False, error=error)


def predict_errors(description: RobotDescription, path: Path | str, **options: Any) -> Indicators:
    """Compute the indicators of a motion: the estimated error of each level.

    Without a plan of the rigid robot the errors of all levels but the highest are infinite. Arguments and
    errors are those of `predict_level`.
    """
    rigid = LEVELS_BY_NAME["rigid"]
    robot = robot_at_level(description, rigid)
    # all levels follow one law, which must be as smooth as that of the most detailed level
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


# ------------------------------------------------------------------ the motions of all levels


class LevelMotion(NamedTuple):
    """The motion with the torques of one level.

    dynamics: the motion with its torques; None if the level's model cannot follow the motion.
    seconds: computing time of the torques [s].
    reason: why the model cannot follow the motion; empty otherwise.
    """

    dynamics: InverseDynamics | None
    seconds: float
    reason: str = ""


def compute_level_motions(
    description: RobotDescription, plan: CrossingPlan, own: Level
) -> dict[str, LevelMotion]:
    """Compute the torques of each level, by name, along the motion of a plan.

    The law is corrected to meet the condition (8) of each level. `own` is the level of the plan itself.
    """
    motions = {}
    for level in LEVELS:
        if level is own:
            motions[level.name] = LevelMotion(plan.dynamics, plan.seconds)
            continue
        started = time.perf_counter()
        try:
            model = ModelOnMotion.of(plan.dynamics, robot_at_level(description, level))
            dynamics = model.resolve(level.geometry)
        except NoAnswer as refusal:
            reason = f"no torques: {refusal.sentence}"
            motions[level.name] = LevelMotion(dynamics=None, seconds=0.0, reason=reason)
        else:
            motions[level.name] = LevelMotion(dynamics, time.perf_counter() - started)
    return motions


def robot_at_level(description: RobotDescription, level: Level) -> ParallelRobot:
    """Return the robot with the masses and springs of a level."""
    simplified = with_bodies(description, level.bodies)
    robot = ParallelRobot.from_description(simplified, flexibility=level.flexibility)
    return robot if level.elastic_inertia else replace(robot, elastic_inertia=False)


def measure_fall(motion: InverseDynamics) -> tuple[float, MotorControl | None]:
    """Return the time constants of the robot's fall in a motion, and the feedback that the motors need.

    A robot falls where weight or the motors' torques drive the platform off its path
    (`open_loop.fall_exponent`). The motors have feedback only if it falls for more than MAX_FALL time
    constants; otherwise the feedback is None.
    """
    # ratio of the motors' feedback frequency to the rate of the fall, to catch the robot
    control_to_fall = 10.0
    fall = fall_exponent(motion)
    if fall <= MAX_FALL:
        return fall, None
    inertia = motor_inertia(motion.robot, motion.configuration(0.0)[0])
    frequency = control_to_fall * fall / motion.duration  # [1/s]
    return fall, MotorControl.of(inertia, frequency)


# ------------------------------------------------------------------ their errors


class LevelError(NamedTuple):
    """The estimated errors of a level.

    torque: error of the torques, divided by their peak.
    platform: error of the platform, divided by the path's length.
    """

    torque: float = np.inf
    platform: float = np.inf

    @property
    def words(self) -> str:
        """Both errors in words; empty if unknown."""
        if not np.isfinite(self.torque):
            return ""
        return f"torques {format_percent(self.torque)}, platform {format_percent(self.platform)}"


class Indicators(NamedTuple):
    """The estimated error of each level, by name, as a number and in words."""

    error: Mapping[str, float]
    words: Mapping[str, str]

    @staticmethod
    def of(errors: Mapping[str, LevelError]) -> Indicators:
        """Return indicators with errors that do not grow from any level to the next higher one.

        A level's error is the largest of its own and those of the levels above, because in a single level
        errors may cancel by chance. A missing error and NaN count as infinite. The error of the highest level
        is zero.
        """
        largest = 0.0  # error of the levels above
        error, words = {LEVELS[-1].name: largest}, {LEVELS[-1].name: ""}
        for level in reversed(LEVELS[:-1]):
            own = errors.get(level.name, LevelError())
            largest = max(largest, float(np.nan_to_num(max(own), nan=np.inf)))
            error[level.name] = largest
            words[level.name] = own.words
        return Indicators(error, words)

    def choose_level(self, tolerance: float) -> str:
        """Return the name of the least level whose error is within the tolerance."""
        return next(level.name for level in LEVELS if self.error[level.name] <= tolerance)


def compute_indicators(motions: Mapping[str, LevelMotion], control: MotorControl | None) -> Indicators:
    """Compute the indicators from the levels' motions, by name.

    All errors are infinite without a motion of the highest or the rigid level, or if the motion meets the
    boundary of the workspace. `control` is the feedback of the motors, if any.
    """
    from scipy.interpolate import CubicSpline  # takes as long to import as the rest of this program

    highest, rigid = motions[LEVELS[-1].name].dynamics, motions["rigid"].dynamics
    if highest is None or rigid is None:
        return Indicators.of({})
    times = np.linspace(0.0, rigid.duration, STEPS + 1)
    try:
        motor_speed = platform_wrench(rigid.robot, rigid.motion(times)).motor_speed  # G (T, n_a, n)
        # (GROWTH_INSTANTS, n, n) three matrices, which change slowly and are expensive; axis 1 is time
        instants = np.linspace(0.0, rigid.duration, GROWTH_INSTANTS)
        matrices = CubicSpline(instants, error_dynamics(rigid, instants), axis=1)(times)
    except NoAnswer:  # at the boundary of the workspace
        return Indicators.of({})
    error_matrices = ErrorDynamics(*matrices)
    if control is not None:
        error_matrices = error_matrices.with_control(control, motor_speed)

    robot = rigid.robot
    highest_torque = highest.torques(times)  # (T, n_a), the reference
    # (n_a,) for each motor the peak of all motors of the same unit
    peaks = largest_by_unit(robot, np.abs(highest_torque).max(axis=0))
    # (n,) displacement of each platform coordinate that is as long as the path
    path_scale = robot.platform_scale * (path_length(robot, rigid.path) / robot.length)

    def estimate(level: InverseDynamics) -> LevelError:
        """Estimate the errors of the motion with a level's torques."""
        missing_torque = highest_torque - level.torques(times)
        missing_wrench = np.einsum("tan,ta->tn", motor_speed, missing_torque)  # G' (missing torque)
        displacement = open_loop_error(error_matrices, times, missing_wrench)
        displacement += highest.platform(times) - level.platform(times)
        return LevelError(
            torque=(np.abs(missing_torque) / peaks).max(),
            platform=np.linalg.norm(displacement / path_scale, axis=1).max(),
        )

    errors = {}
    for name, motion in motions.items():
        if motion.dynamics is not None:
            errors[name] = estimate(motion.dynamics)
    return Indicators.of(errors)


def format_percent(share: float) -> str:
    """Format a share in per cent, with two digits below 10 % and no decimals above."""
    return f"{100.0 * share:.0f} %" if share >= 0.1 else f"{100.0 * share:.2g} %"
