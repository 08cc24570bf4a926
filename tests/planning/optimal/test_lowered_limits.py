"""Limits that one law's motion lowers bind no other law of the search."""

from types import SimpleNamespace

import numpy as np
import pytest

import robots
from framework import Line, plan_crossing
from framework.errors import NoLaw, NotConverged
from framework.planning.optimal import elastic_search
from framework.planning.optimal.elastic_search import ElasticSearch, Iterate, Start
from framework.tolerances import MAX_SOFTENING

OPTIONS = {"geometry": "rigid", "optimize": "time", "torque_limit": 0.4}


def plan():
    """Plan the path of the paper with springs in the gears."""
    robot = robots.load("five_bar", flexibility="flexible_joints")
    return plan_crossing(robot, Line([0.1, 0.345], [-0.05, 0.195]), **OPTIONS)


@pytest.mark.slow
def test_a_rough_motion_does_not_lower_the_limits_of_later_laws(monkeypatch):
    """A spike of torque that rounding lets through costs hardly more than the shares of smoother laws."""
    smooth = plan()
    true_excess, calls = elastic_search.limit_excess, []

    def excess(dynamics, specification):
        calls.append(dynamics)
        return 135.0 if len(calls) == 1 else true_excess(dynamics, specification)

    monkeypatch.setattr(elastic_search, "limit_excess", excess)
    rough = plan()
    assert len(calls) > 1
    np.testing.assert_allclose(rough.duration, smooth.duration, rtol=3e-2)


@pytest.mark.slow
def test_refusal_says_by_how_much_the_nearest_motion_exceeds_the_limits(monkeypatch):
    """Without a proof the refusal names neither a holding torque nor a remedy."""
    monkeypatch.setattr(elastic_search, "limit_excess", lambda *_: 135.0)
    with pytest.raises(NotConverged, match=r"no law was found .* takes 135 times the limits") as refusal:
        plan()
    assert "would do" not in str(refusal.value)
    assert "at rest" not in str(refusal.value)


@pytest.mark.parametrize(("excess", "rest"), [(1.2, 0.3), (0.3, 1.2)])
def test_a_motion_that_is_not_at_rest_is_no_more_allowed_than_one_beyond_limits(excess, rest):
    assert Iterate(None, excess, rest).worst == 1.2


@pytest.mark.parametrize("rest", [0.999, 1.001, 1.4])
def test_springs_that_move_at_an_end_are_refused(rest):
    search = SimpleNamespace(
        task=None,
        starts=("only",),
        _certify=lambda *_: Iterate(None, 1.0, rest),
        _refuse_rest=lambda rest: NoLaw(f"moves by {rest}"),
    )
    motions = ElasticSearch._keep_limits(search, "only", SimpleNamespace(law=None))
    if rest < 1.0:
        assert [iterate.rest for iterate in motions] == [rest]
    else:
        with pytest.raises(NoLaw, match="moves by"):
            next(motions)


def improving(monkeypatch, excesses):
    """A search whose steps give motions of these excesses, nan for a failure; certificates find the same."""
    specification = SimpleNamespace(goal="time", friction=np.zeros(1))
    left = iter(excesses)
    law = SimpleNamespace(peak=1.0, reference=np.ones(1), cost=1.0, program=SimpleNamespace(problem=None))

    def step(*_):
        excess = next(left, np.nan)
        if np.isnan(excess):
            raise NotConverged("no next law")
        return Iterate(law, excess, 0.5, balance="balance")

    def certify(iterate):
        motion = SimpleNamespace(cost=lambda goal: iterate.best.cost)
        return iterate._replace(motion=motion)

    monkeypatch.setattr(elastic_search, "peaks_at_nodes", lambda *_: np.full(1, 2.0))
    monkeypatch.setattr(elastic_search, "find_next_law", lambda *_: law)
    monkeypatch.setattr(elastic_search, "require_law", lambda *_: law)
    search = SimpleNamespace(
        task=SimpleNamespace(specification=specification),
        springs_vibrate=False,
        _balance_law=lambda *_: Iterate(law, np.inf, np.inf, balance="balance"),
        _linearise_motion=step,
        _certify_balance=certify,
    )
    return ElasticSearch._improve(search, law)


@pytest.mark.parametrize("excesses", [[0.9], [0.9, np.nan, 0.9], [1.1, 0.9]])
def test_a_motion_that_is_allowed_is_certified_whatever_fails_after_it(monkeypatch, excesses):
    certified = [iterate for iterate in improving(monkeypatch, excesses) if iterate.motion is not None]
    assert [iterate.excess for iterate in certified] == [0.9]


def test_a_search_in_which_all_steps_fail_ends_with_the_failure(monkeypatch):
    with pytest.raises(NotConverged, match="no next law"):
        list(improving(monkeypatch, [1.1]))


@pytest.mark.parametrize("durations", [[1.2, 1.0], [1.2, 1.1]])
def test_a_quickest_motion_that_takes_longer_than_asked_is_none(durations):
    def motion(duration):
        return SimpleNamespace(cost=lambda goal: duration, dynamics=SimpleNamespace(duration=duration))

    search = SimpleNamespace(
        task=SimpleNamespace(
            specification=SimpleNamespace(goal="time", longest=1.0),
            robot=SimpleNamespace(name="slow"),
            follows_balance=True,
        ),
        starts=(Start(2e-2),),
        _find_first_law=lambda *_: SimpleNamespace(cost=1.0),
        _improve=lambda law: (Iterate(law, 0.9, 0.9, motion(duration)) for duration in durations),
    )
    motions = ElasticSearch.find_motions(search)
    if durations[-1] <= 1.0:
        assert [each.dynamics.duration for each in motions] == [1.0]
    else:
        with pytest.raises(NotConverged, match=r"takes at most 1 s: the quickest .* takes 1\.1 s") as refusal:
            next(motions)
        assert refusal.value.residual == pytest.approx(0.1)


@pytest.mark.parametrize("softening", [0.9, 1.1])
def test_springs_that_give_way_are_refused_beyond_the_largest_softening(monkeypatch, softening):
    least = SimpleNamespace(rho=softening * MAX_SOFTENING, s=0.4)
    monkeypatch.setattr(elastic_search, "find_least_softening", lambda problem, duration: least)
    search = SimpleNamespace(
        task=SimpleNamespace(specification=SimpleNamespace(duration=1.0), robot=SimpleNamespace(name="soft")),
        _problem=lambda *_, **__: SimpleNamespace(_replace=lambda **_: None),
    )
    if softening < 1.0:
        ElasticSearch._check_softening(search, None)
    else:
        with pytest.raises(NoLaw, match=r"give way at s = 0\.4") as refusal:
            ElasticSearch._check_softening(search, None)
        assert refusal.value.evidence is least
