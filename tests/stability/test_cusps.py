"""Cusps of the singular curve: the planar 3-RPR of Innocenti and Parenti-Castelli.

What goes wrong: (a) "the determinant kept its sign, so the assembly mode is the same, so the motors say where
the platform is": around a cusp the platform goes from one answer of the forward kinematics to another without
any singularity, and a program that knows the lengths of the legs alone takes it to be where it was. (b) On a
cusp three answers are one: lengths wrong by d move the platform by d^(1/3), a rounding of 1e-16 by 1e-5.
Why: the map from platform to motors is folded, and at a cusp the fold is folded.
What we do: positions come from the path by inverse kinematics, which is regular at cusps and on folds.
Source of robot and lengths: Innocenti and Parenti-Castelli 1998, after Zein, Wenger and Chablat, Robotica
25, 2007.
"""

from functools import cache

import mpmath
import numpy as np
import pytest

import robots
from framework import Line, Spline, assemble, locate_singularities, plan_crossing
from tests.oracles import naive
from tests.robots.test_three_rpr import legs, line_matrix, meeting_point

LENGTHS = np.array([14.98, 15.38, 12.0]) * 0.05  # [m] of the legs
NEAR = np.array([[-0.745, 0.079, 0.245], [0.734, -0.151, 2.133]])  # two of the six poses, to three digits
VIA = [0.172, -0.3, 1.093]  # on a way between them that avoids all singularities
TURN = 1.0  # [rad] of the platform at the cusp
NEAR_CUSP = (-0.189, -0.319)  # [m], to three digits


def lengths(x) -> list:
    return [leg[2] for leg in legs(x)]


def pose_of(target, guess) -> np.ndarray:
    """Forward kinematics by Newton's method from a guess, in double precision."""
    with mpmath.workdps(15):
        return naive.newton(lambda x: np.array(lengths(x), dtype=float) - target, line_matrix, guess)


@cache
def poses() -> np.ndarray:
    """Both poses (2, 3) to rounding."""
    return np.array([pose_of(LENGTHS, near) for near in NEAR])


@cache
def around() -> Spline:
    return Spline([poses()[0], VIA, poses()[1]])


def confusion() -> tuple[float, float, float]:
    """What legs of equal lengths hide: largest difference of the lengths [m], distance of the poses [m], and
    how far from the true end a program is that goes by lengths and stays near the start [m]."""
    first, second = poses()
    difference = np.abs(np.array(lengths(first), dtype=float) - np.array(lengths(second), dtype=float)).max()
    by_lengths = pose_of(np.array(lengths(second), dtype=float), first)
    return (
        float(difference),
        float(np.linalg.norm((second - first)[:2])),
        float(np.linalg.norm((second - by_lengths)[:2])),
    )


def gap(pose):
    """Distance of the third leg's line from the meeting point of the others [m]: zero on the locus."""
    px, py = meeting_point(pose)
    _, (ux, uy), *_ = legs(pose)[2]
    return ux * (py - mpmath.mpf("0.5")) - uy * px


def free_twist(pose):
    """A turn about the meeting point of the legs' lines: t_s, not scaled."""
    px, py = meeting_point(pose)
    return py - pose[1], pose[0] - px, mpmath.mpf(1)


@cache
def cusp() -> np.ndarray:
    """A pose (3,) on the locus whose t_s is tangent to the locus, to rounding."""

    def equations(x, y):
        pose, h = (x, y, mpmath.mpf(TURN)), mpmath.mpf(10) ** -15
        moved = [[a + side * h * b for a, b in zip(pose, free_twist(pose), strict=True)] for side in (1, -1)]
        return [gap(pose), (gap(moved[0]) - gap(moved[1])) / (2 * h)]

    with mpmath.workdps(50):
        x, y = mpmath.findroot(equations, NEAR_CUSP, tol=1e-40)
        return np.array([float(x), float(y), TURN])


def shift(error: float) -> float:
    """How far the platform is [m] from the cusp when the legs are longer by `error` [m]; fifty digits."""
    with mpmath.workdps(50):
        at = [mpmath.mpf(float(v)) for v in cusp()]
        wanted = [length + mpmath.mpf(error) for length in lengths(at)]
        size = mpmath.cbrt(mpmath.mpf(error))
        for side in (1, -1, 3, -3):
            start = [a + side * size * b for a, b in zip(at, free_twist(at), strict=True)]
            try:
                found = mpmath.findroot(
                    lambda *x: [a - b for a, b in zip(lengths(x), wanted, strict=True)], start, maxsteps=60
                )
            except (ValueError, ZeroDivisionError):
                continue
            return float(mpmath.hypot(found[0] - at[0], found[1] - at[1]))
    raise ArithmeticError("no pose near the cusp")


def lengths_off(error: float) -> float:
    """Largest change [m] of a length when the platform is off the cusp by `error` [m]."""
    with mpmath.workdps(50):
        at = [mpmath.mpf(float(v)) for v in cusp()]
        exact, e = lengths(at), mpmath.mpf(error)
        moved = [lengths([at[0] + e * mpmath.cos(a), at[1] + e * mpmath.sin(a), at[2]]) for a in range(7)]
        return float(max(abs(p - q) for row in moved for p, q in zip(row, exact, strict=True)))


def through_the_cusp() -> Line:
    """A path across the locus that moves along t_s as well."""
    at, h = cusp(), 1e-6
    slope = np.array([float(gap(at + h * unit) - gap(at - h * unit)) / (2 * h) for unit in np.eye(3)])
    twist = np.array(free_twist(at), dtype=float)
    direction = slope / np.linalg.norm(slope) + 0.5 * twist / np.linalg.norm(twist)
    return Line(at - 0.1 * direction, at + 0.1 * direction)


def test_our_path_leads_around_the_cusp_with_finite_torques():
    plan = plan_crossing(robots.load("three_rpr"), around(), duration=2.0)
    assert plan.crossings == ()
    assert plan.certificate.tail < 1e-10
    turned = plan.motor_angle(2.0) - plan.motor_angle(0.0)  # [rad] of screws that turn 314 rad/m
    assert np.abs(turned).max() < 1e-10
    np.testing.assert_allclose(plan.platform(2.0), poses()[1], rtol=0, atol=1e-14)


def test_a_path_through_the_cusp_is_planned():
    robot, path = robots.load("three_rpr"), through_the_cusp()
    motors = assemble(robot, cusp()).q[robot.actuated]
    np.testing.assert_allclose(motors, np.array(lengths(cusp()), dtype=float), rtol=0, atol=1e-14)
    near = min(locate_singularities(robot, path), key=lambda point: abs(point.s - 0.5))
    assert near.s == pytest.approx(0.5, abs=1e-11)
    plan = plan_crossing(robot, path, duration=1.5)
    assert plan.certificate.tail < 1e-10
    assert max(crossing.residual for crossing in plan.crossings) < 1e-11
