"""The Gough-Stewart platform against its textbook geometry: leg lengths, Plücker lines, Lagrange's equations.

The closed forms below know the published dimensions and nothing of the URDF. All of them are analytic,
so a step of 1e-30 i gives their derivatives to rounding.
"""

from functools import partial

import numpy as np
import pytest

import robots
from framework import Line, assemble, forward_kinematics, track_path
from framework.kinematics.frames import frames_at
from framework.kinematics.motion_rates import joint_rates, motion_at
from framework.laws.path import time_derivatives
from framework.numerics.chebyshev import TimeGrid
from tests.oracles.closed_form import Crossing, Kinematics
from tests.oracles.lagrange import platform_force
from tests.oracles.spherical import cross, rodrigues, spin

ROBOT = "gough_stewart"
H = 1e-30
DENSITY = 76e3 / 9.81  # [kg/m^3]
GEAR, ROTOR = 314.159265, 2e-3  # [rad/m], [kg m^2]


def ring(radius, degrees):
    angle = np.deg2rad(degrees)
    return radius * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])


BASE = ring(3.0, [-2.5, 2.5, 117.5, 122.5, 237.5, 242.5])  # (6, 3) [m]
PLATFORM = ring(1.0, [-50.0, 50.0, 70.0, 170.0, 190.0, 290.0])


def legs(x):
    """Leg vectors (6, 3) from base to platform joint."""
    return x[:3] + PLATFORM @ rodrigues(x[3:]).T - BASE


def lengths(x):
    leg = legs(x)
    return np.sqrt(np.sum(leg * leg, axis=1))


def test_leg_lengths_lead_to_the_pose_that_has_them():
    """Its motors are its legs: the joint coordinate of a leg is its length [m]."""
    robot, rng = robots.load("gough_stewart"), np.random.default_rng(5)
    start = assemble(robot)
    for _ in range(5):
        x = start.x + 0.03 * rng.uniform(-1, 1, 6) * np.repeat([robot.length, 1.0], 3)
        found = forward_kinematics(robot, lengths(x).real)
        np.testing.assert_allclose(found.x, x, rtol=0, atol=1e-12 / found.clearance)


def plucker(x):
    """Lines of the legs (6, 6), direction and moment about the platform's centre."""
    leg = legs(x).real
    line = leg / np.linalg.norm(leg, axis=1)[:, None]
    return np.hstack([line, np.cross(leg + BASE - x[:3], line)])


PART = 0.75 * np.linalg.norm(PLATFORM[0] + [0, 0, 2.0] - BASE[0])  # length of tube and of rod [m]
HOME = PLATFORM + np.array([0, 0, 2.0]) - BASE
Z = HOME / np.linalg.norm(HOME, axis=1)[:, None]
X = np.cross(Z, [0, 0, 1.0]) / np.linalg.norm(np.cross(Z, [0, 0, 1.0]), axis=1)[:, None]
Y = np.cross(Z, X)


def cylinder(length, outer, inner):
    """Mass, moments of inertia across and along."""
    mass = DENSITY * np.pi * (outer**2 - inner**2) * length
    across = mass * (3 * (outer**2 + inner**2) + length**2) / 12
    return mass, across, mass * (outer**2 + inner**2) / 2


TUBE, ROD, PLATE = cylinder(PART, 0.05, 0.03), cylinder(PART, 0.03, 0.0), cylinder(0.05, 1.0, 0.0)


def kinetic_energy(x, dx):
    """Of the platform, the tubes, the rods and the rotors [J]."""
    R, omega = rodrigues(x[3:]), spin(x[3:], dx[3:])
    arm = PLATFORM @ R.T
    leg, dleg = legs(x), dx[:3] + cross(omega, arm)
    L = np.sqrt(np.sum(leg * leg, axis=1))
    d = leg / L[:, None]
    dL = np.sum(d * dleg, axis=1)
    dd = (dleg - dL[:, None] * d) / L[:, None]
    # universal joint: swing about X, then tilt about the turned Y; they make the leg's own spin
    (dx_, dy, dz), (vx, vy, vz) = ([np.sum(u * w, axis=1) for u in (X, Y, Z)] for w in (d, dd))
    c = np.sqrt(1 - dx_ * dx_)
    swing, tilt = (dy * vz - dz * vy) / c**2, vx / c
    turned = (dz / c)[:, None] * Y + (-dy / c)[:, None] * Z
    leg_spin = swing[:, None] * X + tilt[:, None] * turned
    square, about = np.sum(leg_spin * leg_spin, axis=1), np.sum(leg_spin * d, axis=1)
    energy = 0.5 * PLATE[0] * dx[:3] @ dx[:3]
    local = R.T @ omega
    energy = energy + 0.5 * (PLATE[1] * (local[0] ** 2 + local[1] ** 2) + PLATE[2] * local[2] ** 2)
    for (mass, across, axial), velocity in ((TUBE, PART / 2 * dd), (ROD, dleg - PART / 2 * dd)):
        energy = energy + 0.5 * mass * np.sum(velocity * velocity)
        energy = energy + 0.5 * np.sum(across * (square - about**2) + axial * about**2)
    return energy + 0.5 * ROTOR * GEAR**2 * np.sum(dL**2)


def potential_energy(x):
    leg = legs(x)
    up = leg[:, 2] / np.sqrt(np.sum(leg * leg, axis=1))
    height = TUBE[0] * PART / 2 * up + ROD[0] * (leg[:, 2] - PART / 2 * up)
    return 9.81 * (PLATE[0] * x[2] + np.sum(height))


def gradient(function, x):
    return np.array([function(x + 1j * H * unit).imag / H for unit in np.eye(6)])


def length_rates(x):
    """d(lengths)/dx (6, 6): leg by coordinate."""
    return np.array([lengths(x + 1j * H * unit).imag / H for unit in np.eye(6)]).T


def poses(count, turn):
    """Random poses whose rotation vector measures up to `turn` [rad] a component."""
    spread = np.array([0.4, 0.4, 0.4, *turn])
    return [0, 0, 2.2, 0, 0, 0] + spread * np.random.default_rng(5).uniform(-1, 1, (count, 6))


KINEMATICS = Kinematics(poses(12, [0.6, 0.6, 1.4]), lambda x: lengths(x).real, plucker, 1e-12, 1e-11)
CROSSING = Crossing(
    scene="turn",
    unprepared="turn-unprepared",
    clear="tilt",
    lines=plucker,
    bracket=(0.3, 0.6),
    rates=length_rates,
    force=partial(platform_force, kinetic_energy, potential_energy),
    gear=GEAR,
    share=0.9,
    twist_within=1e-11,
    force_within=lambda force: 1e-10 * np.abs(force).max(),
    torque_within=lambda torque: 1e-10 * np.abs(torque).max(),
    away=0.1,
    power_within=1e-9,
)


@pytest.mark.parametrize(
    ("start", "end"),
    [
        ([0, 0, 2, -0.3, 0.2, -1.0], [0.3, -0.2, 2.6, 0.5, -0.4, 2.4]),  # 1.1, over 0.2, to 2.5 rad
        ([0.2, 0, 2.6, 0.2, -0.3, 2.6], [-0.1, 0.2, 2.2, -0.2, 0.3, 3.7]),  # beyond half a turn
    ],
)
def test_rates_along_a_path_with_large_rotations(robot, start, end):
    branch = track_path(robot, Line(start, end))
    grid = TimeGrid(np.array([0.0, 1.0]), 96)
    t = grid.times
    s, ds, dds = 0.1 + 0.5 * t + 0.2 * t**2, 0.5 + 0.4 * t, np.full_like(t, 0.4)
    closed = branch.close(s)
    x, dx, ddx = time_derivatives(branch.path, [s, ds, dds])
    motion = motion_at(robot, closed, dx, ddx)
    _, v, a = grid.values(grid.fit(closed.q - closed.q[0]))
    np.testing.assert_allclose(motion.v, v, atol=3e-10 * np.abs(v).max())
    np.testing.assert_allclose(motion.a, a, atol=1e-6 * np.abs(a).max())
    # the legs, in closed form
    exact = np.array([lengths(p + 1j * H * rate) for p, rate in zip(x, dx, strict=True)])
    np.testing.assert_allclose(closed.q[:, robot.actuated], exact.real, atol=1e-12)
    np.testing.assert_allclose(motion.v[:, robot.actuated], exact.imag / H, atol=1e-11)
    twist, _ = robot.platform.twist(x, dx)
    rates = joint_rates(robot, closed, twist, np.zeros((len(t), 0)))
    np.testing.assert_array_equal(rates, motion.v)
    # and the attitude
    for k in (0, 40, 95):
        R = frames_at(robot, closed.q[k : k + 1]).rotation[0, 0]
        np.testing.assert_allclose(R, rodrigues(x[k, 3:]).real, atol=1e-12)


def test_level_platform_is_singular_a_quarter_turn_from_home():
    """Fichter 1986: whatever the height, and nowhere else in between."""
    for z in (1.5, 2.0, 2.6):
        dets = [np.linalg.det(plucker(np.array([0, 0, z, 0, 0, a]))) for a in (1e-9, 1.5, np.pi / 2, 1.65)]
        assert abs(dets[2]) < 1e-13 < abs(dets[1])
        assert dets[0] * dets[1] > 0 > dets[1] * dets[3]
