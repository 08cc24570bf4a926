"""The 5R with heavy legs: what the condition of massless legs leaves, integrated forward.

The witness is a forward dynamics in full coordinates that shares no code with the inverse dynamics.
"""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import robots
from framework import Condition, Law, UnboundedTorque, assemble, inverse_dynamics, locate_singularities
from framework.dynamics.finite_differences import finite_difference_torques
from framework.planning.scenes import scene_path
from tests.oracles.forward_simulation import forward_simulate

TIMES = np.linspace(0.0, 1.5, 151)
ON_THE_PATH = 1e-10  # [m] at every sample


def tracking_error(robot, torque, path, law) -> np.ndarray:
    """Distance [m] of the payload from its place on the path at TIMES, driven by `torque`."""
    model = robot.model
    tips = tuple(model.getFrameId(name) for name in ("left_tip", "right_tip"))
    armature = np.zeros(model.nv)
    armature[robot.actuated] = robot.gear_ratio**2 * robot.rotor_inertia
    q, _ = forward_simulate(
        model,
        closure_frames=[tips],
        closure_rows=[(0, 1)],
        actuated=robot.actuated,
        armature=armature,
        torque=lambda t: robot.gear_ratio * torque(t),
        q0=assemble(robot, path(0.0)).q,
        v0=np.zeros(model.nv),
        times=TIMES,
    )
    crank, rod = q[:, 0], q[:, 0] + q[:, 1]  # left leg of the 5R: closed form, nothing of ours
    tip = np.column_stack([-0.2 + 0.25 * (np.cos(crank) + np.cos(rod)), 0.25 * (np.sin(crank) + np.sin(rod))])
    return np.linalg.norm(tip - path(law(TIMES)), axis=1)


def test_the_condition_without_leg_inertia_is_refused_and_fails_the_same_test():
    robot = robots.load("five_bar_heavy")
    path = scene_path(robot.description.scenes["C"])
    (point,) = locate_singularities(robot, path)
    # massless legs: t_s . m x'' = 0 on a straight path means s" = 0, Eq. (18)
    light = [Condition(1.0, 0, point.s), Condition(1.0, 1, 1.5), Condition(1.0, 2, 0.0)]
    law = Law.rest_to_rest(1.5, 2, light)
    with pytest.raises(UnboundedTorque):
        inverse_dynamics(robot, path, law)
    # the best that can be done with its torques: leave the spike out and carry smoothly over it
    raw = finite_difference_torques(robot, path, law, samples=3001)
    keep = np.abs(raw.time - 1.0) > 0.01
    torque = CubicSpline(raw.time[keep], raw.torque[keep])
    assert tracking_error(robot, torque, path, law).max() > 1e4 * ON_THE_PATH
