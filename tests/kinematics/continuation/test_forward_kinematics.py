"""From motors to the pose: closed forms, the way there and back, and an end at Type 2 singularities."""

import numpy as np
import pytest
from scipy.optimize import brentq

import robots
from framework import (
    InvalidInput,
    Line,
    Type2Singularity,
    assemble,
    forward_kinematics,
    locate_singularities,
    track_path,
)
from framework.kinematics.continuation.forward_kinematics import motors_are_free
from framework.kinematics.frames import frames_at, integrate
from framework.kinematics.linearised_loops import linearised_at
from tests.oracles.closure_rows import closure_rows
from tests.oracles.forward_simulation import kinematics

MOTORS, LINK = np.array([[-0.2, 0.0], [0.2, 0.0]]), 0.25  # the 5R of the paper
FREE = [name for name in robots.CATALOGUE if motors_are_free(robots.load(name))]
NAMES = [
    pytest.param(name, marks=() if name in ("five_bar", "delta", "agile_eye") else pytest.mark.slow)
    for name in FREE
]


def motors_of(robot, q):
    return robot.actuated_coordinates(np.atleast_2d(q))[0]


def elbows(q_a):
    return MOTORS + LINK * np.column_stack([np.cos(q_a), np.sin(q_a)])


def tip(q_a, side):
    """Where the rods of the 5R meet: on this side of the line between the elbows."""
    left, right = elbows(q_a)
    half = (right - left) / 2
    height = np.sqrt(LINK**2 - half @ half)
    return left + half + side * height * np.array([-half[1], half[0]]) / np.linalg.norm(half)


@pytest.mark.parametrize("seed", range(12))
def test_the_tip_of_the_5r_is_where_two_circles_meet(seed):
    robot = robots.load("five_bar")
    start = assemble(robot)
    q_a = motors_of(robot, start.q)
    (side,) = (side for side in (1, -1) if np.allclose(tip(q_a, side), start.x))
    turn = np.random.default_rng(seed).uniform(-1.2, 1.2, 2)
    apart = [np.linalg.norm(np.diff(elbows(q_a + s * turn), axis=0)) for s in np.linspace(0.0, 1.0, 2001)]
    if max(apart) < 2 * LINK:
        found = forward_kinematics(robot, q_a + turn)
        np.testing.assert_allclose(found.x, tip(q_a + turn, side), atol=1e-13 / found.clearance)
        np.testing.assert_allclose(motors_of(robot, found.q), q_a + turn, atol=1e-15)
        return
    # on the way the elbows part until the rods lie in line: there, and not before, it ends

    def too_far(s):
        return np.linalg.norm(np.diff(elbows(q_a + s * turn), axis=0)) - 2 * LINK

    first = np.argmax(np.array(apart) > 2 * LINK) / 2000
    expected = brentq(too_far, first - 1 / 2000, first, xtol=1e-14)
    with pytest.raises(Type2Singularity, match="five_bar: a Type 2 singularity") as caught:
        forward_kinematics(robot, q_a + turn)
    assert caught.value.share == pytest.approx(expected, abs=1e-12)
    np.testing.assert_allclose(caught.value.platform, elbows(q_a + expected * turn).mean(axis=0), atol=1e-9)
    np.testing.assert_allclose(motors_of(robot, caught.value.q), q_a + caught.value.share * turn, atol=1e-15)


def step(robot, rng, size: float):
    """A turn of all motors by `size` [rad, robot lengths]."""
    aside = rng.standard_normal(robot.n_a)
    return size * aside / np.linalg.norm(aside) * robot.column_scale[robot.actuated]


def hold(robot, q):
    """Least singular value of the passive columns of the closures, by rows written anew for the tests."""
    model, data = robot.model, robot.model.createData()
    kinematics(model, data, q, np.zeros(model.nv))
    rows = closure_rows(model, data, robot.description.closures).jacobian
    columns = robot.following
    return np.linalg.svd(rows[:, columns] * robot.column_scale[columns], compute_uv=False)[-1]


@pytest.mark.parametrize("name", NAMES)
def test_where_the_way_ends_the_motors_do_not_hold_the_robot(name):
    robot = robots.load(name)
    start = assemble(robot)
    q_a, rng = motors_of(robot, start.q), np.random.default_rng(8)
    # The rods of delta_hinges, 0.54 m, reach its elbows unless the circle through the rods' upper ends, moved
    # inwards by the platform's radius, is larger: up to 2 rad away at 1 in 2000 positions of the motors.
    size, ended = 3.0 if name == "delta_hinges" else 2.0, []
    for sign in (1, -1, 1, -1):
        turn = sign * step(robot, rng, size)
        try:
            forward_kinematics(robot, q_a + turn)
        except Type2Singularity as end:
            ended.append(end)
            np.testing.assert_allclose(motors_of(robot, end.q), q_a + end.share * turn, rtol=0, atol=1e-14)
    assert ended or name == "n_four_bar"  # which turns without end
    for end in ended:
        assert hold(robot, end.q) < 1e-6 * hold(robot, start.q)


@pytest.mark.parametrize("name", NAMES)
def test_it_inverts_the_inverse_kinematics(name):
    robot = robots.load(name)
    start = assemble(robot)
    rng = np.random.default_rng(9)
    size = 0.03 * robot.platform_scale
    for _ in range(3):
        pose = assemble(robot, start.x + size * rng.uniform(-1, 1, robot.n))
        found = forward_kinematics(robot, motors_of(robot, pose.q))
        allowed = 1e-12 * robot.length / found.clearance**2
        np.testing.assert_allclose(found.x, pose.x, rtol=0, atol=allowed)
        np.testing.assert_allclose(found.q, pose.q, rtol=0, atol=allowed)


def test_it_keeps_the_assembly_mode_of_where_it_starts():
    robot = robots.load("five_bar")
    path = Line([0.1, 0.345], [-0.05, 0.195])
    branch = track_path(robot, path)
    (point,) = locate_singularities(robot, path, branch=branch)
    for s in (0.3, 0.95):  # before and behind the Type 2 singularity
        q = branch.close(s).q[0]
        q_a = motors_of(robot, q)
        side = 1 if np.allclose(tip(q_a, 1), path(s)) else -1
        found = forward_kinematics(robot, q_a + 0.03, near=q)
        np.testing.assert_allclose(found.x, tip(q_a + 0.03, side), atol=1e-12)
    with pytest.raises(Type2Singularity) as caught:
        forward_kinematics(robot, motors_of(robot, point.q) + 0.01, near=point.q)
    assert caught.value.share == 0.0
    np.testing.assert_array_equal(caught.value.q, point.q)


def test_turns_of_motors_and_platform_are_counted_on():
    robot = robots.load("n_four_bar")  # a parallelogram whose platform turns with its motor
    start = assemble(robot)
    q_a = motors_of(robot, start.q)
    for turns in (1, -2):
        found = forward_kinematics(robot, q_a + 2 * np.pi * turns)
        assert motors_of(robot, found.q) == pytest.approx(q_a + 2 * np.pi * turns, abs=1e-12)
        at = frames_at(robot, np.stack([start.q, found.q])).position
        np.testing.assert_allclose(at[1], at[0], atol=1e-12 * robot.length)
    quarter = forward_kinematics(robot, q_a + 0.5 * np.pi)
    back = forward_kinematics(robot, q_a + 2.5 * np.pi, near=quarter.q)
    np.testing.assert_allclose(back.x - quarter.x, 2 * np.pi * np.round((back.x - quarter.x) / (2 * np.pi)))


def test_springs_keep_their_deflections():
    robot = robots.load("five_bar", flexibility="flexible_links")
    q = assemble(robot).q.copy()
    stretch, twist = 1e-3, 0.01
    names = list(robot.elastic_names)
    q[robot.elastic[names.index("left_rod")]] = stretch
    q[robot.elastic[names.index("left_drive")]] = twist
    with pytest.raises(InvalidInput, match="open by"):
        forward_kinematics(robot, motors_of(robot, q), near=q)
    # close the loops on the passive joints alone, by the circles of the deflected links
    q_a = motors_of(robot, q)
    left, right = elbows(q_a + np.array([twist, 0.0]))
    between = right - left
    apart = np.linalg.norm(between)
    along = (apart**2 + (LINK + stretch) ** 2 - LINK**2) / (2 * apart)
    aside = np.array([-between[1], between[0]]) / apart
    corner = left + along * between / apart + np.sqrt((LINK + stretch) ** 2 - along**2) * aside
    for joint, elbow, crank in (("left_elbow", left, q_a[0] + twist), ("right_elbow", right, q_a[1])):
        column = [robot.coordinates.name_of(k) for k in range(robot.model.nv)].index(joint)
        angle = np.arctan2(*(corner - elbow)[::-1]) - crank
        q[column] += np.angle(np.exp(1j * (angle - q[column])))
    found = forward_kinematics(robot, q_a, near=q)
    np.testing.assert_allclose(found.q, q, atol=1e-13)
    np.testing.assert_allclose(found.x, corner, atol=1e-13)
    moved = forward_kinematics(robot, q_a + 0.05, near=q)
    np.testing.assert_array_equal(moved.q[robot.elastic], q[robot.elastic])


@pytest.mark.parametrize(
    ("name", "q_a", "near", "complaint"),
    [
        ("five_bar", [1.0], None, "left_motor, right_motor.* must be 2 finite numbers"),
        ("five_bar", [1.0, np.nan], None, "must be 2 finite numbers"),
        ("five_bar", "motors", None, "must be 2 finite numbers"),
        ("five_bar", [1.2, 1.0], [0.0, 0.1], "q, all joints of five_bar, must be 4 finite numbers"),
        ("five_bar", [1.2, 1.0], [1.0, 0.0, 1.0, 0.0], "the loops of five_bar are open by"),
        ("standing_quadruped", np.zeros(12), None, "12 motors drive 6 degrees of freedom"),
    ],
)
def test_what_cannot_be_right_is_refused(name, q_a, near, complaint):
    with pytest.raises(InvalidInput, match=complaint):
        forward_kinematics(robots.load(name), q_a, near=near)


def sign_on_branch(robot, way: np.ndarray) -> float:
    """The sign of det P behind a way (n_a,) of the motors, which the branch follows in small steps."""
    steps = 200
    q = robot.reference.q[None]
    for _ in range(steps):
        turn = np.zeros((1, robot.model.nv))
        turn[:, robot.actuated] = way / steps
        rates = linearised_at(robot, q, None)
        turn[:, robot.following] = -rates.passive_factors.solve(rates.closures @ turn[0])
        q = integrate(robot, q, turn)
        for _ in range(3):  # closed again
            here, turn = linearised_at(robot, q, None), np.zeros_like(turn)
            turn[:, robot.following] = -here.passive_factors.solve(here.residual[:, robot.n :])
            q = integrate(robot, q, turn)
    return float(linearised_at(robot, q, None).passive_factors.slogdet[0][0])


@pytest.mark.parametrize(
    ("name", "motors", "share_of_the_way"),
    [
        ("delta", [None, np.pi, None], 0.48),  # one motor alone, and the motors can go on behind
        ("delta", [None, np.pi, None], 1.0),
        ("par4", [0.058, -0.04, 1.708, 1.816], 1.0),  # crosses the locus twice in a tenth of the way
    ],
)
def test_where_modes_cross_without_a_fold_none_is_chosen_in_silence(name, motors, share_of_the_way):
    """The way ends where det P changes its sign for the first time."""
    robot = robots.load(name)
    start = robot.actuated_coordinates(robot.reference.q[None])[0]
    ends = [here if angle is None else angle for here, angle in zip(start, motors, strict=True)]
    way = share_of_the_way * (ends - start)
    with pytest.raises(Type2Singularity) as stopped:
        forward_kinematics(robot, start + way)
    at = stopped.value.share
    off = 1e-4
    before = [sign_on_branch(robot, share * way) for share in (0.1 * at, 0.5 * at, at - off)]
    assert before == [before[0]] * 3
    assert sign_on_branch(robot, (at + off) * way) == -before[0]
