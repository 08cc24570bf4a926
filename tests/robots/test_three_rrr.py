"""The planar 3-RRR against textbook geometry: two circles a leg, three rods that meet in a point.

Nothing here is taken from the URDF but its numbers. Derivatives of the closed forms are taken with fifty
digits, so that they cost no accuracy.
"""

import mpmath as mp
import numpy as np
import pytest
from scipy.optimize import brentq

from framework import assemble

ROBOT = "three_rrr"
MOTORS = [(0, 0), (mp.mpf("1.2"), 0), (mp.mpf("0.6"), mp.mpf("1.0392304845413265"))]  # A_i
CORNERS = [("-0.0928", "-0.0535"), ("0.0928", "-0.0535"), ("0", "0.107")]  # C_i in the platform
LENGTH = mp.mpf("0.6")  # A_i B_i and B_i C_i [m]
CRANK, ROD, PLATFORM = mp.mpf("1.5"), mp.mpf("0.9"), mp.mpf(4)  # [kg]
# about their axes of turning: cylinders of radius 15 mm and 12 mm, a disc of 120 mm
CRANK_ABOUT_MOTOR = CRANK * (3 * mp.mpf("0.015") ** 2 + LENGTH**2) / 12 + CRANK * LENGTH**2 / 4
ROD_ABOUT_CENTRE = ROD * (3 * mp.mpf("0.012") ** 2 + LENGTH**2) / 12
PLATFORM_ABOUT_CENTRE = PLATFORM * mp.mpf("0.12") ** 2 / 2
GEAR, ROTOR = 10, mp.mpf("1.2e-4")
MODE = 1  # the cranks stand to the left of the lines A_i C_i
PLACES = np.array([0.6, 0.4, -0.4]) + np.random.default_rng(2).uniform(-1, 1, (10, 3)) * [0.1, 0.1, 0.2]
WORK_WITHIN, TWIST_WITHIN = 1e-11, 1e-10  # of 1 to 10 N, N m


def legs(x):
    """For each leg: corner C, elbow B, angles of crank and rod, with mpmath numbers."""
    px, py, turn = (mp.mpf(v) for v in x)
    c, s = mp.cos(turn), mp.sin(turn)
    found = []
    for (ax, ay), corner in zip(MOTORS, CORNERS, strict=True):
        kx, ky = map(mp.mpf, corner)
        cx, cy = px + c * kx - s * ky, py + s * kx + c * ky
        reach = mp.hypot(cx - ax, cy - ay)
        crank = mp.atan2(cy - ay, cx - ax) + MODE * mp.acos(reach / (2 * LENGTH))
        bx, by = ax + LENGTH * mp.cos(crank), ay + LENGTH * mp.sin(crank)
        found.append(((cx, cy), (bx, by), crank, mp.atan2(cy - by, cx - bx)))
    return found


def matrices(x):
    """A and B of A v = B dq: rods of constant length, row by row."""
    A, B = np.zeros((3, 3)), np.zeros((3, 3))
    for i, ((cx, cy), _, crank, rod) in enumerate(legs(x)):
        ux, uy = mp.cos(rod), mp.sin(rod)
        A[i] = [ux, uy, (cx - x[0]) * uy - (cy - x[1]) * ux]
        B[i, i] = LENGTH * mp.sin(rod - crank)
    return A, B


def meeting_point(x):
    """Where the lines of the first two rods meet."""
    (c1, b1, *_), (c2, b2, *_), _ = legs(x)
    d1, d2 = (c1[0] - b1[0], c1[1] - b1[1]), (c2[0] - b2[0], c2[1] - b2[1])
    across = d1[0] * d2[1] - d1[1] * d2[0]
    along = ((b2[0] - b1[0]) * d2[1] - (b2[1] - b1[1]) * d2[0]) / across
    return b1[0] + along * d1[0], b1[1] + along * d1[1]


def closed_form_crossing(path):
    """s where the third rod passes through the point in which the first two meet."""

    def gap(s):
        px, py = meeting_point(path(s))
        (cx, cy), (bx, by), *_ = legs(path(s))[2]
        return float((cx - bx) * (py - by) - (cy - by) * (px - bx))

    return brentq(gap, 0.1, 0.99, xtol=1e-15, rtol=1e-14)


def bodies(x):
    """Inertia and coordinate of every moving part: kinetic energy is the sum of 0.5 m dy^2."""
    x = [mp.mpf(v) for v in x]
    parts = [(PLATFORM, x[0]), (PLATFORM, x[1]), (PLATFORM_ABOUT_CENTRE, x[2])]
    for (cx, cy), (bx, by), crank, rod in legs(x):
        parts += [(CRANK_ABOUT_MOTOR + GEAR**2 * ROTOR, crank), (ROD_ABOUT_CENTRE, rod)]
        parts += [(ROD, (bx + cx) / 2), (ROD, (by + cy) / 2)]
    return parts


def test_inverse_kinematics_of_all_joints(robot):
    rng = np.random.default_rng(1)
    for x in np.array([0.6, 0.4, -0.5]) + rng.uniform(-1, 1, (20, 3)) * [0.12, 0.12, 0.4]:
        q = dict(zip(list(robot.model.names)[1:], assemble(robot, x).q, strict=True))
        for i, (_, _, crank, rod) in enumerate(legs(x), start=1):
            turned = [q[f"motor_{i}"] - crank, q[f"motor_{i}"] + q[f"elbow_{i}"] - rod]
            np.testing.assert_allclose([float(mp.sin(t / 2)) for t in turned], 0, atol=1e-12)
        assert q["motor_1"] + q["elbow_1"] + q["wrist_1"] == pytest.approx(x[2], abs=1e-12)
