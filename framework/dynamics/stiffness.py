"""Stiffness of the platform with locked motors, and free vibrations, at rest and under load.

With locked motors the springs and loops allow the motions dq = Z dz, where Z spans the null space of the loop
equations c along the elastic and passive joints. With the energy V of springs and weight, the external wrench
w on the platform and the forces lambda in the loops, tangent stiffness and mass along these motions are

    H = Z' (d2V/dq2 - lambda . d2c/dq2 - w . d2x/dq2) Z,        M = Z' (mass matrix) Z.

Without load H is the stiffness K of the springs alone. Under load the geometric stiffness of weight, w and
lambda is added. The stiffness K_x along a platform motion v is that of the motion dz of least energy:

    v' K_x v = min { dz' H dz : X dz = v },        compliance = X H^-1 X' = K_x^-1.

No formula divides by the velocity matrix A, so K_x, H and M are finite at a Type 2 singularity, where the
platform can move along t_s without stretching a spring. Without load K_x t_s = 0, the compliance along t_s is
infinite, and the first frequency is 0. Under load only the geometric stiffness remains along t_s; the robot
may hold or buckle.

Sources: Quennouelle and Gosselin, Stiffness Matrix of Compliant Parallel Mechanisms, ARK 2008; for the
elimination by a null space Z, Briot and Khalil, Dynamics of Parallel Robots, Springer 2015, chapter 12.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.dynamics.forces import mass_matrices
from framework.dynamics.tangent_stiffness import Load, check_wrench, evaluate_equilibrium, tangent_stiffness
from framework.errors import InvalidInput, NotConverged
from framework.kinematics.continuation.arclength import LOAD_STEP
from framework.kinematics.frames import difference, integrate, integrate_columns
from framework.kinematics.line_springs import Lines
from framework.kinematics.linearised_loops import LinearisedLoops, assembled_at, scaled_loops
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, ArrayLike, BoolArray, IntArray, ReadOnlyArrays
from framework.numerics.ordered_sums import factor_transposed, matmul, matvec
from framework.tolerances import (
    EIGENVALUE_ROUNDING,
    LOOP_GAP,
    MAX_DEFLECTION,
    NEWTON_STEP,
    RANK_ROUNDING,
)


class CompliantMotions(NamedTuple):
    """The motions that springs and loops allow at T configurations, with locked motors by default."""

    Z: Array  # (T, f, d) rates of unlocked joints; orthonormal if lengths are counted in robot lengths
    X: Array  # (T, n, d) twists of the platform on its axes
    K: Array  # (T, d, d) stiffness of the springs alone
    M: Array  # (T, d, d) mass of all bodies, and of rotors that move


def require_springs(robot: ParallelRobot) -> None:
    """Raise InvalidInput for a robot without springs."""
    if not robot.has_springs:
        raise InvalidInput(
            f"{robot.name}, {robot.flexibility}: no springs, so the platform does not give way; load it with "
            f"flexible_joints or flexible_links"
        )


def compliant_motions(
    robot: ParallelRobot, linearised: LinearisedLoops, q: Array, *, columns: IntArray | None = None
) -> CompliantMotions:
    """Compute the compliant motions with spring stiffness and mass at configurations q (T, nq).

    Args:
        columns: joints (f,) that move, by default all but those of the motors. Rotors count if they move.

    Raises:
        InvalidInput: a robot without springs.
    """
    require_springs(robot)
    columns = robot.unlocked if columns is None else columns
    _Q, _R, null = factor_transposed(scaled_loops(robot, linearised)[:, :, columns])
    Z = null * robot.column_scale[columns][:, None]
    stiffness = robot.all_stiffness[columns]
    mass = (mass_matrices(robot, q) + np.diag(robot.rotors))[:, columns[:, None], columns]
    transposed = Z.swapaxes(1, 2)
    of_lines = np.zeros((1, 1, 1))  # springs between points, without the geometric stiffness of their pull
    if robot.line_springs.names:
        between = Lines.of(robot, linearised.frames).stiffness[:, columns[:, None], columns]
        of_lines = matmul(transposed, matmul(between, Z))
    return CompliantMotions(
        Z=Z,
        X=matmul(linearised.platform[:, :, columns], Z),
        K=matmul(transposed * stiffness, Z) + of_lines,
        M=matmul(transposed, matmul(mass, Z)),
    )


def natural_frequencies(free: CompliantMotions, count: int) -> Array:
    """Compute the lowest natural frequencies (T, count) [Hz]; NaN beyond the last."""
    frequencies = np.full((len(free.K), count), np.nan)
    for k, (stiffness, mass) in enumerate(zip(free.K, free.M, strict=True)):
        squares, _shapes = _vibrations(stiffness, mass)
        frequencies[k, : len(squares)] = np.sqrt(np.maximum(squares[:count], 0.0)) / (2 * np.pi)
    return frequencies


def least_ratios(H: Array, S: Array) -> tuple[Array, Array]:
    """Compute the least ratio z' H z / z' S z (T,), and its z (T, d).

    If H + sigma S is positive definite, the least ratio is 1 / mu - sigma, where mu is the largest eigenvalue
    of S relative to H + sigma S. With the Cholesky factor L of H + sigma S, mu is the largest eigenvalue of
    L^-1 S L'^-1. This inverts neither H, which is singular at Type 2, nor S, which is singular if bodies have
    no mass. The shift sigma is tr H / tr S, so that it does not depend on units.

    Args:
        H, S: symmetric matrices (T, d, d); S is positive semidefinite, and H unless the robot buckles.

    Returns:
        The ratio and z; NaN if there is no least one, or where the robot buckles so far that H + sigma S is
        indefinite.
    """
    least, motions = np.full(len(H), np.nan), np.full(H.shape[:2], np.nan)
    # shift the stiffness of rows with a denominator, S != 0
    trace_H = np.abs(np.trace(H, axis1=1, axis2=2))
    trace_S = np.trace(S, axis1=1, axis2=2)
    rows = np.flatnonzero(trace_S > 0)
    if not len(rows):  # also if there are no motions, d = 0
        return least, motions
    sigma = trace_H[rows] / trace_S[rows]
    shifted = H[rows] + sigma[:, None, None] * S[rows]
    is_definite = np.linalg.eigvalsh(shifted)[:, 0] > 0
    # largest eigenvalue of S relative to H + sigma S, where that is positive definite
    rows, sigma = rows[is_definite], sigma[is_definite]
    inverse = np.linalg.inv(np.linalg.cholesky(shifted[is_definite]))  # L^-1
    relative = matmul(matmul(inverse, S[rows]), inverse.swapaxes(1, 2))
    mu, vectors = np.linalg.eigh(relative)
    least[rows] = 1.0 / mu[:, -1] - sigma
    motions[rows] = matvec(inverse.swapaxes(1, 2), vectors[:, :, -1])
    return least, motions


def least_stiffness(robot: ParallelRobot, free: CompliantMotions) -> Array:
    """Compute the stiffness (T,) of the platform in its softest direction, see `softest_motion`."""
    return softest_motion(robot, free)[0]


def softest_motion(robot: ParallelRobot, free: CompliantMotions) -> tuple[Array, Array]:
    """Compute the platform's least stiffness (T,) [N/m] and its direction (T, k).

    It is 0 at Type 2, and the least of z' K z / |X z|^2 over all motions z with locked motors, `free`. X z is
    the velocity of the platform's point, and the direction a unit vector on its k axes, the largest entry
    positive. For a platform that only turns, X z is its rate of rotation, and the result the rotational
    stiffness [N m/rad].
    """
    X = free.X[:, moving_axes(robot)]
    stiffness, motions = least_ratios(free.K, matmul(X.swapaxes(1, 2), X))
    # a negative ratio is rounding of the stiffness 0 at Type 2
    return np.maximum(stiffness, 0.0), _unit_rows(matvec(X, motions))


def moving_axes(robot: ParallelRobot) -> IntArray:
    """Return the k axes along which a platform moves; all where only turns are possible."""
    return np.flatnonzero(robot.translations if robot.translations.any() else ~robot.translations)


def _unit_rows(vectors: Array) -> Array:
    """Scale vectors (T, k) to unit length, their largest entries positive; NaN without a length."""
    largest = np.take_along_axis(vectors, np.abs(vectors).argmax(axis=1)[:, None], axis=1)
    sizes = np.linalg.norm(vectors, axis=1, keepdims=True) * np.sign(largest)
    unit: Array = vectors / np.where(sizes == 0.0, np.nan, sizes)
    return unit


def direction_in_words(names: Sequence[str], direction: Array) -> str:
    """Say along which axis a unit direction (k,) leads, and the angle off.

    Examples are "along y" and "21 degrees off y, towards -x and z".
    """
    order = np.argsort(-np.abs(direction))
    first, *others = ((names[k], float(direction[k])) for k in order)
    sign = "-" if first[1] < 0 else ""
    off = np.degrees(np.arccos(min(abs(first[1]), 1.0)))
    if off < 1.0:
        return f"along {sign}{first[0]}"
    least = 0.2 * np.linalg.norm([size for _, size in others])  # smaller ones are not named
    towards = [f"{'-' if size < 0 else ''}{name}" for name, size in others if abs(size) > least]
    return f"{off:.0f} degrees off {sign}{first[0]}, towards {' and '.join(towards)}"


def locked_motor_frequency(free: CompliantMotions) -> Array:
    """Compute the first natural frequency (T,) [Hz] with locked motors, 0 at Type 2; NaN without mass."""
    return np.sqrt(np.maximum(least_ratios(free.K, free.M)[0], 0.0)) / (2 * np.pi)


@dataclass(frozen=True, eq=False)
class PlatformStiffness(ReadOnlyArrays):
    """Stiffness and free vibrations of a robot with locked motors at one configuration.

    Twists and wrenches are on the platform's axes in the base frame, at the origin of the platform frame.
    Forces of joints are on the joint side of the gears.
    """

    robot: ParallelRobot
    q: Array  # (nq,) with the deflections of the load
    x: Array  # (n,)
    stiffness: Array  # (n, n) K_x [N/m, N/rad, N m/rad], finite at Type 2 too
    compliance: Array  # (n, n) inverse of K_x; infinite where there is none
    squares: Array  # (k,) omega^2 [rad^2/s^2], ascending, of motions with mass; negative where they buckle
    modes: Array  # (k, nv) joint rates of each vibration; the generalised mass is 1 kg m^2
    platform_modes: Array  # (k, n) twist of the platform in each vibration
    loaded: bool
    is_stable: bool  # whether every motion with locked motors is resisted, also that of a leg alone

    @property
    def frequencies(self) -> Array:
        """The natural frequencies (k,) [Hz]; NaN for a motion that buckles."""
        with np.errstate(invalid="ignore"):
            return np.sqrt(self.squares) / (2 * np.pi)

    @property
    def along_axes(self) -> Array:
        """Stiffness (n,) along each axis, free along the others [N/m, N m/rad]."""
        with np.errstate(divide="ignore"):
            stiffness: Array = 1 / np.diagonal(self.compliance)
        return stiffness

    @property
    def softest_direction(self) -> Array:
        """Unit twist (n,) of least stiffness, lengths in robot lengths; its largest entry is positive."""
        scale = self.robot.platform_scale
        _values, vectors = np.linalg.eigh(self.stiffness * np.outer(scale, scale))
        return _unit_rows(vectors[None, :, 0])[0]

    def displace_pose(self, mode: int, size: float) -> Array:
        """Return the configuration (nq,) in which a vibration moves its largest joint by `size`.

        `size` is in rad or robot lengths. The loops are closed to first order.
        """
        rates = self.modes[mode]
        largest = np.abs(rates / self.robot.column_scale).max()
        return integrate(self.robot, self.q[None], (rates * size / largest)[None])[0]

    @property
    def softest_in_words(self) -> str:
        """The softest direction in words: 21 degrees off y, towards -x."""
        return direction_in_words(self.robot.axis_names, self.softest_direction)


def platform_stiffness(
    robot: ParallelRobot, q: ArrayLike, *, loaded: bool = False, wrench: ArrayLike | None = None
) -> PlatformStiffness:
    """Compute stiffness, compliance, natural frequencies and modes at an assembled configuration q (nq,).

    Args:
        loaded: whether to deflect the springs from q, with locked motors, until they carry weight and
            `wrench`. Otherwise the result is that at q without load.
        wrench: external wrench ON the platform, on the platform's axes (n,) [N, N m]. A moment is allowed
            only if the platform turns about a single axis, since otherwise it has no potential.

    Raises:
        InvalidInput: q leaves the loops open; the robot has no springs, or springs that leave the platform
            rigid along some axis; a wrench is given without `loaded`.
        NotConverged: there is no equilibrium near q.
    """
    if wrench is not None and not loaded:
        raise InvalidInput("wrench: counts under load alone; give loaded=True")
    closed = assembled_at(robot, q)
    if loaded:
        deflected, load = _find_equilibrium(robot, closed.q[0], wrench)
        closed = assembled_at(robot, deflected)
    free = compliant_motions(robot, closed, closed.q)  # T = 1
    H = free.K[0]
    if loaded:
        H = tangent_stiffness(robot, closed, closed.q, free.Z, load)[0]

    # modes in the motions Z, then as rates of all joints
    squares, shapes = _vibrations(H, free.M[0])
    modes = np.zeros((len(shapes), robot.nv))
    modes[:, robot.unlocked] = shapes @ free.Z[0].T
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
    """Minimise V - w . x subject to c = 0 from q (nq,); return equilibrium and load.

    Newton's method is used with the absolute values of the eigenvalues, so that steps lead downhill even
    where the robot buckles. If the robot snaps through, the result is the equilibrium beyond.

    Raises:
        InvalidInput: the wrench has no potential.
        NotConverged: there is no equilibrium near q, or only one with deflections beyond MAX_DEFLECTION.
    """
    max_steps = 200  # of Newton's method, which converges quadratically at the end
    columns = robot.unlocked
    lengths = robot.column_scale[columns]
    load = Load(check_wrench(robot, wrench), share=np.ones(1), preload=np.zeros((1, robot.nv)))
    step_size = np.inf  # [rad, robot lengths] largest entry of the last step
    for _ in range(max_steps):
        at = evaluate_equilibrium(robot, q[None], load)
        if step_size < NEWTON_STEP:
            if deflects_little(robot, q[None])[0] and np.abs(at.closing_step).max() < LOOP_GAP:
                return q, load
            break
        values, vectors = np.linalg.eigh(at.H[0])
        sizes = np.abs(values)  # so that steps lead downhill, also where the robot buckles
        stiffness = np.maximum(sizes, EIGENVALUE_ROUNDING * sizes.max(initial=0.0))
        # (d,) steps along the motions that keep the loops closed
        uphill = vectors @ (vectors.T @ at.energy_slope[0] / stiffness)
        step = at.closing_step[0] - at.null_space[0] @ uphill
        step_size = np.abs(step).max()
        if not np.isfinite(step_size):
            break
        damping = LOAD_STEP / max(step_size, LOAD_STEP)
        q = integrate_columns(robot, q, columns, step * damping * lengths)
    raise NotConverged(
        "the springs find no equilibrium near this configuration: the load buckles the "
        "robot, or deflects it by more than linear springs mean",
        name=robot.name,
        residual=step_size,
    )


def deflects_little(robot: ParallelRobot, q: Array) -> BoolArray:
    """Return whether (T,) the deflections of q (T, nq) are within the range of linear springs."""
    deflections = (difference(robot, robot.neutral, q) / robot.column_scale)[:, robot.elastic]
    return np.abs(deflections).max(axis=1, initial=0.0) <= MAX_DEFLECTION


# ------------------------------------------------------------------ matrices


def _condense(robot: ParallelRobot, H: Array, X: Array) -> Array:
    """Compute the platform's stiffness K_x (n, n) from H (d, d) and the twists X (n, d) of all motions.

    v' K_x v = min { dz' H dz : X dz = v }. With a right inverse R and the null space N of X, dz = R v + N y,
    and the minimum over y is K_x = R' (H - H N (N' H N)^-1 N' H) R.

    Raises:
        InvalidInput: the springs leave the platform rigid along some direction.
    """
    scale = robot.platform_scale
    U, values, V_rows = np.linalg.svd(X / scale[:, None])  # scaled, so that all entries have one unit
    if len(values) < len(X) or values[-1] <= RANK_ROUNDING * values[0]:
        raise InvalidInput(
            f"{robot.name}, {robot.flexibility}: the springs leave the platform rigid along some direction "
            f"while the motors are locked, so it has no stiffness matrix"
        )
    R = V_rows[: len(X)].T @ (U / values).T / scale  # (d, n) X R = 1
    N = V_rows[len(X) :].T  # (d, d - n) X N = 0
    forces = H @ R
    if N.size:
        forces -= H @ N @ np.linalg.solve(N.T @ H @ N, N.T @ forces)
    K = R.T @ forces
    return 0.5 * (K + K.T)  # symmetric but for rounding


def _inverse(robot: ParallelRobot, K: Array) -> Array:
    """Compute the compliance (n, n) from the stiffness K, which may be singular.

    Entry (i, j) is infinite if a direction without stiffness moves both axes i and j.
    """
    scales = np.outer(robot.platform_scale, robot.platform_scale)  # convert K to moments over angles
    values, vectors = np.linalg.eigh(K * scales)
    is_free = np.abs(values) <= EIGENVALUE_ROUNDING * np.abs(values).max()
    compliance = (vectors / np.where(is_free, np.inf, values)) @ vectors.T * scales
    is_moved = np.abs(vectors[:, is_free]) > RANK_ROUNDING  # (n, free) axis i by a free direction
    return np.where(is_moved @ is_moved.T, np.inf, compliance)


def _vibrations(H: Array, M: Array) -> tuple[Array, Array]:
    """Compute squared angular frequencies (k,) [rad^2/s^2], ascending, and mode shapes z (k, d).

    The frequencies are those of the stiffness H and the mass M, (d, d) each. The shapes have z' M z = 1.
    Motions without mass have no vibration of their own: they follow the others statically.
    """
    # shapes of unit mass, so that the generalised problem becomes an ordinary one
    values, vectors = np.linalg.eigh(M)
    has_mass = (values > 0.0) & (values > RANK_ROUNDING * values.max(initial=0.0))
    massive = vectors[:, has_mass] / np.sqrt(values[has_mass])  # (d, k) motions of unit mass
    massless = vectors[:, ~has_mass]
    if massless.shape[1] and massive.shape[1]:  # massless motions y follow with the least energy
        coupling = massless.T @ H @ massive
        y, *_ = np.linalg.lstsq(massless.T @ H @ massless, coupling, rcond=None)
        massive -= massless @ y
    squares, shapes = np.linalg.eigh(massive.T @ H @ massive)
    is_rounding = np.abs(squares) <= EIGENVALUE_ROUNDING * np.abs(squares).max(initial=0.0)
    return np.where(is_rounding, 0.0, squares), (massive @ shapes).T
