"""Signs of working modes and assembly modes, and the legs of a working mode.

At given x the equations [platform - x ; closures] = 0 split into blocks that can be solved one after the
other: the irreducible blocks of the sparsity pattern of their Jacobian (Dulmage and Mendelsohn 1958; Duff,
Erisman and Reid 1986, chapter 6). Each block is a leg with its own Type 1 singularities, at which alone the
sign of its determinant changes. det [dF/dq] is the product of the legs' determinants. Its sign does not
distinguish a robot with two flipped legs from one with none, but the signs of all legs do.

A block may hold several legs, as that of a Delta. Let G be the joint rates for unit twists of the platform.
Near Type 1 singularities of several legs, G = sum w_i r_i' / s_i + bounded: s_i vanishes and changes sign
where leg i is stretched, r_i is the twist that this leg refuses there, and w_i its own motion. From one pose
to the next, G_1^+ G_2 has the eigenvalues s_i1 / s_i2, negative for each leg that has flipped. G depends on
the motions that the loops allow and not on their equations, so it is smooth where these lose rank and the
branch is smooth.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from framework.errors import InvalidInput
from framework.kinematics.inverse_kinematics import require_square
from framework.kinematics.linearised_loops import LinearisedLoops, linearised_at, moving_loops
from framework.kinematics.loop_ranges import relative_orientation
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, BoolArray, IntArray, Names, ReadOnlyArrays, join, select
from framework.numerics.ordered_sums import are_regular, matvec, singular_values
from framework.tolerances import DETERMINANT_LOST, RANK_LOST


def mode_signs(robot: ParallelRobot, linearised: LinearisedLoops) -> tuple[Array, Array]:
    """Compute the signs (T,) that change with the working mode and with the assembly mode.

    The first is the sign of det [dF/dq], which changes at Type 1 singularities. The second is the sign of det
    P, which changes at Type 2 singularities; it is 1 for robots with redundant motors.
    """
    working_sign, _ = linearised.factors.slogdet
    assembly_sign, _ = passive_determinants(linearised)
    return working_sign, assembly_sign


def passive_determinants(linearised: LinearisedLoops) -> tuple[Array, Array]:
    """Compute the signs of det P and log |det P|, (T,) each; P are the passive columns of the loops.

    det P counts as 1 if P is not square (redundant motors) or empty (no passive joints). In both cases the
    equations have no `passive_part`.
    """
    if linearised.equations.passive_part is None:
        T = len(linearised.residual)
        return np.ones(T), np.zeros(T)
    return linearised.passive_factors.slogdet


def keeps_sign(start: Iterable[Array], end: Iterable[Array]) -> BoolArray:
    """Return whether determinants keep their signs from `start` to `end`, (T, ...).

    A determinant at the end smaller than `DETERMINANT_LOST` times that at the start is rounding and has no
    sign.

    Args:
        start, end: signs (T, ...) of the determinants, then logarithms (T, ...) of their sizes.
    """
    start_sign, start_logarithm = start
    end_sign, end_logarithm = end
    return (end_sign == start_sign) & (end_logarithm - start_logarithm > np.log(DETERMINANT_LOST))


class ModeStates(NamedTuple):
    """Quantities of T configurations that lead to neighbours and tell whether these share a working mode."""

    q: Array  # (T, nq)
    bases: Array  # (T, R, m) of the ranges of the loops' rows, to which signs refer; (T, 0, 0) if R = m
    signs: Array  # (T, legs) of the legs' determinants; 0 if dF/dq is singular to the last bit
    logarithms: Array  # (T, legs) of the sizes of these determinants
    rates: Array  # G (T, k, n): dimensionless rates of the moving joints for unit twists; 0 if singular

    @staticmethod
    def of(robot: ParallelRobot, linearised: LinearisedLoops) -> ModeStates:
        """Compute the quantities at T configurations."""
        signs, logarithms = leg_slogdets(robot, linearised)
        (regular,) = signs.all(axis=1).nonzero()
        unit_twists = np.zeros((robot.n, len(regular), linearised.residual.shape[1]))
        unit_twists[:, :, : robot.n] = np.eye(robot.n)[:, None]
        rates = np.zeros((len(signs), len(robot.moving), robot.n))
        solution = linearised.select(regular).factors.solve(unit_twists)  # (n, regular, k)
        rates[regular] = (solution / robot.column_scale[robot.moving]).transpose(1, 2, 0)
        return ModeStates(linearised.frames.q, linearised.bases, signs, logarithms, rates)

    def joint_rates(self, robot: ParallelRobot, twists: Array) -> Array:
        """Compute joint rates (T, nv) at twists (T, n) of the platform, springs and idle turns at rest."""
        rates = np.zeros((len(twists), robot.nv))
        rates[:, robot.moving] = matvec(self.rates, twists) * robot.column_scale[robot.moving]
        return rates

    def loops(self, robot: ParallelRobot, k: int) -> Array:
        """Compute the dimensionless Jacobian (m, moving) of the loops at the k-th configuration."""
        return moving_loops(robot, linearised_at(robot, self.q[[k]], bases=self.bases[[k]]))[0]


def keeps_working_mode(robot: ParallelRobot, *stacks: LinearisedLoops) -> BoolArray:
    """Return which of T successive steps keep the working mode, (T,).

    The steps lead through 1 + T configurations, in one or several stacks. A configuration whose loops have
    lost rank belongs to no mode.
    """
    chain = join([ModeStates.of(robot, stack) for stack in stacks])
    starts, followers = select(chain, slice(None, -1)), select(chain, slice(1, None))
    loops = np.concatenate([moving_loops(robot, stack) for stack in stacks])  # (1 + T, m, moving)
    return are_regular(loops[1:], RANK_LOST) & share_working_mode(robot, starts, followers)


def share_working_mode(robot: ParallelRobot, starts: ModeStates, ends: ModeStates) -> BoolArray:
    """Return whether no leg has a Type 1 singularity between or at neighbouring configurations, (T,).

    The k-th start and the k-th end are neighbours. In one mode the determinant of each leg keeps its sign,
    and so does the map from twists to joint rates. A determinant also changes its sign where the loop
    equations lose rank, even if the branch is smooth there. In this case the map of each leg decides.
    """
    shared = np.asarray((starts.signs * ends.signs).all(axis=1))
    (regular,) = shared.nonzero()
    shared[regular] = _continues_map(starts.rates[regular], ends.rates[regular])
    end_signs = ends.signs * relative_orientation(starts.bases, ends.bases)[:, None]
    keeps = keeps_sign((starts.signs, starts.logarithms), (end_signs, ends.logarithms)).all(axis=1)
    for k in (shared & ~keeps).nonzero()[0].tolist():
        # singular values change by no more than the matrix does (Weyl), so a larger one has not vanished
        loops = ends.loops(robot, k)
        change = np.linalg.norm(loops - starts.loops(robot, k))
        least = singular_values(loops).min(initial=np.inf)
        maps = np.array([starts.rates[k], ends.rates[k]])  # (2, k, n)
        # of each leg the rates of its joints for the twists that determine them
        leg_maps = [maps[:, [*leg.columns, *leg.needed]][..., leg.twists] for leg in legs(robot)]
        shared[k] = RANK_LOST <= least <= change and all(_continues_map(*pair) for pair in leg_maps)
    return shared


def _continues_map(start: Array, end: Array) -> BoolArray:
    """Return whether maps from twists to joint rates (..., k, f) have no flipped leg from start to end.

    If the joints of a leg turn back for the same twist, G_2 t = -c G_1 t with c > 0, then G_1^+ G_2 has the
    eigenvalue -c; if they only change their rates it is positive, and near a singularity of the leg it grows
    without bound. Rounding may split two equal negative ones into a complex pair, so all within 45 degrees of
    the negative axis count as negative.
    """
    Q, R = np.linalg.qr(start)
    ratio = np.linalg.solve(R, Q.swapaxes(-1, -2) @ end)  # (..., f, f) G_1^+ G_2
    # eigenvalues are no farther from 1 than the matrix from I in its Frobenius norm, mostly near enough
    continues = np.asarray(((ratio - np.eye(ratio.shape[-1])) ** 2).sum(axis=(-2, -1)) < 0.25)
    others = ~continues
    if others.any():
        values = np.linalg.eigvals(ratio[others])  # (others, f)
        is_positive = values.real > -np.abs(values.imag)
        continues[others] = (is_positive & (np.abs(values) < 1.0 / DETERMINANT_LOST)).all(axis=-1)
    return continues


@dataclass(frozen=True, eq=False)
class Leg(ReadOnlyArrays):
    """A group of joints that k equations at given x determine together."""

    motors: Names  # names of its actuators; empty for joints that only follow
    rows: IntArray  # (k,) indices of its equations in F
    columns: IntArray  # (k,) its joints, as indices into the columns that move: actuated, then passive
    needed: IntArray  # (j,) joints of the legs that have to be solved earlier, as indices like `columns`
    twists: IntArray  # (f,) indices of the platform's twists that determine all these joints


@lru_cache(maxsize=16)
def legs(robot: ParallelRobot) -> tuple[Leg, ...]:
    """Compute the legs in the order of their first motor, legs without a motor last.

    Raises:
        InvalidInput: the platform does not determine the joints.
    """
    require_square(robot)
    if _match_rows(robot.equations.pattern[:, robot.moving]) is None:
        raise InvalidInput("the platform does not determine the joints")
    return split_legs(robot, np.arange(len(robot.equations.pattern)), robot.moving)


def split_legs(robot: ParallelRobot, rows: IntArray, columns: IntArray) -> tuple[Leg, ...]:
    """Split equations of F, indices `rows` (r,), and `columns` (k,) of joints into legs, motors first.

    Equations that are not square, or that do not determine the joints in any pose, are split into groups that
    share no joint. The columns of a leg are indices into `columns`.
    """
    pattern = robot.equations.pattern[rows][:, columns]  # (r, k)
    row_of = _match_rows(pattern)  # (k,) an equation for each column
    linked = pattern.T @ pattern if row_of is None else pattern[row_of]  # (k, k)
    # which columns a column needs, directly or through others: no chain of needs is longer than k
    needs = np.linalg.matrix_power(linked | np.eye(len(columns), dtype=bool), len(columns))
    is_one_leg = needs & needs.T  # the irreducible blocks: columns that need each other
    names = dict(zip(robot.actuated.tolist(), robot.actuator_names, strict=True))
    all_legs = []
    for k in np.unique(is_one_leg.argmax(axis=1)):  # the first column of each leg; those of motors come first
        own = is_one_leg[k]
        motors = tuple(names[column] for column in columns[own].tolist() if column in names)
        own_rows, all_rows = (
            rows[pattern[:, group].any(axis=1) if row_of is None else np.sort(row_of[group])]
            for group in (own, needs[k])
        )
        twists = all_rows[all_rows < robot.n]  # the rows of the platform come first
        needed = np.flatnonzero(needs[k] & ~own)
        all_legs.append(Leg(motors, own_rows, np.flatnonzero(own), needed, twists))
    return tuple(all_legs)


def _match_rows(pattern: BoolArray) -> IntArray | None:
    """Find rows (k,) of a pattern (k, k), one for each column, each once, by augmenting paths.

    None if the pattern is not square, or if all matrices with this pattern are singular.
    """
    column_of = dict[int, int]()  # by row

    def match(column: int, tried: set[int]) -> bool:
        """Give the column a row, other than those tried, moving the columns that have one already."""
        for row in np.flatnonzero(pattern[:, column]).tolist():
            if row not in tried:
                tried.add(row)
                if row not in column_of or match(column_of[row], tried):
                    column_of[row] = column
                    return True
        return False

    rows, columns = pattern.shape
    if rows != columns or not all(match(column, set()) for column in range(columns)):
        return None
    return np.array(sorted(column_of, key=column_of.__getitem__), dtype=np.intp)


def leg_slogdets(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute sign and logarithm of the size of each leg's determinant of dF/dq, (2, T, legs)."""
    slogdets = np.empty((2, len(linearised.residual), len(legs(robot))))
    for group, rows, columns in _legs_by_size(robot):
        blocks = linearised.jacobian[:, rows[:, :, None], columns[:, None]]  # (T, g, k, k)
        slogdets[0][:, group], slogdets[1][:, group] = np.linalg.slogdet(blocks)
    return slogdets


@lru_cache(maxsize=16)
def _legs_by_size(robot: ParallelRobot) -> list[tuple[IntArray, IntArray, IntArray]]:
    """Return the legs in groups of g legs with k equations each.

    A group has the indices (g,) of its legs, those (g, k) of their equations in F, and the columns (g, k) of
    their joints in the velocity vector.
    """
    sizes = np.array([len(leg.rows) for leg in legs(robot)])
    groups = []
    for size in np.unique(sizes):
        (group,) = (sizes == size).nonzero()
        rows = np.array([legs(robot)[k].rows for k in group])
        columns = np.array([legs(robot)[k].columns for k in group])
        groups.append((group, rows, robot.moving[columns]))
    return groups


def leg_signs(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Return the working mode: the sign (T, legs) of each leg's determinant, 0 at Type 1."""
    return leg_slogdets(robot, linearised)[0]
