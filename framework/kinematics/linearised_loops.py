"""Platform and loops of a robot as one system F(q) = 0, with dF/dq at given configurations.

F(q) = [platform(q) - x ; closures(q)] has n equations of the platform and m independent ones of the loops.
Every matrix of the robot (A, B, C, the P of Type 2, the matrix of Type 1) consists of rows and columns of
J = dF/dq. P has the rows of the loops and the columns of the passive joints, and loses rank at Type 2
singularities. The Type 1 matrix has all rows and the columns of actuated and passive joints.

Overconstrained loops have R equations of rank m < R, of which no m suffice in all poses. Then the m equations
are combinations U'F of all R, with an orthonormal basis U (R, m) of the range of their Jacobian J (see
`loop_ranges`). Where F = 0 and J v = 0, derivatives of U drop out of all derivatives of U'F: within the range
they only mix equations that hold, and outside of it they annihilate J.

Functions from `scaled_loops` on return dimensionless matrices: rows (equations) and columns (joints) are in
radians and lengths of the robot. So the singular values by which rank is judged do not depend on the unit of
length.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from warnings import warn

import numpy as np

from framework.errors import InvalidInput
from framework.kinematics.assembly import Configuration, configuration
from framework.kinematics.closures import LoopWrenches, loop_wrenches, scale_jacobian
from framework.kinematics.frames import FrameStack, frames_at, full_motion, move_wrench
from framework.kinematics.loop_ranges import align_bases, oriented_bases
from framework.kinematics.loop_structure import rounded_gap
from framework.kinematics.parallel_robot import Equations, ParallelRobot
from framework.numerics.arrays import Array, ArrayLike, IntArray, select
from framework.numerics.banded_lu import Band, Factors
from framework.numerics.ordered_sums import are_regular, matvec, singular_values
from framework.tolerances import FILE_ROUNDING, LOOP_RATE, RANK_LOST


@dataclass(frozen=True, eq=False)
class LinearisedLoops:
    """F and its derivatives at T configurations, with m independent loop equations."""

    equations: Equations  # what does not depend on the configuration
    frames: FrameStack  # of the robot at these configurations
    x: Array  # (T, n) platform coordinates, those of the frames where the residual vanishes
    loops: LoopWrenches  # all loop equations of the robot, redundant ones included
    residual: Array  # (T, n + m) F [m or rad]
    wrenches: Array  # (T, n + R, 6) of platform and rows of the loops, about the base's origin
    jacobian: Array  # (T, n + m, nv) dF/dq
    combination: Array | None = None  # (T, R, m) by which equations are sums of R rows; None if R = m

    @property
    def q(self) -> Array:
        """Configurations (T, nq)."""
        return self.frames.q

    @property
    def linearised(self) -> LinearisedLoops:
        """The equations themselves, once a part of the result of `close_loops`; deprecated."""
        warn("close_loops(..).linearised goes in 0.10: see close_loops(..)", DeprecationWarning, stacklevel=2)
        return self

    @property
    def bases(self) -> Array:
        """Bases U of the ranges of the rows, (T, R, m) dimensionless; (T, 0, 0) if the rows are fixed."""
        if self.combination is None:
            return np.zeros((len(self.residual), 0, 0))
        return self.combination * self.equations.span_scale[:, None]

    def combine(self, values: Array) -> Array:
        """Return the combinations (T, m) of values (T, R) of the loops' rows."""
        return values if self.combination is None else np.vecmat(values, self.combination)

    def combine_rows(self, rows: Array) -> Array:
        """Return the rows (T, n + m, k) of the equations for those of platform and loops (T, n + R, k)."""
        if self.combination is None:
            return rows
        n = self.equations.n
        return np.concatenate([rows[:, :n], self.combination.swapaxes(1, 2) @ rows[:, n:]], axis=1)

    def spread(self, multipliers: Array) -> Array:
        """Return the multipliers (T, R) of all rows, of least norm, for those (T, m) of the equations."""
        return multipliers if self.combination is None else np.matvec(self.combination, multipliers)

    def select(self, k: int | slice | IntArray) -> LinearisedLoops:
        """Return the equations at the configuration of index k (T = 1), or at several.

        A selection of all is the object itself, which keeps the LU factors computed so far.
        """
        all_indices = np.arange(len(self.residual))
        which = all_indices[k].reshape(-1)
        if len(which) == len(all_indices) and (which == all_indices).all():
            return self
        return LinearisedLoops(
            equations=self.equations,
            frames=self.frames.select(which),
            x=self.x[which],
            loops=select(self.loops, which),
            residual=self.residual[which],
            wrenches=self.wrenches[which],
            jacobian=self.jacobian[which],
            combination=None if self.combination is None else self.combination[which],
        )

    @property
    def gap(self) -> Array:
        """Largest residual (T,) of all loop equations, redundant ones included [m or rad]."""
        return np.abs(self.solved_residual).max(axis=1, initial=0.0)

    @property
    def solved_residual(self) -> Array:
        """Residuals (T, rows) of the loop equations that can hold.

        These are all rows, redundant ones included. But where rounded rows are combined with the others, as
        the R > rows of a combination show, no row holds by itself: these are the residuals of combinations.
        """
        rows = self.loops.residual
        has_rounded_rows = self.combination is not None and self.combination.shape[1] > rows.shape[1]
        return self.residual[:, self.equations.n :] if has_rounded_rows else rows

    @property
    def platform(self) -> Array:
        """Rows of dF/dq of the platform, (T, n, nv)."""
        return self.jacobian[:, : self.equations.n]

    @property
    def closures(self) -> Array:
        """Rows of dF/dq of the independent loops, (T, m, nv)."""
        return self.jacobian[:, self.equations.n :]

    @cached_property
    def factors(self) -> Factors:
        """LU factors of dF/dq (T, n + m, n + m) along the moving joints; see `_factor`."""
        return self._factor(self.equations.moving_part, "the platform and the loops")

    @cached_property
    def passive_factors(self) -> Factors:
        """LU factors of P (T, m, m), the loops along the passive joints; see `_factor`."""
        return self._factor(self.equations.passive_part, "the loops along passive joints")

    def _factor(self, part: Band | None, subject: str) -> Factors:
        """Factor a part (T, k, k) of dF/dq.

        Raises:
            numpy.linalg.LinAlgError: the part is None: its equations, `subject`, and joints differ in number.
        """
        if part is None:
            raise np.linalg.LinAlgError(f"{subject} do not make a square system")
        count, rows, columns = self.jacobian.shape
        values = self.jacobian.reshape(count, rows * columns).take(part.entries, axis=1)  # (T, E) row-major
        return part.factor(values)


def linearised_at(
    robot: ParallelRobot, q: Array, x: Array | None = None, *, bases: Array | None = None
) -> LinearisedLoops:
    """Compute F and dF/dq at q (T, nq) and platform coordinates x (T, n).

    By default x is that of the platform at q, so that the platform's residual is zero.

    Args:
        bases: (T, R, m) or (R, m) bases of ranges nearby, to which those of the rows are aligned. By default
            see `oriented_bases`.
    """
    equations, structure, n = robot.equations, robot.structure, robot.n
    frames = frames_at(robot, q)
    loops = loop_wrenches(robot.rows, frames)
    rows, needed = loops, structure.independent
    if structure.varies:
        rows, needed = loop_wrenches(robot.spanning_loops, frames), np.arange(len(structure.spanning))

    residual = np.zeros((len(q), len(equations.bodies)))
    if x is None:
        x = robot.platform.coordinates(frames)
    else:
        residual[:, :n] = robot.platform.residual(frames, x)
    residual[:, n:] = rows.residual.take(needed, axis=1)

    wrenches = np.empty((*residual.shape, 6))  # each at the origin of its frame, `equations.bodies`
    wrenches[:, :n] = robot.platform.wrenches(frames)
    wrenches[:, n:] = rows.wrench.take(needed, axis=1)
    origins = frames.position.take(equations.bodies, axis=1)  # (T, n + R, 3)
    wrenches = move_wrench(wrenches, origins)  # now about the base's origin

    jacobian = equations.jacobian(wrenches, frames)
    linearised = LinearisedLoops(equations, frames, x, loops, residual, wrenches, jacobian)
    if structure.varies:
        linearised = _combine_rows(robot, linearised, bases)
    linearised.jacobian.flags.writeable = False
    return linearised


def _combine_rows(robot: ParallelRobot, all_rows: LinearisedLoops, bases: Array | None) -> LinearisedLoops:
    """Replace the R rows by m combinations: the bases of their ranges, aligned to `bases` unless None."""
    n, moving = robot.n, robot.moving
    units = robot.column_scale[moving]
    scale = robot.equations.span_scale
    J = all_rows.closures[:, :, moving] * units / scale[:, None]  # (T, R, k) dimensionless
    if bases is not None:
        U = align_bases(J, bases)
    else:
        X = all_rows.platform[:, :, moving] * units / robot.platform_scale[:, None]
        U = oriented_bases(J, X, robot.structure.row_space[moving], all_rows.frames.q)
    combined = replace(all_rows, combination=U / scale[:, None])
    return replace(
        combined,
        residual=np.concatenate(
            [all_rows.residual[:, :n], combined.combine(all_rows.residual[:, n:])], axis=1
        ),
        jacobian=combined.combine_rows(all_rows.jacobian),
    )


@lru_cache(maxsize=16)
def linearised_at_reference(robot: ParallelRobot) -> LinearisedLoops:
    """Return the equations at the assembled reference, T = 1."""
    reference = robot.reference
    return linearised_at(robot, reference.q[None], reference.x[None])


def assembled_at(
    robot: ParallelRobot, q: ArrayLike | Configuration, *, stacks: bool = False
) -> LinearisedLoops:
    """Linearise the equations at a configuration q (nq,) after checking that q is assembled.

    Args:
        stacks: whether T configurations (T, nq) are accepted as well.

    Raises:
        InvalidInput: q has the wrong shape, is not finite, or leaves a loop open.
    """
    q = np.array(configuration(robot, q, stacks=stacks), ndmin=2)  # a copy: the caller may change its array
    linearised = linearised_at(robot, q)
    gaps = np.abs(linearised.solved_residual)  # (T, rows), or (T, m) of dimensionless combinations
    if gaps.shape[1] == len(robot.row_lengths):
        gaps = gaps / robot.row_lengths
    rounding = rounded_gap(robot, robot.reference.q[None]) / robot.length  # which no pose closes
    if gaps.max(initial=0.0) > FILE_ROUNDING + rounding:
        worst = gaps.max(axis=1).argmax()
        raise InvalidInput(
            f"q{f', row {worst}' if len(q) > 1 else ''}: the loops of {robot.name} are open by "
            f"{linearised.gap[worst]:.3g} m or rad there; see `assemble`"
        )
    return linearised


def scaled_loops(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute the Jacobian (T, m, nv) of the independent loop equations [rad, robot lengths]."""
    return scale_jacobian(robot, linearised.closures, robot.loop_lengths)


def require_closed_rates(
    robot: ParallelRobot, linearised: LinearisedLoops, v: Array, name: str = "v"
) -> None:
    """Raise InvalidInput if joint rates v (T, nv) called `name` open the loops: J v must be rounding."""
    speeds = v / robot.column_scale  # [rad/s, robot lengths/s]
    loop_rates = np.abs(matvec(scaled_loops(robot, linearised), speeds)).max(axis=1, initial=0.0)
    opening_rows = np.flatnonzero(loop_rates > LOOP_RATE * np.abs(speeds).max(axis=1, initial=1.0))
    if len(opening_rows):
        first = opening_rows[0]
        row = f", row {first}" if len(v) > 1 else ""
        raise InvalidInput(
            f"{name}{row}: the loops of {robot.name} open with {loop_rates[first]:.3g} rad/s or robot "
            f"lengths/s; see `dynamics_at`"
        )


def moving_loops(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Return the columns (T, m, moving) of `scaled_loops` along actuated and passive joints."""
    return scaled_loops(robot, linearised)[:, :, robot.moving]


def independent_loops_matrix(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute the Jacobian (T, m, nv) of the independent loops, rows scaled by `LoopStructure.row_sizes`.

    The scale brings rows of odd size, as after a change of unit, to unit size.
    """
    return scaled_loops(robot, linearised) / robot.structure.row_sizes[:, None]


def passive_matrix(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute P (T, m, n_p), the dimensionless derivatives of the loops along passive joints."""
    return linearised.closures[:, :, robot.following] * robot.passive_scale


def clearance(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute the least singular value (T,) of P: 0 at Type 2, infinite without passive joints."""
    values = singular_values(passive_matrix(robot, linearised))
    return values.min(axis=1, initial=np.inf)


def find_near_type2(robot: ParallelRobot, linearised: LinearisedLoops) -> IntArray:
    """Find the ascending indices of configurations at Type 2, with a `clearance` below RANK_LOST."""
    return np.flatnonzero(~are_regular(passive_matrix(robot, linearised), RANK_LOST))


def type2_matrix(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute the square matrix (T, n_p, n_p) that is singular at Type 2: P, or P'P with redundant motors.

    With redundant motors P has more rows than columns and loses rank only at isolated poses, where det P'P
    vanishes without changing sign.
    """
    P = passive_matrix(robot, linearised)
    return P if P.shape[1] == P.shape[2] else P.swapaxes(1, 2) @ P


def type1_matrix(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute the dimensionless Jacobian (T, n + m, n + m) of the inverse kinematics.

    The rows are those of the platform, then of the independent loops. The columns are the actuated, then the
    passive joints, as in `robot.moving`. The matrix is singular at Type 1 singularities and where the loop
    equations lose rank.
    """
    return linearised.jacobian[:, :, robot.moving] * robot.moving_scale


def passive_motion(robot: ParallelRobot, eta: Array) -> Array:
    """Return joint rates (..., nv) for dimensionless passive rates eta (..., n_p), other joints at rest.

    eta is in radians and robot lengths, the result in rad and m.
    """
    columns = robot.following  # the passive joints, without those that turn idly
    return full_motion(robot, columns, eta * robot.column_scale[columns])


def count_lost_ranks(robot: ParallelRobot, linearised: LinearisedLoops, level: float) -> IntArray:
    """Count the ranks (T,) that the independent loops have lost along actuated and passive joints.

    A rank is lost where a singular value of the loops' dimensionless Jacobian vanishes.

    Args:
        level: share of the largest singular value below which another one counts as zero. A largest value
            below 1 counts as 1.
    """
    values = singular_values(moving_loops(robot, linearised))  # (T, m)
    largest = np.maximum(values.max(axis=1, initial=0.0), 1.0)
    return np.sum(values < level * largest[:, None], axis=1)
