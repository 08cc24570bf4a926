"""The nearest pose to one out of reach, against optimisers on closed forms of the legs that know no loops.

A pose is within reach where the legs' closed forms have a solution, within the ranges of the motors.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import minimize

import robots
from framework import ControlCycle, InvalidInput, NotAssembled, ParallelRobot, assemble
from framework.atlas import nearest
from framework.atlas.nearest import nearest_pose
from framework.kinematics.continuation.pose_search import distance_unit
from framework.kinematics.diagnostics.diagnosis import describe_pose
from framework.kinematics.linearised_loops import linearised_at, linearised_at_reference
from framework.kinematics.modes import mode_signs
from framework.proofs.working_modes import working_modes
from tests.kinematics.linkages import frame, joint, linkage
from tests.oracles import five_bar_pose
from tests.robots import test_gough_stewart, test_orthoglide
from tests.robots.every_robot import KINDS

CRANK_AND_ROD = 0.5  # [m] stretched, and folded to nothing
LEG_RANGE = 2.3653505129889623, 4.7307010259779245  # [m]


def orthoglide_room(x):
    _, y, z = x[test_orthoglide.LEGS].T
    across = test_orthoglide.LENGTH**2 - y**2 - z**2
    slides = x + np.sqrt(np.maximum(across, 0.0))
    return np.concatenate([across, slides, 0.6 - slides])


def gough_stewart_room(x):
    lengths = test_gough_stewart.lengths(x).real
    return np.concatenate([lengths - LEG_RANGE[0], LEG_RANGE[1] - lengths])


ROOMS = {"orthoglide": orthoglide_room, "gough_stewart": gough_stewart_room}
REACH = {"orthoglide": 1.2, "gough_stewart": 0.6}  # [lengths, rad] of targets
STARTS = 4  # of the optimiser, the best of which counts


def targets_out_of_reach(robot, count, rng):
    """Platform coordinates (n,) in all directions from the reference that no legs reach."""
    while count:
        direction = rng.standard_normal(robot.n)
        offset = direction / np.linalg.norm(direction) * rng.uniform(0.3, 1.0) * REACH[robot.name]
        x = robot.reference.x + offset * robot.platform_scale
        if ROOMS[robot.name](x).min() < 0:
            count -= 1
            yield x


def least_distance(robot, target, rng):
    """Least distance [robot lengths, rad] by sequential least squares on closed forms, from many starts."""
    scale, room = robot.platform_scale, ROOMS[robot.name]
    goal = target / scale
    found = []
    for _ in range(STARTS):
        best = minimize(
            lambda y: 0.5 * np.sum((y - goal) ** 2),
            robot.reference.x / scale + 0.15 * rng.standard_normal(robot.n),
            jac=lambda y: y - goal,
            method="SLSQP",
            constraints={"type": "ineq", "fun": lambda y: room(y * scale)},
            options={"ftol": 1e-12},
        )
        if room(best.x * scale).min() > -1e-6:
            found.append(np.linalg.norm(best.x - goal))
    return min(found)


@pytest.mark.parametrize("name", ROOMS)
def test_no_pose_of_closed_forms_is_nearer(name):
    robot, rng = robots.load(name), np.random.default_rng(3)
    for target in targets_out_of_reach(robot, 2, rng):
        nearest = nearest_pose(robot, target)
        distance = np.linalg.norm((nearest.x - target) / robot.platform_scale)
        assert distance < least_distance(robot, target, rng) + 1e-3
        assert nearest.distance == pytest.approx(distance * (robot.length if nearest.unit == "m" else 1.0))
        assert nearest.stops
        assert nearest.residual < 1e-11
        assert ROOMS[name](nearest.x).min() > -1e-7  # the root of rounding where a leg is stretched
        assert not describe_pose(robot, nearest.q).exceeded


def test_a_pose_within_reach_is_reached():
    robot = robots.load("orthoglide")
    target = robot.reference.x + np.array([0.1, -0.05, 0.08])
    nearest = nearest_pose(robot, target)
    assert nearest.stops == ()
    np.testing.assert_allclose(nearest.q, assemble(robot, target).q, rtol=0, atol=1e-8)


def test_a_stretched_leg_and_a_range_are_named():
    stretched = nearest_pose(robots.load("five_bar"), [0.3, 0.6])
    assert stretched.stops == ("a leg is stretched or folded (Type 1)",)
    assert "right_slide ends its range" in nearest_pose(robots.load("biglide"), [0.0, 0.6]).stops


CRANK, ROD = 0.12, 0.31  # m


def slider_crank(folder, angle, lower, upper, slide=""):
    """A crank and a rod that push a block along x; the crank is drawn at an angle and has a range [rad]."""
    sine = CRANK * np.sin(angle)
    block = CRANK * np.cos(angle) + np.sqrt(ROD**2 - sine**2)
    elements = (
        joint("crank", "base", kind="revolute", limit=f'lower="{lower}" upper="{upper}"', mass=1)
        + joint("rod", "crank_link", (CRANK, 0, 0), mass=1)
        + frame("pin", "rod_link", (ROD, 0, 0))
        + joint("block", "base", axis="x", kind="prismatic", limit=slide or 'lower="-9" upper="9"', mass=1)
    )
    return ParallelRobot.from_description(
        linkage(
            folder,
            elements,
            "platform: {joints: [block]}\nactuators: [{joint: crank}]\n"
            "closures: [{name: pin, frames: [pin, block_link], axes: [x, y]}]\n"
            f"reference: {{crank: {angle}, rod: {-np.arcsin(sine / ROD) - angle}, block: {block}}}\n",
        ).description
    )


@pytest.mark.parametrize("angle", [0.9, -1.3])
def test_the_nearest_pose_is_within_ranges_whatever_the_reference(tmp_path, angle):
    """At crank angle a the block is at CRANK cos a + sqrt(ROD^2 - (CRANK sin a)^2), which falls with |a|."""
    robot = slider_crank(tmp_path, angle, -0.4, 0.5)
    end = 0.5 if angle > 0 else -0.4
    at_end = CRANK * np.cos(end) + np.sqrt(ROD**2 - (CRANK * np.sin(end)) ** 2)
    found = nearest_pose(robot, [0.3])
    assert found.stops == ("crank ends its range",)
    np.testing.assert_allclose(found.x, at_end, atol=1e-9)
    assert not describe_pose(robot, found.q).exceeded
    cycle = ControlCycle(robot)  # drawn beyond its range, and led by hand
    np.testing.assert_allclose(cycle.approach([0.3]).x, at_end, atol=1e-9)


@pytest.mark.slow
def test_where_no_pose_is_within_ranges_none_is_called_nearest(tmp_path):
    robot = slider_crank(tmp_path, 1.0, -0.4, 0.5, slide='lower="0.1" upper="0.3"')  # block beyond 0.4 m
    with pytest.raises(NotAssembled, match="no pose within them was found"):
        nearest_pose(robot, [0.3])


def test_a_cycle_waits_at_the_nearest_pose_and_returns():
    robot = robots.load("five_bar")
    cycle = ControlCycle(robot)
    x = cycle.x.copy()
    stretched = cycle.approach([0.3, 0.6])
    far = np.array([0.3, 0.6]) - five_bar_pose.BASES[0]
    edge = five_bar_pose.BASES[0] + CRANK_AND_ROD * far / np.linalg.norm(far)
    np.testing.assert_allclose(cycle.x, edge, rtol=0, atol=1e-4)  # second order in the distance
    assert stretched.distance == pytest.approx(np.linalg.norm(far) - CRANK_AND_ROD, abs=1e-9)
    assert cycle.approach(x).stops == ()
    np.testing.assert_allclose(cycle.q, robot.reference.q, rtol=0, atol=1e-8)
    cycle.approach([0.3, 0.6])
    for share in np.linspace(0.1, 1.0, 10):  # back by the motors alone
        start = robot.actuated_coordinates(stretched.q[None])[0]
        end = robot.actuated_coordinates(robot.reference.q[None])[0]
        cycle.update(start + share * (end - start), np.zeros(2))
    np.testing.assert_allclose(cycle.x, x, rtol=0, atol=1e-9)


CYCLES = [name for name in KINDS if name != "two_arms"]  # redundant motors, which no cycle takes


@pytest.mark.parametrize("name", CYCLES)
def test_a_cycle_that_approaches_keeps_both_modes_and_says_what_stops_it(name):
    robot, rng = robots.load(name), np.random.default_rng(4)
    cycle, reference = ControlCycle(robot), linearised_at_reference(robot)
    for _ in range(2):
        direction = rng.standard_normal(robot.n)
        away = 3.0 * robot.platform_scale * direction / np.linalg.norm(direction)
        nearest = cycle.approach(robot.reference.x + away)
        reached = linearised_at(robot, nearest.q[None], nearest.x[None])
        assert mode_signs(robot, reached) == mode_signs(robot, reference)
        assert bool(nearest.stops) == (nearest.distance > 1e-9 * robot.length)
        assert not describe_pose(robot, nearest.q).exceeded
        cycle.update(robot.actuated_coordinates(nearest.q[None])[0], np.zeros(robot.n_a))
        # loops closed to 1e-12, seen through motors at 1e-3 of their hold, to which x is of second order
        np.testing.assert_allclose(cycle.x, nearest.x, rtol=0, atol=1e-6)


def test_coordinates_are_as_many_as_the_platform_has():
    with pytest.raises(InvalidInput, match=r"x \(x, y\)"):
        nearest_pose(robots.load("five_bar"), [0.1, 0.2, 0.3])


@pytest.mark.parametrize(
    ("name", "unit"),
    [("orthoglide", "m"), ("gough_stewart", "robot lengths and rad"), ("spherical_rrr", "rad")],
)
def test_distances_are_in_metres_only_where_nothing_turns(name, unit):
    robot = robots.load(name)
    assert distance_unit(robot) == (robot.length if unit == "m" else 1.0, unit)


def test_a_search_starts_where_all_legs_bend_as_in_the_reference(monkeypatch):
    robot = robots.load("five_bar")
    search = SimpleNamespace(enter_ranges=lambda q: None)  # the branch ends on the way
    modes = working_modes(robot, [0.05, 0.3]).modes
    own = assemble(robot, [0.05, 0.3]).q
    assert len(modes) == 4  # both elbows, either way
    for mode in modes:
        monkeypatch.setattr(nearest, "find_closed_pose", lambda robot, q=mode.q: SimpleNamespace(q=q))
        if np.allclose(mode.q, own, atol=1e-9):
            assert nearest._start_within_ranges(robot, search) == tuple(mode.q)
        else:
            with pytest.raises(NotAssembled, match="working mode"):
                nearest._start_within_ranges(robot, search)
