"""Singular points move with the deflections at the rate that `locate` tells."""

from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import Arc, Line, ParallelRobot, locate_singularities, plan_scene, track_path
from framework.planning.scenes import scene_path
from framework.singularity.points_on_path import spring_shift
from tests.robots.every_robot import KINDS

PATH = Line([0.1, 0.345], [-0.05, 0.195])


def shifts(robot: ParallelRobot, path) -> list[np.ndarray]:
    branch = track_path(robot, path)
    return [spring_shift(branch, point) for point in locate_singularities(robot, path, branch=branch)]


@pytest.mark.parametrize("rod", ["left_rod", "right_rod"])
def test_a_stretched_spring_moves_the_point_as_a_longer_rod_does(write_robot, rod):
    robot = robots.load("five_bar", flexibility="flexible_links")
    (rates,) = shifts(robot, PATH)

    def singular(length: float) -> float:
        """s of the rigid robot whose rod has this length [m]."""
        tip = f'<child link="{rod.split("_")[0]}_tip"/>\n    <origin xyz="{{}} 0 0"'
        file = write_robot(urdf=((tip.format("0.25"), tip.format(length)),))
        (point,) = locate_singularities(ParallelRobot.from_file(file), PATH)
        return point.s

    step = 1e-4
    slope = (singular(0.25 + step) - singular(0.25 - step)) / (2 * step)
    # the central difference of s is exact to the square of its step
    assert rates[robot.elastic_names.index(rod)] == pytest.approx(slope, rel=1e-5)


@pytest.mark.parametrize("name", KINDS)
def test_a_spring_behind_a_motor_moves_no_singular_point(name):
    """The motor makes up for it: motor and spring turn about one axis, and the pose is the same."""
    robot = robots.load(name, flexibility="flexible_joints")
    behind = {spring.name for spring in robot.description.springs if not spring.motion}
    for scene in robot.description.scenes.values():
        for rates in shifts(robot, scene_path(scene)):
            for spring, rate in zip(robot.elastic_names, rates, strict=True):
                assert rate == 0.0 or np.isnan(rate) or spring not in behind


@pytest.mark.parametrize(
    ("name", "scene"),
    [
        ("five_bar", "C"),
        ("four_bar", "dead_point"),
        ("biglide", "bow"),
        ("three_rrr", "crossing"),
        pytest.param("delta", "cross", marks=pytest.mark.slow),
    ],
)
def test_the_crossing_of_the_deformed_robot_is_where_its_deflections_move_it(name, scene):
    robot = robots.load(name, flexibility="flexible_links")
    plan = plan_scene(robot, scene, geometry="deformed")
    path = scene_path(robot.description.scenes[scene])
    for point, rates, crossing in zip(
        locate_singularities(robot, path), shifts(robot, path), plan.crossings, strict=True
    ):
        moved, deflection = crossing.s - point.s, plan.deflection(crossing.time).ravel()
        assert abs(moved) > 1e-7
        # the rate is exact to first order; deflections are some 1e-4 of the robot
        assert rates @ deflection == pytest.approx(moved, rel=2e-3)


def test_a_touch_is_not_moved_by_a_deflection():
    robot = robots.load("five_bar", flexibility="flexible_links")
    top = np.sqrt(0.06)  # both rods in one line at (0, top), where the locus is horizontal
    touch = Arc([0.08, top + 0.05], [0.0, top], [-0.08, top + 0.05])
    assert [point.contact for point in locate_singularities(robot, touch)] == ["tangential"]
    (rates,) = shifts(robot, touch)
    assert np.isnan(rates).all()


def test_a_rigid_robot_has_no_springs_to_move_it():
    assert [rates.shape for rates in shifts(robots.load("five_bar"), PATH)] == [(0,)]


def test_where_several_motions_escape_no_derivative_is_told():
    robot = robots.load("gough_stewart", flexibility="flexible_joints")
    start = np.array([0.1, 0.05, 1.0, 0.2, 0.1, 0.0])  # to the opposite pose, through the flat one
    (shift,) = shifts(robot, Line(start, -start))
    assert np.isnan(shift).all()
    branch = track_path(robots.load("five_bar", flexibility="flexible_links"), PATH)
    (point,) = locate_singularities(branch.robot, PATH, branch=branch)
    assert np.isfinite(spring_shift(branch, point)).all()
    assert np.isnan(spring_shift(branch, replace(point, corank=2))).all()
