"""Forward dynamics by pinocchio's contact solver: the loops are its constraints, the steps those of DOP853.

Nothing is shared with `simulate` but the tree and the frames of the robot file. Every joint must move some
mass, and every loop be a point or a weld. Source: Carpentier, Budhiraja and Mansard 2021, "Proximal and
sparse resolution of constrained dynamic equations", Robotics: Science and Systems.
"""

from collections.abc import Callable

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

from framework import ParallelRobot

Torque = Callable[[float, np.ndarray, np.ndarray], np.ndarray]  # t, q, v -> motor torques (n_a,), motor side
Force = Callable[[pin.Model, np.ndarray], np.ndarray]  # model, q -> generalised forces (nv,)


def simulate_contacts(
    robot: ParallelRobot,
    torque: Torque,
    q: np.ndarray,
    v: np.ndarray,
    times: np.ndarray,
    *,
    damping: float = 0.0,
    world: Force | None = None,
    closing: float = 0.02,
) -> tuple[np.ndarray, np.ndarray]:
    """Return q (T, nq) and v (T, nv) at `times` (T,), from q (nq,) and v (nv,) at the first of them.

    Open loops close with the time constant `closing` [s], critically damped.
    """
    model = robot.model.copy()
    model.armature[robot.actuated] += robot.gear_ratio**2 * robot.rotor_inertia
    contacts, contact_data = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    for contact in robot.constraint_models():
        gains = contact.m_baumgarte_parameters
        gains.Kp, gains.Kd = 1 / closing**2, 2 / closing
        contacts.append(contact)
        contact_data.append(contact.createData())
    data = model.createData()
    pin.initConstraintDynamics(model, data, contacts, contact_data)
    # with the default settings redundant rows, as of a planar loop described in space, give NaN
    settings = pin.ProximalSettings(accuracy=1e-12, mu=1e-8, max_iter=20)

    def slope(t: float, y: np.ndarray) -> np.ndarray:
        q, v = np.split(y, 2)
        force = -robot.all_stiffness * (q - robot.joint_rest) - (robot.joint_damping + damping) * v
        force[robot.actuated] += robot.gear_ratio * torque(t, q, v)
        if world is not None:
            force += world(model, q)
        a = pin.constraintDynamics(model, data, q, v, force, contacts, contact_data, settings)
        return np.concatenate([v, a])

    y = solve_ivp(slope, times[[0, -1]], np.concatenate([q, v]), "DOP853", times, rtol=1e-11, atol=1e-12).y.T
    return y[:, : robot.model.nq], y[:, robot.model.nq :]
