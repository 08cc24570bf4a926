"""Poses in stacks and in streams are those found one by one; both end where the assembly mode does."""

import numpy as np
import pytest

import robots
from framework import InvalidInput, Type2Singularity, assemble, plan_scene
from framework.kinematics.closures import loop_equations
from framework.kinematics.continuation.forward_kinematics import follow_motors, forward_kinematics_stack
from framework.kinematics.frames import frames_at
from framework.kinematics.inverse_kinematics import close_each
from framework.kinematics.linearised_loops import linearised_at, type1_matrix
from framework.proofs.assembly_modes import assembly_modes
from tests.kinematics.continuation.small_steps import are_same, turn
from tests.oracles.closure_rows import closure_errors
from tests.oracles.forward_simulation import kinematics

STEPS = 64  # a 64th as long beside a singularity
ASIDE = 1e-3  # [rad, robot lengths] from a pose, where the inverse kinematics begins
SLOW = ("delta", "orthoglide", "humanoid_ankle", "four_bar", "agile_eye")


def error_against_inverse_kinematics(robot, q, x, rng):
    """Return the largest distance of q (T, nq) to where Newton closes x (T, n), times its condition.

    Where a leg is nearly stretched the next working mode is as near as the least singular value is small.
    """
    legs = np.linalg.svd(type1_matrix(robot, linearised_at(robot, q, x)), compute_uv=False)[:, -1]
    aside = np.minimum(ASIDE, 0.1 * legs)[:, None] * rng.uniform(-1, 1, q.shape) * robot.column_scale
    again = close_each(robot, x, q + aside)
    lengths = np.where(robot.loops.rotation, 1.0, robot.length)[:, None]
    loops = loop_equations(robot.loops, frames_at(robot, q)).jacobian / lengths * robot.column_scale
    passive = np.linalg.svd(loops[:, :, robot.following], compute_uv=False).min(axis=1)
    apart = np.abs((again.q - q) / robot.column_scale).max(axis=1) * np.minimum(passive, legs)
    assert again.closed.any()
    return apart[again.closed].max()


@pytest.mark.parametrize(
    ("name", "poses"), [("five_bar", 20), *(pytest.param(name, 100, marks=pytest.mark.slow) for name in SLOW)]
)
def test_random_poses_a_tenth_away_are_found_on_their_branch(name, poses):
    """By the motor that turns most; small steps lead to each, and its loops are closed by other equations."""
    robot, rng = robots.load(name), np.random.default_rng(0)
    turns = rng.standard_normal((poses, robot.n_a))
    turns *= rng.uniform(0.1, 0.15, (poses, 1)) / np.abs(turns).max(axis=1, keepdims=True)
    turns *= robot.column_scale[robot.actuated]
    q_a = robot.actuated_coordinates(robot.reference.q[None]) + turns
    stack = forward_kinematics_stack(robot, q_a)
    arrived = np.setdiff1d(np.arange(poses), list(stack.refused))
    assert len(arrived) >= poses / 4  # the delta stands beside its locus: half of all ways meet it
    assert {type(refusal) for refusal in stack.refused.values()} <= {Type2Singularity}
    q, data = stack.q[arrived], robot.model.createData()
    np.testing.assert_allclose(robot.actuated_coordinates(q), q_a[arrived], rtol=0, atol=1e-14)
    for one in q:
        kinematics(robot.model, data, one, np.zeros(robot.model.nv))
        gaps = closure_errors(robot.model, data, robot.description.closures)
        assert np.abs(gaps).max() < 1e-14 * max(robot.length, 1.0)
    assert error_against_inverse_kinematics(robot, q, stack.x[arrived], rng) < 1e-12
    off = ~are_same(robot, turn(robot, turns[arrived], STEPS), q)
    assert are_same(robot, turn(robot, turns[arrived][off], 64 * STEPS), q[off]).all()


def test_a_stack_starts_in_the_mode_of_the_pose_that_is_given():
    """Each assembly mode of the 5R, from its own pose: two circles meet in mirror images about a line."""
    robot = robots.load("five_bar")
    q_a = robot.actuated_coordinates(robot.reference.q[None])
    first, second = assembly_modes(robot, q_a[0]).modes
    nearby = q_a + np.array([[0.0, 0.0], [0.02, -0.03], [-0.04, 0.01]])
    stacks = [forward_kinematics_stack(robot, nearby, near=mode.q) for mode in (first, second)]
    for mode, stack in zip((first, second), stacks, strict=True):
        assert not stack.refused
        np.testing.assert_allclose(stack.x[0], mode.x, atol=1e-12)
    data = robot.model.createData()
    for k, q in enumerate(stacks[0].q):
        kinematics(robot.model, data, q, np.zeros(robot.model.nv))
        for elbow in ("left_elbow", "right_elbow"):  # where the motors hold them
            place = data.oMi[robot.model.getJointId(elbow)].translation[:2]
            rods = [np.linalg.norm(stack.x[k] - place) for stack in stacks]
            assert rods[0] == pytest.approx(rods[1], abs=1e-12)
    assert np.linalg.norm(stacks[0].x - stacks[1].x, axis=1).min() > 0.1


def test_a_stream_that_meets_type_2_ends_between_the_samples_around_it():
    plan = plan_scene(robots.load("five_bar"), "C")
    (crossing,) = plan.crossings
    times = np.linspace(0.0, plan.duration, 61)
    samples = plan.motor_angle(times) / plan.robot.gear_ratio
    before = int(np.sum(times < crossing.time))
    stream = follow_motors(plan.robot, samples, near=plan.configuration(times[:1])[0])
    for k in range(before):
        np.testing.assert_allclose(next(stream).x, plan.platform(times[k]), atol=1e-9)
    with pytest.raises(Type2Singularity, match="a Type 2 singularity on the way") as end:
        next(stream)
    between = plan.platform(times[before - 1 : before + 1])
    apart = np.linalg.norm(np.diff(between, axis=0))
    assert np.linalg.norm(end.value.platform - crossing.platform) < apart


def test_encoders_of_a_single_turn_are_counted_on():
    robot = robots.load("n_four_bar")
    start = assemble(robot)
    begin = robot.actuated_coordinates(start.q[None])[0]
    turned = begin + np.linspace(0.0, 4 * np.pi, 41)[:, None]
    samples = np.mod(turned, 2 * np.pi)
    *_, last = follow_motors(robot, samples, single_turn=True)
    assert robot.actuated_coordinates(last.q[None])[0] == pytest.approx(turned[-1], abs=1e-12)
    assert abs(last.x - start.x) == pytest.approx(4 * np.pi, abs=1e-12)


@pytest.mark.parametrize(
    ("name", "q_a", "words"),
    [
        ("five_bar", [[1.0, np.nan]], "left_motor, right_motor.* finite numbers"),
        ("standing_quadruped", np.zeros((2, 12)), "12 motors drive 6 degrees of freedom"),
    ],
)
def test_what_cannot_be_right_is_refused(name, q_a, words):
    robot = robots.load(name)
    with pytest.raises(InvalidInput, match=words):
        forward_kinematics_stack(robot, q_a)
    with pytest.raises(InvalidInput, match=words):
        next(follow_motors(robot, q_a))
