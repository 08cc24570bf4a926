"""Paths that no law can cross, bent as little as helps."""

from types import SimpleNamespace

import numpy as np
import pytest

import robots
from framework import Line, NoLaw, Spline, load_plan, locate_singularities, plan_crossing, simulate
from framework.cli import main
from framework.planning.path_modification import (
    MAX_BEND_SHARE,
    _evaluate_bump,
    _Modification,
    plan_request_with_modified_path,
)
from framework.planning.request import Request
from framework.planning.saved import save_plan
from tests.oracles.planar import without_rotors
from tests.planning.test_orthogonal_path import PLACE, bent

LIMIT = 0.33  # [N m]
STEEP = np.array([0.03, 0.06])


@pytest.mark.slow
def test_a_path_orthogonal_to_the_twist_is_bent_as_little_as_the_torque_limit_allows(tmp_path, monkeypatch):
    # from 0.6 % of the path on, where the limit still refuses: each refusal is explained at length
    monkeypatch.setattr("framework.planning.path_modification.DOUBLED_BENDS", 4)
    robot = robots.load("five_bar")
    path, twist = bent(robot, 0.02)
    asked = {"duration": 1.5, "law": "optimal", "torque_limit": LIMIT}
    with pytest.raises(NoLaw, match="no speed meets") as refused:
        plan_crossing(robot, path, **asked)
    assert refused.value.remedy == {"bend": True}
    found = plan_request_with_modified_path(robot, Request.of(robot, path, **asked))
    plan = found.plan
    assert simulate(robot, plan).tracking_error < 1e-8
    assert max(plan.peak_torque.values()) <= LIMIT
    # the ends are kept, and it has moved no farther than it says
    assert np.array_equal(plan.path(np.array([0.0, 1.0])), path(np.array([0.0, 1.0])))
    s = np.linspace(0.0, 1.0, 777)
    away = np.linalg.norm(plan.path(s) - path(s), axis=1)
    assert 0.9 * found.moved < away.max() <= found.moved * (1 + 1e-4)
    assert found.turned == 0.0
    assert 0.0 < found.share < MAX_BEND_SHARE
    # where it crosses, its tangent has turned towards t_s
    for crossing in plan.crossings:
        assert abs(plan.path(crossing.s, 1) @ twist) > 1e-3 * np.linalg.norm(plan.path(crossing.s, 1))
    # larger bends to the same side are told with what they need, and can be taken
    shares = [choice.share for choice in found.choices]
    assert 5 <= len(shares) <= 8
    assert shares == sorted(shares)
    assert shares[0] == pytest.approx(found.share, rel=5e-2)  # of the curve, and of the spline
    assert found.choices[0].peak_torque == plan.peak_torque
    assert max(found.choices[-1].peak_torque.values()) < max(plan.peak_torque.values())
    taken = plan_request_with_modified_path(robot, Request.of(robot, path, **asked), bend=shares[2])
    assert taken.share == pytest.approx(shares[2], rel=5e-2)
    assert max(taken.plan.peak_torque.values()) <= max(found.choices[2].peak_torque.values()) * (1 + 1e-6)
    # half of the bend is not enough
    points = plan.path.points
    half = Spline(0.5 * (points + path(np.linspace(0.0, 1.0, len(points)))))
    with pytest.raises(NoLaw, match="admissible"):
        plan_crossing(robot, half, **asked)
    save_plan(plan, tmp_path)
    assert load_plan(tmp_path).path == plan.path


def test_a_path_that_needs_no_bend_is_left_alone():
    robot, path = without_rotors(), Line(PLACE + STEEP, PLACE - STEEP)
    found = plan_request_with_modified_path(robot, Request.of(robot, path, duration=1.5))
    assert found.plan.path is path
    assert (found.moved, found.turned, found.share) == (0.0, 0.0, 0.0)


def test_a_bend_keeps_the_ends_and_so_cannot_mend_a_stop_on_the_locus():
    robot = without_rotors()
    (point,) = locate_singularities(robot, Line(PLACE + STEEP, PLACE - STEEP))
    with pytest.raises(NoLaw, match="no law can rest on the locus"):
        plan_request_with_modified_path(
            robot, Request.of(robot, Line(PLACE + STEEP, point.platform), duration=1.5)
        )


def test_the_command_says_how_far_the_path_was_bent(capsys):
    assert main(["plan", "five_bar", "--scene", "C", "--bend"]) == 0
    assert "path bent         not at all" in capsys.readouterr().out
    for wrong in (["--bend", "--raw"], ["--bend", "6%"], ["--bend", "0"], ["--bend", "much"]):
        assert main(["plan", "five_bar", "--scene", "C", *wrong]) == 2
        assert "bend: " in capsys.readouterr().err


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("least", [0.0004, 0.0011, 0.013, 0.047])
def test_bends_to_either_side_are_found_to_nine_percent(least, side):
    """With a plan wherever a bend is large enough, to one side alone; a tenth is added as reserve."""
    tried = []

    def plan_bent(share):
        tried.append(share)
        return share if share * side >= least else None

    share, _ = _Modification._find_least(SimpleNamespace(plan_bent=plan_bent))
    assert share * side == pytest.approx(1.1 * least, rel=0.1)
    assert max(np.abs(tried[:-1])) <= MAX_BEND_SHARE


def test_a_bent_path_passes_the_points_that_the_bend_moves(monkeypatch):
    monkeypatch.setattr("framework.planning.path_modification.plan_request", lambda _, request, **__: request)
    robot, s = robots.load("five_bar"), np.linspace(0.0, 1.0, 9)
    request = Request.of(robot, Line(PLACE + STEEP, PLACE - STEEP), duration=1.5)
    unit = np.outer(np.sin(np.pi * s), [0.01, -0.02])
    bent_request = _Modification(robot, request, s, unit, np.ones(2), 1.0).plan_bent(-0.5)
    np.testing.assert_allclose(bent_request.path.points, request.path(s) - 0.5 * unit, atol=1e-15)
    assert bent_request.duration == request.duration


@pytest.mark.parametrize("c", [0.15, 0.4, 0.85])
def test_a_bump_of_height_one_does_not_bend_at_the_crossing_nor_at_the_ends(c):
    s = np.linspace(0.0, 1.0, 20001)
    b = _evaluate_bump(s, c)
    assert b.max() == pytest.approx(1.0, abs=1e-5)
    bends = np.abs(np.diff(b, 2)) / s[1] ** 2  # |b"| at s[1:-1]
    assert np.interp(c, s[1:-1], bends) < 1e-3 * bends.max()
    assert max(bends[0], bends[-1]) < 1e-2 * bends.max()
    np.testing.assert_allclose(_evaluate_bump(1.0 - s, 1.0 - c), b, atol=1e-12)
