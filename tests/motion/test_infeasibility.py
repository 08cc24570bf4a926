"""A proof of infeasibility is worth what its numbers say, and no refusal rests on less."""

from __future__ import annotations

import clarabel
import numpy as np
import pytest
import scipy.sparse as sparse

import robots
from framework import Line, plan_crossing
from framework.crossing.optimal import task_programs
from framework.errors import NoLaw, NotConverged
from framework.motion.infeasibility import MIN_PROOF_REACH, Infeasible

LINE = Line([0.1, 0.345], [-0.05, 0.195])


def at_least(least: float, q) -> Infeasible:
    """x >= least and |x| <= 1, and a combination q of both."""
    return Infeasible(
        np.array(q), sparse.csc_array([[-1.0], [0.0], [-1.0]]), np.array([-least, 1.0, 0.0]), (2,)
    )


def test_a_combination_that_contradicts_itself_is_a_proof():
    proof = at_least(2.0, [3.0, 3.0, -3.0])
    assert proof.contradiction == (0.0, -1.0)
    assert proof.holds


@pytest.mark.parametrize(
    ("least", "q"),
    [
        (0.5, [1.0, 1.0, -1.0]),  # b' q > 0: x = 0.5 is admissible
        (2.0, [1.0, 0.9, -1.0]),  # out of the cone
        (2.0, [-1.0, -1.0, 1.0]),  # the same of a row
        (2.0, [1.0, 1.0, -0.99]),  # leaves 0.01 x: rules out |x| < 100 and no more
        (2.0, [1.0, np.nan, -1.0]),
        (2.0, [0.0, 0.0, 0.0]),
    ],
)
def test_what_is_none_is_not_taken_for_one(least, q):
    assert not at_least(least, q).holds


@pytest.mark.parametrize(("share", "holds"), [(-3.0, True), (3.0, False)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_share_of_an_equality_may_have_either_sign(sign, share, holds):
    """x + y = 0 written with either sign, y <= -2 and |x| <= 1; the wrong share does not cancel y."""
    rows = sparse.csc_array([[sign, sign], [0.0, 1.0], [0.0, 0.0], [-1.0, 0.0]])
    proof = np.array([sign * share, 3.0, 3.0, -3.0])
    assert Infeasible(proof, rows, np.array([0.0, -2.0, 1.0, 0.0]), (2,), 1).holds == holds


def test_a_proof_that_is_nearly_one_is_refined_to_one():
    rough = at_least(2.0, [1.0, 1.0, -0.99])
    assert rough.reach == pytest.approx(100.0)
    assert not rough.holds
    assert rough.refined().holds


def test_where_there_is_a_solution_nothing_is_refined_to_a_proof():
    rng = np.random.default_rng(5)
    for _ in range(20):
        q = rng.uniform(0.5, 1.5, 3) * [1.0, 1.5, -0.5]
        assert not at_least(0.9, q).refined().holds


def test_motors_too_weak_by_far_are_refused_with_a_proof_too():
    with pytest.raises(NoLaw) as refused:
        plan_crossing(robots.load("five_bar"), LINE, duration=1.5, law="optimal", torque_limit=1e-5)
    left, right = refused.value.proof.contradiction
    assert -right > MIN_PROOF_REACH * left


@pytest.mark.parametrize("status", ["AlmostPrimalInfeasible", "PrimalInfeasible"])
def test_a_solver_that_claims_more_than_it_proves_gives_no_refusal(monkeypatch, status):
    class Claims:
        def __init__(self, *given):
            self.z, self.x = np.ones(len(given[3])), np.zeros(len(given[1]))
            self.status = status

        def solve(self):
            return self

    monkeypatch.setattr(task_programs, "DEGREES", (10,))
    monkeypatch.setattr(clarabel, "DefaultSolver", Claims)
    with pytest.raises(NotConverged, match=status):
        plan_crossing(robots.load("five_bar"), LINE, duration=1.5, law="optimal", torque_limit=0.1)
