"""The biglide against textbook geometry, and against Lagrange in 60 digits through its singular point."""

from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest

import robots
from framework import (
    Line,
    OutOfReach,
    ParallelRobot,
    assemble,
    locate_singularities,
    plan_scene,
)
from framework.planning.scenes import scene_path
from tests.oracles.closed_form import Kinematics
from tests.oracles.one_degree import ASIDE, DIGITS, instants, law_powers, law_value

ROBOT = "biglide"
HALF, ROD = 0.2, 0.2 * np.sqrt(2)  # [m] half the distance of the rails, length of a rod
RAILS = np.array([-HALF, HALF])
SIDES = np.array([-1.0, 1.0])  # left slider below, right slider above the end effector
SLIDER, PAYLOAD, TURNS = 1.0, 3.0, (2e-5, 1e-5)  # [kg] at the feet, [kg] in the tip, [kg m^2] of each leg
GEAR, ROTOR = 314.1592653589793, 6.4e-6
START, END, TIME, SPEED = (-0.06, 0.15), (0.05, -0.15), 0.53, 1.6  # of scene `across`
CROSSING = 0.06 / 0.11  # x = 0
REACH = ROD - HALF  # |x| where a rod is normal to its rail, Type 1


def sliders(x: np.ndarray) -> np.ndarray:
    """Inverse kinematics: coordinates of the sliders, (..., 2) [m]."""
    x = np.asarray(x)
    return x[..., 1:] + SIDES * np.sqrt(ROD**2 - (x[..., :1] - RAILS) ** 2)


def velocity_ratio(x: np.ndarray) -> np.ndarray:
    """Of the sliders over the tip: u_i . x' = (u_i . e_y) q_i' with u_i along the rods."""
    rods = np.column_stack([x[0] - RAILS, x[1] - sliders(x)])
    return rods / rods[:, 1:]


PLACES = np.random.default_rng(1).uniform([-0.08, -0.2], [0.08, 0.2], (8, 2))
KINEMATICS = Kinematics(PLACES, sliders, velocity_ratio, 1e-12, 1e-12)


def test_the_rods_are_aligned_on_the_line_midway_between_the_rails(robot):
    (point,) = locate_singularities(robot, scene_path(robot.description.scenes["across"]))
    assert point.s == pytest.approx(CROSSING, abs=1e-12)
    assert (point.kind, point.contact, point.corank) == ("type_2", "transversal", 1)
    # normal to both rods, which lie along (1, 1), and pointing along the path
    np.testing.assert_allclose(point.twist, np.array([1.0, -1.0]) / np.sqrt(2), rtol=0, atol=1e-12)
    assert not locate_singularities(robot, scene_path(robot.description.scenes["clear"]))


def test_a_bow_meets_that_line_where_its_circle_does(robot):
    start, via, end = (np.array(p) for p in robot.description.scenes["bow"].points)
    rows = 2 * np.array([via - start, end - start])
    centre = np.linalg.solve(rows, [via @ via - start @ start, end @ end - start @ start])
    radius = np.linalg.norm(start - centre)
    height = centre[1] - np.sign(centre[1] - via[1]) * np.sqrt(radius**2 - centre[0] ** 2)  # at x = 0

    def angle(p):
        return np.arctan2(*(p - centre)[::-1])

    s = (angle([0.0, height]) - angle(start)) / (angle(end) - angle(start))
    path = scene_path(robot.description.scenes["bow"])
    (point,) = locate_singularities(robot, path)
    assert point.s == pytest.approx(s, abs=1e-12)
    crossing = plan_scene(robot, "bow").crossings[0]
    # t_s . x" = 0 but for the turning of the legs, 3e-5 kg m^2 on 3 kg
    twist = np.array([1.0, -1.0])
    s2 = -(twist @ path(s, 2)) * crossing.speed**2 / (twist @ path(s, 1))
    assert crossing.acceleration == pytest.approx(s2, rel=1e-3)


def test_the_workspace_ends_where_a_rod_is_normal_to_its_rail(robot):
    for end in (-0.1, 0.1):
        with pytest.raises(OutOfReach) as caught:
            locate_singularities(robot, Line([-0.01, 0.0], [end, 0.02]))
        assert caught.value.platform[0] == pytest.approx(np.sign(end) * REACH, abs=1e-6)
        # the rod of the far rail
        assert caught.value.joint == ("right_slide" if end < 0 else "left_slide")


def test_with_both_sliders_below_there_is_no_type_2():
    description = robots.load("biglide").description
    reference = {"left_slide": -0.1, "left_hinge": 1.05, "right_slide": 0.04, "right_hinge": 2.74}
    robot = ParallelRobot.from_description(replace(description, reference=reference))
    q = assemble(robot, START).q[robot.actuated]
    np.testing.assert_allclose(q, START[1] - np.sqrt(ROD**2 - (START[0] - RAILS) ** 2), rtol=0, atol=1e-12)
    assert not locate_singularities(robot, scene_path(description.scenes["across"]))


class Lagrange:
    """Scene `across` in 60 digits: sliders, tip and turning legs, motors through q_i' = y' + a_i(x) x'."""

    def __init__(self, smoothness: int) -> None:
        with mp.workdps(DIGITS):
            self.start = [mp.mpf(c) for c in START]
            self.way = [mp.mpf(e) - mp.mpf(c) for c, e in zip(START, END, strict=True)]
            self.half, self.rod = mp.mpf("0.2"), mp.mpf("0.2") * mp.sqrt(2)
            s = -self.start[0] / self.way[0]
            # at x = 0, a_1 = a_2 = a: what the sliders give is along (a, 1), so F_x = a F_y
            a, (dx, dy) = self.slopes(mp.mpf(0))[0], self.way
            turn, slope = self.turning(mp.mpf(0)), mp.diff(self.turning, 0)
            pushed = (PAYLOAD + turn) * dx - a * PAYLOAD * dy
            curve = -slope / 2 * (dx * SPEED) ** 2 / pushed
            inner = [(TIME, 0, s), (TIME, 1, SPEED), (TIME, 2, curve)]
            self.s, self.powers = s, law_powers(1.0, smoothness, inner)

    def position(self, x, axis):
        """Coordinate of a slider less y."""
        rail = (-1, 1)[axis] * self.half
        return (-1, 1)[axis] * mp.sqrt(self.rod**2 - (x - rail) ** 2)

    def slopes(self, x):
        return [mp.diff(lambda u, axis=axis: self.position(u, axis), x) for axis in (0, 1)]

    def turning(self, x):
        """Inertia of the turning legs on x'^2: the hinge turns by x' over the rod's length along the rail."""
        return sum(mp.mpf(i) / self.position(x, axis) ** 2 for axis, i in enumerate(TURNS))

    def slider(self, t, axis):
        s = law_value(self.powers, t)
        return self.start[1] + s * self.way[1] + self.position(self.start[0] + s * self.way[0], axis)

    def joint_forces(self, t):
        """Forces of the motors on the sliders, rotors excluded [N]."""
        s, ds, dds = (law_value(self.powers, t, order) for order in range(3))
        x, dx, ddx = self.start[0] + s * self.way[0], self.way[0] * ds, self.way[0] * dds
        fx = (PAYLOAD + self.turning(x)) * ddx + mp.diff(self.turning, x) / 2 * dx**2
        fy = PAYLOAD * self.way[1] * dds
        a, b = self.slopes(x)
        left = (fx - b * fy) / (a - b)  # a left + b right = fx, left + right = fy
        rods = (left, fy - left)
        slides = [mp.diff(lambda u, axis=axis: self.slider(u, axis), t, 2) for axis in (0, 1)]
        return [rod + SLIDER * slide for rod, slide in zip(rods, slides, strict=True)]

    def torques(self, t, stiffness=mp.inf):
        """Motor torques [N m]; a spring of that stiffness [N/m] between each screw and its slider."""
        with mp.workdps(DIGITS):
            at = mp.mpf(t) + (ASIDE if t == TIME else 0)

            def motor(u, axis):
                sprung = self.joint_forces(u)[axis] / stiffness if stiffness < mp.inf else 0
                return self.slider(u, axis) + sprung

            forces = self.joint_forces(at)
            rotors = [mp.mpf(ROTOR) * GEAR * mp.diff(lambda u, i=i: motor(u, i), at, 2) for i in (0, 1)]
            return [float(r + f / mp.mpf(GEAR)) for r, f in zip(rotors, forces, strict=True)]


@pytest.mark.parametrize(("flexibility", "stiffness"), [("rigid", mp.inf), ("flexible_joints", 2e5)])
def test_torques_agree_with_lagrange_at_the_singular_point_too(flexibility, stiffness):
    plan = plan_scene(robots.load("biglide", flexibility=flexibility), "across")
    exact = Lagrange(smoothness=2 if flexibility == "rigid" else 4)
    assert plan.crossings[0].s == pytest.approx(float(exact.s), abs=1e-14)
    assert plan.crossings[0].residual < 1e-12
    assert plan.certificate.tail < 1e-9
    times = instants(1.0, TIME, 6)
    expected = [exact.torques(t, stiffness) for t in times]
    np.testing.assert_allclose(plan.torque(times), expected, rtol=0, atol=1e-10)  # of 0.05 N m


def test_elastic_rods_are_aligned_elsewhere():
    plan = plan_scene(robots.load("biglide", flexibility="flexible_links"), "bow")
    (crossing,) = plan.crossings
    left, right = ROD + plan.deflection(crossing.time)[2:]
    # the end effector divides the distance of the rails as the lengths of the rods
    assert crossing.platform[0] == pytest.approx(HALF * (left - right) / (left + right), abs=1e-12)
    assert abs(crossing.platform[0]) > 1e-8
