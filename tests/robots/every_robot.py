"""What the generated tests run over: the catalogue, its flexibilities and its scenes.

Nothing here names a robot but those of every kind, whose laws are held at once; a file more in `robots/` is a
robot more in every test of `test_every_robot*.py`.
"""

from collections.abc import Callable, Iterable
from functools import lru_cache

import numpy as np
import pytest

import robots
from framework import CrossingPlan, NoAnswer, NoLaw, ParallelRobot, plan_scene
from framework.model.description import FLEXIBILITIES, Scene
from framework.planning.scenes import scene_path

CASES = [(name, flexibility) for name in robots.CATALOGUE for flexibility in FLEXIBILITIES]
RIGID = {name: robots.load(name) for name in robots.CATALOGUE}
ELASTIC = [case for case in CASES if RIGID[case[0]].description.active_springs(case[1])]
SCENES = [(name, scene) for name, robot in RIGID.items() for scene in robot.description.scenes]


def the_5r(case: tuple[str, ...]) -> bool:
    """Whether a case, which begins with the robot's name, is about the paper's robot."""
    return case[0] == "five_bar"


def in_stages(cases: Iterable[tuple[str, ...]], *, at_once: Callable = the_5r) -> list:
    """The cases as parameters: those `at_once` in the first stage of the tests, all others in the second."""
    return [
        pytest.param(case, id="-".join(case), marks=() if at_once(case) else pytest.mark.slow)
        for case in cases
    ]


# The springs of flexible_joints are among those of flexible_links: with both at once only the paper's robot.
FEWEST_AND_MOST = [case for case in CASES if the_5r(case) or case[1] != "flexible_joints"]
# Motors turn, in a plane and in space, or slide; a sphere, a ring with a redundant row, redundant motors.
KINDS = ("five_bar", "biglide", "delta", "gough_stewart", "agile_eye", "bricard", "two_arms", "three_rpr")
STAGED = in_stages(
    CASES, at_once=lambda case: case[1] == "rigid" or (case in FEWEST_AND_MOST and case[0] in KINDS)
)


def asks_nothing(scene: Scene) -> bool:
    """Whether the scene asks for no crossing condition, or for one at an imposed place."""
    return scene.times == () or scene.at is not None


def first_path(robot: ParallelRobot):
    """The path of the robot's first scene."""
    return scene_path(next(iter(robot.description.scenes.values())))


@lru_cache(maxsize=256)
def planned(robot: ParallelRobot, **options) -> CrossingPlan:
    """The first scene of the robot that has a plan."""
    for name in robot.description.scenes:
        try:
            return plan_scene(robot, name, **options)
        except NoAnswer:
            continue
    raise AssertionError(f"{robot.name} has no scene that can be planned")


@lru_cache(maxsize=256)
def crossing(robot: ParallelRobot, **options) -> CrossingPlan:
    """The first plan of the robot that crosses a singularity, or else its first plan."""
    plans = []
    for name, scene in robot.description.scenes.items():
        if asks_nothing(scene):
            continue
        try:
            plans.append(plan_scene(robot, name, **options))
        except NoLaw:  # with the smoothness that is asked for
            continue
        if plans[-1].crossings:
            return plans[-1]
    assert plans, f"{robot.name} has no scene that can be planned"
    return plans[0]


def assert_same_torques(
    one: CrossingPlan, two: CrossingPlan, *, within: float = 1e-9, ratio: float = 1.0
) -> None:
    """Assert that the second has `ratio` times the torques of the first, to a share of their peak."""
    t = np.linspace(0.0, one.duration, 201)
    peak = np.abs(one.torque(t)).max()
    # measured: 1e-14 as a rule, 2e-11 for the springs of standing_quadruped and four_bar
    np.testing.assert_allclose(two.torque(t) / ratio, one.torque(t), rtol=0, atol=within * peak)
