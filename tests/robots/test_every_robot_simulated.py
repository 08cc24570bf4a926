"""Planned torques, integrated forward, bring every robot along its path: for every scene with a law.

Generated: a robot added to the catalogue is tested here without a line written. The witness shares no
dynamics with the plan: see `tests.oracles.forward_simulation` and, where springs end on bodies without mass,
`tests.oracles.massless_simulation`.
"""

import numpy as np
import pytest

import robots
from framework import UnboundedTorque, locate_singularities, plan_scene
from framework.planning.scenes import scene_path
from tests.robots.back_on_path import BACK, misses
from tests.robots.every_robot import ELASTIC, KINDS, RIGID, SCENES, asks_nothing, crossing, in_stages

LAWFUL = [(name, scene) for name, scene in SCENES if not asks_nothing(RIGID[name].description.scenes[scene])]
FIRST = list({name: (name, scene) for name, scene in reversed(LAWFUL)}.values())  # scene of each robot
UNPREPARED = [case for case in SCENES if case not in LAWFUL]
# Rods with mass hang between a drive's spring and their own: each spring on the way to the motor needs two
# more derivatives of s to start from rest. With 4 the springs would be set ringing, by 1e-6 m at most.
SMOOTHNESS = {"flexible_joints": 4, "flexible_links": 8}


@pytest.mark.parametrize("case", in_stages(LAWFUL, at_once=lambda case: case in FIRST and case[0] in KINDS))
def test_planned_torques_bring_a_rigid_robot_along_the_path(case):
    name, scene = case
    robot = RIGID[name]
    off = misses(robot, plan_scene(robot, scene), rtol=1e-11)
    print(f"{name}, {scene}: back on the path within {np.abs(off).max():.1e} m, rad")
    assert np.abs(off).max() < BACK  # measured: 7e-11 at most


@pytest.mark.parametrize("case", in_stages(ELASTIC, at_once=lambda case: False))
def test_planned_torques_bring_an_elastic_robot_along_the_path(case):
    name, flexibility = case
    robot = robots.load(name, flexibility=flexibility)
    plan = crossing(robot, smoothness=SMOOTHNESS[flexibility], times=None, speeds=None)
    off = misses(robot, plan, rtol=1e-8)
    print(f"{name}, {flexibility}: back on the path within {np.abs(off).max():.1e} m, rad")
    assert np.abs(off).max() < BACK


@pytest.mark.parametrize("case", in_stages(UNPREPARED, at_once=lambda case: True))
def test_a_scene_that_asks_for_no_condition_where_it_meets_a_singularity_has_no_torques(case):
    name, scene = case
    robot = RIGID[name]
    assert locate_singularities(robot, scene_path(robot.description.scenes[scene]))
    with pytest.raises(UnboundedTorque):
        plan_scene(robot, scene)
