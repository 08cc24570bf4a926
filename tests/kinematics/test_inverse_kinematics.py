"""Closing the loops of many instants at once, and when two configurations share a working mode."""

import numpy as np
import pytest

import robots
from framework import Line, NotAssembled, track_path
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.linearised_loops import linearised_at, linearised_at_reference
from framework.kinematics.modes import keeps_working_mode, mode_signs


@pytest.fixture(scope="module")
def robot():
    return robots.load("five_bar")


def elbow(robot) -> int:
    """The column of the passive joint between the left crank and the left rod."""
    left, right = robot.passive
    return int(left if robot.coordinates.name_of(int(left)).startswith("left") else right)


@pytest.mark.parametrize("beside", [0.0, 1e-9, -1e-9])
def test_a_leg_folded_upon_itself_belongs_to_no_working_mode(robot, beside):
    near = linearised_at_reference(robot)
    q = robot.q_near.copy()
    # equal crank and rod: at half a turn the rod's tip is on the motor, wherever the crank points
    for turn in (np.pi, -np.pi):
        q[elbow(robot)] = turn + beside
        folded = linearised_at(robot, q[None], np.zeros((1, 2)))
        assert not keeps_working_mode(robot, near, folded)


def test_signs_of_the_modes_are_those_of_the_determinants(robot):
    branch = track_path(robot, Line([0.1, 0.345], [-0.05, 0.195]))  # through a Type 2 singularity
    linearised = branch.close(np.linspace(0.0, 1.0, 12)).linearised
    working, assembly = mode_signs(robot, linearised)
    moving = np.concatenate([robot.actuated, robot.passive])
    np.testing.assert_array_equal(working, np.linalg.slogdet(linearised.jacobian[:, :, moving])[0])
    np.testing.assert_array_equal(assembly, np.linalg.slogdet(linearised.closures[:, :, robot.passive])[0])
    assert len(set(working)) == 1
    assert len(set(assembly)) == 2


def test_what_does_not_close_is_named_by_its_place(robot):
    x = np.array([[0.1, 0.345], [0.1, 2.0], [0.05, 0.3]])  # 2 m away: no leg is as long
    with pytest.raises(NotAssembled, match=r"x, y = \(0.1, 2\)") as caught:
        close_loops(robot, x, np.repeat(robot.q_near[None], 3, axis=0))
    assert caught.value.residual > 0.1


def test_a_guess_without_numbers_is_no_answer(robot):
    x = np.repeat([[0.1, 0.345]], 3, axis=0)
    guess = np.repeat(robot.q_near[None], 3, axis=0)
    guess[1] = np.nan
    with pytest.raises(NotAssembled):
        close_loops(robot, x, guess)


def test_an_empty_stack_closes(robot):
    assert close_loops(robot, np.empty((0, 2)), np.empty((0, robot.model.nq))).q.shape == (0, 4)
