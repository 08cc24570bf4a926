"""The planar 3-RPR against textbook geometry: three lines that meet in a point, or are parallel.

Nothing here is taken from the URDF but its numbers. Derivatives of the closed forms are taken with fifty
digits, so that they cost no accuracy.
"""

import mpmath as mp
import numpy as np
import pytest
from scipy.optimize import brentq

from framework import Line, assemble, locate_singularities, plan_crossing
from tests.oracles.planar_work import assert_virtual_work

ROBOT = "three_rpr"


with mp.workdps(50):
    UNIT = mp.mpf("0.05")
    PIVOTS = [(0, 0), (mp.mpf("15.91") * UNIT, 0), (0, 10 * UNIT)]  # A_i
    D12, D23, D31 = (mp.mpf(side) * UNIT for side in ("17.04", "16.54", "20.84"))
    ANGLE = mp.acos((D12**2 + D31**2 - D23**2) / (2 * D12 * D31))  # at B_1, law of cosines
    CORNERS = [(0, 0), (D12, 0), (D31 * mp.cos(ANGLE), D31 * mp.sin(ANGLE))]  # B_i in the platform
    BLOCK, ROD, PLATFORM = mp.mpf("1.5"), mp.mpf(2), mp.mpf(5)  # [kg]
    ROD_LENGTH = mp.mpf("1.2")
    BLOCK_ABOUT_PIVOT = BLOCK * mp.mpf("0.08") ** 2 / 6  # a cube of 80 mm
    ROD_ABOUT_CENTRE = ROD * (3 * mp.mpf("0.012") ** 2 + ROD_LENGTH**2) / 12
    PLATE_ABOUT_CENTRE = PLATFORM * (D12**2 + D23**2 + D31**2) / 36  # a uniform triangle
    GEAR, ROTOR = 2 * mp.pi / mp.mpf("0.02"), mp.mpf("2e-5")  # screws of 20 mm lead
PLACES = np.array([-0.2, 0.3, 0.4]) + np.random.default_rng(2).uniform(-1, 1, (10, 3)) * [0.1, 0.1, 0.2]
WORK_WITHIN, TWIST_WITHIN = 1e-10, 1e-12  # of 10 N, N m


def placed(x, point):
    """A point of the platform at pose x."""
    px, py, turn = x
    c, s = mp.cos(turn), mp.sin(turn)
    return px + c * point[0] - s * point[1], py + s * point[0] + c * point[1]


def legs(x):
    """For each leg: corner B, unit vector from A to B, length, direction angle."""
    x = [mp.mpf(v) for v in x]
    found = []
    for (ax, ay), corner in zip(PIVOTS, CORNERS, strict=True):
        bx, by = placed(x, corner)
        length = mp.hypot(bx - ax, by - ay)
        unit = (bx - ax) / length, (by - ay) / length
        found.append(((bx, by), unit, length, mp.atan2(by - ay, bx - ax)))
    return found


def line_matrix(x):
    """A of A v = d(lengths)/dt: Pluecker coordinates of the leg lines, about the platform's origin."""
    A = np.zeros((3, 3))
    for i, ((bx, by), (ux, uy), *_) in enumerate(legs(x)):
        A[i] = [ux, uy, (bx - x[0]) * uy - (by - x[1]) * ux]
    return A


def matrices(x):
    """A and B of A v = B d(lengths)/dt."""
    return line_matrix(x), np.eye(3)


def meeting_point(x):
    """Where the lines of legs 1 and 2 meet."""
    (_, (ux, uy), *_), (_, (wx, wy), *_), _ = legs(x)
    (ax, ay), (bx, by), _ = PIVOTS
    along = ((bx - ax) * wy - (by - ay) * wx) / (ux * wy - uy * wx)
    return ax + along * ux, ay + along * uy


def closed_form_crossing(path):
    """s where the third line passes through the point in which the first two meet."""

    def gap(s):
        px, py = meeting_point(path(s))
        _, (ux, uy), *_ = legs(path(s))[2]
        ax, ay = PIVOTS[2]
        return float(ux * (py - ay) - uy * (px - ax))

    return brentq(gap, 0.5, 0.7, xtol=1e-15, rtol=1e-14)


def parallel_pose(length):
    """Pose with three parallel legs, the first of this length [m], and the legs' direction angle."""

    def offsets(turn, direction):
        across = -mp.sin(direction), mp.cos(direction)
        gaps = []
        for (ax, ay), corner in zip(PIVOTS[1:], CORNERS[1:], strict=True):
            bx, by = placed((0, 0, turn), corner)
            gaps.append((bx - ax) * across[0] + (by - ay) * across[1])
        return gaps

    with mp.workdps(30):
        turn, direction = mp.findroot(offsets, (mp.mpf("0.0339"), mp.mpf("0.4758")))
        x = [length * mp.cos(direction), length * mp.sin(direction), turn]
        return np.array([float(v) for v in x]), float(direction)


def bodies(x):
    """Inertia and coordinate of every moving part: kinetic energy is the sum of 0.5 m dy^2."""
    x = [mp.mpf(v) for v in x]
    centre = placed(x, [sum(corner[k] for corner in CORNERS) / 3 for k in range(2)])
    parts = [(PLATFORM, centre[0]), (PLATFORM, centre[1]), (PLATE_ABOUT_CENTRE, x[2])]
    for (bx, by), (ux, uy), length, direction in legs(x):
        parts += [(GEAR**2 * ROTOR, length), (BLOCK_ABOUT_PIVOT + ROD_ABOUT_CENTRE, direction)]
        parts += [(ROD, bx - ux * ROD_LENGTH / 2), (ROD, by - uy * ROD_LENGTH / 2)]
    return parts


def test_inverse_kinematics_of_all_joints(robot):
    rng = np.random.default_rng(1)
    for x in np.array([-0.1, 0.35, 0.4]) + rng.uniform(-1, 1, (20, 3)) * [0.2, 0.1, 0.3]:
        q = dict(zip(list(robot.model.names)[1:], assemble(robot, x).q, strict=True))
        for i, (_, _, length, direction) in enumerate(legs(x), start=1):
            assert q[f"motor_{i}"] == pytest.approx(float(length), abs=1e-12)
            assert abs(mp.sin((q[f"pivot_{i}"] - direction) / 2)) < 1e-12
        assert q["pivot_1"] + q["wrist_1"] == pytest.approx(x[2], abs=1e-12)


def test_parallel_legs_leave_the_platform_free_to_slide_across_them(robot):
    x, direction = parallel_pose(0.35)
    step = np.array([-0.06, 0.05, 0.1])
    path = Line(x - step, x + step)
    (point,) = locate_singularities(robot, path)
    assert point.s == pytest.approx(0.5, abs=1e-12)
    assert (point.kind, point.contact, point.corank) == ("type_2", "transversal", 1)
    across = np.array([-np.sin(direction), np.cos(direction), 0.0])  # the meeting point is at infinity
    np.testing.assert_allclose(point.twist, across * np.sign(across @ point.twist), atol=1e-12)
    assert_virtual_work(plan_crossing(robot, path, duration=1.5), bodies, GEAR, WORK_WITHIN)
