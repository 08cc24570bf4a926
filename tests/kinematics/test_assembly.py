"""The assembled reference, the loop equations that count there, and the joints that move nothing."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import robots
from framework import Mechanism, NotAssembled, ParallelRobot
from framework.kinematics.frames import frames_at
from tests.oracles.closure_rows import closure_errors, closure_rows
from tests.oracles.forward_simulation import kinematics

NAMES = list(robots.CATALOGUE)
RANK = 1e-9  # of the largest singular value


def opened(robot, q):
    """Errors of the closures and their rows at q, both written anew for the tests."""
    model, data = robot.model, robot.model.createData()
    kinematics(model, data, q, np.zeros(model.nv))
    closures = robot.description.closures
    return closure_errors(model, data, closures), closure_rows(model, data, closures).jacobian


@pytest.mark.parametrize("name", NAMES)
def test_at_the_reference_the_loops_are_closed(name):
    robot = robots.load(name)
    reference = robot.reference
    errors, _ = opened(robot, reference.q)
    assert np.abs(errors).max() < 1e-12 * max(robot.length, 1.0)
    assert reference.residual < 1e-12 * max(robot.length, 1.0)
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, reference.q)
    place = data.oMf[robot.frames[0]].translation
    moves = robot.platform.sliding
    np.testing.assert_allclose(reference.x[moves], place[robot.platform.along], atol=1e-14)


def test_what_the_file_gives_is_held_while_the_rest_closes_the_loops():
    description = robots.load("five_bar").description
    motors = {"left_motor": 1.3, "right_motor": 1.1}
    robot = ParallelRobot.from_description(replace(description, reference=motors))
    q = robot.reference.q
    assert [q[column] for column in robot.actuated] == [1.3, 1.1]
    errors, _ = opened(robot, q)
    assert np.abs(errors).max() < 1e-13


@pytest.mark.parametrize("name", NAMES)
def test_the_kept_rows_say_all_that_the_closures_say(name):
    """As many as the rank of rows written anew, and together with those of no higher rank."""
    robot = robots.load(name)
    _, anew = opened(robot, robot.reference.q)
    scale = robot.column_scale
    rank = np.linalg.matrix_rank(anew * scale, tol=RANK * np.linalg.norm(anew * scale, 2))
    kept = robot.structure.independent
    assert len(kept) == rank
    assert np.all(np.diff(kept) > 0)
    assert robot.loops.names == tuple(robot.rows.names[row] for row in kept)


@pytest.mark.parametrize("name", NAMES)
def test_idle_joints_are_as_many_as_passive_motions_that_nothing_feels(name):
    robot = robots.load(name)
    q = robot.reference.q
    _, rows = opened(robot, q)
    frame = robot.platform.jacobian(frames_at(robot, q[None]))[0]
    felt = np.vstack([rows, frame]) * robot.column_scale
    passive = felt[:, robot.passive]
    rank = np.linalg.matrix_rank(passive, tol=RANK * np.linalg.norm(felt, 2))
    idle = robot.structure.idle
    assert len(idle) == len(robot.passive) - rank
    assert sorted([*idle, *robot.following]) == sorted(robot.passive)
    held = [k for k, column in enumerate(robot.passive) if column not in idle]
    assert np.linalg.matrix_rank(passive[:, held], tol=RANK * np.linalg.norm(felt, 2)) == rank == len(held)


def test_loops_that_cannot_close_are_named_with_what_is_missing():
    robot = robots.load("five_bar")
    text = robot.description.urdf_text
    short = text.replace('<origin xyz="0.25 0 0" rpy="0 0 0"/>', '<origin xyz="0.05 0 0" rpy="0 0 0"/>')
    assert short != text
    broken = Mechanism.from_description(replace(robot.description, urdf_text=short))
    with pytest.raises(NotAssembled, match=r"tip\.\w+ stays 0\.\d+ m apart after \d+ steps") as caught:
        ParallelRobot.of(broken)
    errors, _ = opened(broken, caught.value.q)
    gap = np.linalg.norm(errors)  # the largest of three components lies between the whole and its root third
    assert gap / np.sqrt(3) <= caught.value.residual <= gap


def test_a_reference_far_from_any_assembly_names_the_joint():
    description = robots.load("five_bar").description
    far = {**description.reference, "left_elbow": description.reference["left_elbow"] + 1.0}
    with pytest.raises(NotAssembled, match=r"not near an assembled configuration: \w+ is given as"):
        ParallelRobot.from_description(replace(description, reference=far))
