"""Closing the loops of many instants at once, and when two configurations share a working mode."""

import numpy as np
import pytest

import robots
from framework import Line, NotAssembled, track_path
from framework.kinematics import inverse_kinematics
from framework.kinematics.inverse_kinematics import close_each, close_loops
from framework.kinematics.linearised_loops import linearised_at, linearised_at_reference
from framework.kinematics.modes import keeps_working_mode, mode_signs
from framework.tolerances import NEWTON_STEP

ROBOT = "five_bar"


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
    linearised = branch.close(np.linspace(0.0, 1.0, 12))
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


def test_an_empty_stack_closes(robot):
    assert close_loops(robot, np.empty((0, 2)), np.empty((0, robot.model.nq))).q.shape == (0, 4)


# newton's method on a stack: each instant for itself, whatever stands beside it


REACHED = np.array([[0.1, 0.345], [0.08, 0.33], [0.02, 0.3]])
TOO_FAR = np.array([[0.1, 2.0]])


def test_instants_of_a_large_stack_end_at_their_own_last_step(robot, monkeypatch):
    """Of 202 instants one starts far away and one never closes: the others wait for neither."""
    x = np.array([[0.1, 0.345], *np.linspace([0.1, 0.345], [0.02, 0.3], 200), [0.1, 2.0]])
    guess = close_loops(robot, x[1:-1], np.repeat(robot.q_near[None], 200, axis=0)).q
    guess = np.vstack([guess[-1], guess, robot.q_near])
    evaluated = []
    linearise = inverse_kinematics.linearised_at
    monkeypatch.setattr(
        inverse_kinematics, "linearised_at", lambda r, q, *x: evaluated.append(len(q)) or linearise(r, q, *x)
    )
    q, linearised, closed = close_each(robot, x, guess)
    assert closed.tolist() == [True] * 201 + [False]
    assert sum(evaluated) < 4 * len(x)
    np.testing.assert_array_equal(linearised.frames.q, q)
    np.testing.assert_allclose(linearised.residual[:-1], 0.0, atol=1e-15)
    np.testing.assert_allclose(q[0], q[1], rtol=0, atol=1e-14)


def guesses(robot, count: int):
    return np.repeat(robot.reference.q[None], count, axis=0)


def spoilt(robot):
    """Guesses that lead nowhere: out of reach; no numbers; all links along x, a singular matrix."""
    near = robot.reference.q
    return np.array([near, np.full(len(near), np.nan), np.zeros(len(near))])


def test_what_closes_is_what_closes_alone(robot):
    alone = close_loops(robot, REACHED, guesses(robot, 3))
    places = np.concatenate([REACHED[:1], TOO_FAR, REACHED[1:2], REACHED[:1], REACHED[2:], REACHED[:1]])
    starts = guesses(robot, 6)
    starts[[1, 3, 5]] = spoilt(robot)
    found = close_each(robot, places, starts)
    np.testing.assert_array_equal(found.closed, [True, False, True, False, True, False])
    np.testing.assert_allclose(found.q[found.closed], alone.q, rtol=0, atol=1e-14)
    assert np.abs(found.linearised.residual[found.closed]).max() < 1e-15


def test_an_instant_whose_step_is_too_long_is_given_up_and_not_moved(robot):
    starts = guesses(robot, 3)
    near = np.repeat(close_loops(robot, REACHED[:1], starts[:1]).q, 3, axis=0)
    places = REACHED[0] + np.array([[0.0, 0.0], [1e-3, 0.0], [0.05, 0.0]])
    found = close_each(robot, places, near, farthest=0.02)
    np.testing.assert_array_equal(found.closed, [True, True, False])
    np.testing.assert_array_equal(found.q[2], near[2])


@pytest.mark.parametrize("name", ["delta", "gough_stewart", "three_upu", "agile_eye"])
def test_closed_means_that_the_error_is_the_square_of_the_last_step(name):
    robot = robots.load(name)
    reference = robot.reference
    rng = np.random.default_rng(2)
    aside = 0.02 * rng.standard_normal((20, robot.model.nv)) * robot.column_scale
    found = close_each(robot, np.repeat(reference.x[None], 20, axis=0), reference.q + aside)
    assert found.closed.all()
    size = robot.platform_scale.max()
    assert np.abs(found.linearised.residual).max() < 10 * NEWTON_STEP**2 * size + 1e-14 * robot.length
