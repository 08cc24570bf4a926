"""Par4 against its textbook geometry: four spheres, bars between two half plates, Lagrange's equations.

The closed forms take for granted that the half plates do not turn; in the robot under test legs and bars hold
them.
"""

from functools import partial

import numpy as np

from framework import assemble
from tests.oracles.closed_form import Crossing, Kinematics
from tests.oracles.lagrange import platform_force
from tests.oracles.parallelogram_arms import ParallelogramArms
from tests.oracles.placements import placements

ROBOT = "par4"
ARM, BAR = 0.35, 0.16  # [m]
ARM_MASS, HALF_MASS, BAR_MASS, TOOL_MASS = 0.8, 0.15, 0.1, 1.5  # [kg]
BAR_INERTIA, TOOL_INERTIA = BAR_MASS * (3 * 0.008**2 + BAR**2) / 12, TOOL_MASS * 0.1**2 / 2
GEAR, ROTOR = 30.0, 1e-4
ARMS = ParallelogramArms(
    yaw=np.deg2rad([-45.0, 45.0, 135.0, 225.0]),
    arm=ARM,
    rod=0.8,
    reach=0.2 - 0.06,
    arm_mass=ARM_MASS,
    arm_inertia=ARM_MASS * (3 * 0.025**2 + ARM**2) / 12 + ARM_MASS * (ARM / 2) ** 2 + ROTOR * GEAR**2,
    rod_mass=0.2,
    rod_radius=0.008,
)
HALF = np.array([1.0, 1.0, -1.0, -1.0])  # at which end of the bar a leg pulls


def pivots(x):
    """First pivot of the half plate that each leg holds (4, 3)."""
    bar = np.array([np.cos(x[3]), np.sin(x[3]), 0])
    return x[:3] + 0.5 * BAR * HALF[:, None] * bar


def pivot_rates(x):
    """d(pivots)/dx (4, 3, 4)."""
    turn = 0.5 * BAR * np.array([-np.sin(x[3]), np.cos(x[3]), 0])
    return np.concatenate([np.tile(np.eye(3), (4, 1, 1)), HALF[:, None, None] * turn[None, :, None]], axis=2)


def motor_angles(x):
    return ARMS.motor_angles(pivots(x)).real


def matrices(x):
    """A and B (4, 4) of A dx = B dq: the speed along each forearm, at both of its ends."""
    q = motor_angles(x)
    n = ARMS.forearms(pivots(x), q)
    return np.einsum("li,lik->lk", n, pivot_rates(x)), np.diag(np.sum(n * ARMS.knee_rates(q), axis=1))


def velocity_ratio(x):
    A, B = matrices(x)
    return np.linalg.solve(B, A)


def kinetic_energy(x, dx):
    """Of the tool, the bars, the half plates, the forearms, the arms and the rotors [J]."""
    pivot = pivot_rates(x) @ dx
    energy = ARMS.kinetic_energy(pivots(x), pivot)
    energy += 0.5 * HALF_MASS * (np.sum(pivot[0] ** 2) + np.sum(pivot[2] ** 2))
    energy += 0.5 * (TOOL_MASS + 2 * BAR_MASS) * np.sum(dx[:3] ** 2)
    return energy + 0.5 * (TOOL_INERTIA + 2 * BAR_INERTIA) * dx[3] ** 2


def potential_energy(x):
    return ARMS.potential_energy(pivots(x)) + 9.81 * (TOOL_MASS + 2 * BAR_MASS + 2 * HALF_MASS) * x[2]


SPREAD = np.array([0.1, 0.1, 0.1, 0.4])
PLACES = [0, 0, -0.75, 0.7] + SPREAD * np.random.default_rng(3).uniform(-1, 1, (12, 4))
KINEMATICS = Kinematics(PLACES, motor_angles, velocity_ratio, 1e-12, 1e-10)
CROSSING = Crossing(
    scene="cross",
    unprepared="cross-unprepared",
    clear="pick",
    lines=lambda x: matrices(x)[0],
    bracket=(0.1, 0.9),
    rates=velocity_ratio,
    force=partial(platform_force, kinetic_energy, potential_energy),
    gear=GEAR,
    share=0.9,
    twist_within=1e-9,
    force_within=lambda force: 1e-9,
    torque_within=lambda torque: 1e-10,
    away=0.08,
    power_within=1e-9,
)


def test_the_half_plates_do_not_turn(robot):
    for x in PLACES:
        for place in placements(robot.model, ("a", "b"), assemble(robot, x).q):
            np.testing.assert_allclose(place.rotation, np.eye(3), atol=1e-12)


def test_the_second_bar_keeps_two_rows_of_five(robot):
    kept = set(robot.loops.names)
    assert set(robot.rows.names) - kept == {"bar_2.z", "bar_2.rx", "bar_2.ry"}
