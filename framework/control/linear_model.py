"""The linear model of a robot, rigid or elastic, about its planned motion, regular at Type 2.

Let y = (x, e) be platform coordinates and deflections, and T = dq/dy. The changes of the forces along
motions with closed loops (`driven_force_changes`) give, for small deviations from the plan,

    E_2 y" + E_1 y' + E_0 y = B tau + f theta,        E_k = T' d(force)_k,        B = T' S' n,

where S selects the motors, n is the gear ratio, and theta are unknown constants: an error of the payload, of
dry friction, of springs, of gravity, of torques. E_2 is singular if links have no mass. Therefore the
coordinates are w = (x, q_m, e_o) = W y: the platform, joints of motors in the place of as many deflections,
and the other deflections. With massless links, these move no mass at constant (x, q_m). With V = W^-1,

    M = V' E_2 V,        D = V' (E_1 V + 2 E_2 V'),        K = V' (E_0 V + E_1 V' + E_2 V"),

where V' and V" behind E are time derivatives, V' = -V W' V, V" = -V (W" V + 2 W' V'). Coordinates l that are
together too fast for the sampling period, massless ones among them, are in static balance with the
coordinates h that stay: l = L_h h + L_t tau + L_f theta from the rows K_lh h + K_ll l = B_l tau + f_l theta.
The state is (h, h', theta).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.control.reference import Reference
from framework.control.variations import scale_payload
from framework.dynamics.forces import driven_force_changes, tree_forces
from framework.errors import InvalidInput, check_choice
from framework.kinematics.motion_rates import MotionChanges, coordinate_changes
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, IntArray, ReadOnlyArrays
from framework.numerics.ordered_sums import matmul
from framework.tolerances import RANK_LOST, RANK_ROUNDING

DISTURBANCES = ("payload", "friction", "springs", "gravity", "torque")
# of the sampling rate: coordinates in static balance vibrate faster. At 3, vibrations of half of the sampling
# rate, the fastest that samples tell apart, change by 1.4 %
LEAST_BALANCED_SHARE = 3.0
CHOICE_INSTANTS = 9  # at which coordinates are chosen
SMALL_CHANGE = 0.01  # of the payload, in which forces are linear


class CoordinateChoice(NamedTuple):
    """The coordinates w = (x, q_m, e of the others), and which of them stay in the model."""

    motors: IntArray  # indices of the motors whose joints are coordinates
    others: IntArray  # indices of the deflections that are coordinates
    kept: IntArray  # indices of w: h
    balanced: IntArray  # indices of w: l


@dataclass(frozen=True, eq=False)
class LinearModel(ReadOnlyArrays):
    """Deviations z = (h, h', theta) (N,) from the plan at K sampling instants: z' = A z + B tau.

    h are platform coordinates [m, rad], then the joints `columns`. F and G advance z by one period.
    """

    choice: CoordinateChoice
    columns: IntArray  # (m - n,) joints in h behind the platform
    kinds: tuple[str, ...]  # of DISTURBANCES
    names: tuple[str, ...]  # (p,) of theta: payload, friction of a motor, ...
    A: Array  # (K, N, N)
    B: Array  # (K, N, n_a)
    F: Array  # (K, N, N)
    G: Array  # (K, N, n_a)
    joints: Array  # (K, nv, N) deviations of all joints by z
    joints_by_torque: Array  # (K, nv, n_a) and by torques, of deflections in static balance

    @property
    def m(self) -> int:
        """Number of coordinates h."""
        return (self.A.shape[1] - len(self.names)) // 2


class _Equations(NamedTuple):
    """M w" + D w' + K w = B tau at T instants, for d coordinates w, or for the m coordinates h."""

    M: Array  # (T, d, d)
    D: Array  # (T, d, d)
    K: Array  # (T, d, d)
    B: Array  # (T, d, n_a)


def linearise_plan(
    reference: Reference, disturbances: tuple[str, ...] = (), *, like: LinearModel | None = None
) -> LinearModel:
    """Compute the linear model about a plan, with the disturbances theta of some kinds.

    Args:
        reference: plan at the sampling instants.
        disturbances: kinds of DISTURBANCES.
        like: a model of another robot of the same structure, whose coordinates are taken.

    Raises:
        InvalidInput: unknown kind; a motion of the platform moves no mass.
        NotAssembled: the platform does not determine the joints at some instant (Type 1).
    """
    return linearise_variants(reference, disturbances, [reference.robot.stiffness], like=like)[0]


def linearise_variants(
    reference: Reference,
    disturbances: tuple[str, ...],
    stiffnesses: Sequence[Array],
    *,
    like: LinearModel | None = None,
) -> list[LinearModel]:
    """Compute the linear models of robots that differ in the stiffness (n_e,) of their springs alone.

    Only E_0 and the forces of spring errors depend on it. See `linearise_plan`; without `like` the
    coordinates are those of the first robot.
    """
    robot, motion = reference.robot, reference.motion
    joint_torque = robot.gear_ratio * reference.torque - (robot.rotors * motion.a)[:, robot.actuated]
    rates = (reference.x, reference.dx, reference.ddx)
    steps = np.concatenate([robot.elastic, robot.structure.idle])
    changes = coordinate_changes(robot, motion, steps, rates)
    r = tree_forces(robot, motion)
    force_changes = driven_force_changes(robot, motion, r, joint_torque, changes)
    d = robot.n + robot.n_e  # coordinates y; the other steps are those of idle joints, which rest
    changes = MotionChanges(*(change[..., :d, :] for change in changes))
    E = matmul(changes.q, force_changes[:, :, :d].swapaxes(2, 3))  # (3, K, d, d)
    names, forces = _disturbance_forces(reference, r, changes, disturbances)  # (K, d, p) on y
    deflections = changes.q[..., robot.elastic]  # (K, d, n_e)
    models: list[LinearModel] = []
    for stiffness in stiffnesses:
        varied = E.copy()
        varied[0] += (deflections * (stiffness - robot.stiffness)) @ deflections.swapaxes(1, 2)
        of_springs = dict(zip(robot.elastic_names, stiffness / robot.stiffness, strict=True))
        factors = [of_springs.get(name.removeprefix("spring "), 1.0) for name in names]
        like = like or (models[0] if models else None)
        choice = like.choice if like else _choose_coordinates(reference, varied, changes)
        models.append(_reduce(reference, disturbances, names, varied, forces * factors, changes, choice))
    return models


def _reduce(
    reference: Reference,
    disturbances: tuple[str, ...],
    names: tuple[str, ...],
    E: Array,
    forces: Array,
    changes: MotionChanges,
    choice: CoordinateChoice,
) -> LinearModel:
    """Compute the model in the coordinates chosen, of equations E (3, K, d, d) and forces (K, d, p) of y.

    F and G advance z by one period, with A and B in its middle and constant torque. They are parts of the
    exponential of [A, B; 0, 0].
    """
    from scipy.linalg import expm

    robot, d = reference.robot, E.shape[2]
    equations, V = _transform(reference, E, changes, choice)
    h, b = choice.kept, choice.balanced  # b: indices of l
    condensed, L_h, L_t = _condense(equations, h, b)

    f = V.swapaxes(1, 2) @ forces  # on w
    L_f = np.linalg.solve(equations.K[:, b[:, None], b], f[:, b])
    f_h = f[:, h] - equations.K[:, h[:, None], b] @ L_f

    count, m, n_a = condensed.B.shape
    N = 2 * m + len(names)
    generator = np.zeros((count, N + n_a, N + n_a))  # [A, B; 0, 0]
    generator[:, :m, m : 2 * m] = np.eye(m)
    by_state_and_torque = np.concatenate([-condensed.K, -condensed.D, f_h, condensed.B], axis=2)
    generator[:, m : 2 * m] = np.linalg.inv(condensed.M) @ by_state_and_torque
    middle = np.concatenate([0.5 * (generator[:-1] + generator[1:]), generator[-1:]])
    transition = expm(middle * reference.period)

    # joints by z: w = (h, l) by z, y = V w, dq = T y
    w_by_z = np.zeros((count, d, N))
    w_by_z[:, h, :m] = np.eye(m)
    w_by_z[:, b, :m] = L_h
    w_by_z[:, b, 2 * m :] = L_f
    joints_by_w = changes.q.swapaxes(1, 2) @ V  # (K, nv, d)
    joints = np.concatenate([robot.actuated[choice.motors], robot.elastic[choice.others]])
    return LinearModel(
        choice=choice,
        columns=joints[h[robot.n :] - robot.n],
        kinds=disturbances,
        names=names,
        A=generator[:, :N, :N],
        B=generator[:, :N, N:],
        F=transition[:, :N, :N],
        G=transition[:, :N, N:],
        joints=joints_by_w @ w_by_z,
        joints_by_torque=joints_by_w[:, :, b] @ L_t,
    )


def _transform(
    reference: Reference, E: Array, changes: MotionChanges, choice: CoordinateChoice
) -> tuple[_Equations, Array]:
    """Transform the equations E (3, T, d, d) of y to coordinates w; return them and V (T, d, d) = dy/dw."""
    robot = reference.robot
    n = robot.n
    joints = robot.actuated[choice.motors]
    W = np.zeros((3, *E.shape[1:]))  # W and its two time derivatives
    W[0, :, range(n), range(n)] = 1.0
    rows = slice(n, n + len(joints))
    for order, rate in enumerate((changes.q, changes.v, changes.accelerations[0])):
        W[order, :, rows] = rate[..., joints].swapaxes(1, 2)
    W[0, :, range(rows.stop, W.shape[2]), n + choice.others] = 1.0
    V = np.linalg.inv(W[0])
    dV = -V @ W[1] @ V
    ddV = -V @ (W[2] @ V + 2 * W[1] @ dV)
    VT = V.swapaxes(1, 2)
    equations = _Equations(
        M=VT @ E[2] @ V,
        D=VT @ (E[1] @ V + 2 * E[2] @ dV),
        K=VT @ (E[0] @ V + E[1] @ dV + E[2] @ ddV),
        B=VT @ (robot.gear_ratio * changes.q[..., robot.actuated]),
    )
    return equations, V


def _condense(equations: _Equations, h: IntArray, b: IntArray) -> tuple[_Equations, Array, Array]:
    """Eliminate the coordinates l, `b`, in static balance, l = L_h h + L_t tau.

    Their mass moves along with h as in static balance (Guyan), and is zero for massless links.

    Returns:
        The equations of h, and L_h (T, d - m, m) and L_t (T, d - m, n_a).
    """
    M, D, K, B = equations
    hh, hb, bh, bb = (np.ix_(np.arange(len(M)), rows, columns) for rows in (h, b) for columns in (h, b))
    L_h = np.asarray(-np.linalg.solve(K[bb], K[bh]), float)
    L_t = np.asarray(np.linalg.solve(K[bb], B[:, b]), float)
    L_hT = L_h.swapaxes(1, 2)

    def reduce_along_balance(matrix: Array) -> Array:
        """Return a matrix for motions h with l = L_h h."""
        along: Array = matrix[hh] + matrix[hb] @ L_h + L_hT @ (matrix[bh] + matrix[bb] @ L_h)
        return along

    equations = _Equations(
        M=reduce_along_balance(M),
        D=reduce_along_balance(D),
        K=K[hh] + K[hb] @ L_h,
        B=B[:, h] - K[hb] @ L_t,
    )
    return equations, L_h, L_t


def _choose_coordinates(reference: Reference, E: Array, changes: MotionChanges) -> CoordinateChoice:
    """Choose the coordinates w, and which are in static balance, at CHOICE_INSTANTS of the plan.

    All motors that deflections move are coordinates. Static balance leaves out the inertia of l at rest of h:
    it changes the square of a vibration's frequency f by about (f / f_l)^2 of it, where f_l is that of the
    slowest vibration of l with h at rest (Guyan). Coordinates that are each fast alone may be slow together:
    the joints of a delta's arms vibrate at 222 Hz, none of them alone below 1000 Hz. Therefore coordinates
    are added to l, the fastest alone first, as long as f_l stays above LEAST_BALANCED_SHARE of the sampling
    rate.
    """
    robot = reference.robot
    n = robot.n
    spread = np.unique(np.linspace(0, len(E[0]) - 1, CHOICE_INSTANTS).astype(int))
    E = E[:, spread]
    changes = MotionChanges(changes.q[spread], changes.v[spread], changes.accelerations[:, spread])
    motors, others = _motors_of_springs(robot, changes)
    none = np.arange(0)
    equations, _ = _transform(reference, E, changes, CoordinateChoice(motors, others, none, none))
    M, K = equations.M, equations.K
    period = reference.period / (2 * np.pi * LEAST_BALANCED_SHARE)  # [s/rad] 1 / (2 pi f_l), at most
    alone = np.einsum("tii->ti", M)[:, n:] / np.einsum("tii->ti", K)[:, n:]  # (T, d - n) [s^2/rad^2]
    balanced: list[int] = []
    for index in n + np.argsort(np.abs(alone).max(axis=0), kind="stable"):
        rows = np.array([*balanced, index])
        block = np.ix_(np.arange(len(M)), rows, rows)
        squares = np.linalg.eigvals(np.linalg.solve(K[block], M[block]))  # (T, l) 1 / (2 pi f_l)^2
        if np.abs(squares).max() > period**2:
            break
        balanced.append(int(index))
    b = np.array(sorted(balanced), dtype=np.intp)
    choice = CoordinateChoice(motors, others, np.setdiff1d(np.arange(M.shape[1]), b), b)
    mass = _condense(equations, choice.kept, choice.balanced)[0].M  # (T, m, m), singular if a motion has none
    size = np.sqrt(np.abs(np.einsum("tii->ti", mass)))
    scaled = mass / np.maximum(size[:, :, None] * size[:, None], np.finfo(float).tiny)
    if np.linalg.svd(scaled, compute_uv=False)[:, -1].min() < RANK_ROUNDING:
        raise InvalidInput(
            f"{robot.name}, {robot.flexibility}: some motion of the platform moves no mass, so that torques "
            f"do not tell its acceleration"
        )
    return choice


def _motors_of_springs(robot: ParallelRobot, changes: MotionChanges) -> tuple[IntArray, IntArray]:
    """Choose motors whose joints deflections move independently, and list the remaining deflections.

    The motors replace k deflections, chosen so that W is as far from singular as possible at the worst of the
    T instants. The other deflections stay coordinates.
    """
    from scipy.linalg import qr

    if not robot.n_e:
        return np.arange(0), np.arange(0)
    G = changes.q[:, robot.n :, robot.actuated] * robot.column_scale[robot.elastic, None]  # (T, n_e, n_a)
    G = G / robot.column_scale[robot.actuated]
    R, pivots = qr(G[len(G) // 2], mode="r", pivoting=True)
    size = np.abs(np.diagonal(R))
    motors = np.sort(pivots[: np.count_nonzero(size > RANK_LOST * size.max())])
    G = G[:, :, motors]  # (T, n_e, k)

    def clearance(rows: tuple[int, ...]) -> float:
        return float(np.linalg.svd(G[:, list(rows)], compute_uv=False).min(initial=np.inf))

    candidates = {tuple(sorted(qr(g.T, mode="r", pivoting=True)[1][: len(motors)])) for g in G}
    replaced = max(sorted(candidates), key=clearance)
    return motors, np.setdiff1d(np.arange(robot.n_e), replaced)


# ------------------------------------------------------------------ disturbances


def _disturbance_forces(
    reference: Reference, r: Array, changes: MotionChanges, kinds: tuple[str, ...]
) -> tuple[tuple[str, ...], Array]:
    """Compute the generalised forces f (K, d, p) on y of unit disturbances, and their names (p,).

    The tree's forces along the plan are r (K, nv). Units are shares: of the payload's inertia, of the peak
    torque (dry friction, torque), of the stiffness of a spring; gravity is in m/s^2 on base axes.
    """
    robot, motion = reference.robot, reference.motion
    for kind in kinds:
        check_choice("disturbances", kind, DISTURBANCES)
    peak = reference.peak_torque
    names: list[str] = []
    forces: list[Array] = []  # (K, nv, k) that act on the joints
    if "payload" in kinds:
        heavier = replace(robot, model=scale_payload(robot, 1 + SMALL_CHANGE))
        change = tree_forces(heavier, motion) - r
        names.append("payload")
        forces.append(-change[:, :, None] / SMALL_CHANGE)
    if "friction" in kinds:
        names += [f"friction {name}" for name in robot.actuator_names]
        forces.append(_motor_forces(robot, -peak * np.tanh(reference.motor_speed / reference.friction_speed)))
    if "springs" in kinds:
        deflections = robot.coordinates.positions(motion.q)[:, robot.elastic]  # (K, n_e)
        of_springs = np.zeros((len(deflections), robot.nv, robot.n_e))
        of_springs[:, robot.elastic, range(robot.n_e)] = -robot.stiffness * deflections
        names += [f"spring {name}" for name in robot.elastic_names]
        forces.append(of_springs)
    if "gravity" in kinds:
        names += [f"gravity {axis}" for axis in "xyz"]
        for axis in np.eye(3):  # of unit gravity
            model = robot.model.copy()
            model.gravity.linear = axis
            data = model.createData()
            weight = [-pin.computeGeneralizedGravity(model, data, q) for q in motion.q]
            forces.append(np.array(weight)[:, :, None])
    if "torque" in kinds:
        names += [f"torque {name}" for name in robot.actuator_names]
        forces.append(_motor_forces(robot, np.tile(peak, (len(motion.q), 1))))
    none = np.zeros((len(motion.q), robot.nv, 0))
    return tuple(names), changes.q @ np.concatenate([none, *forces], axis=2)


def _motor_forces(robot: ParallelRobot, torque: Array) -> Array:
    """Return the joint forces (K, nv, n_a) of each motor's torque (K, n_a) alone, motor side."""
    forces = np.zeros((len(torque), robot.nv, robot.n_a))
    forces[:, robot.actuated, range(robot.n_a)] = robot.gear_ratio * torque
    return forces
