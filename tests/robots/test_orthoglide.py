"""The Orthoglide against its textbook geometry: three legs of one length, a rule of design, Lagrange.

The closed forms know a platform that does not turn and three legs. In the robot under test parallelograms and
hinges keep the platform from turning.
"""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.optimize import brentq

from framework import (
    Line,
    OutOfReach,
    ParallelRobot,
    assemble,
    locate_singularities,
    plan_scene,
    velocity_matrices,
)
from framework.planning.scenes import scene_path
from tests.oracles.closed_form import Crossing, Kinematics
from tests.oracles.lagrange import platform_force

ROBOT = "orthoglide"
LENGTH, HALF = 0.31058, 0.04  # [m]
CARRIED, ROD, BAR, PLATFORM = 1.5 + 0.5 + 0.2, 0.12, 0.1, 2.5  # [kg]; carriage, column and cross as one
ROD_ACROSS, ROD_ALONG = ROD * (3 * 0.007**2 + LENGTH**2) / 12, ROD * 0.007**2 / 2
TILTING = (0.2 + BAR) * 0.012**2 / 2  # cross and bar about themselves [kg m^2]
GEAR, ROTOR = 314.1592653589793, 5e-5
LEGS = np.array([[0, 1, 2], [1, 2, 0], [2, 0, 1]])  # x, y, z of a leg's frame among those of the base


def along(x):
    """How far the leg reaches along its rail (3,): sqrt(L^2 - y^2 - z^2)."""
    _, y, z = x[LEGS].T
    return np.sqrt(LENGTH**2 - y**2 - z**2)


def slides(x):
    """Inverse kinematics: the coordinate of each carriage (3,) [m]."""
    return x + along(x)


def velocity_ratio(x):
    """d(slides)/dx (3, 3)."""
    _, y, z = x[LEGS].T / along(x)
    return np.array([np.roll((1.0, -y[i], -z[i]), i) for i in range(3)])


def legs(x):
    """Unit vectors from carriage to platform (3, 3)."""
    return (x - np.diag(slides(x))) / LENGTH


def kinetic_energy(x, dx):
    """Of the platform, the bars, the rods, the crosses, the carriages and the rotors [J]."""
    (_, y, z), (v, dy, dz) = x[LEGS].T, dx[LEGS].T
    r = along(x)
    dr = -(y * dy + z * dz) / r
    slide, tilt = v + dr, (dz * r - z * dr) / (r**2 + z**2)
    dn = np.array([-dr, dy, dz]) / LENGTH
    middle = np.array([slide, 0 * slide, 0 * slide]) + 0.5 * LENGTH * dn
    spin = -tilt * y / LENGTH  # the part of the tilt that is along the rod
    energy = 0.5 * (CARRIED + ROTOR * GEAR**2) * np.sum(slide**2) + 0.5 * TILTING * np.sum(tilt**2)
    energy += ROD * np.sum(middle**2) + ROD_ACROSS * np.sum(dn**2) + ROD_ALONG * np.sum(spin**2)  # two a leg
    return energy + 0.5 * (PLATFORM + 3 * BAR) * np.sum(dx**2)


def potential_energy(x):
    lifted = slides(x)[2]
    return 9.81 * ((CARRIED + ROD) * lifted + (PLATFORM + 3 * BAR + 3 * ROD) * x[2])


def hinge_volume(x):
    """Zero when three legs of hinges alone would let the platform turn: their planes y, z share a line."""
    return float(np.prod(along(x)) - np.prod(x))


def exact_s(path, measure):
    return brentq(lambda s: measure(path(s)), 0.0, 1.0, xtol=1e-15, rtol=1e-15)


PLACES = np.random.default_rng(5).uniform(-0.12679, 0.07321, (12, 3))
KINEMATICS = Kinematics(PLACES, slides, velocity_ratio, 1e-13, 1e-11)
CROSSING = Crossing(
    scene="cross",
    unprepared="cross-unprepared",
    clear="mill",
    lines=legs,
    bracket=(0.0, 1.0),
    rates=velocity_ratio,
    force=partial(platform_force, kinetic_energy, potential_energy),
    gear=GEAR,
    share=0.95,
    twist_within=1e-10,
    force_within=lambda force: 1e-9,
)


def test_the_length_of_the_legs_obeys_the_rule_of_design(robot):
    """Between 1/2 and 2 in the whole cube; the bounds at its corners on the diagonal."""
    low, high = -LENGTH / np.sqrt(6), LENGTH / np.sqrt(18)
    assert high - low == pytest.approx(0.2, abs=1e-5)  # the length is rounded to 0.01 mm
    for corner, factors in ((low, (2, 0.5, 0.5)), (high, (1.25, 1.25, 0.5))):
        A, B, _ = velocity_matrices(robot, assemble(robot, [corner] * 3).q)
        np.testing.assert_allclose(np.linalg.svd(np.linalg.solve(B, A))[1], factors, rtol=0, atol=1e-12)
    inside = np.stack(np.meshgrid(*[np.linspace(low, high, 9)] * 3), axis=-1).reshape(-1, 3)
    factors = np.array([np.linalg.svd(velocity_ratio(x), compute_uv=False) for x in inside])
    assert factors.max() < 2 + 1e-12
    assert factors.min() > 0.5 - 1e-12


def test_on_the_diagonal_the_legs_are_parallel_to_one_plane_at_L_over_sqrt_6(robot):
    (point,) = locate_singularities(robot, Line([0, 0, 0], [0.15, 0.15, 0.15]))
    np.testing.assert_allclose(point.platform, LENGTH / np.sqrt(6), rtol=0, atol=1e-13)
    np.testing.assert_allclose(point.twist, 1 / np.sqrt(3), rtol=0, atol=1e-12)


def test_the_workspace_ends_where_a_leg_is_normal_to_its_rail(robot):
    path = Line([0, 0, 0], [0.0, 0.3, 0.2])  # Type 1 of leg 1: y^2 + z^2 = L^2
    with pytest.raises(OutOfReach) as caught:
        locate_singularities(robot, path)
    assert caught.value.s == pytest.approx(LENGTH / np.hypot(0.3, 0.2), abs=1e-6)


def test_hinges_throughout_repeat_twelve_rows_but_not_the_same_twelve_everywhere(robot):
    """As built: 25 rows of rank 13. Those of the isotropic pose fail on the path, at r_1 r_2 r_3 = x y z."""
    axes = dict.fromkeys(("rod_1b", "rod_2b", "rod_3b"), ("x", "y", "z", "rx", "ry"))
    axes |= dict.fromkeys(("mount_2", "mount_3"), ("x", "y", "z", "rx", "rz"))
    closures = tuple(replace(one, axes=axes[one.name]) for one in robot.description.closures)
    hinged = ParallelRobot.from_description(replace(robot.description, closures=closures))
    assert (len(hinged.rows.names), len(hinged.loops.names)) == (25, 13)
    path = scene_path(robot.description.scenes["cross"])
    assert 0.0 < exact_s(path, hinge_volume) < 1.0
    plan, of_hinges = plan_scene(robot, "cross"), plan_scene(hinged, "cross")
    assert [one.s for one in of_hinges.crossings] == pytest.approx(
        [one.s for one in plan.crossings], rel=1e-12
    )
    t = np.linspace(0.0, plan.duration, 101)
    largest = np.abs(plan.torque(t)).max()
    np.testing.assert_allclose(of_hinges.torque(t), plan.torque(t), atol=1e-12 * largest)
