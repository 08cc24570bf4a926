"""The sentences in which the catalogue says why a robot is singular, each of them as a calculation.

Only positions of joints and frames are used, at the singular instant of the first scene that crosses: no
Jacobian, and nothing that searches singularities.
"""

from collections.abc import Callable
from functools import cache
from itertools import combinations

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import ParallelRobot
from framework.numerics.arrays import Array
from framework.show.film import Film
from framework.singularity.jogging import move_platform_straight
from tests.show.test_film import filmed

CROSSING = {
    "biglide": "across",
    "bricard": "dead_point",
    "delta": "cross",
    "five_bar": "C",
    "five_bar_heavy": "C",
    "four_bar": "dead_point",
    "gough_stewart": "turn",
    "humanoid_knee": "deep",
    "orthoglide": "cross",
    "par4": "cross",
    "slider_crank": "dead_centre",
    "spherical_rrr": "cross",
    "three_rpr": "crossing",
    "three_rrr": "crossing",
}
SMALL = 1e-7  # the singular instant is known to 1e-12 or so; angles that touch zero lose half the digits


class Standing:
    """A robot at a configuration: where its joints and frames are, and along what its joints turn."""

    def __init__(self, robot: ParallelRobot, q: Array) -> None:
        self.model, self.data = robot.model, robot.model.createData()
        pin.framesForwardKinematics(self.model, self.data, q)

    def at(self, name: str) -> Array:
        return np.array(self.data.oMf[self.model.getFrameId(name)].translation)

    def way(self, start: str, end: str) -> Array:
        between = self.at(end) - self.at(start)
        return np.asarray(between / np.linalg.norm(between))

    def axis(self, joint: str) -> Array:
        """The third axis of a joint's frame: all joints of spherical_rrr turn about theirs."""
        return np.array(self.data.oMi[self.model.getJointId(joint)].rotation[:, 2])


def in_one_line(standing: Standing, *names: str) -> None:
    first, *others = (standing.way(names[0], name) for name in names[1:])
    for other in others:
        assert np.linalg.norm(np.cross(first, other)) < SMALL


def meet_in_one_point(lines: list[tuple[Array, Array]]) -> None:
    """Lines (point, direction) of a plane: their equations n . p = d have a common solution."""
    normal = np.cross(lines[0][1], lines[1][1])
    across = [np.cross(normal, way) / np.linalg.norm(normal) for _, way in lines]
    rows = np.array([[*a, a @ place] for (place, _), a in zip(lines, across, strict=True)])
    assert np.linalg.svd(rows, compute_uv=False)[2] < SMALL


def parallel_to_one_plane(ways: list[Array], across: Array) -> None:
    for three in combinations(ways, 3):
        assert abs(np.linalg.det(np.array(three))) < SMALL
    np.testing.assert_allclose(np.array(ways) @ (across / np.linalg.norm(across)), 0.0, atol=SMALL)


def rods_in_line(one: Standing, t_s: Array) -> None:
    in_one_line(one, "left_elbow", "right_elbow", "left_tip", "right_tip")


def rods_of_slides_in_line(one: Standing, t_s: Array) -> None:
    in_one_line(one, "left_hinge", "right_hinge", "left_tip", "right_tip")


def crank_and_coupler_in_line(one: Standing, t_s: Array) -> None:
    in_one_line(one, "crank_bearing", "crank_pin", "coupler_tip")


def crank_and_rod_in_line(one: Standing, t_s: Array) -> None:
    in_one_line(one, "crank_bearing", "crank_pin", "rod_tip")


def rod_points_at_the_knee(one: Standing, t_s: Array) -> None:
    rod, knee = one.way("rod_pin", "rod_tip"), one.way("rod_pin", "knee")
    assert abs(np.cross(rod, knee)[1]) < SMALL  # seen along the axis, y: the rod runs beside the knee


def legs_of_three_rpr_meet(one: Standing, t_s: Array) -> None:
    ends = ("wrist_1", "tip_2", "tip_3")
    meet_in_one_point([(one.at(f"pivot_{k}"), one.way(f"pivot_{k}", end)) for k, end in enumerate(ends, 1)])


def rods_of_three_rrr_meet(one: Standing, t_s: Array) -> None:
    ends = ("wrist_1", "tip_2", "tip_3")
    meet_in_one_point([(one.at(f"elbow_{k}"), one.way(f"elbow_{k}", end)) for k, end in enumerate(ends, 1)])


def forearms_parallel_to_one_plane(one: Standing, t_s: Array) -> None:
    tips = ("ball_x", "tip_1b", "tip_2a", "tip_2b", "tip_3a", "tip_3b")
    legs = ("1a", "1b", "2a", "2b", "3a", "3b")
    parallel_to_one_plane([one.way(f"swing_{leg}", tip) for leg, tip in zip(legs, tips, strict=True)], t_s)


def legs_parallel_to_one_plane(one: Standing, t_s: Array) -> None:
    parallel_to_one_plane([one.way(f"swing_{leg}b", f"tip_{leg}b") for leg in (1, 2, 3)], t_s)


def arcs_have_one_line_in_common(one: Standing, t_s: Array) -> None:
    normals = []
    for k, wrist in enumerate(("wrist_1", "tip_2", "tip_3"), 1):
        end = np.array(one.data.oMf[one.model.getFrameId(wrist)].rotation[:, 2])
        normals.append(np.cross(one.axis(f"elbow_{k}"), end))
    parallel_to_one_plane([normal / np.linalg.norm(normal) for normal in normals], t_s)


def lines_of_six_legs_depend(one: Standing, t_s: Array) -> None:
    center, size = one.at("platform"), 1.0
    lines = []
    for k in range(1, 7):
        tip = one.at("ball_x" if k == 1 else f"leg_{k}_tip")
        way = one.way(f"leg_{k}_swing", "ball_x" if k == 1 else f"leg_{k}_tip")
        lines.append([*way, *np.cross(tip - center, way) / size])
    assert np.linalg.svd(np.array(lines), compute_uv=False)[-1] < SMALL
    np.testing.assert_allclose(np.array(lines) @ t_s, 0.0, atol=SMALL)


def a_shift_with_a_turn(one: Standing, t_s: Array) -> None:
    assert min(np.linalg.norm(t_s[:3]), abs(t_s[3])) > 0.01


SENTENCES: dict[str, tuple[str, Callable[[Standing, Array], None]]] = {
    "biglide": ("lie in one line", rods_of_slides_in_line),
    "delta": ("pairs of rods are parallel to one plane", forearms_parallel_to_one_plane),
    "five_bar": ("lie in one line", rods_in_line),
    "five_bar_heavy": ("lie in one line", rods_in_line),
    "four_bar": ("Crank and coupler lie in one line", crank_and_coupler_in_line),
    "gough_stewart": ("lines of the six legs depend on one another", lines_of_six_legs_depend),
    "humanoid_knee": ("The rod points at the axis of the knee", rod_points_at_the_knee),
    "orthoglide": ("legs are parallel to one plane", legs_parallel_to_one_plane),
    "par4": ("a shift with a turn of the bars", a_shift_with_a_turn),
    "slider_crank": ("Crank and rod lie in one line", crank_and_rod_in_line),
    "spherical_rrr": ("planes of the three distal arcs meet in one line", arcs_have_one_line_in_common),
    "three_rpr": ("lines of the three legs meet in one point", legs_of_three_rpr_meet),
    "three_rrr": ("lines of the three rods meet in one point", rods_of_three_rrr_meet),
}


def test_every_sentence_is_proved_here():
    told = {name for name, entry in robots.CATALOGUE.items() if entry.why}
    elsewhere = {"humanoid_ankle"}  # no scene of it crosses: see test_humanoid_ankle.py
    assert told == set(CROSSING) | elsewhere
    assert set(CROSSING) == {*SENTENCES, "bricard"}


@cache
def crossed(name: str) -> tuple[Film, int]:
    """A film, and its frame at the first singular instant."""
    film = filmed(name, CROSSING[name])
    return film, int(np.argmin(np.abs(film.time - film.instants[0].time)))


@pytest.mark.parametrize("name", SENTENCES)
def test_a_robot_is_singular_for_the_reason_that_is_told(name):
    film, k = crossed(name)
    words, proves = SENTENCES[name]
    assert words in robots.CATALOGUE[name].why
    proves(Standing(film.robot, film.q[k]), film.t_s[k])


@pytest.mark.parametrize("name", CROSSING)
def test_no_motor_moves_as_the_platform_starts_along_t_s(name):
    """Neither a leg's length, nor an arm: the motors' derivative along t_s, by central difference."""
    film, k = crossed(name)
    robot, t_s = film.robot, film.t_s[k]
    unit = np.eye(robot.n)  # coordinates of turns are a rotation vector: dx = T^-1 t_s
    rates_to_twist = robot.platform.twist(np.repeat(film.x[k][None], robot.n, axis=0), unit)[0].T
    way = np.linalg.solve(rates_to_twist, t_s)
    step = 1e-4 * min(robot.length, 1.0) / np.abs(way).max()
    poses = [move_platform_straight(robot, film.q[k], film.x[k] + side * step * way) for side in (1, -1)]
    np.testing.assert_allclose(poses[0].x - poses[1].x, 2 * step * way, atol=1e-12)
    rates = (poses[0].motors - poses[1].motors) / (2 * step)
    assert np.abs(rates).max() < 1e-5 * np.abs(way).max() / min(robot.length, 1.0)


def test_the_driven_hinge_of_bricard_turns_back_while_every_second_one_turns_on():
    film, k = crossed("bricard")
    assert "The driven hinge turns back here" in robots.CATALOGUE["bricard"].why
    assert "every second hinge turns on" in robots.CATALOGUE["bricard"].why
    h = 20  # frames
    before, there, after = film.q[k - h], film.q[k], film.q[k + h]
    still = [0, 2, 4]
    turning = [1, 3, 5]
    assert film.robot.actuator_names == ("hinge_1",)
    assert np.all((after - there)[still] * (before - there)[still] > 0)  # both times to the same side
    assert np.all((after - there)[turning] * (before - there)[turning] < 0)
    assert np.abs(after - before)[still].max() < 0.1 * np.abs(after - before)[turning].min()
