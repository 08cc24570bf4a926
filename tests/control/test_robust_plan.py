"""Plans that leave a controller what robots of a stated spread need."""

import numpy as np
import pytest

import robots
from framework import NoAnswer, plan_scene
from framework.control import ControlLoop, Spread, StudySetup, plan_robustly

FIVE_BAR = robots.load("five_bar")
WRONG = Spread(payload=0.1, friction=0.05)


def planner(margins, **options):
    """Plans of scene C by margin, which are noted."""

    def make_plan(margin):
        margins.append(margin)
        return plan_scene(FIVE_BAR, "C", margin=margin, **options)

    return make_plan


@pytest.mark.slow
def test_a_quickest_plan_leaves_the_margin_with_which_robots_pass():
    """Robots of another seed pass with this margin, and not all without one."""
    options = {"optimize": "time", "torque_limit": 0.165}
    robust = plan_robustly(planner([], **options), WRONG, period=2e-3)
    assert 0 < robust.margin < 0.4
    assert robust.unguarded.duration < robust.plan.duration < 1.2 * robust.unguarded.duration
    passed = []
    for plan in (robust.unguarded, robust.plan):
        setup = StudySetup(plan, 2e-3, ControlLoop(), WRONG, 5)
        passed.append(setup.run("lqg", *range(24)).passed.sum())
    assert passed[0] < 20
    assert passed[1] >= 23


def test_where_torques_are_not_limited_one_plan_is_judged():
    margins = []
    robust = plan_robustly(planner(margins, smoothness=4), WRONG, period=5e-3)
    assert (margins, robust.margin, robust.trial.passed) == ([0.0], 0.0, 20)
    assert np.isfinite(robust.prediction.platform)
    tight = ControlLoop(tolerance=1e-7, end=1e-7)
    with pytest.raises(NoAnswer, match="without torque limits a margin does not help"):
        plan_robustly(planner(margins, smoothness=4), WRONG, loop=tight, period=5e-3)


def test_the_command_says_what_it_cannot_make_robust(refusal):
    words = ("plan", "five_bar", "--scene", "C", "--robust")
    assert "unknown --robust 'colour'" in refusal(2, *words, "colour=1%")
    assert "--robust payload: needs a share" in refusal(2, *words, "payload")
    assert "--margin" in refusal(2, *words, "payload=1%", "--torque-limit", "1", "--margin", "5%")
    assert "--sensors" in refusal(2, "plan", "five_bar", "--scene", "C", "--sensors", "motors")


@pytest.mark.slow
def test_a_robust_plan_that_was_written_is_studied_with_the_same_spread(tmp_path, document):
    words = ("plan", "five_bar", "--scene", "C", "--smoothness", "4", "--robust", "payload=10%")
    plan = document(*words, "--out", str(tmp_path))
    assert plan["robust"]["spread"]["payload"] == 0.1
    runs = ("--payload", "10%", "--runs", "3", "--seed", "4", "--controller", "lqg")
    study = document("robustness", str(tmp_path), *runs)
    assert study["spread"]["payload"] == 0.1
    assert study["studies"][0]["probability"] == 1.0
