"""The Delta robot against its textbook geometry: three spheres, three forearms, Lagrange's equations.

The closed forms know a Delta as three arms and three forearms that never turn the platform. The robot
under test has six rods and a platform that only they keep level.
"""

import numpy as np

from framework import assemble
from framework.kinematics.frames import frames_at
from framework.planning.scenes import scene_path
from tests.oracles import lagrange
from tests.oracles.closed_form import Crossing, Kinematics

ROBOT = "delta"
ARM, ROD, WIDTH = 0.524, 1.244, 0.131  # [m]
REACH = 0.164 - 0.044  # motor axes, as seen from the centre of the platform [m]
ARM_MASS, ROD_MASS, PLATFORM_MASS = 1.6, 0.18, 1.5  # [kg]
ROD_RADIUS = 0.008  # [m]
# a uniform cylinder about the motor axis at its end: across its centre, then Steiner
ARM_INERTIA = ARM_MASS * (3 * 0.03**2 + ARM**2) / 12 + ARM_MASS * (ARM / 2) ** 2
GEAR, ROTOR = 30.0, 1e-4
YAW = np.deg2rad([0.0, 120.0, 240.0])
OUT = np.column_stack([np.cos(YAW), np.sin(YAW), 0 * YAW])
SIDE = np.column_stack([-np.sin(YAW), np.cos(YAW), 0 * YAW])
UP = np.array([0.0, 0.0, 1.0])
ELBOW = np.array([-1.0, 1.0, 1.0])  # leg 1 has its elbow inward


def arccos(c):
    """Also of a complex number near the real axis."""
    return np.arccos(c.real) - 1j * c.imag / np.sqrt(1 - c.real**2)


def motor_angles(x):
    """Inverse kinematics: |x - knee(q)| = ROD for each leg, the elbow chosen."""
    out, side, z = OUT @ x - REACH, SIDE @ x, x[2] + 0j
    c = (out**2 + side**2 + z**2 + ARM**2 - ROD**2) / (2 * ARM * np.sqrt(out**2 + z**2))
    lowered = np.arctan2(-z.real, out.real) + 1j * (z.real * out.imag - out.real * z.imag) / (
        out.real**2 + z.real**2
    )
    return lowered - ELBOW * arccos(c)


def knees(q):
    """Centres of the three spheres whose common point is the platform's centre (3, 3)."""
    return (REACH + ARM * np.cos(q))[:, None] * OUT - (ARM * np.sin(q))[:, None] * UP


def forearms(x, q):
    """Unit vectors from knee to platform (3, 3)."""
    return (x - knees(q)) / ROD


def knee_rates(q):
    return -ARM * (np.sin(q)[:, None] * OUT + np.cos(q)[:, None] * UP)


def velocity_ratio(x):
    """dq/dx (3, 3): n . (v - knee rate) = 0 in each leg."""
    q = motor_angles(x).real
    n = forearms(x, q)
    return n / np.sum(n * knee_rates(q), axis=1)[:, None]


def kinetic_energy(x, dx):
    """Of the platform, the arms, the six rods and the rotors [J]."""
    q = motor_angles(x)
    n, slope = forearms(x, q), knee_rates(q)
    dq = (n @ dx) / np.sum(n * slope, axis=1)
    knee = dq[:, None] * slope
    dn = (dx - knee) / ROD
    middle = knee + 0.5 * ROD * dn
    across = ROD_MASS * (3 * ROD_RADIUS**2 + ROD**2) / 12
    # the rod hangs in a universal joint: about SIDE, then sideways; n = -(sin a cos b, -sin b, cos a cos b)
    lateral = np.sum(SIDE * n, axis=1)
    flat = np.column_stack([np.sum(OUT * n, axis=1), n[:, 2]])
    dflat = np.column_stack([np.sum(OUT * dn, axis=1), dn[:, 2]])
    swing = (flat[:, 1] * dflat[:, 0] - flat[:, 0] * dflat[:, 1]) / (1 - lateral**2)
    spin = swing * lateral  # the part of the swing that is along the rod
    along = ROD_MASS * ROD_RADIUS**2 / 2
    rods = ROD_MASS * np.sum(middle**2) + across * np.sum(dn**2) + along * np.sum(spin**2)  # two a leg
    arms = 0.5 * (ARM_INERTIA + ROTOR * GEAR**2) * np.sum(dq**2)
    return 0.5 * PLATFORM_MASS * dx @ dx + arms + rods


def potential_energy(x):
    knee = knees(motor_angles(x))[:, 2]
    rods = 2 * ROD_MASS * 0.5 * (knee + x[2])
    return 9.81 * (PLATFORM_MASS * x[2] + np.sum(0.5 * ARM_MASS * knee + rods))


def platform_force(x, dx, ddx):
    """Lagrange: what the motors must do on the platform's coordinates (3,) [N]."""
    return lagrange.platform_force(kinetic_energy, potential_energy, x, dx, ddx)


def normals(x):
    """Normals of the three parallelograms (3, 3); coplanar in a constraint singularity."""
    return np.cross(SIDE, forearms(x, motor_angles(x).real))


PLACES = [0, 0, -1.2] + 0.15 * np.random.default_rng(3).uniform(-1, 1, (12, 3))
KINEMATICS = Kinematics(PLACES, lambda x: motor_angles(x).real, velocity_ratio, 1e-12, 1e-10)
CROSSING = Crossing(
    scene="cross",
    unprepared="cross-unprepared",
    clear="pick",
    lines=lambda x: forearms(x, motor_angles(x).real),
    bracket=(0.3, 0.7),
    rates=velocity_ratio,
    force=platform_force,
    gear=GEAR,
    share=0.5,
    twist_within=1e-10,
    force_within=lambda force: 1e-10 * max(np.abs(force).max(), 10.0),
)


def test_the_platform_stays_level(robot):
    for x in PLACES:
        q = assemble(robot, x).q
        at = frames_at(robot, q[None])
        np.testing.assert_allclose(at.position[0, 0], x, atol=1e-13)
        np.testing.assert_allclose(at.rotation[0, 0], np.eye(3), atol=1e-12)


def test_elbows_outward_meet_no_singularity_in_the_workspace():
    """Why the scene folds one arm: the FlexPicker's own mode has forearms far from one plane."""
    rng = np.random.default_rng(4)
    radius, angle = 0.8 * np.sqrt(rng.uniform(0, 1, 3000)), rng.uniform(0, 2 * np.pi, 3000)
    z = rng.uniform(-1.25, -0.95, 3000)
    nearest = -np.inf
    for x in np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z]):
        out, side = OUT @ x - REACH, SIDE @ x
        c = (out**2 + side**2 + x[2] ** 2 + ARM**2 - ROD**2) / (2 * ARM * np.hypot(out, x[2]))
        q = np.arctan2(-x[2], out) - np.arccos(c)
        nearest = max(nearest, np.linalg.det(forearms(x, q)))
    assert nearest < -0.2  # one sign everywhere


def test_the_parallelograms_hold_the_platform_level_all_the_way(robot):
    """So its crossing is no constraint singularity."""
    path = scene_path(robot.description.scenes["cross"])
    held = [abs(np.linalg.det(normals(path(s)))) for s in np.linspace(0, 1, 41)]
    assert min(held) > 0.3
