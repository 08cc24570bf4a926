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
    """Compute the signs (T,) that change with the working mode and with the assembly mode.

    The sign of det [dF/dq] changes at Type 1 singularities, the sign of the determinant of the
    passive columns of the loops at Type 2 (of a robot without redundant motors; else it is 1).
    """
    return linearised.factors.slogdet[0], passive_determinants(linearised)[0]


def passive_determinants(linearised: LinearisedLoops) -> tuple[Array, Array]:
    """Compute the signs and logarithms (T,) of det P, the loops' matrix along passive joints.

    With redundant motors these are not square, and without passive joints there are none: it is 1 then.
    """
    if linearised.equations.passive_part is None:
        count = len(linearised.residual)
        return np.ones(count), np.zeros(count)
    return linearised.passive_factors.slogdet


def keeps_sign(first: tuple[Array, Array], second: tuple[Array, Array]) -> BoolArray:
    """Whether two stacks of determinants, given by signs and logarithms (T,), have the same signs, (T,).

    A second determinant that is smaller than the first by `DETERMINANT_LOST` is rounding and has no sign.
    """
    sign, size = first
    second_sign, second_size = second
    return (second_sign == sign) & (second_size - size > np.log(DETERMINANT_LOST))


def keeps_working_mode(robot: ParallelRobot, start: LinearisedLoops, ends: LinearisedLoops) -> BoolArray:
    """Whether each of T successive configurations is in the working mode of its predecessor, (T,).

    `start` (T = 1) is the predecessor of the first of the `ends`. That is so if no Type 1 singularity lies
    between the two or at the second.

    det [dF/dq] keeps its sign then. This determinant also changes sign where the loop equations lose rank,
    although a smooth branch goes on. The map from the motions that the loops allow to the platform does not:
    with N a basis of these motions, continued from one configuration to the other, det (platform N) keeps its
    sign. A configuration whose loops have lost rank belongs to no mode.
    """
    least = singular_values(scaled_loops(robot, ends)[:, :, robot.moving]).min(axis=1, initial=np.inf)
    has_rank = least >= RANK_LOST
    signs = np.concatenate([start.factors.slogdet[0], ends.factors.slogdet[0]])
    sizes = np.concatenate([start.factors.slogdet[1], ends.factors.slogdet[1]])
    keeps = has_rank & keeps_sign((signs[:-1], sizes[:-1]), (signs[1:], sizes[1:]))
    for k in np.flatnonzero(has_rank & ~keeps).tolist():
        previous = ends.select(k - 1) if k else start
        keeps[k] = _keeps_platform_map(robot, previous, ends.select(k))
    return keeps


def _keeps_platform_map(robot: ParallelRobot, first: LinearisedLoops, second: LinearisedLoops) -> bool:
    """Whether det (platform N) keeps its sign between two near configurations (T = 1 each).

    N (moving, n) is an orthonormal basis of the motions that the loops allow. The sign of det (N_1' N_2)
    tells whether the two bases have the same orientation.
    """
    N_1, determinant = _platform_map(robot, first)
    N_2, second_determinant = _platform_map(robot, second)
    continued = second_determinant * np.sign(determinant * np.linalg.det(N_1.T @ N_2))
    return bool(continued > DETERMINANT_LOST * abs(determinant))


def _platform_map(robot: ParallelRobot, linearised: LinearisedLoops) -> tuple[Array, float]:
    """Compute a basis N (moving, n) of the motions that the loops allow, and det (platform N), of one pose.

    Platform times N maps amplitudes of these motions to twists. Its determinant vanishes where the loops
    allow a motion that rests the platform; the sign depends on the orientation of N.
    """
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
    needed: IntArray  # (j,) the columns, likewise, of the legs that have to be solved earlier


def legs(robot: ParallelRobot) -> tuple[Leg, ...]:
    """Compute the legs in the order of their first motor.

    Legs without a motor come last.

    Raises:
        InvalidInput: the platform does not determine the joints.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components, maximum_bipartite_matching

    require_square(robot)
    pattern = csr_array(robot.equations.pattern[:, robot.moving].astype(float))  # (n + m, moving)
    row_of = maximum_bipartite_matching(pattern, perm_type="row")  # (columns,) each column's own equation
    matched = pattern[row_of]  # rows permuted so that the diagonal is full
    # irreducible blocks: the strongly connected components of the columns' graph
    label = connected_components(matched, directed=True, connection="strong")[1]  # (columns,) the leg of each
    needs = _leg_dependencies(label, *matched.nonzero())
    all_legs = []
    for k in range(len(needs)):
        columns = np.flatnonzero(label == k)
        motors = tuple(robot.actuator_names[c] for c in columns if c < robot.n_a)
        needed_columns = np.flatnonzero(needs[k, label] & (label != k))
        all_legs.append(Leg(motors, np.asarray(row_of[columns], dtype=np.intp), columns, needed_columns))
    return tuple(sorted(all_legs, key=lambda leg: int(leg.columns[0]) if leg.motors else pattern.shape[0]))


def _leg_dependencies(label: IntArray, first: IntArray, second: IntArray) -> BoolArray:
    """Compute whether leg i needs leg j, (legs, legs).

    A leg needs itself, and others directly or through others. `label` (columns,) is the leg of each column.
    Each of the pairs (first, second) is a column and another one that its equation contains.
    """
    needs = np.eye(int(label.max(initial=-1)) + 1, dtype=bool)
    needs[label[first], label[second]] = True
    return np.linalg.matrix_power(needs, len(needs))  # a chain of needs has at most as many legs


def leg_determinants(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute the determinant of each leg (T, legs), without dimension: zero on its Type 1 singularities."""
    M = type1_matrix(robot, linearised)
    blocks = [M[:, leg.rows][:, :, leg.columns] for leg in legs(robot)]  # (T, k, k) each
    return np.stack([np.linalg.det(block) for block in blocks], axis=1)


def leg_signs(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Return the working mode: the sign (T, legs) of each leg's determinant; 0 on a Type 1 singularity."""
    return np.sign(leg_determinants(robot, linearised))
