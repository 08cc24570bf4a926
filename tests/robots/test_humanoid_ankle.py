"""The two-motor ankle against its closed form: where a crank's circle meets the sphere of its rod.

The foot stands at R = Ry(pitch) Rx(roll). With d from the motor to the ball on the foot, L and l the lengths
of crank and rod, its tip at L (cos q, 0, -sin q):

    d_x cos q - d_z sin q = (L^2 + d.d - l^2) / 2 L.

Derivatives by complex steps.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from framework import (
    InvalidInput,
    Line,
    ParallelRobot,
    assemble,
    dynamics_at,
    forward_kinematics,
    locate_singularities,
    plan_scene,
    velocity_matrices,
)
from framework.atlas.survey import survey_window
from framework.atlas.workspace_map import restrict_to_ranges, workspace_map
from framework.kinematics.frames import frames_at
from framework.model.description import Platform
from tests.oracles.closed_form import Kinematics
from tests.robots.every_robot import assert_same_torques

ROBOT = "humanoid_ankle"
CRANK, RODS, GEAR = 0.043, (0.18, 0.12), 18
MOTORS = np.array([[-0.014, 0.02775, -0.096], [-0.014, -0.02775, -0.156]])
BALLS = np.array([[-0.0415, 0.0275, 0.0327], [-0.0415, -0.0275, 0.0327]])
ANKLE, CROSS = np.array([0, 0, -0.28]), np.array([0, 0.00025, -0.012])


def about_y(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0 * c, s], [0 * c, 1 + 0 * c, 0 * c], [-s, 0 * c, c]])


def about_x(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1 + 0 * c, 0 * c, 0 * c], [0 * c, c, -s], [0 * c, s, c]])


def foot(x, point):
    """Where a point of the foot is for x = (pitch, roll); complex ones too."""
    return ANKLE + about_y(x[0]) @ (CROSS + about_x(x[1]) @ point)


def cranks(x):
    """Angles (2,) of the cranks, forward of the line from motor to ball."""
    angles = []
    for motor, ball, rod in zip(MOTORS, BALLS, RODS, strict=True):
        d = foot(x, ball) - motor
        reach = np.sqrt(d[0] ** 2 + d[2] ** 2)
        along = np.arctan2(-d[2].real, d[0].real) + 0j
        # to first order in the imaginary parts, which is all that a complex step asks for
        along += 1j * (-d[0].real * d[2].imag + d[2].real * d[0].imag) / abs(reach) ** 2
        angles.append(along - np.arccos((CRANK**2 + d @ d - rod**2) / (2 * CRANK * reach)))
    return np.array(angles)


def derivative(function, x):
    h = 1e-30
    return np.stack([np.imag(function(x + 1j * h * axis)) / h for axis in np.eye(2)], axis=-1)


def poses(count):
    return np.random.default_rng(1).uniform([-0.87, -0.44], [0.35, 0.44], (count, 2))


KINEMATICS = Kinematics(poses(20), lambda x: cranks(x).real, lambda x: derivative(cranks, x), 1e-12, 1e-11)


def test_the_foot_has_its_closed_form_and_the_cranks_lead_back_to_it(robot):
    for x in poses(20):
        q = assemble(robot, x).q
        at = frames_at(robot, q[None])
        np.testing.assert_allclose(at.rotation[0, 0], about_y(x[0]) @ about_x(x[1]), atol=1e-13)
        back = forward_kinematics(robot, cranks(x).real, near=robot.reference.q)
        np.testing.assert_allclose(back.x, x, atol=1e-11)


def test_the_motors_hold_what_stands_on_the_toes_by_virtual_work(robot):
    """A force of the ground on a point of the foot: its power is that of the motors."""
    toes, force = np.array([0.11, 0.02, -0.0432]), np.array([20.0, -10.0, 300.0])
    for x in poses(4):
        q = assemble(robot, x).q
        arm = about_y(x[0]) @ about_x(x[1]) @ toes
        wrench = [*force, *np.cross(arm, force)]
        loaded = dynamics_at(robot, q, wrenches={"foot": wrench}).torque - dynamics_at(robot, q).torque
        pushed = derivative(lambda at: foot(at, toes), x).T @ force
        expected = -np.linalg.solve(derivative(cranks, x).T, pushed) / GEAR
        np.testing.assert_allclose(loaded, expected, rtol=1e-10)


RANGES = np.array([[-0.87, 0.35], [-0.44, 0.44]])  # [rad] of pitch and roll
MOTOR_RANGES = {
    "as the file has them": [[-0.8187, 1.0228], [-0.6454, 1.0973]],
    "narrow": [[-0.2, 0.25], [-0.5, 0.6]],
}


@pytest.mark.parametrize("ranges", MOTOR_RANGES.values(), ids=MOTOR_RANGES.keys())
def test_what_it_reaches_within_its_ranges_has_a_closed_form(robot, ranges):
    """Pitch and roll within theirs, and the cranks within theirs, in one piece with the reference."""
    urdf = robot.description.urdf_text
    for (lower, upper), (least, largest) in zip(MOTOR_RANGES["as the file has them"], ranges, strict=True):
        urdf = urdf.replace(f'lower="{lower}" upper="{upper}"', f'lower="{least}" upper="{largest}"')
    narrowed = ParallelRobot.from_description(replace(robot.description, urdf_text=urdf))
    names = [limit.joint for limit in narrowed.limits]
    window = survey_window(narrowed, size=23, keep_limits=True)
    with pytest.raises(InvalidInput, match="quantity holding"):  # without it the motors' limits are unknown
        restrict_to_ranges(workspace_map(narrowed, replace(window, shape=(3, 3))))
    everything = workspace_map(narrowed, window, ["holding"])
    within = restrict_to_ranges(everything)
    x = everything.window.points()
    motors = np.array([[cranks(pose).real for pose in row] for row in x])
    limits = np.concatenate([RANGES, ranges])
    place = np.concatenate([x, motors], axis=-1)
    beyond = np.maximum(limits[:, 0] - place, place - limits[:, 1]) / (limits[:, 1] - limits[:, 0])
    assert everything.reached.all()
    assert (within.keeps_limits, everything.keeps_limits) == (True, False)
    assert 0.15 * x[..., 0].size < within.reached.sum() < everything.reached.sum()
    np.testing.assert_array_equal(within.reached, (beyond <= 0).all(axis=-1))
    joints = ("ankle_pitch", "ankle_roll", "motor_a", "motor_b")
    for i, j in np.argwhere(~within.reached):
        word = within.reason_words[within.reason[i, j]]
        assert word == f"beyond the range of {joints[np.argmax(beyond[i, j])]}"
    assert set(joints) <= set(names)
    assert np.isnan(within.values["g"][~within.reached]).all()
    assert sum(within.counts.values()) == within.reached.size


def test_what_its_motors_hold_within_their_limits_has_a_closed_form(robot):
    """A moment about the axes of pitch and roll, by virtual work, beside the weight of the foot."""
    moment, limit = np.array([35.0, 10.0]), 2.3889  # [N m]
    window = survey_window(robot, size=13, keep_limits=True)
    everything = workspace_map(robot, window, ["holding"], wrench=moment)
    within, share = restrict_to_ranges(everything), everything.values["holding"]
    for i, j in np.argwhere(everything.reached)[::5]:
        weight = dynamics_at(robot, everything.q[i, j]).torque
        slope = derivative(cranks, window.points()[i, j])
        torque = weight - np.linalg.solve(slope.T, moment) / GEAR
        assert share[i, j] == pytest.approx(np.abs(torque).max() / limit, rel=1e-10)
    weak = within.reason == within.reason_words.index("beyond the torque limits at rest")
    in_range = ~np.char.startswith(np.array(within.reason_words)[within.reason], "beyond the range")
    np.testing.assert_array_equal(weak, in_range & (share > 1.0))
    assert 0 < weak.sum() < within.reached.sum()


def test_pitch_and_roll_of_the_cross_are_the_two_angles_of_the_foot(robot):
    """R = Ry Rx: the joints, and the axes [ry, rx] of the foot, are the same platform."""
    description = replace(robot.description, platform=Platform("foot", ("ry", "rx")))
    angles = ParallelRobot.from_description(description)
    for x in poses(3):
        one, two = assemble(robot, x).q, assemble(angles, x).q
        np.testing.assert_allclose(two, one, atol=1e-13)
        ours, theirs = (velocity_matrices(which, one) for which in (robot, angles))
        np.testing.assert_allclose(
            np.linalg.solve(theirs.B, theirs.A), np.linalg.solve(ours.B, ours.A), atol=1e-11
        )
    assert_same_torques(plan_scene(robot, "swing"), plan_scene(angles, "swing"), within=1e-10)


def test_its_type_2_singularity_lies_beyond_the_range_of_its_joints(robot):
    path = Line([0.9, 0.0], [1.2, 0.0])
    (point,) = locate_singularities(robot, path)
    exact = brentq(lambda s: np.linalg.det(derivative(cranks, path(s))), 0.3, 0.8, xtol=1e-14)
    assert (point.kind, point.corank) == ("type_2", 1)
    assert point.s == pytest.approx(exact, abs=1e-10)  # the root of a determinant of differences
    # the corners of the range are free of it, and all poses between them
    inside = [np.linalg.det(derivative(cranks, x)) for x in poses(400)]
    assert max(inside) < -0.1
