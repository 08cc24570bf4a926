"""Forward dynamics as one writes them with pinocchio's contacts, and scipy or a Runge-Kutta method.

Nothing of the framework: it gives the model, the names of frames and the start. For robots without springs at
their joints.
"""

from collections.abc import Callable

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

from framework import ParallelRobot
from framework.numerics import Array

MOST_CALLS = 20_000  # of the right-hand side
PROXIMAL = (1e-12, 1e-12, 1e-8, 20)  # settings with which planar loops are sound in 3D

Torque = Callable[[Array], Array]  # times (T,) [s] -> motor torques (T, n_a) [N m]


def _slope(robot: ParallelRobot) -> Callable[[Array, Array], Array]:
    """d(q, v)/dt (2 nv,) at (q, v) under joint forces (nv,), by constraintDynamics, a 3D contact a loop."""
    model = robot.model.copy()
    model.armature[robot.actuated] = robot.gear_ratio**2 * robot.rotor_inertia
    contacts, contact_data = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    for closure in robot.description.closures:
        one, other = (model.frames[model.getFrameId(name)] for name in closure.frames)
        ends = (one.parentJoint, one.placement, other.parentJoint, other.placement)
        contact = pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, model, *ends, pin.ReferenceFrame.LOCAL)
        contacts.append(contact)
        contact_data.append(contact.createData())
    data, settings = model.createData(), pin.ProximalSettings(*PROXIMAL)
    pin.initConstraintDynamics(model, data, contacts, contact_data)
    nv = model.nv

    def slope(y: Array, force: Array) -> Array:
        a = pin.constraintDynamics(model, data, y[:nv], y[nv:], force, contacts, contact_data, settings)
        return np.concatenate([y[nv:], a])

    return slope


def _joint_forces(robot: ParallelRobot, torque: Array) -> Array:
    """Generalised forces (T, nv) of motor torques (T, n_a)."""
    forces = np.zeros((len(torque), robot.model.nv))
    forces[:, robot.actuated] = robot.gear_ratio * torque
    return forces


def runge_kutta(robot: ParallelRobot, torque: Torque, start: Array, times: Array) -> Array:
    """Joints (T, nv) at equidistant times (T,), from rest at `start` (nv,), by RK4."""
    slope, h = _slope(robot), float(times[1])
    forces = _joint_forces(robot, torque(np.linspace(0.0, times[-1], 2 * len(times) - 1)))
    y, states = np.concatenate([start, np.zeros_like(start)]), [start]
    for k in range(len(times) - 1):
        early, middle, late = forces[2 * k : 2 * k + 3]
        k1 = slope(y, early)
        k2 = slope(y + 0.5 * h * k1, middle)
        k3 = slope(y + 0.5 * h * k2, middle)
        k4 = slope(y + h * k3, late)
        y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        states.append(y[: len(start)])
    return np.array(states)


def dop853(robot: ParallelRobot, torque: Torque, start: Array, times: Array, *, tolerance: float) -> Array:
    """Joints (T, nv) at times (T,), from rest at `start` (nv,), by scipy's DOP853 to a relative tolerance.

    Raises:
        ArithmeticError: it gives up, or calls too often.
    """
    slope, calls = _slope(robot), 0

    def rate(t: float, y: Array) -> Array:
        nonlocal calls
        calls += 1
        if calls > MOST_CALLS:
            raise ArithmeticError(f"DOP853: no end after {MOST_CALLS} calls, at t = {t:.6g} s")
        return slope(y, _joint_forces(robot, torque(np.array([t])))[0])

    y = np.concatenate([start, np.zeros_like(start)])
    span, absolute = (0.0, times[-1]), 1e-2 * tolerance
    solved = solve_ivp(rate, span, y, "DOP853", rtol=tolerance, atol=absolute, t_eval=times)
    if not solved.success:
        raise ArithmeticError(solved.message)
    return np.asarray(solved.y[: len(start)].T)
