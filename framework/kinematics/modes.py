"""Signs of working modes and assembly modes, and the legs of a working mode.

At given x the equations [platform - x ; closures] = 0 split into blocks that can be solved one after the
other: the irreducible blocks of the sparsity pattern of their Jacobian (Dulmage and Mendelsohn 1958; Duff,
Erisman and Reid 1986, chapter 6). Each block is a leg with its own Type 1 singularities, at which alone the
sign of its determinant changes. det [dF/dq] is the product of the legs' determinants. Its sign does not
distinguish a robot with two flipped legs from one with none, but the signs of all legs do.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from framework.errors import InvalidInput
from framework.kinematics.inverse_kinematics import require_square
from framework.kinematics.linearised_loops import LinearisedLoops, moving_loops, scaled_platform, type1_matrix
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, BoolArray, IntArray, Names, ReadOnlyArrays
from framework.numerics.ordered_sums import singular_values
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
    """Return whether determinants keep their signs from `start` to `end`, (T,).

    A determinant at the end smaller than `DETERMINANT_LOST` times that at the start is rounding and has no
    sign.

    Args:
        start, end: signs (T,) of the determinants, then logarithms (T,) of their sizes.
    """
    start_sign, start_logarithm = start
    end_sign, end_logarithm = end
    return (end_sign == start_sign) & (end_logarithm - start_logarithm > np.log(DETERMINANT_LOST))


def keeps_working_mode(robot: ParallelRobot, start: LinearisedLoops, ends: LinearisedLoops) -> BoolArray:
    """Return whether each of T successive configurations is in the working mode of its predecessor, (T,).

    `start` (T = 1) is the predecessor of the first of the `ends`. Both are in the same mode if no Type 1
    singularity lies between the two or at the second.

    Then det [dF/dq] keeps its sign. But this determinant also changes sign where the loop equations lose
    rank, even if the branch is smooth there. In this case another determinant decides. Let N be a basis of
    the motions that the loops allow, continued from one configuration to the next. Then det (platform N)
    changes sign at Type 1 singularities only. A configuration whose loops have lost rank belongs to no mode.
    """
    least = singular_values(moving_loops(robot, ends)).min(axis=1, initial=np.inf)
    has_rank = least >= RANK_LOST
    determinants = np.concatenate([start.factors.slogdet, ends.factors.slogdet], axis=1)  # (2, 1 + T)
    keeps = has_rank & keeps_sign(determinants[:, :-1], determinants[:, 1:])
    for k in np.flatnonzero(has_rank & ~keeps).tolist():
        previous = ends.select(k - 1) if k else start
        keeps[k] = _keeps_platform_map(robot, previous, ends.select(k))
    return keeps


def _keeps_platform_map(robot: ParallelRobot, start: LinearisedLoops, end: LinearisedLoops) -> bool:
    """Return whether det (platform N) keeps its sign from `start` to `end`, close configurations (T = 1).

    N (moving, n) is an orthonormal basis of the motions that the loops allow. The sign of det (N_1' N_2)
    tells whether the two bases have the same orientation.
    """
    N_1, start_determinant = _platform_map(robot, start)
    N_2, end_determinant = _platform_map(robot, end)
    orientation = np.linalg.det(N_1.T @ N_2)
    # the end's determinant on the basis continued from the start, positive if it keeps its sign
    continued = end_determinant * np.sign(start_determinant * orientation)
    return bool(continued > DETERMINANT_LOST * abs(start_determinant))


def _platform_map(robot: ParallelRobot, linearised: LinearisedLoops) -> tuple[Array, float]:
    """Compute a basis N (moving, n) of the motions that the loops allow, and det (platform N), T = 1.

    The matrix platform N maps amplitudes of these motions to twists. Its determinant vanishes where the loops
    allow a motion with the platform at rest; its sign depends on the orientation of N.
    """
    loops = moving_loops(robot, linearised)[0]  # (m, moving)
    basis = np.linalg.svd(loops).Vh[len(loops) :].T  # the null space of the loops, which have full rank
    platform = scaled_platform(robot, linearised)[0][:, robot.moving]  # (n, moving)
    return basis, float(np.linalg.det(platform @ basis))


@dataclass(frozen=True, eq=False)
class Leg(ReadOnlyArrays):
    """A group of joints that k equations at given x determine together."""

    motors: Names  # names of its actuators; empty for joints that only follow
    rows: IntArray  # (k,) indices of its equations in F
    columns: IntArray  # (k,) its joints, as indices into the `moving` columns: actuated, then passive
    needed: IntArray  # (j,) joints of the legs that have to be solved earlier, as indices like `columns`


@lru_cache(maxsize=64)
def legs(robot: ParallelRobot) -> tuple[Leg, ...]:
    """Compute the legs in the order of their first motor, legs without a motor last.

    Raises:
        InvalidInput: the platform does not determine the joints.
    """
    require_square(robot)
    pattern = robot.equations.pattern[:, robot.moving]  # (n + m, columns)
    row_of = _match_rows(pattern)  # (columns,) an equation for each column
    # which columns a column needs, directly or through others: no chain of needs is longer than `columns`
    needs = np.linalg.matrix_power(pattern[row_of] | np.eye(len(row_of), dtype=bool), len(row_of))
    is_one_leg = needs & needs.T  # the irreducible blocks: columns that need each other
    all_legs = []
    for k in np.unique(is_one_leg.argmax(axis=1)):  # the first column of each leg; those of motors come first
        columns = np.flatnonzero(is_one_leg[k])
        motors = tuple(robot.actuator_names[c] for c in columns if c < robot.n_a)
        needed = np.flatnonzero(needs[k] & ~is_one_leg[k])
        all_legs.append(Leg(motors, np.sort(row_of[columns]), columns, needed))
    return tuple(all_legs)


def _match_rows(pattern: BoolArray) -> IntArray:
    """Find rows (k,) of a pattern (k, k), one for each column, each once, by augmenting paths.

    Raises:
        InvalidInput: there are none, so all matrices with this pattern are singular.
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

    if not all(match(column, set()) for column in range(len(pattern))):
        raise InvalidInput("the platform does not determine the joints")
    return np.array(sorted(column_of, key=column_of.__getitem__), dtype=np.intp)


def leg_determinants(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute the dimensionless determinant of each leg (T, legs), zero at its Type 1 singularities."""
    M = type1_matrix(robot, linearised)
    blocks = [M[:, leg.rows][:, :, leg.columns] for leg in legs(robot)]  # (T, k, k) each
    return np.stack([np.linalg.det(block) for block in blocks], axis=1)


def leg_signs(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Return the working mode: the sign (T, legs) of each leg's determinant, 0 at Type 1."""
    return np.sign(leg_determinants(robot, linearised))
