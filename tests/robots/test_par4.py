"""Par4 against its textbook geometry: four spheres, bars between two half plates, Lagrange's equations.

The closed forms take for granted that the half plates do not turn; in the robot under test legs and bars hold
them.
"""

import numpy as np
import pinocchio as pin

from framework import assemble
from tests.oracles import lagrange
from tests.oracles.closed_form import Crossing, Kinematics

ROBOT = "par4"
ARM, ROD, BAR = 0.35, 0.8, 0.16  # [m]
REACH = 0.2 - 0.06  # motor axes, as seen from the first pivot of the half plate [m]
ARM_MASS, ROD_MASS, HALF_MASS, BAR_MASS, TOOL_MASS = 0.8, 0.2, 0.15, 0.1, 1.5  # [kg]
ARM_INERTIA = ARM_MASS * (3 * 0.025**2 + ARM**2) / 12 + ARM_MASS * (ARM / 2) ** 2  # about the motor
ROD_ACROSS, ROD_ALONG = ROD_MASS * (3 * 0.008**2 + ROD**2) / 12, ROD_MASS * 0.008**2 / 2
BAR_INERTIA, TOOL_INERTIA = BAR_MASS * (3 * 0.008**2 + BAR**2) / 12, TOOL_MASS * 0.1**2 / 2
GEAR, ROTOR = 30.0, 1e-4
YAW = np.deg2rad([-45.0, 45.0, 135.0, 225.0])
OUT = np.column_stack([np.cos(YAW), np.sin(YAW), 0 * YAW])
SIDE = np.column_stack([-np.sin(YAW), np.cos(YAW), 0 * YAW])
UP = np.array([0.0, 0.0, 1.0])
HALF = np.array([1.0, 1.0, -1.0, -1.0])  # at which end of the bar a leg pulls


def arccos(c):
    """Also of a complex number near the real axis."""
    return np.arccos(c.real) - 1j * c.imag / np.sqrt(1 - c.real**2)


def pivots(x):
    """First pivot of the half plate that each leg holds (4, 3)."""
    bar = np.array([np.cos(x[3]), np.sin(x[3]), 0])
    return x[:3] + 0.5 * BAR * HALF[:, None] * bar


def pivot_rates(x):
    """d(pivots)/dx (4, 3, 4)."""
    turn = 0.5 * BAR * np.array([-np.sin(x[3]), np.cos(x[3]), 0])
    return np.concatenate([np.tile(np.eye(3), (4, 1, 1)), HALF[:, None, None] * turn[None, :, None]], axis=2)


def motor_angles(x):
    """Inverse kinematics: |pivot - knee(q)| = ROD for each leg, the knee outward."""
    p = pivots(x)
    out, side, z = np.sum(OUT * p, axis=1) - REACH + 0j, np.sum(SIDE * p, axis=1), p[:, 2] + 0j
    c = (out**2 + side**2 + z**2 + ARM**2 - ROD**2) / (2 * ARM * np.sqrt(out**2 + z**2))
    lowered = np.arctan2(-z.real, out.real) + 1j * (z.real * out.imag - out.real * z.imag) / (
        out.real**2 + z.real**2
    )
    return lowered - arccos(c)


def knees(q):
    """Centres of the four spheres on which the pivots lie (4, 3)."""
    return (REACH + ARM * np.cos(q))[:, None] * OUT - (ARM * np.sin(q))[:, None] * UP


def knee_rates(q):
    return -ARM * (np.sin(q)[:, None] * OUT + np.cos(q)[:, None] * UP)


def forearms(x, q):
    """Unit vectors from knee to wrist (4, 3)."""
    return (pivots(x) - knees(q)) / ROD


def matrices(x):
    """A and B (4, 4) of A dx = B dq: the speed along each forearm, at both of its ends."""
    q = motor_angles(x)
    n = forearms(x, q)
    return np.einsum("li,lik->lk", n, pivot_rates(x)), np.diag(np.sum(n * knee_rates(q), axis=1))


def velocity_ratio(x):
    A, B = (part.real for part in matrices(x))
    return np.linalg.solve(B, A)


def kinetic_energy(x, dx):
    """Of the tool, the bars, the half plates, the forearms, the arms and the rotors [J]."""
    q = motor_angles(x)
    n, slope = forearms(x, q), knee_rates(q)
    pivot = pivot_rates(x) @ dx
    dq = np.sum(n * pivot, axis=1) / np.sum(n * slope, axis=1)
    knee = dq[:, None] * slope
    dn = (pivot - knee) / ROD
    # the rod hangs in a universal joint: about SIDE, then sideways
    lateral = np.sum(SIDE * n, axis=1)
    flat, dflat = (np.column_stack([np.sum(OUT * u, axis=1), u[:, 2]]) for u in (n, dn))
    swing = (flat[:, 1] * dflat[:, 0] - flat[:, 0] * dflat[:, 1]) / (1 - lateral**2)
    energy = 0.5 * ROD_MASS * np.sum((knee + 0.5 * ROD * dn) ** 2)
    energy += 0.5 * ROD_ACROSS * np.sum(dn**2) + 0.5 * ROD_ALONG * np.sum((swing * lateral) ** 2)
    energy += 0.5 * (ARM_INERTIA + ROTOR * GEAR**2) * np.sum(dq**2)
    energy += 0.5 * HALF_MASS * (np.sum(pivot[0] ** 2) + np.sum(pivot[2] ** 2))
    energy += 0.5 * (TOOL_MASS + 2 * BAR_MASS) * np.sum(dx[:3] ** 2)
    return energy + 0.5 * (TOOL_INERTIA + 2 * BAR_INERTIA) * dx[3] ** 2


def potential_energy(x):
    knee = knees(motor_angles(x))[:, 2]
    legs = np.sum(0.5 * ARM_MASS * knee + 0.5 * ROD_MASS * (knee + x[2]))
    return 9.81 * (legs + (TOOL_MASS + 2 * BAR_MASS + 2 * HALF_MASS) * x[2])


def platform_force(x, dx, ddx):
    """Lagrange: what the motors must do on the platform's coordinates (4,) [N, N m]."""
    return lagrange.platform_force(kinetic_energy, potential_energy, x, dx, ddx)


SPREAD = np.array([0.1, 0.1, 0.1, 0.4])
PLACES = [0, 0, -0.75, 0.7] + SPREAD * np.random.default_rng(3).uniform(-1, 1, (12, 4))
KINEMATICS = Kinematics(PLACES, lambda x: motor_angles(x).real, velocity_ratio, 1e-12, 1e-10)
CROSSING = Crossing(
    scene="cross",
    unprepared="cross-unprepared",
    clear="pick",
    lines=lambda x: matrices(x)[0].real,
    bracket=(0.1, 0.9),
    rates=velocity_ratio,
    force=platform_force,
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
        q = assemble(robot, x).q
        data = robot.model.createData()
        pin.framesForwardKinematics(robot.model, data, q)
        for half in ("a", "b"):
            place = data.oMf[robot.model.getFrameId(half, pin.FrameType.BODY)]
            np.testing.assert_allclose(place.rotation, np.eye(3), atol=1e-12)


def test_the_second_bar_keeps_two_rows_of_five(robot):
    kept = set(robot.loops.names)
    assert set(robot.rows.names) - kept == {"bar_2.z", "bar_2.rx", "bar_2.ry"}
