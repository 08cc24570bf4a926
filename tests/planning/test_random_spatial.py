"""Spatial robots under gravity on random lines across their loci: planned, or refused.

Torques are held against the equations of motion that the tests write anew, refusals against
the bound of all laws.
"""

import numpy as np
import pytest

from framework import CrossingPlan, NoLaw, plan_crossing
from framework.planning.optimal.peak_bound import bound_plan
from framework.planning.refusals import HoldingTorque
from tests.oracles.equations_of_motion import defects_at
from tests.planning.random_lines import random_crossings

SPATIAL = ("delta", "orthoglide", "par4", "gough_stewart")
COUNT, SEED = 3, 11


def check_plan(plan: CrossingPlan, duration: float) -> None:
    assert plan.duration == duration
    assert plan.certificate.monotone
    assert plan.certificate.tail < 1e-9
    assert max(crossing.residual for crossing in plan.crossings) < 1e-11
    t = np.append(np.linspace(0.0, duration, 21), [crossing.time for crossing in plan.crossings])
    found = defects_at(plan, t)
    assert found.open < 1e-12 * max(plan.robot.length, 1.0)
    assert found.speed < 1e-12
    assert found.acceleration < 1e-12
    assert found.force < 1e-9


def check_refusal(refusal: NoLaw, limit: float, bound: float) -> None:
    """`bound` is that of every law's peak [N m] on this path in this duration."""
    proof = refusal.proof
    if isinstance(proof, HoldingTorque):
        assert proof.torque > proof.limit == limit
        return
    peak = refusal.evidence.torque_peak
    assert peak is None or peak > 1.0
    if peak is not None:
        assert 0.95 < bound / limit / peak < 1.0


@pytest.mark.slow
@pytest.mark.parametrize("k", range(COUNT))
@pytest.mark.parametrize("name", SPATIAL)
def test_a_random_line_is_crossed_and_refused_with_a_proof_where_the_motors_are_too_weak(name, k):
    robot, found = random_crossings(name, k + 1, SEED)
    line, duration = found[k]
    plan = plan_crossing(robot, line, duration=duration, law="optimal")
    check_plan(plan, duration)
    torque = float(np.abs(plan.torque(np.linspace(0.0, duration, 6001))).max())
    bound = bound_plan(plan).value * float(plan.optimality.reference.max())
    assert 1.0 - 1e-9 < torque / bound < 1.02
    limited = plan_crossing(robot, line, duration=duration, torque_limit=1.03 * torque)
    assert np.abs(limited.torque(np.linspace(0.0, duration, 6001))).max() <= 1.03 * torque
    with pytest.raises(NoLaw) as refused:
        plan_crossing(robot, line, duration=duration, torque_limit=0.9 * torque)
    check_refusal(refused.value, 0.9 * torque, bound)
