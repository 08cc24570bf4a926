"""Forward dynamics with all coordinates: an independent witness of planned torques.

Torques that come out of an inverse dynamics go in here, and the robot must come back along the
planned path. Nothing is shared with the inverse dynamics under test: no choice of independent
coordinates, no inversion of A, no condition at the crossing. At every instant one solves

    [ M  J' ] [   a    ]   [ f - h  ]        M (nv, nv) mass matrix, rotors included; f motors and springs
    [ J  0  ] [ -force ] = [ -drift ]        J (nc, nv) closure rows, J a + drift = 0

which is regular at a Type 2 singularity: there the passive columns of J lose rank, not J itself.
The constraints enter by their second derivative only (index 1); each output is the state of the
integration itself, neither stabilised nor projected, so that the drift is part of the testimony.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp

from framework import ParallelRobot
from tests.oracles.closure_rows import ClosureRows, closure_rows, independent, range_rows

FRAME_AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
Rows = Callable[[pin.Data], ClosureRows]  # the independent closure rows at the state of the data
Force = Callable[[float, np.ndarray], np.ndarray]  # t, q -> generalised forces (nv,), joint side


def kinematics(model: pin.Model, data: pin.Data, q: np.ndarray, v: np.ndarray) -> None:
    """Bring `data` to the state that closure rows are read from."""
    pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)


def mass_matrix(model: pin.Model, data: pin.Data, q: np.ndarray) -> np.ndarray:
    """The mass matrix without rotors (nv, nv); crba is sure to fill its upper half only."""
    mass = np.triu(pin.crba(model, data, q))
    return mass + np.triu(mass, 1).T


def accelerations(mass: np.ndarray, force: np.ndarray, rows: ClosureRows) -> tuple[np.ndarray, np.ndarray]:
    """Accelerations (nv,) and closure forces (m,) of the system above."""
    nv, (m, _) = len(mass), rows.jacobian.shape
    kkt = np.zeros((nv + m, nv + m))
    kkt[:nv, :nv] = mass
    kkt[:nv, nv:] = rows.jacobian.T
    kkt[nv:, :nv] = rows.jacobian
    solution = np.linalg.solve(kkt, np.concatenate([force, -rows.drift]))
    return solution[:nv], -solution[nv:]


def integrate(
    slope: Callable[[float, np.ndarray], np.ndarray],
    start: float,
    end: float,
    state: np.ndarray,
    *,
    rtol: float,
    atol: float,
    longest_step: float = np.inf,
) -> np.ndarray:
    """The state at the end of an interval.

    `longest_step` [s] keeps the first guess of a stiff system within reach of the error control.

    Raises:
        ArithmeticError: DOP853 gives up.
    """
    solution = solve_ivp(slope, (start, end), state, "DOP853", rtol=rtol, atol=atol, max_step=longest_step)
    if not solution.success:
        raise ArithmeticError(f"integration stopped in [{start}, {end}] s: {solution.message}")
    return solution.y[:, -1]


def simulate_tree(
    model: pin.Model,
    *,
    rows: Rows,
    force: Force,
    armature: ArrayLike,
    q0: ArrayLike,
    v0: ArrayLike,
    times: ArrayLike,
    rtol: float = 1e-13,
    atol: float = 1e-15,
    longest_step: float = np.inf,
    damping: ArrayLike = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Integrate a tree with closures under forces.

    Joints may be of any kind: between two outputs the state is the tangent offset u from the last
    output, q = q_k + u and u' = D(u)^-1 v with D the derivative of pinocchio's integrate.

    Args:
        model: the open tree, `model.armature` zero.
        rows: the independent closure rows; redundant ones make the system singular.
        force: t [s], q (nq,) -> motors and springs (nv,) [N m or N], joint side.
        armature: n^2 I_a of each column, (nv,) [kg m^2], zero where there is no motor.
        damping: viscous, (nv,) [N m s/rad, N s/m].
        q0, v0: assembled configuration (nq,) and a velocity (nv,) that the closures allow.
        times: output instants (T,) [s], increasing; the first is the instant of q0, v0. Where the
            force has a kink, a time should stand on it: each interval is integrated anew.
        rtol, atol: of DOP853, per step, on u [rad or m] and v alike.

    Returns:
        q (T, nq) and v (T, nv).
    """
    if np.any(model.armature):
        raise ValueError("model.armature is not zero: crba would count the rotors twice")
    data, nv = model.createData(), model.nv
    rotors = np.diag(np.asarray(armature, float))
    straight = model.nq == nv  # every joint a line: q' = v
    base = np.asarray(q0, float)  # the last output

    def slope(t: float, state: np.ndarray) -> np.ndarray:
        u, v = state[:nv], state[nv:]
        q = base + u if straight else pin.integrate(model, base, u)
        kinematics(model, data, q, v)
        closed = rows(data)
        load = force(t, q) - damping * v - pin.nonLinearEffects(model, data, q, v)
        a, _ = accelerations(mass_matrix(model, data, q) + rotors, load, closed)
        du = v if straight else np.linalg.solve(pin.dIntegrate(model, base, u, pin.ArgumentPosition.ARG1), v)
        return np.concatenate([du, a])

    times = np.asarray(times, float)
    q, v = [np.asarray(q0, float)], [np.asarray(v0, float)]
    for start, end in pairwise(times):
        base = q[-1]
        # Ending a step on every output keeps the order 8: the dense output has only 7.
        state = np.concatenate([np.zeros(nv), v[-1]])
        state = integrate(slope, start, end, state, rtol=rtol, atol=atol, longest_step=longest_step)
        q.append(pin.integrate(model, base, state[:nv]))
        v.append(state[nv:])
    return np.array(q), np.array(v)


def simulate_robot(
    robot: ParallelRobot,
    torque: Callable[[float], np.ndarray],
    *,
    q0: ArrayLike,
    times: ArrayLike,
    rtol: float = 1e-13,
    atol: float = 1e-15,
) -> tuple[np.ndarray, np.ndarray]:
    """Integrate any parallel robot from rest under motor torques t -> (n_a,) [N m], motor side.

    Of the robot only its tree, its index sets and the words of its file are taken. Every direction must
    carry inertia; see `tests.oracles.massless_simulation` for those that carry none.

    Returns:
        q (T, nq) and v (T, nv).
    """
    model, closures = robot.model, robot.description.closures
    data, rest = model.createData(), np.zeros(model.nv)
    kinematics(model, data, np.asarray(q0, float), rest)
    rank = len(independent(closure_rows(model, data, closures).jacobian))

    def rows(data: pin.Data) -> ClosureRows:
        jacobian, drift = closure_rows(model, data, closures)
        basis = range_rows(jacobian, rank)
        return ClosureRows(basis @ jacobian, basis @ drift)

    return simulate_tree(
        model,
        rows=rows,
        force=lambda t, q: springs(robot, q) + motors(robot, torque(t)),
        armature=rotors(robot),
        q0=q0,
        v0=rest,
        times=times,
        rtol=rtol,
        atol=atol,
        longest_step=longest_step(robot, times),
        damping=robot.joint_damping,
    )


def longest_step(robot: ParallelRobot, times: ArrayLike) -> float:
    """A two-hundredth of the motion [s] for springs, no bound for rigid robots."""
    return np.ptp(times) / 200 if robot.n_e else np.inf


def rotors(robot: ParallelRobot) -> np.ndarray:
    """n^2 I_a on the columns of the motors, (nv,) [kg m^2 or kg]."""
    armature = np.zeros(robot.model.nv)
    armature[robot.actuated] = robot.gear_ratio**2 * robot.rotor_inertia
    return armature


def motors(robot: ParallelRobot, torque: np.ndarray) -> np.ndarray:
    """Motor torques (n_a,) as generalised forces (nv,), joint side."""
    force = np.zeros(robot.model.nv)
    force[robot.actuated] = robot.gear_ratio * torque
    return force


def springs(robot: ParallelRobot, q: np.ndarray) -> np.ndarray:
    """Forces (nv,) of all springs: the elastic coordinates, and springs on joints of the URDF."""
    turned = pin.difference(robot.model, pin.neutral(robot.model), q)
    force = -robot.joint_stiffness * (turned - robot.joint_rest)
    force[robot.elastic] -= robot.stiffness * turned[robot.elastic]
    return force


def point_rows(
    model: pin.Model,
    data: pin.Data,
    closure_frames: Sequence[tuple[int, int]],
    closure_axes: Sequence[Sequence[int]],
) -> ClosureRows:
    """Rows of closures p_2 - p_1 = 0 [m] along some of the world's axes."""
    jacobian, drift = [], []
    for ends, axes in zip(closure_frames, closure_axes, strict=True):
        keep = list(axes)
        slope = [pin.getFrameJacobian(model, data, f, FRAME_AXES)[:3] for f in ends]
        jacobian.append((slope[1] - slope[0])[keep])
        bias = [pin.getFrameClassicalAcceleration(model, data, f, FRAME_AXES) for f in ends]
        drift.append((bias[1].linear - bias[0].linear)[keep])
    return ClosureRows(np.vstack(jacobian), np.concatenate(drift))


def forward_simulate(
    model: pin.Model,
    *,
    closure_frames: Sequence[tuple[int, int]],
    closure_rows: Sequence[Sequence[int]],
    actuated: Sequence[int],
    armature: ArrayLike,
    torque: Callable[[float], np.ndarray],
    q0: ArrayLike,
    v0: ArrayLike,
    times: ArrayLike,
    rtol: float = 1e-13,
    atol: float = 1e-15,
    damping: ArrayLike = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """`simulate_tree` for loops closed by points, written down by a robot's own test.

    Args:
        closure_frames: for each loop the two frame ids whose origins coincide.
        closure_rows: for each loop the world axes kept among (0, 1, 2), e.g. (0, 1) for a planar
            robot. Redundant rows make the system singular: the caller leaves them out.
        actuated: columns of v that carry a motor, (n_a,).
        torque: t [s] -> generalised forces on the actuated columns (n_a,) [N m or N], joint side
            (motor torque times gear ratio).
    """
    columns = list(actuated)

    def force(t: float, _: np.ndarray) -> np.ndarray:
        load = np.zeros(model.nv)
        load[columns] = torque(t)
        return load

    return simulate_tree(
        model,
        rows=lambda data: point_rows(model, data, closure_frames, closure_rows),
        force=force,
        armature=armature,
        q0=q0,
        v0=v0,
        times=times,
        rtol=rtol,
        atol=atol,
        damping=damping,
    )
