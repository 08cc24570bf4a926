"""Folds of deflections at rest, against arclength in all coordinates, and by the laws of soft springs."""

from functools import cache

import numpy as np
import pytest

from framework import NoLaw, plan_crossing
from framework.dynamics.static_fold import find_static_fold
from framework.planning.refusals.refusal_proofs import StaticFold
from framework.singularity.points_on_path import search_path
from tests.dynamics.upright_robots import drawn
from tests.oracles.static_fold import fold


@cache
def branch_of(softness):
    """The poses of an upright five-bar; 100 times as soft, its springs give way at both ends of the path."""
    return search_path(drawn(7).robot(softness), drawn(7).path).branch


@pytest.mark.parametrize("s", [0.0, pytest.param(1.0, marks=pytest.mark.slow)])
def test_a_fold_is_that_of_all_coordinates(s):
    branch, at = branch_of(100.0), np.array([s])
    expected = fold(branch.robot, branch.path(at)[0], branch.guess(at)[0])
    assert find_static_fold(branch, s) == pytest.approx(expected, rel=2e-3)


@pytest.mark.slow
def test_springs_twice_as_soft_fold_at_half_the_compliance():
    for s in (0.0, 1.0):
        folds = [find_static_fold(branch_of(softness), s) for softness in (100.0, 200.0)]
        assert 2.0 * folds[1] == pytest.approx(folds[0], rel=1e-2)


def test_springs_a_little_stiffer_than_at_the_fold_hold_and_softer_ones_do_not():
    softness = 100.0 * find_static_fold(branch_of(100.0), 1.0)  # of springs at the fold
    assert find_static_fold(branch_of(0.98 * softness), 1.0) is None
    assert find_static_fold(branch_of(1.02 * softness), 1.0) == pytest.approx(1.0 / 1.02, rel=3e-3)


@pytest.mark.slow
def test_a_plan_is_refused_with_the_fold_and_the_springs_that_hold():
    asked = drawn(7)
    with pytest.raises(NoLaw, match="at rest at s = 0 the springs give way") as refusal:
        plan_crossing(asked.robot(100.0), asked.path, duration=asked.duration, law="optimal")
    fold_at_start = find_static_fold(branch_of(100.0), 0.0)
    assert refusal.value.evidence == StaticFold(0.0, fold_at_start)
    stiffness = float(str(refusal.value).split("springs ")[-1].split(" times")[0])
    assert find_static_fold(branch_of(100.0 / stiffness), 0.0) is None
