"""What each scene of the catalogue keeps as its level: enough by simulation, and no lower level is."""

import pytest

import robots
from framework import plan_scene
from framework.fidelity.fidelity_indicators import compute_level_motions, robot_at_level
from framework.fidelity.model_comparison import Comparison, ReferenceMotion
from framework.model.fidelity_levels import LEVELS, LEVELS_BY_NAME
from tests.robots.every_robot import RIGID, SCENES, asks_nothing, in_stages

PLANNED = [(name, scene) for name, scene in SCENES if not asks_nothing(RIGID[name].description.scenes[scene])]


def quick(case) -> bool:
    return case in [("five_bar", "A"), ("humanoid_ankle", "swing")]


def test_every_scene_that_has_a_plan_keeps_a_level_at_one_per_cent():
    kept = {case: RIGID[case[0]].description.scenes[case[1]].fidelity for case in SCENES}
    assert {case for case, level in kept.items() if level is not None} == set(PLANNED)
    assert {level.tolerance for level in kept.values() if level is not None} == {0.01}


@pytest.mark.parametrize("case", in_stages(PLANNED, at_once=quick))
def test_the_kept_level_is_enough_and_the_one_below_it_is_not(case):
    name, scene = case
    kept = robots.load(name).description.scenes[scene].fidelity
    top = robot_at_level(robots.load(name).description, LEVELS[-1])
    plan = plan_scene(top, scene)
    place = LEVELS.index(LEVELS_BY_NAME[kept.level])
    motions = compute_level_motions(top.description, plan, LEVELS[-1])
    names = [level.name for level in LEVELS[max(place - 1, 0) : place + 1]]
    reference = ReferenceMotion.of(plan, top, kept.tolerance)
    *below, enough = reference.compare_levels([(name, motions[name]) for name in names])

    def error(comparison: Comparison) -> float:
        return max(comparison.torque, comparison.platform)

    assert error(enough) <= kept.tolerance
    assert all(error(one) > kept.tolerance for one in below)
