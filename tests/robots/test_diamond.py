"""The Diamond against its textbook geometry: two arms, two rods that never turn the platform, Lagrange.

The closed forms know one arm and one rod a leg. In the robot under test parallelograms of hinges keep
brackets and platform level.
"""

import shutil
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import robots
from framework import ControlCycle, load_robot, plan_scene, simulate
from framework.atlas.survey import survey_window
from framework.atlas.workspace_map import workspace_map
from tests.oracles.closed_form import Crossing, Kinematics
from tests.oracles.lagrange import platform_force
from tests.oracles.parallelogram_arms import ParallelogramArms

ROBOT = "diamond"
ARM, ROD = 0.35, 0.45  # [m]
ARM_MASS, IDLER_MASS, BRACKET_MASS, PLATFORM_MASS = 1.1, 0.25, 0.2, 1.4  # [kg]
GEAR, ROTOR = 20.0, 1.5e-4


def beam_inertia(mass, radius):
    """Of a uniform cylinder as long as the arm, about its end."""
    return mass * (3 * radius**2 + ARM**2) / 12 + mass * (ARM / 2) ** 2


ARMS = ParallelogramArms(
    yaw=np.array([0.0, np.pi]),
    arm=ARM,
    rod=ROD,
    reach=0.22 - 0.07,
    # a bracket at the end weighs on the motor as twice its mass along the arm
    arm_mass=ARM_MASS + IDLER_MASS + 2 * BRACKET_MASS,
    arm_inertia=beam_inertia(ARM_MASS, 0.025)
    + beam_inertia(IDLER_MASS, 0.008)
    + BRACKET_MASS * ARM**2
    + ROTOR * GEAR**2,
    rod_mass=2 * 0.16,
    rod_radius=0.008,
)


def in_space(x):
    """The point (x, 0, z) of a platform (x, z)."""
    return np.array([x[0], 0 * x[0], x[1]])


def motor_angles(x):
    return ARMS.motor_angles(in_space(x)).real


def rods(x):
    """Unit vectors from knee to platform, x and z (2, 2)."""
    return ARMS.forearms(in_space(x), motor_angles(x))[:, ::2]


def velocity_ratio(x):
    """dq/dx (2, 2): n . (v - knee rate) = 0 in each leg."""
    n = rods(x)
    return n / np.sum(n * ARMS.knee_rates(motor_angles(x))[:, ::2], axis=1)[:, None]


def kinetic_energy(x, dx):
    return 0.5 * PLATFORM_MASS * dx @ dx + ARMS.kinetic_energy(in_space(x), in_space(dx))


def potential_energy(x):
    return 9.81 * PLATFORM_MASS * x[1] + ARMS.potential_energy(in_space(x))


PLACES = [0, -0.45] + np.array([0.3, 0.15]) * np.random.default_rng(3).uniform(-1, 1, (12, 2))
KINEMATICS = Kinematics(PLACES, motor_angles, velocity_ratio, 1e-12, 1e-10)
CROSSING = Crossing(
    scene="cross",
    unprepared="cross-unprepared",
    clear="pick",
    lines=rods,
    bracket=(0.3, 1.0),
    rates=velocity_ratio,
    force=partial(platform_force, kinetic_energy, potential_energy),
    gear=GEAR,
    share=0.5,
    twist_within=1e-10,
    force_within=lambda force: 1e-9 * max(np.abs(force).max(), 10.0),
)


def test_torques_of_the_mirrored_scene_are_those_of_the_other_motor(robot):
    one, two = plan_scene(robot, "pick"), plan_scene(robot, "pick-mirrored")
    t = np.linspace(0.0, one.duration, 51)
    np.testing.assert_allclose(one.torque(t), two.torque(t)[:, ::-1], rtol=0, atol=1e-12)


@pytest.mark.parametrize("scene", ["pick", "pick-mirrored", pytest.param("cross", marks=pytest.mark.slow)])
def test_a_simulation_follows_the_scene_wherever_other_loop_equations_suffice(scene):
    run = simulate(plan_scene(robots.load(ROBOT), scene), samples=51)
    assert run.tracking_error < 1e-9
    assert run.closure_error < 1e-13


@pytest.mark.parametrize("off", [1e-8, 1e-6])
def test_a_rod_that_is_off_by_rounding_is_simulated_and_controlled(off, tmp_path):
    """With a wrong test of closed loops the start is refused: no pose closes all of them."""
    folder = shutil.copytree(Path(robots.__file__).parents[1] / "urdf" / ROBOT, tmp_path / ROBOT)
    urdf = folder / "diamond.urdf"
    end = '<child link="tip_lb"/>\n    <origin xyz="0 0 -0.45"'
    text = urdf.read_text()
    assert end in text
    urdf.write_text(text.replace(end, end.replace("-0.45", f"{-0.45 - off!r}")))
    robot = load_robot(folder / "diamond.yaml")
    plan = plan_scene(robot, "pick")
    assert off / 10 < plan.certificate.rounded_gap < off
    run = simulate(plan, method="stiff", samples=51)
    assert run.tracking_error < 1e-6 + 10 * off
    cycle = ControlCycle(robot)
    cycle.update(robot.actuated_coordinates(robot.reference.q[None])[0], np.zeros(robot.n_a))
    np.testing.assert_allclose(cycle.x, robot.reference.x, rtol=0, atol=10 * off)


@pytest.mark.slow
@pytest.mark.parametrize("size", [13, 80])
def test_the_map_has_the_sign_of_the_angle_between_the_rods_and_no_other_locus(robot, size):
    drawn = workspace_map(robot, survey_window(robot, size=size), ["g"])
    x, g = drawn.window.points()[drawn.reached], drawn.values["g"][drawn.reached]
    sines = np.array([np.linalg.det(rods(place)) for place in x])
    clear = np.abs(sines) > 1e-6
    assert np.count_nonzero(clear) > size
    assert len(set(np.sign(sines * g)[clear])) == 1
    for curve in drawn.locus.curves:
        sines = np.array([np.linalg.det(rods(place)) for place in curve.x])
        assert not curve.is_type2 or np.abs(sines).max() < 1e-9
