"""Payloads from a tonne to a femtogram, and none.

What goes wrong: a check of condition (8) against a fixed number of newtons passes any motion if only the
payload is light, and its torque has a pole all the same. With heavy legs and a light payload t_s . W_p of the
payload alone is not the condition either.
Why: a pole is a matter of proportion; and all bodies pull along t_s, not the payload only.
What we do: what is left along t_s is compared with the sum of its own terms, all bodies included.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import robots
from framework import Arc, Condition, Law, ParallelRobot, UnboundedTorque, inverse_dynamics, plan_crossing
from tests.oracles.planar import CROSSING_SPEED, CROSSING_TIME, DURATION, LINE, without_rotors

MASSES = 10.0 ** np.arange(-15, 4, 3)  # [kg]
CURVED = Arc([0.1, 0.345], [0.02, 0.27], [-0.05, 0.16])


@cache
def carrying(mass: float, name: str = "five_bar") -> ParallelRobot:
    """The robot with this payload [kg]; motors of the 5R without rotors, so that nothing else has mass."""
    description = robots.load(name).description
    text = description.urdf_text
    assert '<mass value="10"/>' in text
    changed = text.replace('<mass value="10"/>', f'<mass value="{float(mass)!r}"/>')
    if name == "five_bar":
        return without_rotors(urdf_text=changed)
    return ParallelRobot.from_description(replace(description, urdf_text=changed))


def left_over(mass: float) -> float:
    """|t_s . W_p| [N] of the unprepared motion."""
    with pytest.raises(UnboundedTorque) as caught:
        plan_crossing(carrying(mass), LINE, duration=DURATION, times=[])
    return abs(caught.value.wrench)


def torque_per_mass(mass: float) -> np.ndarray:
    """Our torques of the prepared motion, over the payload [N m/kg]."""
    plan = plan_crossing(
        carrying(mass), LINE, duration=DURATION, times=[CROSSING_TIME], speeds=[CROSSING_SPEED]
    )
    return plan.torque(np.linspace(0.0, DURATION, 101)) / mass


def test_unprepared_motions_are_refused_by_a_force_proportional_to_the_payload():
    forces = np.array([left_over(mass) for mass in MASSES]) / MASSES
    np.testing.assert_allclose(forces, forces[-1], rtol=1e-10)


def test_prepared_torques_are_proportional_to_the_payload():
    one = torque_per_mass(10.0)
    for mass in MASSES:
        assert np.abs(torque_per_mass(mass) - one).max() < 1e-11 * np.abs(one).max()


def test_without_any_mass_nothing_is_asked_for_and_nothing_is_needed():
    plan = plan_crossing(carrying(0.0), LINE, duration=DURATION, times=[])
    assert np.abs(plan.torque(np.linspace(0.0, DURATION, 31))).max() == 0.0


@pytest.mark.parametrize("mass", [0.0, 1e-6, 1.0])
def test_with_heavy_legs_the_payload_alone_is_not_the_condition(mass):
    robot = carrying(mass, "five_bar_heavy")
    asked = dict(duration=2.0, times=[1.0], speeds=[0.8])
    plan = plan_crossing(robot, CURVED, **asked)
    (crossing,) = plan.crossings
    assert crossing.residual < 1e-11
    first, second = (CURVED(crossing.s, order) for order in (1, 2))
    payload_only = -(crossing.twist @ second) * 0.8**2 / (crossing.twist @ first)
    conditions = [crossing.s, 0.8, payload_only]
    law = Law.rest_to_rest(2.0, 2, [Condition(1.0, order, value) for order, value in enumerate(conditions)])
    with pytest.raises(UnboundedTorque) as caught:
        inverse_dynamics(robot, CURVED, law)
    assert abs(caught.value.wrench) > 1e-3  # [N]
