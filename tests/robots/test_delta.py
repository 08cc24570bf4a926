"""The Delta robot against its textbook geometry: three spheres, three forearms, Lagrange's equations.

The closed forms know a Delta as three arms and three forearms that never turn the platform. The robot
under test has six rods and a platform that only they keep level.
"""

from dataclasses import replace
from functools import partial

import numpy as np

from framework.planning.scenes import scene_path
from tests.oracles.closed_form import Crossing, Kinematics
from tests.oracles.lagrange import platform_force
from tests.oracles.parallelogram_arms import LevelPlatform, ParallelogramArms

ROBOT = "delta"
ARM, ROD = 0.524, 1.244  # [m]
ARM_MASS, PLATFORM_MASS = 1.6, 1.5  # [kg]
GEAR, ROTOR = 30.0, 1e-4
ARMS = ParallelogramArms(
    yaw=np.deg2rad([0.0, 120.0, 240.0]),
    arm=ARM,
    rod=ROD,
    reach=0.164 - 0.044,
    arm_mass=ARM_MASS,
    # a uniform cylinder about the motor axis at its end: across its centre, then Steiner
    arm_inertia=ARM_MASS * (3 * 0.03**2 + ARM**2) / 12 + ARM_MASS * (ARM / 2) ** 2 + ROTOR * GEAR**2,
    rod_mass=2 * 0.18,
    rod_radius=0.008,
    elbow=np.array([-1.0, 1.0, 1.0]),  # leg 1 has its elbow inward
)
DELTA = LevelPlatform(ARMS, PLATFORM_MASS)


def normals(x):
    """Normals of the three parallelograms (3, 3); coplanar in a constraint singularity."""
    return np.cross(ARMS.side, DELTA.forearms(x))


PLACES = [0, 0, -1.2] + 0.15 * np.random.default_rng(3).uniform(-1, 1, (12, 3))
KINEMATICS = Kinematics(PLACES, DELTA.motor_angles, DELTA.velocity_ratio, 1e-12, 1e-10)
CROSSING = Crossing(
    scene="cross",
    unprepared="cross-unprepared",
    clear="pick",
    lines=DELTA.forearms,
    bracket=(0.3, 0.7),
    rates=DELTA.velocity_ratio,
    force=partial(platform_force, DELTA.kinetic_energy, DELTA.potential_energy),
    gear=GEAR,
    share=0.5,
    twist_within=1e-10,
    force_within=lambda force: 1e-10 * max(np.abs(force).max(), 10.0),
)


def test_elbows_outward_meet_no_singularity_in_the_workspace():
    """Why the scene folds one arm: the FlexPicker's own mode has forearms far from one plane."""
    rng = np.random.default_rng(4)
    radius, angle = 0.8 * np.sqrt(rng.uniform(0, 1, 3000)), rng.uniform(0, 2 * np.pi, 3000)
    z = rng.uniform(-1.25, -0.95, 3000)
    nearest = -np.inf
    outward = replace(ARMS, elbow=1.0)
    for x in np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z]):
        nearest = max(nearest, np.linalg.det(outward.forearms(x, outward.motor_angles(x).real)))
    assert nearest < -0.2  # one sign everywhere


def test_the_parallelograms_hold_the_platform_level_all_the_way(robot):
    """So its crossing is no constraint singularity."""
    path = scene_path(robot.description.scenes["cross"])
    held = [abs(np.linalg.det(normals(path(s)))) for s in np.linspace(0, 1, 41)]
    assert min(held) > 0.3
