"""The four-bar linkage against its loop equation solved in closed form, and against Lagrange in 60 digits."""

import mpmath as mp
import numpy as np
import pytest
from scipy.optimize import brentq

import robots
from framework import assemble, locate_singularities, velocity_matrices
from framework.planning.scenes import scene_path
from tests.oracles.one_degree import OneDegree

GROUND, CRANK, COUPLER, ROCKER = 0.1, 0.04, 0.12, 0.08  # [m], Norton, Design of Machinery, Example 4-1
CROSSED = "dead_point"
NEAR, STIFFNESS = 0.42, 400  # [rad], [N m/rad] of the elastic drive
SCENE = {"ends": (1.4, -0.4), "duration": 1.0, "time": 0.53, "speed": 1.6}


def rocker_angle(crank):
    """Angle of the rocker of the open circuit: where two circles meet [rad]."""
    m = mp if isinstance(crank, mp.mpf) else np
    x, y = GROUND - CRANK * m.cos(crank), -CRANK * m.sin(crank)  # from the crank's pin to D
    reach = m.sqrt(x * x + y * y)
    # angle at D between the way back to the pin and the rocker, by the law of cosines
    apex = m.acos((reach**2 + ROCKER**2 - COUPLER**2) / (2 * reach * ROCKER))
    back = m.atan2(-y, -x) if m is mp else np.arctan2(-y, -x)
    return back - apex


def coupler_angle(crank):
    """Angle of the coupler [rad]."""
    m = mp if isinstance(crank, mp.mpf) else np
    rocker = rocker_angle(crank)
    x = GROUND + ROCKER * m.cos(rocker) - CRANK * m.cos(crank)
    y = ROCKER * m.sin(rocker) - CRANK * m.sin(crank)
    return m.atan2(y, x) if m is mp else np.arctan2(y, x)


def linkage() -> OneDegree:
    """Masses as in the URDF: bars with their centres of mass on their axes."""

    def heights(x):
        coupler, rocker = coupler_angle(x), rocker_angle(x)
        return mp.mpf(0.001) * mp.sin(x), CRANK * mp.sin(x) + 0.06 * mp.sin(coupler), 0.045 * mp.sin(rocker)

    def inertia(x):
        coupler, rocker = coupler_angle(x), rocker_angle(x)
        # velocity loop: a x' e(x) + b c' e(c) = r p' e(p), each rate over x'
        dc = CRANK * mp.sin(rocker - x) / (COUPLER * mp.sin(coupler - rocker))
        dp = CRANK * mp.sin(coupler - x) / (ROCKER * mp.sin(coupler - rocker))
        centre = CRANK**2 + (0.06 * dc) ** 2 + 2 * CRANK * 0.06 * dc * mp.cos(coupler - x)
        crank = mp.mpf(0.0082) + mp.mpf(2.05) * mp.mpf(0.001) ** 2
        return crank + 0.12 * centre + mp.mpf(1.5e-4) * dc**2 + (mp.mpf(1.2e-4) + 0.2 * 0.045**2) * dp**2

    def potential(x):
        return mp.mpf(9.81) * sum(m * y for m, y in zip((2.05, 0.12, 0.2), heights(x), strict=True))

    return OneDegree(rocker_angle, inertia, potential, mp.mpf(20), mp.mpf(5e-6))


def dead_points() -> tuple[float, float]:
    """Crank angles with crank and coupler aligned, stretched and folded: triangles with b + a and b - a."""
    triangles = [COUPLER + CRANK, COUPLER - CRANK]
    stretched, folded = (np.arccos((GROUND**2 + r**2 - ROCKER**2) / (2 * GROUND * r)) for r in triangles)
    return stretched, folded - np.pi


def test_the_textbook_example():
    # Norton's printed answers for a crank at 40 degrees, open circuit; his rounding shows in the last digit
    q = assemble(robots.load("four_bar"), [np.radians(40)]).q
    assert np.degrees(q[0] + q[1]) == pytest.approx(20.30, abs=0.01)
    assert np.degrees(q[2]) == pytest.approx(57.33, abs=0.01)


@pytest.mark.parametrize("crank", np.random.default_rng(1).uniform(-4.8, 1.4, 5))
def test_inverse_kinematics_and_A_B_agree_with_closed_forms(crank):
    robot = robots.load("four_bar")
    q = assemble(robot, [crank]).q
    turns = 2 * np.pi * np.round((q[2] - rocker_angle(crank)) / (2 * np.pi))
    assert q[2] == pytest.approx(rocker_angle(crank) + turns, abs=1e-12)
    ours = velocity_matrices(robot, q)
    coupler, rocker = q[0] + q[1], q[2]
    A, B = CRANK * np.sin(coupler - crank), ROCKER * np.sin(coupler - rocker)  # A x' = B q'
    assert ours.A[0, 0] * B == pytest.approx(A * ours.B[0, 0], abs=1e-12)


def test_dead_points_have_their_closed_form():
    robot = robots.load("four_bar")
    path = scene_path(robot.description.scenes["full_turn"])
    points = locate_singularities(robot, path)
    expected = [(1.4 - dead) / (2 * np.pi) for dead in dead_points()]
    np.testing.assert_allclose([point.s for point in points], expected, rtol=0, atol=1e-12)
    for point in points:
        assert (point.kind, point.contact, point.corank) == ("type_2", "transversal", 1)
        np.testing.assert_allclose(point.twist, [-1.0])  # all of the platform's one motion

    def aligned(s):
        crank = 1.4 - 1.8 * s
        return np.sin(coupler_angle(crank) - crank)

    (point,) = locate_singularities(robot, scene_path(robot.description.scenes["dead_point"]))
    assert point.s == pytest.approx(brentq(aligned, 0.4, 0.7, xtol=1e-15), abs=1e-12)
    assert not locate_singularities(robot, scene_path(robot.description.scenes["clear"]))
