"""The delta of hinges against its textbook geometry: three arms and forearms, a level platform."""

import numpy as np

import robots
from framework import assemble, plan_scene, simulate
from framework.kinematics.linearised_loops import linearised_at
from framework.singularity.type2 import singularity_measure
from tests.oracles.closed_form import Kinematics
from tests.oracles.lagrange import platform_force
from tests.oracles.parallelogram_arms import LevelPlatform, ParallelogramArms

ROBOT = "delta_hinges"
ARM, ROD = 0.26, 0.54  # [m]
ARM_MASS, BAR_MASS, PLATFORM_MASS, BAR_RADIUS = 0.7, 0.06, 0.5, 0.008  # [kg, m]
GEAR, ROTOR = 30.0, 5e-5
ARMS = ParallelogramArms(
    yaw=np.deg2rad([0.0, 120.0, 240.0]),
    arm=ARM,
    rod=ROD,
    reach=0.18 - 0.05,
    arm_mass=ARM_MASS + 2 * BAR_MASS,  # the upper bar at the end weighs as twice its mass along the arm
    arm_inertia=ARM_MASS * (3 * 0.022**2 + ARM**2) / 12
    + ARM_MASS * (ARM / 2) ** 2
    + BAR_MASS * ARM**2
    + ROTOR * GEAR**2,
    rod_mass=2 * 0.09,
    rod_radius=0.006,
    swung_inertia=2 * BAR_MASS * BAR_RADIUS**2 / 2,  # upper and lower bar about themselves
)
DELTA = LevelPlatform(ARMS, PLATFORM_MASS + 3 * BAR_MASS)


def motor_torques(x, dx, ddx):
    force = platform_force(DELTA.kinetic_energy, DELTA.potential_energy, x, dx, ddx)
    return np.linalg.solve(DELTA.velocity_ratio(x).T, force) / GEAR


PLACES = [0, 0, -0.56] + 0.12 * np.random.default_rng(3).uniform(-1, 1, (12, 3))
KINEMATICS = Kinematics(PLACES, DELTA.motor_angles, DELTA.velocity_ratio, 1e-12, 1e-10)


def test_g_has_the_sign_of_the_volume_of_the_forearms(robot):
    for x in PLACES:
        g = singularity_measure(robot, linearised_at(robot, assemble(robot, x).q[None])).g[0]
        first = singularity_measure(robot, linearised_at(robot, robot.reference.q[None])).g[0]
        volumes = [np.linalg.det(DELTA.forearms(at)) for at in (x, robot.reference.x)]
        assert g * first * np.prod(volumes) > 0


def test_torques_of_the_mirrored_scene_are_those_of_the_other_legs(robot):
    one, two = plan_scene(robot, "pick"), plan_scene(robot, "pick-mirrored")
    t = np.linspace(0.0, one.duration, 51)
    np.testing.assert_allclose(one.torque(t), two.torque(t)[:, [0, 2, 1]], rtol=0, atol=1e-12)


def test_a_simulation_follows_the_scene():
    run = simulate(plan_scene(robots.load(ROBOT), "pick"), samples=51)
    assert run.tracking_error < 1e-9
    assert run.closure_error < 1e-13
