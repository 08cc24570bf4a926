"""The paper's planar 5R against closed forms: fifty digits, exact derivatives (oracles/five_bar.py)."""

import re

import numpy as np
import pytest

import robots
from framework import UnboundedTorque, assemble, locate_singularities, plan_scene, velocity_matrices
from framework.planning.scenes import scene_path
from tests.oracles import five_bar as oracle

# The crossing instant, t = 1 s, is one of them; polynomials of degree 70 have no feature between them.
TIMES = np.linspace(0.0, 1.5, 91)
VARIANTS = [
    ("rigid", "rigid"),
    ("flexible_joints", "rigid"),
    ("flexible_links", "rigid"),
    ("flexible_links", "deformed"),
]
# Lengths from the file are decimals in double precision: 1e-13 is what rounding may leave of torques
# of 0.1 N m. The project promises 1e-9 N m.
TORQUE = 1e-13


@pytest.mark.parametrize(
    ("scene", "flexibility", "geometry"), [("A", *VARIANTS[-1]), *(("C", *variant) for variant in VARIANTS)]
)
def test_torques_and_deflections_agree_with_closed_forms(scene, flexibility, geometry):
    plan = plan_scene(robots.load("five_bar", flexibility=flexibility), scene, geometry=geometry)
    exact = oracle.solve(scene=scene, flexibility=flexibility, geometry=geometry)
    assert plan.law.degree == len(exact.coefficients) - 1
    np.testing.assert_allclose(plan.torque(TIMES), oracle.torques(exact, TIMES), rtol=0, atol=TORQUE)
    few = TIMES[::6]
    np.testing.assert_allclose(plan.motor_angle(few), oracle.motor_angles(exact, few), atol=1e-12)
    # of 3e-4 rad and 1e-4 m at most
    np.testing.assert_allclose(plan.deflection(few), oracle.deflections(exact, few), rtol=0, atol=1e-15)


def test_rigid_robot_on_the_law_of_the_elastic_one():
    plan = plan_scene(robots.load("five_bar"), "C", smoothness=4)
    exact = oracle.solve(scene="C", flexibility="rigid", geometry="rigid", smoothness=4)
    assert plan.law.degree == 12
    np.testing.assert_allclose(plan.torque(TIMES), oracle.torques(exact, TIMES), rtol=0, atol=TORQUE)


@pytest.mark.parametrize(
    ("flexibility", "geometry", "s"),
    [
        ("rigid", "rigid", 0.667006874764298),
        ("flexible_links", "rigid", 0.667006874764298),
        ("flexible_links", "deformed", 0.667103351667140),
    ],
)
def test_the_deformed_robot_is_singular_elsewhere(flexibility, geometry, s):
    plan = plan_scene(robots.load("five_bar", flexibility=flexibility), "C", geometry=geometry)
    (crossing,) = plan.crossings
    exact = oracle.solve(scene="C", flexibility=flexibility, geometry=geometry)
    assert crossing.s == pytest.approx(s, abs=2e-15)
    assert crossing.s == pytest.approx(float(exact.s_c), abs=2e-15)
    assert crossing.acceleration == pytest.approx(0.0, abs=1e-12)  # Eq. (18): the path is straight
    assert crossing.residual < 1e-12


def test_singular_point_and_twist_have_their_closed_forms():
    robot = robots.load("five_bar")
    path = scene_path(robot.description.scenes["C"])
    (point,) = locate_singularities(robot, path)
    assert point.s == pytest.approx(float(oracle.locus_position("C")), abs=1e-15)
    assert (point.kind, point.contact, point.corank) == ("type_2", "transversal", 1)
    twist = oracle.singular_twist(point.platform)  # Eq. (16)
    np.testing.assert_allclose(point.twist, twist * np.sign(twist @ point.twist), atol=1e-12)


@pytest.mark.parametrize("s", [0.0, 0.3, 0.6, 0.95])
def test_A_B_C_are_those_of_the_paper_up_to_the_choice_of_rows(s):
    robot = robots.load("five_bar", flexibility="flexible_links")
    x = scene_path(robot.description.scenes["C"])(s)
    ours = velocity_matrices(robot, assemble(robot, x).q)
    A, B, C = oracle.velocity_matrices(x)  # Eqs. (13)-(15)
    rows = ours.A @ np.linalg.inv(A)  # our rows are these combinations of the paper's
    np.testing.assert_allclose(ours.B, rows @ B, atol=1e-13)
    np.testing.assert_allclose(ours.C[:, :2], rows @ B, atol=1e-13)  # drives give way as motors turn
    np.testing.assert_allclose(ours.C[:, 2:], rows @ C, atol=1e-13)


@pytest.mark.parametrize(
    ("scene", "flexibility", "geometry"),
    [("C-printed", *VARIANTS[0]), *(("B", *variant) for variant in VARIANTS)],
)
def test_a_law_without_condition_8_gets_no_torques(scene, flexibility, geometry):
    robot = robots.load("five_bar", flexibility=flexibility)
    with pytest.raises(UnboundedTorque, match=r"t_s \. W_p = ") as caught:
        plan_scene(robot, scene, geometry=geometry)
    if geometry == "deformed":
        return  # the pole is where the deformed robot is singular, next test's business
    error = caught.value
    s = float(oracle.locus_position("C"))
    assert error.s == pytest.approx(s, abs=1e-12)
    # straight path: t_s . W_p = m (t_s . x') s"
    conditions = {"B": [], "C-printed": [(1.0, 0, 2 / 3), (1.0, 1, 1.5), (1.0, 2, 0.0)]}[scene]
    law = power_law(conditions, 4 if robot.n_e else 2)
    assert law(error.time) == pytest.approx(s, abs=1e-9)
    along = np.array([-0.15, -0.15])
    twist = oracle.singular_twist(scene_path(robot.description.scenes[scene])(s))
    expected = 10.0 * abs(twist @ along) * abs(law.deriv(2)(error.time))
    assert abs(error.wrench) == pytest.approx(expected, rel=1e-6)
    if not robot.n_e:  # the path crosses t_s at another angle than 90 degrees and is straight: s" is to be 0
        has, asked = (float(word) for word in re.findall(r's" = ([^\s;]+)', str(error)))
        assert has == pytest.approx(law.deriv(2)(error.time), rel=1e-4)
        assert asked == 0.0


def power_law(conditions, smoothness, duration=1.5):
    """The law by brute force: powers of t, one linear system. Good to about 1e-9."""
    ends = [(t, k, float(t > 0 and k == 0)) for t in (0.0, duration) for k in range(smoothness + 1)]
    everything = [*ends, *conditions]
    unit = np.eye(len(everything))
    rows = [[np.polynomial.Polynomial(p).deriv(k)(t) for p in unit] for t, k, _ in everything]
    return np.polynomial.Polynomial(np.linalg.solve(rows, [value for *_, value in everything]))
