"""Links whose mass goes to zero.

What goes wrong: the joint-space mass matrix M loses rank with the mass of the last link of an open leg, and
an operational-space formula with M^-1 loses a digit for each factor of ten; without mass it divides by zero.
Why: a massless link accelerates without bound under any torque of its own; only the loop gives it a motion.
What we do: inverse dynamics never inverts M. Torques tend to those of massless legs linearly, and with no
mass at all are exactly theirs.
"""

from dataclasses import replace
from functools import cache

import mpmath
import numpy as np
import pinocchio as pin

import robots
from framework import ParallelRobot, plan_scene
from tests.oracles import five_bar as oracle
from tests.oracles.forward_simulation import kinematics, point_rows
from tests.planning.test_plan import scaled_legs

MASSES = 10.0 ** -np.arange(0, 16, 1.0)  # [kg] of each rod
TIMES = (0.3, 0.8, 0.9999, 1.0, 1.2)  # [s]


@cache
def with_legs(mass: float) -> ParallelRobot:
    heavy = robots.load("five_bar_heavy").description  # rods of 1 kg
    return ParallelRobot.from_description(replace(heavy, urdf_text=scaled_legs(heavy.urdf_text, float(mass))))


def naive_error(mass: float) -> float:
    """Relative error of joint accelerations by M^-1 and (J M^-1 J')^-1, against the same in fifty digits."""
    robot = with_legs(mass)
    model, data = robot.model, robot.model.createData()
    plan = plan_scene(robot, "C")
    q, v = plan.dynamics.configuration(0.4)[0], plan.dynamics.velocity(0.4)[0]
    tips = [(model.getFrameId("left_tip"), model.getFrameId("right_tip"))]
    kinematics(model, data, q, v)
    J, drift = point_rows(model, data, tips, [(0, 1)])
    M = pin.crba(model, data, q)
    M = np.triu(M) + np.triu(M, 1).T
    rotors = robot.gear_ratio**2 * robot.rotor_inertia
    M[robot.actuated, robot.actuated] += rotors
    force = -pin.nonLinearEffects(model, data, q, v)
    force[robot.actuated] += robot.gear_ratio * plan.torque(0.4)
    inverse = np.linalg.inv(M)
    pull = np.linalg.solve(J @ inverse @ J.T, J @ inverse @ force + drift)
    direct = inverse @ (force - J.T @ pull)
    with mpmath.workdps(50):
        kkt, right = mpmath.zeros(6), mpmath.matrix([*force, *-drift])
        for i in range(4):
            for j in range(4):
                kkt[i, j] = M[i, j]
            for j in range(2):
                kkt[i, 4 + j] = kkt[4 + j, i] = J[j, i]
        exact = np.array(mpmath.lu_solve(kkt, right).T.tolist()[0], dtype=float)[:4]
    return float(np.abs(direct - exact).max() / np.abs(exact).max())


def distance_to_massless(mass: float) -> float:
    """Largest difference [N m] of our torque to the closed form for massless legs."""
    exact = oracle.torques(oracle.solve("C", "rigid", "rigid"), TIMES)
    return float(np.abs(plan_scene(with_legs(mass), "C").torque(TIMES) - exact).max())


def test_our_torques_tend_to_those_of_massless_legs():
    distances = np.array([distance_to_massless(mass) for mass in MASSES])
    large = MASSES >= 1e-8
    slopes = distances[large] / MASSES[large]
    assert np.abs(slopes[2:] / slopes[2] - 1).max() < 0.01  # linear in the mass
    assert distances[MASSES <= 1e-12].max() < 1e-11  # down to what scene C is computed to
