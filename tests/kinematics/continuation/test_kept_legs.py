"""Paths on which two legs come near the poses where they are stretched or folded at once, and turn back.

Two legs that flip together keep the sign of det [dF/dq]. Witnesses are closed forms of each leg.
"""

import numpy as np
import pytest
from scipy.optimize import brentq, least_squares

import robots
from framework import Spline, track_path
from tests.robots import test_delta as delta_form
from tests.robots import test_gough_stewart as gough_form

DISTANCES = [3e-3, 1e-5, 1e-9]  # [m] between the turn and the point where both are stretched
S = np.linspace(0.0, 1.0, 101)


def turn_back(robot, apex, away, distance):
    """Poses on a path towards `apex` that turns back at a distance [m]."""
    apex, away = np.asarray(apex), np.asarray(away)
    path = Spline([apex + 0.05 * away, apex + distance * away, apex + 0.05 * away])
    return track_path(robot, path).close(S)


def joint_sines(robot, q, names):
    columns = [k for k in range(robot.nv) if robot.coordinates.name_of(k) in names]
    return np.sin(robot.coordinates.positions(q)[:, columns])


@pytest.mark.parametrize("distance", DISTANCES)
@pytest.mark.parametrize(
    ("name", "apex", "elbows"),
    [
        # cranks and rods of 0.25 m, motors 0.4 m apart
        ("five_bar", [0.0, np.sqrt(0.5**2 - 0.2**2)], ["left_elbow", "right_elbow"]),
        # cranks and rods of 0.6 m, motors 1.2 m apart, corners 0.1856 m apart and 0.0535 m below the centre
        ("three_rrr", [0.6, np.sqrt(1.2**2 - (0.6 - 0.0928) ** 2) + 0.0535, 0.0], ["elbow_1", "elbow_2"]),
    ],
)
def test_two_stretched_elbows_keep_their_sides(name, apex, elbows, distance):
    robot = robots.load(name)
    away = -np.eye(robot.n)[1]
    sines = joint_sines(robot, turn_back(robot, apex, away, distance).q, elbows)
    start = joint_sines(robot, robot.reference.q[None], elbows)
    np.testing.assert_array_equal(np.sign(sines), np.broadcast_to(np.sign(start), sines.shape))


@pytest.mark.parametrize("distance", DISTANCES)
def test_two_stretched_arms_of_a_delta_keep_their_sides(distance):
    """Its legs are one block of the equations: no sign of a determinant tells two flips from none."""
    robot, form = robots.load("delta"), delta_form.ARMS

    def slack(z):
        """Length that arm and rod of legs 2 and 3 have left at (0.3, 0, z) [m]."""
        p = np.array([0.3, 0.0, z])
        reach = np.hypot(form.out[1] @ p - form.reach, z)
        return form.arm + np.sqrt(form.rod**2 - (form.side[1] @ p) ** 2) - reach

    apex = [0.3, 0.0, brentq(slack, -1.8, -1.2, xtol=1e-15)]
    poses = turn_back(robot, apex, [0.0, 0.0, 1.0], distance)
    expected = np.array([delta_form.DELTA.motor_angles(x) for x in poses.x])
    turns = robot.actuated_coordinates(poses.q) - expected
    # sqrt(distance) of the fold from a pose that rounding moves by 1e-15 m
    assert np.abs((turns + np.pi) % (2 * np.pi) - np.pi).max() < 1e-14 / np.sqrt(distance) + 1e-12


@pytest.mark.parametrize("distance", DISTANCES[:-1])
def test_two_legs_beside_their_universal_joints_keep_their_tilts(distance):
    """A leg along the first axis of its universal joint may turn about it, and pass on to the other tilt."""
    robot = robots.load("gough_stewart")
    start = np.array([2.6, -0.75, 0.26, -0.05, 0.42, 0.22])  # legs 1 and 2 nearly along their first axes

    def off_axis(x):
        leg = gough_form.legs(x).real[:2]
        leg /= np.linalg.norm(leg, axis=1)[:, None]
        across = np.stack([gough_form.Y[:2], gough_form.Z[:2]])
        return np.append(np.sum(leg * across, axis=2), 1e-9 * (x - start))

    apex = least_squares(off_axis, start, xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    poses = turn_back(robot, apex, [0.3, -0.2, 1.0, 0.1, 0.05, 0.2], distance)
    names = [f"leg_{k}_tilt" for k in range(1, 7)]
    columns = [k for k in range(robot.nv) if robot.coordinates.name_of(k) in names]
    assert np.cos(robot.coordinates.positions(poses.q)[:, columns]).min() > 0.0
