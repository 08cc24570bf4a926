"""What is drawn of the motors' forces: held against the legs, which carry them, and against t_s."""

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework.dynamics.platform_wrench import action_lines
from framework.show.scene import force_edges, why_no_figure
from framework.show.shapes import body_shapes, motor_shapes
from tests.browser.pages import filmed

# Where each leg begins and ends; legs without mass or their own load carry forces along themselves alone.
LEGS = {
    ("gough_stewart", "turn"): [
        (f"leg_{k}_swing", "ball_x" if k == 1 else f"leg_{k}_tip") for k in range(1, 7)
    ],
    ("three_rpr", "crossing"): [("pivot_1", "wrist_1"), ("pivot_2", "tip_2"), ("pivot_3", "tip_3")],
    ("delta", "cross"): [("swing_1b", "tip_1b"), ("swing_2b", "tip_2b"), ("swing_3b", "tip_3b")],
    ("five_bar", "bow"): [("left_elbow", "left_tip"), ("right_elbow", "right_tip")],
}


@pytest.mark.parametrize(("name", "scene"), LEGS)
def test_the_lines_of_the_forces_run_along_the_legs(name, scene):
    film = filmed(name, scene)
    robot = film.robot
    lines = action_lines(robot, film.motors.motor_speed)
    model, data = robot.model, robot.model.createData()
    for frame in (0, 200, len(film.time) - 1):
        pin.framesForwardKinematics(model, data, film.q[frame])
        origin = data.oMf[robot.frames[0]].translation
        for k, ends in enumerate(LEGS[name, scene]):
            start, end = (data.oMf[model.getFrameId(end)].translation for end in ends)
            leg = (end - start) / np.linalg.norm(end - start)
            way = lines.direction[frame, k]
            assert abs(leg @ way) == pytest.approx(1.0, abs=1e-9)
            if robot.platform.translations.all():  # the platform does not turn: through its origin
                np.testing.assert_allclose(lines.point[frame, k], 0.0, atol=1e-12)
            else:
                off = np.cross(start - origin - lines.point[frame, k], leg)
                off = off if robot.n == 6 else off @ [0.0, 0.0, 1.0]  # height is no matter in the plane
                assert np.abs(off).max() < 1e-9 * robot.length


@pytest.mark.parametrize("name", ["four_bar", "humanoid_ankle"])  # of one motor; turned about its own joints
def test_motors_without_a_line_along_the_axes_of_the_base_have_none(name):
    robot = robots.load(name)
    assert action_lines(robot, np.ones((1, robot.n_a, robot.n))) is None


def test_a_pose_without_torques_leaves_no_lines():
    motor_speed = np.ones((2, 2, 2))
    assert action_lines(robots.load("five_bar"), motor_speed) is not None
    motor_speed[1, 0, 0] = np.nan
    assert action_lines(robots.load("five_bar"), motor_speed) is None


@pytest.mark.parametrize(
    ("name", "scene"), [("delta", "cross"), ("orthoglide", "cross"), ("spherical_rrr", "cross")]
)
def test_what_the_motors_give_is_flat_across_t_s_at_the_singular_instant(name, scene):
    film = filmed(name, scene)
    sides = force_edges(film.robot, film.motors.motor_speed, np.ones(3))
    volume = np.abs(np.linalg.det(sides)) / np.prod(np.linalg.norm(sides, axis=2), axis=1)
    k = int(np.argmin(np.abs(film.time - film.instants[0].time)))
    assert volume[k] < 1e-9
    assert volume.max() > 1e-3
    assert np.abs(sides[k] @ film.t_s[k]).max() < 1e-9 * np.abs(sides[k]).max() * np.linalg.norm(film.t_s[k])


@pytest.mark.parametrize("name", robots.CATALOGUE)
def test_a_figure_of_the_forces_is_drawn_or_it_is_said_why_not(name):
    robot = robots.load(name)
    speeds = np.random.default_rng(5).normal(size=(2, robot.n_a, robot.n))
    sides = force_edges(robot, speeds, np.ones(robot.n_a))
    assert (sides is None) == (robot.n == 1 or bool(why_no_figure(robot)))
    assert robot.n_a == 1 or sides is not None or "drawn" in why_no_figure(robot)


@pytest.mark.parametrize("name", ["gough_stewart", "three_rpr", "three_upu"])
def test_a_motor_of_a_leg_that_stretches_is_a_drum_about_its_tube(name):
    robot = robots.load(name)
    bodies = body_shapes(robot)
    for shape, column in zip(motor_shapes(robot, bodies), robot.actuated, strict=True):
        joint = next(j for j in range(robot.model.njoints) if robot.model.joints[j].idx_v == column)
        assert shape.node == robot.model.parents[joint]
        assert shape.kind == "cylinder"
        tubes = [body.size[0] for body in bodies if body.node == shape.node and body.kind == "cylinder"]
        assert shape.size[0] > max(tubes, default=0.0)
