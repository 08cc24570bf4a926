"""Bricard's mechanism against the closed form of the threefold-symmetric ring.

All hinges with odd numbers turn alike, and all with even numbers. With rods of one length and twists of a
right angle, (1 + cos a) (1 + cos b) = 1 (Chen, You and Tarnai, Int. J. Solids Struct. 42, 2005), with
a = 90 deg + q_odd and b = 90 deg + q_even; the benchmark starts at a = b = 90 deg. One coordinate is left, so
the torque is Lagrange's.
"""

import numpy as np
import pytest

import robots
from framework import (
    Law,
    UnboundedTorque,
    assemble,
    check_robot,
    inverse_dynamics,
    locate_singularities,
    plan_scene,
    velocity_matrices,
)
from framework.kinematics.closures import loop_equations
from framework.kinematics.frames import frames_at
from framework.model.description import FLEXIBILITIES
from framework.planning.scenes import scene_path

ROBOT = "bricard"
QUARTER = np.pi / 2
GRAVITY = 9.81
ACROSS, ALONG = (1 + 0.01) / 12, 0.01 / 6  # inertia of a rod of 1 kg, 1 m and 0.1 m square
# The ring along the edges of a cube: rods 1 to 5, and the axes of the hinges in front of them.
RODS = np.array([[1, 0, 0], [0, -1, 0], [0, 0, 1], [-1, 0, 0], [0, 1, 0]], dtype=float)
AXES = np.array([[0, -1, 0], [0, 0, -1], [-1, 0, 0], [0, -1, 0], [0, 0, -1]], dtype=float)


def other(angle):
    """The positive a that goes with b, and the other way round."""
    return np.arccos(1 / (1 + np.cos(angle)) - 1)


def slope(b):
    """da/db."""
    a = other(b)
    return -(1 + np.cos(a)) * np.sin(b) / (np.sin(a) * (1 + np.cos(b)))


def turn(axis, angle):
    """Rodrigues."""
    skew = np.cross(np.eye(3), axis)  # skew v = axis x v
    return np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew


def energies(x):
    """Mass M of T = M x'^2 / 2 and V [J] where the last rod is turned by x."""
    b = x + QUARTER
    q, rate = (other(b) - QUARTER, x), (slope(b), 1.0)
    frame, omega = np.eye(3), np.zeros(3)
    position, velocity = np.zeros(3), np.zeros(3)
    mass = height = 0.0
    for k, (rod, axis) in enumerate(zip(RODS, AXES, strict=True)):
        omega = omega + rate[k % 2] * frame @ axis
        frame = frame @ turn(axis, q[k % 2])
        along = frame @ rod
        centre = velocity + np.cross(omega, along / 2)
        spin = omega @ along
        mass += centre @ centre + ACROSS * (omega @ omega - spin**2) + ALONG * spin**2
        height += (position + along / 2)[1]
        position, velocity = position + along, velocity + np.cross(omega, along)
    # the ring closes on the far end of the ground, which rests
    np.testing.assert_allclose(position, [0, 0, 1], atol=1e-14)
    np.testing.assert_allclose(velocity, 0, atol=1e-13)
    return mass, GRAVITY * height


def hinges(a, b):
    """Hinge angles (6,) in the order of the tree."""
    return np.array([a - QUARTER, b - QUARTER] * 3)


def test_rank_is_5_of_6_along_the_whole_curve(robot):
    found = check_robot(robot)
    assert (found.mobility, found.loop_equations, found.rank) == (1, 6, 5)
    assert len(found.redundant_rows) == 1
    assert found.redundant_rows[0].startswith("ring.")
    b = np.linspace(-2 * np.pi / 3, 2 * np.pi / 3, 201)[1:-1]
    once = np.array([hinges(sign * other(angle), angle) for sign in (1, -1) for angle in b])
    loops = loop_equations(robot.rows, frames_at(robot, once))
    np.testing.assert_allclose(loops.residual, 0, atol=1e-14)
    values = np.linalg.svd(loops.jacobian, compute_uv=False)
    assert values.shape == (398, 6)
    assert values[:, 5].max() < 1e-14
    assert values[:, 4].min() > 0.5  # nowhere a second one: the curve has no branch


def test_hinges_and_velocities_have_their_closed_forms(robot):
    for x in np.random.default_rng(1).uniform(-1.5, 0.3, 6):
        b = x + QUARTER
        q = assemble(robot, [x]).q
        np.testing.assert_allclose(q, hinges(other(b), b), atol=1e-12)
        A, B, _ = velocity_matrices(robot, q)
        assert A[0, 0] / B[0, 0] == pytest.approx(slope(b), abs=1e-12)  # dq_a = A / B dx


@pytest.mark.parametrize("flexibility", FLEXIBILITIES)
def test_where_the_first_hinge_turns_back_is_type_2(flexibility):
    robot = robots.load("bricard", flexibility=flexibility)
    (point,) = locate_singularities(robot, scene_path(robot.description.scenes["dead_point"]))
    assert point.s == pytest.approx((QUARTER - 0.2) / 1.8, abs=1e-12)  # slope(b) = 0 at b = 0
    assert (point.kind, point.contact, point.corank) == ("type_2", "transversal", 1)
    assert point.twist == pytest.approx([-1.0])
    rates = {robot.coordinates.name_of(k): point.motion[k] for k in range(robot.model.nv)}
    for k in range(1, 7):
        assert rates[f"hinge_{k}"] == pytest.approx(-1.0 if k % 2 == 0 else 0.0, abs=1e-12)


def test_condition_8_has_its_closed_form():
    (crossing,) = plan_scene(robots.load("bricard"), "dead_point").crossings
    h = 1e-3
    back, here, ahead = (np.array(energies(k * h - QUARTER)) for k in (-1, 0, 1))
    assert crossing.condition.alpha == pytest.approx(here[0] * 1.8, rel=1e-12)
    assert crossing.condition.beta == pytest.approx(0.0, abs=1e-12)  # by symmetry M has an extremum
    assert back[0] == pytest.approx(ahead[0], abs=1e-12)
    # force along -x; central difference, good to h^2
    assert crossing.condition.gamma == pytest.approx(-(ahead[1] - back[1]) / (2 * h), rel=1e-5)


def test_a_law_that_forgets_gravity_is_refused(robot):
    with pytest.raises(UnboundedTorque) as caught:
        inverse_dynamics(robot, scene_path(robot.description.scenes["dead_point"]), Law.rest_to_rest(2.0, 2))
    assert caught.value.s == pytest.approx((QUARTER - 0.2) / 1.8, abs=1e-12)
