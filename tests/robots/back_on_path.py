"""How far the planned torques, integrated forward, leave a robot from its path.

Frames, closures and the platform's coordinates are those of the tests: of the plan only its torques, its path
and where it starts are taken.
"""

import numpy as np

from framework import CrossingPlan, ParallelRobot
from tests.oracles.closure_rows import closure_errors, frame_of
from tests.oracles.equations_of_motion import apart
from tests.oracles.forward_simulation import kinematics, simulate_robot
from tests.oracles.massless_simulation import massless_directions, simulate_massless

BACK = 1e-8  # [m, rad]


def misses(robot: ParallelRobot, plan: CrossingPlan, *, rtol: float) -> np.ndarray:
    """Distance from the path (T, n) [m, rad] of the robot under the planned torques, from rest."""
    torque, edges = plan.torque, plan.dynamics.torques.edges
    times = np.union1d(np.linspace(0.0, plan.duration, 6), edges)  # forces have kinks where panels meet
    q0 = plan.dynamics.configuration(np.zeros(1))[0]
    options = {"q0": q0, "times": times, "rtol": rtol, "atol": 0.01 * rtol}
    if massless_directions(robot, q0).shape[1]:
        q = simulate_massless(robot, torque, **options)
    else:
        q, _ = simulate_robot(robot, torque, **options)
    data, closures = robot.model.createData(), robot.description.closures
    platform = frame_of(robot.model, robot.description.platform.frame)
    off = []
    for k, t in enumerate(times):
        kinematics(robot.model, data, q[k], np.zeros(robot.model.nv))
        # what starts open stays open, and may yet come along the path
        assert np.abs(closure_errors(robot.model, data, closures)).max() < BACK, f"open at t = {t:g} s"
        off.append(apart(robot, q[k], data.oMf[platform], plan.platform(t)))
    return np.array(off)
