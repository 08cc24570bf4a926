"""Loads put on little by little: against the energy of the 5R written anew, where it snaps and where not."""

from __future__ import annotations

import numpy as np
import pytest

import robots
from framework import InvalidInput, assemble
from framework.statics.loading import LoadReason, loaded_stack
from framework.statics.stiffness import least_stiffness, platform_stiffness
from tests.oracles import five_bar_pose

STEPS = 20  # of the load, of the oracle
H = 1e-5  # [m] of its differences


def derivatives(x, start, w):
    """Slope (2,) and Hessian (2, 2) of V - w . x at the payload's place x (2,)."""
    steps = H * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [-1, -1], [1, -1], [-1, 1]])
    V = five_bar_pose.energy(x + steps, start) - steps @ w
    mixed = (V[5] + V[6] - V[7] - V[8]) / (4 * H * H)
    hessian = np.array([[V[1] + V[2] - 2 * V[0], 0.0], [0.0, V[3] + V[4] - 2 * V[0]]]) / H**2
    return np.array([V[1] - V[2], V[3] - V[4]]) / (2 * H), hessian + mixed * np.array([[0, 1], [1, 0]])


def followed(x, w):
    """The share of the load at which the payload, followed from x (2,), loses its stiffness; else that."""
    start, x = five_bar_pose.pose(np.array([x])), np.array(x)
    for k in range(STEPS + 1):
        for _ in range(20):
            slope, hessian = derivatives(x, start, w * k / STEPS)
            if np.linalg.eigvalsh(hessian)[0] <= 0:
                return k / STEPS, None
            move = -np.linalg.solve(hessian, slope)
            x = x + move * min(1.0, 2e-3 / np.abs(move).max())
            if np.abs(move).max() < 1e-9:
                break
        else:
            return k / STEPS, None
    return 1.0, np.linalg.eigvalsh(derivatives(x, start, w)[1])[0]


@pytest.mark.parametrize(
    ("y", "force", "snaps"),
    [
        (0.27, -300.0, True),  # above the locus and pushed onto it: a truss that snaps through
        (0.27, 300.0, False),
        (0.36, -300.0, False),
        (0.22, -300.0, False),  # below it the same force pulls away
        (0.22, 1500.0, True),
    ],
)
def test_the_5r_gives_way_where_its_energy_does(y, force, snaps):
    robot = robots.load("five_bar", flexibility="flexible_links")
    w = np.array([0.0, force])
    found = loaded_stack(robot, assemble(robot, [0.01, y]).q[None], wrench=w)
    share, softest = followed((0.01, y), w)
    assert (softest is None) == snaps
    assert found.reason[0] == (LoadReason.GIVES_WAY if snaps else LoadReason.CARRIED)
    assert share - 1.0 / STEPS - 1e-6 <= found.share[0] <= share
    if not snaps:
        assert least_stiffness(robot, found.free)[0] == pytest.approx(softest, rel=1e-4)


def test_a_stack_has_the_equilibria_of_each_pose_alone_where_these_have_not_jumped():
    robot = robots.load("delta", flexibility="flexible_joints")
    x = robot.reference.x + np.array([[0.0, 0.0, 0.0], [0.2, -0.1, 0.05], [-0.3, 0.1, -0.1]])
    q = np.array([assemble(robot, place).q for place in x])
    w = [30.0, -20.0, 10.0]
    found = loaded_stack(robot, q, wrench=w)
    assert found.reason.tolist() == [LoadReason.CARRIED, LoadReason.GIVES_WAY, LoadReason.CARRIED]
    for k in range(len(q)):
        alone = platform_stiffness(robot, q[k], loaded=True, wrench=w)
        if k == 1:  # it has snapped through, to a stable place at half a metre
            assert alone.is_stable
            assert np.linalg.norm(alone.x - x[k]) > 0.3 * robot.length
            continue
        np.testing.assert_allclose(found.q[k], alone.q, rtol=0, atol=1e-8)
        softest = np.linalg.eigvalsh(alone.stiffness)[0]
        assert least_stiffness(robot, found.free)[k] == pytest.approx(softest, rel=1e-6)


def test_loads_that_cannot_be_are_refused_and_absurd_ones_are_not_carried():
    robot = robots.load("five_bar", flexibility="flexible_links")
    with pytest.raises(InvalidInput, match="wrench"):
        loaded_stack(robot, robot.reference.q[None], wrench=[1.0])
    with pytest.raises(InvalidInput, match="no springs"):
        loaded_stack(robots.load("five_bar"), robots.load("five_bar").reference.q[None])
    found = loaded_stack(robot, robot.reference.q[None], wrench=[0.0, 1e9])  # a kilometre away
    assert found.reason[0] in (LoadReason.GIVES_WAY, LoadReason.TOO_SOFT)
