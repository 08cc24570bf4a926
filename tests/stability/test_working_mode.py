"""A leg that nearly folds: the inverse kinematics has two solutions that come together.

What goes wrong: Newton's method from the previous point has no notion of a branch. Where two solutions are
close it lands on either; from there on the leg is mirrored, with a perfect residual at each point.
Why: crank and rod are as long as each other, and over the motor any crank angle reaches the point.
What we do: a step counts only if the corrector stays small against the predictor and the working mode keeps
its sign; else it is halved. A path that meets the fold is refused, with the leg and the place.
"""

import numpy as np
import pytest

import robots
from framework import Arc, Line, OutOfReach, Type1Singularity, assemble, locate_singularities, track_path
from tests.oracles import five_bar as oracle
from tests.oracles import naive

DISTANCES = np.array([0.05, 0.02, 0.01, 5e-3, 2e-3, 1e-3])  # [m] at which the path passes the left motor


def past_the_motor(distance: float) -> Line:
    """A straight path that passes the left motor at a distance [m]; at 0 it folds the leg."""
    aside = distance * np.array([1.0, -1.0]) / np.sqrt(2)
    return Line(np.array([-0.13, 0.07]) + aside, np.array([-0.27, -0.07]) + aside)


def wrapped(angles: np.ndarray) -> np.ndarray:
    return np.abs(np.angle(np.exp(1j * angles)))


def errors(distance: float, samples: int = 50) -> tuple[float, float]:
    """Largest error [rad] of the crank angles along the path, naive and ours, against the closed form."""
    path, robot = past_the_motor(distance), robots.load("five_bar")
    s = np.linspace(0.0, 1.0, samples)
    exact = np.array([oracle.inverse_kinematics(x) for x in path(s)])
    ours = track_path(robot, path).close(s).q[:, robot.actuated]
    angles, followed = exact[0], []
    for x in path(s):
        angles = naive.newton_cranks(x, angles)
        followed.append(angles)
    return float(wrapped(np.array(followed) - exact).max()), float(wrapped(ours - exact).max())


def test_a_leg_that_nearly_folds_keeps_its_mode():
    assert max(errors(distance)[1] for distance in DISTANCES) < 1e-11  # the crank turns by 1 / distance


@pytest.mark.parametrize("distance", [0.0, 1e-8])
def test_on_the_motor_the_path_is_refused_with_the_leg(distance):
    with pytest.raises((Type1Singularity, OutOfReach), match="leg of left_motor") as caught:
        locate_singularities(robots.load("five_bar"), past_the_motor(distance))
    assert caught.value.s == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("short", [1e-2, 1e-4, 1e-8, 0.0, -1e-8])
def test_near_the_stretched_leg_the_branch_is_kept_or_the_path_refused(short):
    robot, motor = robots.load("five_bar"), np.array([-0.2, 0.0])
    middle = np.deg2rad(60)
    centre = motor + (0.4 - short) * np.array([np.cos(middle), np.sin(middle)])
    turned = middle + np.array([-0.6, 0.0, 0.9])
    path = Arc(*(centre + 0.1 * np.column_stack([np.cos(turned), np.sin(turned)])))
    s = np.linspace(0.0, 1.0, 101)
    if short <= 0:
        with pytest.raises((Type1Singularity, OutOfReach), match="leg of left_motor") as caught:
            track_path(robot, path)
        assert short < 0 or caught.value.s == pytest.approx(0.6 / 1.5, abs=1e-3)
        return
    exact = np.array([oracle.inverse_kinematics(x) for x in path(s)])
    ours = track_path(robot, path).close(s).q[:, robot.actuated]
    # the angle goes as the root of what the leg is short of: half the digits near the reach
    assert wrapped(ours - exact).max() < max(1e-12, 1e-15 / np.sqrt(short))
    assert np.abs(assemble(robot, path(1.0)).q[robot.actuated] - exact[-1]).max() < 1e-11
