"""Stiffness of the platform with locked motors, and its free vibrations, at rest and under load.

The motors locked, springs and loops leave the motions dq = Z dz, Z spanning the null space of the loop
equations c along the elastic and the passive joints. With the energy V of springs and weight, the forces w of
the world on the platform and the forces lambda in the loops, the tangent stiffness along them is

    H = Z' (d2V/dq2 - lambda . d2c/dq2 - w . d2x/dq2) Z,        M = Z' (mass matrix) Z:

springs alone (V's part K) without load, and the geometric stiffness of weight, w and lambda beside them under
load. A platform motion v = X dz takes the least energy of all dz that give it:

    v' K_x v = min { dz' H dz : X dz = v },        compliance = X H^-1 X' = K_x^-1.

Nothing here divides by A. At a Type 2 singularity a motion that stretches no spring moves the platform, along
t_s: without load K_x, H and M stay finite, K_x t_s = 0, the compliance along t_s is infinite and the first
frequency 0; under load what is left along t_s is the geometric stiffness alone, which may hold or buckle.

Source: Quennouelle and Gosselin, Stiffness Matrix of Compliant Parallel Mechanisms, ARK 2008; the elimination
by a null space as Briot and Khalil, Dynamics of Parallel Robots, Springer 2015, chapter 12, for Z.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.dynamics.tangent_stiffness import (
    Load,
    balance,
    check_wrench,
    factor_transposed,
    moving_columns,
    tangent_stiffness,
)
from framework.errors import InvalidInput, NotConverged
from framework.kinematics.frames import difference, integrate_columns
from framework.kinematics.linearised_loops import LinearisedLoops, assembled_at
from framework.kinematics.loop_matrices import scaled_loops
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.kinematics.pinocchio_memory import scratch_of
from framework.numerics.arrays import Array, ArrayLike, BoolArray, IntArray, ReadOnlyArrays
from framework.numerics.ordered_sums import matmul
from framework.tolerances import (
    EIGENVALUE_ROUNDING,
    LOOP_GAP,
    MAX_DEFLECTION,
    NEWTON_STEP,
    RANK_ROUNDING,
)

MAX_NEWTON_STEPS = 200  # of Newton's method for the equilibrium; quadratic once it is near
MAX_STEP = 0.1  # [rad, robot lengths] of that method: deflections of springs that mean something are smaller
SHIFTS = (1.0, 1e3, 1e6)  # of H by S, over their traces' ratio: a negative H under load asks for a larger one
MIN_EIGENVALUE_RATIO = 1e-8  # over the largest eigenvalue of H: flatter directions count as that steep


class CompliantMotions(NamedTuple):
    """The motions that springs and loops allow at T configurations while the motors are locked."""

    columns: IntArray  # (f,) of the velocity vector: elastic, then passive ones that follow
    Z: Array  # (T, f, d) orthonormal in radians and robot lengths, then turned back
    X: Array  # (T, n, d) the platform's twist on its axes
    K: Array  # (T, d, d) of the springs alone
    M: Array  # (T, d, d) of all bodies; rotors rest


def require_springs(robot: ParallelRobot) -> None:
    """Raise InvalidInput for a robot that nothing makes give way."""
    if not (robot.n_e or robot.joint_stiffness.any()):
        raise InvalidInput(
            f"{robot.name}, {robot.flexibility}: no springs, so the platform does not give way; load it with "
            f"flexible_joints or flexible_links"
        )


def compliant_motions(robot: ParallelRobot, linearised: LinearisedLoops, q: Array) -> CompliantMotions:
    """Compute motions, stiffness of the springs and mass at configurations q (T, nq).

    Raises:
        InvalidInput: a robot without springs: use --flexibility flexible_joints or flexible_links.
    """
    require_springs(robot)
    columns = moving_columns(robot)
    null = factor_transposed(scaled_loops(robot, linearised)[:, :, columns])[2]
    Z = null * robot.column_scale[columns][:, None]
    stiffness = robot.all_stiffness[columns]
    mass = mass_matrices(robot, q)[:, columns[:, None], columns]
    transposed = Z.swapaxes(1, 2)
    return CompliantMotions(
        columns=columns,
        Z=Z,
        X=matmul(linearised.platform[:, :, columns], Z),
        K=matmul(transposed * stiffness, Z),
        M=matmul(transposed, matmul(mass, Z)),
    )


def least_ratios(H: Array, S: Array) -> Array:
    """Compute the least z' H z / z' S z (T,), S positive semidefinite; NaN without one.

    With H + sigma S positive definite, the least is 1 / mu - sigma, mu the largest eigenvalue of S relative
    to H + sigma S. So neither H is inverted, which is singular at Type 2, nor S, which is singular where
    bodies have no mass.
    """
    least = np.full(len(H), np.nan)
    size_H = np.abs(np.trace(H, axis1=1, axis2=2))
    size_S = np.trace(S, axis1=1, axis2=2)
    for factor in SHIFTS:
        todo = np.flatnonzero(np.isnan(least) & (size_S > 0))
        if not len(todo):
            break
        sigma = factor * size_H[todo] / size_S[todo]
        shifted = H[todo] + sigma[:, None, None] * S[todo]
        positive = np.linalg.eigvalsh(shifted)[:, 0] > 0
        rows = todo[positive]
        inverse = np.linalg.inv(np.linalg.cholesky(shifted[positive]))
        relative = matmul(matmul(inverse, S[rows]), inverse.swapaxes(1, 2))  # L^-1 S L'^-1
        mu = np.linalg.eigvalsh(relative)[:, -1]
        least[rows] = 1.0 / mu - sigma[positive]
    return least


def least_stiffness(robot: ParallelRobot, free: CompliantMotions) -> Array:
    """Compute the stiffness (T,) [N/m] of the platform's point in its softest direction, 0 at Type 2.

    Of a platform that only turns moment over turn [N m/rad].
    """
    loaded = robot.translations if robot.translations.any() else ~robot.translations
    X = free.X[:, loaded]
    return np.maximum(least_ratios(free.K, matmul(X.swapaxes(1, 2), X)), 0.0)


def locked_motor_frequency(free: CompliantMotions) -> Array:
    """Compute the first natural frequency (T,) [Hz] with locked motors, 0 at Type 2; NaN if nothing has mass.

    With motors free to turn: `dynamics.vibrations.free_motor_frequency`.
    """
    return np.sqrt(np.maximum(least_ratios(free.K, free.M), 0.0)) / (2 * np.pi)


@dataclass(frozen=True, eq=False)
class PlatformStiffness(ReadOnlyArrays):
    """Stiffness and free vibrations of a robot at one configuration, its motors locked.

    Twists and wrenches on the platform's axes, base frame, at the platform frame's origin. Joint side.
    """

    robot: ParallelRobot
    q: Array  # (nq,) with the deflections of the load
    x: Array  # (n,)
    stiffness: Array  # (n, n) K_x [N/m, N/rad, N m/rad], finite at Type 2 too
    compliance: Array  # (n, n) its inverse; infinite where it has none
    squares: Array  # (k,) rad^2/s^2 ascending; negative where a load buckles the robot; massless motions not
    modes: Array  # (k, nv) joint rates of each; its generalised mass is 1 kg m^2
    platform_modes: Array  # (k, n) the platform's twist in each
    loaded: bool
    is_stable: bool  # whether every motion with locked motors is resisted, of the platform or of a leg alone

    @property
    def frequencies(self) -> Array:
        """Natural frequencies (k,) [Hz]; NaN for a motion that buckles."""
        with np.errstate(invalid="ignore"):
            return np.sqrt(self.squares) / (2 * np.pi)


def platform_stiffness(
    robot: ParallelRobot, q: ArrayLike, *, loaded: bool = False, wrench: ArrayLike | None = None
) -> PlatformStiffness:
    """Compute stiffness, compliance, natural frequencies and modes at an assembled configuration q (nq,).

    Args:
        loaded: under weight and `wrench`: the springs first give way, from q with locked motors, until they
            carry both; else at q, as if nothing pulled.
        wrench: of the world ON the platform, on its axes (n,) [N, N m]; a moment only about a single axis
            (others have no potential).

    Raises:
        InvalidInput: q leaves the loops open; a robot without springs, or with springs that leave the
            platform rigid along some axis; a wrench without `loaded`.
        NotConverged: there is no equilibrium near q.
    """
    expect_robot(robot)
    if wrench is not None and not loaded:
        raise InvalidInput("wrench: counts under load alone; give loaded=True")
    closed, load = assembled_at(robot, q), None
    if loaded:
        q, load = _find_equilibrium(robot, closed.q[0], wrench)
        closed = assembled_at(robot, q)
    free = compliant_motions(robot, closed.linearised, closed.q)
    H = free.K[0]
    if load is not None:
        H = tangent_stiffness(robot, closed.linearised, closed.q, free.Z, load)[0]
    squares, shapes = _vibrations(H, free.M[0])
    modes = np.zeros((len(shapes), robot.model.nv))
    modes[:, free.columns] = shapes @ free.Z[0].T
    stiffness = _condense(robot, H, free.X[0])
    return PlatformStiffness(
        robot=robot,
        q=closed.q[0],
        x=closed.x[0],
        stiffness=stiffness,
        compliance=_inverse(robot, stiffness),
        squares=squares,
        modes=modes,
        platform_modes=shapes @ free.X[0].T,
        loaded=loaded,
        is_stable=bool(np.linalg.eigvalsh(H).min(initial=np.inf) > 0),
    )


# ------------------------------------------------------------------ under load


def _find_equilibrium(robot: ParallelRobot, q: Array, wrench: ArrayLike | None) -> tuple[Array, Load]:
    """Minimise V - w . x with c = 0 from q (nq,); return the equilibrium and its load.

    Newton's method with the size of each eigenvalue in place of the eigenvalue itself, so that steps lead
    downhill where the robot buckles. If the robot snaps through, the equilibrium beyond is returned.
    """
    columns = moving_columns(robot)
    lengths = robot.column_scale[columns]
    load = Load(check_wrench(robot, wrench), np.ones(1), np.zeros((1, robot.model.nv)))
    size = np.inf
    for _ in range(MAX_NEWTON_STEPS):
        state = balance(robot, q[None], load)
        if size < NEWTON_STEP:
            if deflects_little(robot, q[None])[0] and state.gap[0] < LOOP_GAP:
                return q, load
            break
        values, vectors = np.linalg.eigh(state.H[0])
        sizes = np.abs(values)  # away from maxima and saddles
        downhill = np.maximum(sizes, MIN_EIGENVALUE_RATIO * sizes.max())
        along = vectors @ (vectors.T @ state.slope[0] / downhill)  # (d,) on the null space of the loops
        step = state.closing[0] - state.null[0] @ along
        size = float(np.abs(step).max())
        if not np.isfinite(size):
            break
        q = integrate_columns(robot, q, columns, step * min(1.0, MAX_STEP / max(size, MAX_STEP)) * lengths)
    raise NotConverged(
        f"{robot.name}: the springs find no equilibrium near this configuration: the load buckles the "
        f"robot, or deflects it by more than linear springs mean",
        residual=size,
    )


def deflects_little(robot: ParallelRobot, q: Array) -> BoolArray:
    """Whether the deflections of q (T, nq) are within the range of linear springs, (T,)."""
    deflections = (difference(robot, robot.neutral, q) / robot.column_scale)[:, robot.elastic]
    return np.abs(deflections).max(axis=1, initial=0.0) <= MAX_DEFLECTION


# ------------------------------------------------------------------ matrices


def mass_matrices(robot: ParallelRobot, q: Array) -> Array:
    """Compute the mass matrices (T, nv, nv) of the open tree, rotors not included."""
    model, data = robot.model, scratch_of(robot).data
    upper = np.empty((len(q), model.nv, model.nv))
    for k in range(len(q)):
        upper[k] = pin.crba(model, data, q[k])
    upper = np.triu(upper)
    return upper + np.triu(upper, 1).swapaxes(1, 2)


def _condense(robot: ParallelRobot, H: Array, X: Array) -> Array:
    """Compute the platform's stiffness K_x (n, n) from H along all motions and their twists X.

    v' K_x v = min { dz' H dz : X dz = v }. With R a right inverse of X and N its null space dz = R v + N y,
    and the least over y is K_x = R' (H - H N (N' H N)^-1 N' H) R.
    """
    scale = robot.platform_scale
    U, values, V_rows = np.linalg.svd(X / scale[:, None])
    if len(values) < len(X) or values[-1] <= RANK_ROUNDING * values[0]:
        raise InvalidInput(
            f"{robot.name}, {robot.flexibility}: the springs leave the platform rigid along some direction "
            f"while the motors are locked, so it has no stiffness matrix"
        )
    R = V_rows[: len(X)].T @ (U / values).T / scale  # (d, n) X R = 1
    N = V_rows[len(X) :].T  # (d, d - n) X N = 0
    forces = H @ R
    if N.size:
        forces = forces - H @ N @ np.linalg.solve(N.T @ H @ N, N.T @ H @ R)
    K = R.T @ forces
    return 0.5 * (K + K.T)


def _inverse(robot: ParallelRobot, K: Array) -> Array:
    """Compute the compliance (n, n), infinite in all entries that a direction without stiffness reaches."""
    scale = robot.platform_scale
    values, vectors = np.linalg.eigh(K * scale * scale[:, None])
    is_free = np.abs(values) <= EIGENVALUE_ROUNDING * np.abs(values).max()
    is_moved = np.abs(vectors[:, is_free]) > RANK_ROUNDING
    infinite = (is_moved[:, None] & is_moved[None]).any(axis=2)
    compliance = (vectors / np.where(is_free, np.inf, values)) @ vectors.T * scale * scale[:, None]
    return np.where(infinite, np.inf, compliance)


def _vibrations(H: Array, M: Array) -> tuple[Array, Array]:
    """Compute squared angular frequencies (k,) [rad^2/s^2], ascending, and shapes z (k, d) with z' M z = 1.

    Motions without mass follow the others at once and have no vibration of their own.
    """
    values, vectors = np.linalg.eigh(M)
    has_mass = (values > 0.0) & (values > RANK_ROUNDING * values[-1])
    massive = vectors[:, has_mass] / np.sqrt(values[has_mass])  # (d, k) of unit mass
    light = vectors[:, ~has_mass]
    if light.shape[1] and massive.shape[1]:  # motions y without mass follow with the least energy
        y = np.linalg.lstsq(light.T @ H @ light, light.T @ H @ massive, rcond=None)[0]
        massive = massive - light @ y
    squares, shapes = np.linalg.eigh(massive.T @ H @ massive)
    is_rounding = np.abs(squares) <= EIGENVALUE_ROUNDING * np.abs(squares).max(initial=0.0)
    return np.where(is_rounding, 0.0, squares), (massive @ shapes).T
