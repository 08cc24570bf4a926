"""Stacked poses, Jacobians and motions of frames against pinocchio's own answers, frame by frame."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import eigenpy
import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import InvalidInput
from framework.kinematics.frames import Scratch, frame_motions, frames_at, scratch_of
from framework.simulation import Stepper

WORLD_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
# slides, turns, springs of six axes, a free root
NAMES = ["five_bar", "slider_crank", "gough_stewart", "delta", "standing_quadruped"]


def states(robot, count: int):
    rng = np.random.default_rng(4)
    steps = rng.standard_normal((count, robot.model.nv))
    q = np.array([pin.integrate(robot.model, robot.q_near, step) for step in steps])
    return q, rng.standard_normal((count, robot.model.nv))


@pytest.mark.parametrize("flexibility", ["rigid", "flexible_links"])
@pytest.mark.parametrize("name", NAMES)
def test_stacks_hold_what_pinocchio_says_of_each_frame(name, flexibility):
    robot = robots.load(name, flexibility=flexibility)
    model, data = robot.model, robot.model.createData()
    q, v = states(robot, 3)
    at = frames_at(robot, q)
    motions = frame_motions(robot, at, v)
    for k in range(3):
        pin.forwardKinematics(model, data, q[k], v[k], np.zeros(model.nv))
        pin.computeJointJacobians(model, data, q[k])
        pin.updateFramePlacements(model, data)
        for f, frame in enumerate(robot.frames):
            expected = {
                "position": data.oMf[frame].translation,
                "rotation": data.oMf[frame].rotation,
                "jacobian": pin.getFrameJacobian(model, data, frame, WORLD_AXES).reshape(6, -1),
                "twist": pin.getFrameVelocity(model, data, frame, WORLD_AXES).vector,
                "drift": pin.getFrameClassicalAcceleration(model, data, frame, WORLD_AXES).vector,
            }
            found = {
                "position": at.position[k, f],
                "rotation": at.rotation[k, f],
                "jacobian": at.frame_jacobian(f)[k],
                "twist": [*motions.rates[1, k, f, 3], *motions.twist[k, f, 3:]],
                "drift": [*motions.rates[2, k, f, 3], *motions.twist_rate[k, f, 3:]],
            }
            for what, value in expected.items():
                size = max(1.0, np.abs(value).max())
                np.testing.assert_allclose(found[what], value, rtol=0, atol=1e-13 * size, err_msg=what)


def test_a_stack_is_not_written_over_by_the_next_one():
    robot = robots.load("five_bar")
    q, v = states(robot, 2)
    first = frames_at(robot, q[:1])
    kept = first.placements.copy(), first.screws.copy()
    frame_motions(robot, frames_at(robot, q[1:]), v[1:])
    for before, after in zip(kept, first[:2], strict=True):
        np.testing.assert_array_equal(after, before)


def test_threads_do_not_share_a_working_memory():
    robot = robots.load("gough_stewart")
    q, _ = states(robot, 200)
    expected = [frames_at(robot, part).position for part in q.reshape(4, 50, -1)]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda part: frames_at(robot, part).position, [*q.reshape(4, 50, -1)] * 5))
    for positions, same in zip(found, expected * 5, strict=True):
        np.testing.assert_array_equal(positions, same)


def test_a_model_that_a_caller_adds_frames_to_has_room_for_them():
    """Pinocchio would write the new placements beyond the memory of the old ones."""
    robot = robots.load("five_bar")
    robot = replace(robot, model=robot.model.copy())
    q = robot.reference.q[None]
    expected = frames_at(robot, q).placements
    for k in range(20):
        robot.model.addFrame(pin.Frame(f"tool_{k}", 1, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    assert len(scratch_of(robot).placements) == robot.model.nframes
    np.testing.assert_array_equal(frames_at(robot, q).placements, expected)
    with pytest.raises(InvalidInput, match="more than numbers"):
        Stepper.of([robots.load("five_bar"), robot])


def test_copies_of_the_working_memory_are_refused():
    eigenpy.sharedMemory(False)
    try:
        with pytest.raises(RuntimeError, match="sharedMemory"):
            Scratch.of(robots.load("five_bar").model, (0,))
    finally:
        eigenpy.sharedMemory(True)
