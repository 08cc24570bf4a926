"""The legs of a robot, as the inverse kinematics sees them, and the working mode as one sign for each.

With the platform given, the equations [platform - x ; closures] = 0 fall apart into blocks that are solved
one after the other: the irreducible blocks of the sparsity pattern of their Jacobian (Dulmage and Mendelsohn
1958; Duff, Erisman and Reid 1986, chapter 6). Each block is a leg, with its own Type 1 singularities: the
sign of its determinant changes there and nowhere else. det [dF/dq] is the product of these determinants, so
that its sign alone does not tell a robot with two legs turned over from one with none; the signs of all do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from framework.arrays import Array, IntArray, ReadOnlyArrays
from framework.kinematics.inverse_kinematics import System, require_square
from framework.kinematics.loop_matrices import mobile_matrix
from framework.kinematics.parallel_robot import ParallelRobot


@dataclass(frozen=True, eq=False)
class Leg(ReadOnlyArrays):
    """Joints that the platform's pose determines together."""

    motors: tuple[str, ...]  # names of its actuators; none for joints that only follow
    rows: IntArray  # (k,) of the equations F
    columns: IntArray  # (k,) among the `moving` columns: actuated, then passive
    before: IntArray  # (j,) of the legs that have to be solved before, likewise


def legs(robot: ParallelRobot) -> tuple[Leg, ...]:
    """The legs in the order of their first motor; those without a motor last.

    Raises:
        InvalidInput: the platform does not determine the joints.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components, maximum_bipartite_matching

    require_square(robot)
    part = robot.equations.moving
    size = part.shape[0]
    pattern = csr_array((np.ones(len(part.row)), (part.row, part.column)), shape=part.shape)
    row_of = maximum_bipartite_matching(pattern, perm_type="row")  # (columns,)
    matched = pattern[row_of]  # its diagonal is full: each column's own equation stands in its row
    label = connected_components(matched, directed=True, connection="strong")[1]
    first, then = matched.nonzero()  # a column's equation has the other columns
    needs = np.eye(int(label.max(initial=-1)) + 1, dtype=bool)
    for _ in needs:
        np.logical_or.at(needs, label[first], needs[label[then]])
    found = []
    for k in range(int(label.max(initial=-1)) + 1):
        columns = np.flatnonzero(label == k)
        motors = tuple(robot.actuator_names[c] for c in columns if c < robot.n_a)
        before = np.flatnonzero(needs[k, label] & (label != k))
        found.append(Leg(motors, np.asarray(row_of[columns], dtype=np.intp), columns, before))
    return tuple(sorted(found, key=lambda leg: int(leg.columns[0]) if leg.motors else size))


def leg_determinants(robot: ParallelRobot, system: System) -> Array:
    """Determinant of each leg (T, legs), without dimension: zero on its Type 1 singularities."""
    M = mobile_matrix(robot, system)
    return np.stack([np.linalg.det(M[:, leg.rows][:, :, leg.columns]) for leg in legs(robot)], axis=1)


def leg_signs(robot: ParallelRobot, system: System) -> Array:
    """The working mode: the sign (T, legs) of each leg's determinant; 0 on a Type 1 singularity itself."""
    return np.asarray(np.sign(leg_determinants(robot, system)))
