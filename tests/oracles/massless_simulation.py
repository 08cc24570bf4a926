"""Forward dynamics of robots with motions that move no mass: there springs and motors are in balance.

A spring at the end of a massless rod, or behind a motor whose rotor has no inertia, leaves directions W,
J W = 0 and M W = 0, in which nothing is accelerated. W' (inertia and gravity) vanishes with them, so the
equations of motion leave there

    W' (forces of the springs and the motors) = 0

an algebraic condition on the configuration. The state of the integration is what the masses do: phi and
phi', with phi a choice among the motor angles, the centres of mass and the directions of the principal
axes of inertia. At every instant

    1. q from  closures(q) = 0,  phi(q) = phi,  W' (springs and motors) = 0            by Newton's method
    2. v from  J v = 0,  Phi v = phi'                   its part along W moves no mass and is left out
    3. a from the equations of motion, with unit inertia along W, where no force is left; phi" = Phi a + ...

Closures are solved here, so they do not drift; the path of the masses is the testimony.
"""

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike
from scipy.linalg import null_space, qr

from framework import ParallelRobot
from tests.oracles.closure_rows import (
    WORLD_AXES,
    ClosureRows,
    closure_errors,
    closure_rows,
    cross,
    independent,
    range_rows,
)
from tests.oracles.forward_simulation import (
    accelerations,
    integrate,
    kinematics,
    longest_step,
    mass_matrix,
    motors,
    rotors,
    springs,
)

MASSLESS = 1e-12  # of the largest inertia of a closed motion
SETTLED = 1e-10  # [rad, m]: what the next step would mend is 1e-4 of it or less
STILL = 1e-9  # [m, 1] that a massive thing may move along a massless direction


def massless_directions(robot: ParallelRobot, q: np.ndarray) -> np.ndarray:
    """Closed motions (nv, r) at q that move no mass."""
    model = robot.model
    data = model.createData()
    kinematics(model, data, q, np.zeros(model.nv))
    closed = null_space(closure_rows(model, data, robot.description.closures).jacobian)
    mass = closed.T @ (mass_matrix(model, data, q) + np.diag(rotors(robot))) @ closed
    inertia, directions = np.linalg.eigh(mass)
    return closed @ directions[:, inertia < MASSLESS * inertia[-1]]


class Masses(NamedTuple):
    """Scalars phi that tell where the masses are, at one state."""

    value: np.ndarray  # (k,) [rad, m, 1]
    jacobian: np.ndarray  # (k, nv)
    drift: np.ndarray  # (k,) phi" when the joint accelerations are zero


class Witness:
    """The tree of a robot with a frame on each centre of mass, axes along the principal inertias."""

    def __init__(self, robot: ParallelRobot) -> None:
        self.robot = robot
        self.model = robot.model.copy()
        self.frames = []  # frame, and whether it matters how the body is turned
        for joint in range(1, self.model.njoints):
            inertia = self.model.inertias[joint]
            if inertia.mass > 0:
                axes = np.linalg.eigh(inertia.inertia)[1]
                axes[:, 2] *= np.linalg.det(axes)
                place = pin.SE3(axes, inertia.lever)
                frame = pin.Frame(f"masses of {joint}", joint, 0, place, pin.FrameType.OP_FRAME)
                self.frames.append((self.model.addFrame(frame, False), inertia.inertia.any()))
        self.data = self.model.createData()
        self.driven = np.array([c for c in robot.actuated if rotors(robot)[c] > 0], dtype=int)
        self.stiffness = robot.joint_stiffness.copy()
        self.stiffness[robot.elastic] += robot.stiffness

    def at(self, q: np.ndarray, v: np.ndarray) -> None:
        kinematics(self.model, self.data, q, v)

    def masses(self, q: np.ndarray) -> Masses:
        """All candidates for phi at the state that `at` was called with."""
        model, data = self.model, self.data
        value = [pin.difference(model, pin.neutral(model), q)[self.driven]]
        jacobian = [np.eye(model.nv)[self.driven]]
        drift = [np.zeros(len(self.driven))]
        for frame, extended in self.frames:
            J = pin.getFrameJacobian(model, data, frame, WORLD_AXES)
            spin = pin.getFrameVelocity(model, data, frame, WORLD_AXES).angular
            bias = pin.getFrameClassicalAcceleration(model, data, frame, WORLD_AXES)
            value.append(data.oMf[frame].translation)
            jacobian.append(J[:3])
            drift.append(bias.linear)
            for axis in data.oMf[frame].rotation.T if extended else ():
                value.append(axis)
                jacobian.append(-pin.skew(axis) @ J[3:])
                drift.append(cross(bias.angular, axis) + cross(spin, cross(spin, axis)))
        return Masses(np.concatenate(value), np.vstack(jacobian), np.concatenate(drift))

    def closed(self, rank: int) -> tuple[np.ndarray, ClosureRows]:
        """U' (rank, m) and the independent rows U'J of the state that `at` was called with."""
        jacobian, drift = closure_rows(self.model, self.data, self.robot.description.closures)
        basis = range_rows(jacobian, rank)
        return basis, ClosureRows(basis @ jacobian, basis @ drift)

    def choice(self, q: np.ndarray, rank: int) -> np.ndarray:
        """Indices of candidates that tell all motions of the masses, well apart, at q."""
        self.at(q, np.zeros(self.model.nv))
        closed = null_space(self.closed(rank)[1].jacobian)
        still = massless_directions(self.robot, q)
        jacobian = self.masses(q).jacobian
        fixed = np.flatnonzero(np.abs(jacobian @ still).max(axis=1, initial=0.0) < STILL)
        order = qr((jacobian[fixed] @ closed).T, mode="r", pivoting=True)[1]
        return np.sort(fixed[order[: closed.shape[1] - still.shape[1]]])

    def configuration(
        self, phi: np.ndarray, chosen: np.ndarray, *, drive: np.ndarray, rank: int, near: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """q (nq,) with the masses at phi and the springs in balance with `drive` (nv,), and W (nv, r) there.

        Raises:
            ArithmeticError: Newton's method does not settle.
        """
        model, closures = self.model, self.robot.description.closures
        q = near
        for _ in range(30):
            self.at(q, np.zeros(model.nv))
            masses = self.masses(q)
            basis, closed = self.closed(rank)
            moving = np.vstack([closed.jacobian, masses.jacobian[chosen]])
            still = null_space(moving)
            error = np.concatenate(
                [
                    basis @ closure_errors(model, self.data, closures),
                    masses.value[chosen] - phi,
                    still.T @ -(springs(self.robot, q) + drive) / self.stiffness.max(),
                ]
            )
            slope = np.vstack([moving, still.T * self.stiffness / self.stiffness.max()])
            step = -np.linalg.solve(slope, error)
            q = pin.integrate(model, q, step)
            if np.abs(step).max() < SETTLED:
                return q, still
        raise ArithmeticError(f"the springs find no balance: last step {np.abs(step).max():.1e} rad or m")


def simulate_massless(
    robot: ParallelRobot,
    torque: Callable[[float], np.ndarray],
    *,
    q0: ArrayLike,
    times: ArrayLike,
    rtol: float = 1e-11,
    atol: float = 1e-13,
) -> np.ndarray:
    """Integrate from rest under motor torques t -> (n_a,) [N m], motor side; gives q (T, nq).

    One choice of phi serves from one of the `times` to the next: they must be near enough that it tells the
    configuration all the way.
    """
    witness, model, closures = Witness(robot), robot.model, robot.description.closures
    near = np.asarray(q0, float)
    witness.at(near, np.zeros(model.nv))
    rank = len(independent(closure_rows(witness.model, witness.data, closures).jacobian))
    armature = np.diag(rotors(robot))
    rate = np.zeros(model.nv)
    q = [near]
    step = longest_step(robot, times)

    def slope(t: float, state: np.ndarray) -> np.ndarray:
        nonlocal near
        count = len(chosen)
        drive = motors(robot, torque(t))
        near, still = witness.configuration(state[:count], chosen, drive=drive, rank=rank, near=near)
        witness.at(near, np.zeros(model.nv))
        jacobian = witness.closed(rank)[1].jacobian
        v = velocity(jacobian, witness.masses(near).jacobian[chosen], state[count:])
        witness.at(near, v)
        closed = witness.closed(rank)[1]
        mass = mass_matrix(witness.model, witness.data, near) + armature
        mass += np.abs(mass).max() * still @ still.T
        load = springs(robot, near) + drive
        load -= pin.nonLinearEffects(witness.model, witness.data, near, v)
        masses = witness.masses(near)
        a, _ = accelerations(mass, load, closed)
        return np.concatenate([state[count:], masses.jacobian[chosen] @ a + masses.drift[chosen]])

    for start, end in pairwise(np.asarray(times, float)):
        chosen = witness.choice(near, rank)
        witness.at(near, rate)
        masses = witness.masses(near)
        state = np.concatenate([masses.value[chosen], masses.jacobian[chosen] @ rate])
        state = integrate(slope, start, end, state, rtol=rtol, atol=atol, longest_step=step)
        near, _ = witness.configuration(
            state[: len(chosen)], chosen, drive=motors(robot, torque(end)), rank=rank, near=near
        )
        witness.at(near, np.zeros(model.nv))
        jacobian = witness.closed(rank)[1].jacobian
        rate = velocity(jacobian, witness.masses(near).jacobian[chosen], state[len(chosen) :])
        q.append(near)
    return np.array(q)


def velocity(closed: np.ndarray, moving: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """The shortest v (nv,) with J v = 0 and Phi v = phi'."""
    right = np.concatenate([np.zeros(len(closed)), rate])
    return np.linalg.lstsq(np.vstack([closed, moving]), right, rcond=None)[0]
