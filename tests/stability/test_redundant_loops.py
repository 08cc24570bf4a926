"""Redundant loops: equations that repeat others.

What goes wrong: a planar robot written in space closes its loop out of the plane for nothing, and a model
with a closure written twice has every equation twice. The matrix of all loop equations is then singular
everywhere: elimination fails or divides rounding by rounding.
Why: "repeats" is a property of the model that persists, "singular" one of a pose that passes; both look like
a lost rank.
What we do: independent rows are found once, at the reference, by rank-revealing QR. Torques are the same
however often and in whatever units of length the loops are written.
"""

from dataclasses import replace

import numpy as np
import pytest

import robots
from framework import ParallelRobot, check_robot, plan_scene
from framework.kinematics.closures import loop_equations
from framework.kinematics.frames import frames_at

COPIES = (1, 2, 4, 8)


def with_copies(name: str, copies: int) -> ParallelRobot:
    """The robot with each of its closures written so many times."""
    description = robots.load(name).description
    closures = tuple(
        replace(closure, name=f"{closure.name}_{k}")
        for k in range(copies)
        for closure in description.closures
    )
    return ParallelRobot.from_description(replace(description, closures=closures))


def all_rows_condition(name: str, copies: int) -> float:
    """Condition number of J J' with all loop equations J: what a solve with every row works with."""
    robot = with_copies(name, copies)
    at = frames_at(robot, robot.reference.q[None])
    J = loop_equations(robot.rows, at).jacobian[0]
    return float(np.linalg.cond(J @ J.T))


def torque_error(name: str, scene: str, copies: int) -> tuple[float, int]:
    """Largest difference [N m] to the torques with each closure once; rows left out."""
    one, many = (plan_scene(with_copies(name, k), scene) for k in (1, copies))
    t = np.linspace(0.0, one.duration, 101)
    dropped = len(check_robot(with_copies(name, copies)).redundant_rows)
    return float(np.abs(many.torque(t) - one.torque(t)).max()), dropped


@pytest.mark.parametrize(("name", "scene", "rank"), [("five_bar", "C", 2), ("three_rpr", "crossing", 4)])
@pytest.mark.parametrize("copies", COPIES)
def test_copies_of_a_loop_change_nothing(name, scene, rank, copies):
    assert all_rows_condition(name, copies) > 1e15  # out of the plane, already with one copy
    error, dropped = torque_error(name, scene, copies)
    assert error < 1e-11
    assert dropped == 3 * copies * rank // 2 - rank  # a spherical closure has three rows, two of use
