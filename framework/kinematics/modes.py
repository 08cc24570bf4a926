"""Signs of working modes and assembly modes, and the legs of a working mode.

With the platform given, the equations [platform - x ; closures] = 0 fall apart into blocks that are solved
one after the other: the irreducible blocks of the sparsity pattern of their Jacobian (Dulmage and Mendelsohn
1958; Duff, Erisman and Reid 1986, chapter 6). Each block is a leg, with its own Type 1 singularities: the
sign of its determinant changes there and nowhere else. det [dF/dq] is the product of these determinants, so
that its sign alone does not tell a robot with two legs turned over from one with none; the signs of all do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from framework.kinematics.inverse_kinematics import require_square
from framework.kinematics.linearised_loops import LinearisedLoops
from framework.kinematics.loop_matrices import scaled_loops, scaled_platform, type1_matrix
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, BoolArray, IntArray, ReadOnlyArrays
from framework.numerics.ordered_sums import singular_values
from framework.tolerances import DETERMINANT_LOST, RANK_LOST


def mode_signs(robot: ParallelRobot, linearised: LinearisedLoops) -> tuple[Array, Array]:
    """Compute the signs (T,) of the working mode and of the assembly mode.

    The sign of det [dF/dq] changes at Type 1 singularities, the sign of the determinant of the
    passive columns of the loops at Type 2 (of a robot without redundant motors; else it is 1).
    """
    return linearised.factors.slogdet[0], passive_determinants(linearised)[0]


def passive_determinants(linearised: LinearisedLoops) -> tuple[Array, Array]:
    """Compute signs and logarithms (T,) of the determinants of the passive columns of the loops.

    With redundant motors these are not square, and without passive joints there are none: it is 1 then.
    """
    if linearised.equations.passive_part is None:
        count = len(linearised.residual)
        return np.ones(count), np.zeros(count)
    return linearised.passive_factors.slogdet


def keeps_sign(before: tuple[Array, Array], after: tuple[Array, Array]) -> BoolArray:
    """Whether determinants (T,), given by signs and logarithms, have the same sign before and after.

    A determinant that has become smaller by more than rounding, `DETERMINANT_LOST`, has no sign.
    """
    sign, size = before
    later_sign, later_size = after
    return (later_sign == sign) & (later_size - size > np.log(DETERMINANT_LOST))


def keeps_working_mode(robot: ParallelRobot, before: LinearisedLoops, after: LinearisedLoops) -> BoolArray:
    """Whether no Type 1 singularity lies between two near configurations or at the second, (T,).

    Of T configurations `after`, each with the one before it, the first with `before` (T = 1).
    det [dF/dq] also changes sign where the loop equations lose rank, although a smooth branch goes on. The
    map from the motions that the loops allow to the platform does not: with N a basis of these motions,
    continued from one configuration to the other, det (platform N) keeps its sign. A determinant at rounding
    has no sign, and loops that have lost rank allow more than one motion; such configurations belong to no
    mode.
    """
    columns = robot.moving
    least = singular_values(scaled_loops(robot, after)[:, :, columns]).min(axis=1, initial=np.inf)
    has_rank = least >= RANK_LOST
    signs = np.concatenate([before.factors.slogdet[0], after.factors.slogdet[0]])
    sizes = np.concatenate([before.factors.slogdet[1], after.factors.slogdet[1]])
    keep = has_rank & keeps_sign((signs[:-1], sizes[:-1]), (signs[1:], sizes[1:]))
    for k in np.flatnonzero(has_rank & ~keep).tolist():
        previous = after.select(k - 1) if k else before
        keep[k] = _keeps_platform_map(robot, previous, after.select(k))
    return keep


def _keeps_platform_map(robot: ParallelRobot, before: LinearisedLoops, after: LinearisedLoops) -> bool:
    """Whether det (platform N) keeps its sign between two near configurations (T = 1 each).

    N (moving, n) is an orthonormal basis of the motions that the loops allow. The basis at the second
    configuration may be turned over against the first: the sign of det (N' N) tells.
    """
    basis, determinant = _platform_map(robot, before)
    later_basis, later_determinant = _platform_map(robot, after)
    continued = later_determinant * np.sign(determinant * np.linalg.det(basis.T @ later_basis))
    return bool(continued > DETERMINANT_LOST * abs(determinant))


def _platform_map(robot: ParallelRobot, linearised: LinearisedLoops) -> tuple[Array, float]:
    """Return a basis N (moving, n) of the motions that the loops allow (T = 1), and det (platform N)."""
    loops = scaled_loops(robot, linearised)[0][:, robot.moving]  # (m, moving)
    basis = np.linalg.svd(loops)[2][len(loops) :].T
    platform = scaled_platform(robot, linearised)[0][:, robot.moving]
    return basis, float(np.linalg.det(platform @ basis))


@dataclass(frozen=True, eq=False)
class Leg(ReadOnlyArrays):
    """Joints that the platform's pose determines together."""

    motors: tuple[str, ...]  # names of its actuators; none for joints that only follow
    rows: IntArray  # (k,) of the equations F
    columns: IntArray  # (k,) among the `moving` columns: actuated, then passive
    before: IntArray  # (j,) of the legs that have to be solved before, likewise


def legs(robot: ParallelRobot) -> tuple[Leg, ...]:
    """Compute the legs in the order of their first motor; legs without a motor last.

    Raises:
        InvalidInput: the platform does not determine the joints.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components, maximum_bipartite_matching

    require_square(robot)
    pattern = csr_array(robot.equations.pattern[:, robot.moving].astype(float))  # (n + m, moving)
    row_of = maximum_bipartite_matching(pattern, perm_type="row")  # (columns,) each column's own equation
    matched = pattern[row_of]  # its diagonal is full
    label = connected_components(matched, directed=True, connection="strong")[1]  # (columns,) the leg of each
    needs = _needed_legs(label, *matched.nonzero())
    all_legs = []
    for k in range(len(needs)):
        columns = np.flatnonzero(label == k)
        motors = tuple(robot.actuator_names[c] for c in columns if c < robot.n_a)
        needed_columns = np.flatnonzero(needs[k, label] & (label != k))
        all_legs.append(Leg(motors, np.asarray(row_of[columns], dtype=np.intp), columns, needed_columns))
    return tuple(sorted(all_legs, key=lambda leg: int(leg.columns[0]) if leg.motors else pattern.shape[0]))


def _needed_legs(label: IntArray, first: IntArray, second: IntArray) -> BoolArray:
    """Return whether a leg needs another one, directly or through others, or is the same, (legs, legs).

    `label` are the legs of columns; the equation of each column `first` contains the column `second`.
    """
    needs = np.eye(int(label.max(initial=-1)) + 1, dtype=bool)
    for _ in needs:
        np.logical_or.at(needs, label[first], needs[label[second]])
    return needs


def leg_determinants(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute the determinant of each leg (T, legs), without dimension: zero on its Type 1 singularities."""
    M = type1_matrix(robot, linearised)
    blocks = [M[:, leg.rows][:, :, leg.columns] for leg in legs(robot)]  # (T, k, k) each
    return np.stack([np.linalg.det(block) for block in blocks], axis=1)


def leg_signs(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Return the working mode: the sign (T, legs) of each leg's determinant; 0 on a Type 1 singularity."""
    return np.sign(leg_determinants(robot, linearised))
