"""Loops of an overconstrained mechanism with rounded dimensions.

With exact dimensions some equations of an overconstrained loop are redundant. With dimensions of seven digits
these equations contradict the others by about 1e-7, and no pose satisfies all of them. So only equations that
are independent beyond rounding are solved, exactly. The residual of the other equations is measured along
each motion and reported in its certificate.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from framework.errors import NotAssembled
from framework.kinematics.assembly import (
    Closing,
    close_reference,
    joint_loops_matrix,
    largest_gap,
    nearby_configurations,
)
from framework.kinematics.closures import loop_equations
from framework.kinematics.frames import frames_at
from framework.kinematics.loop_structure import numerical_rank, pivot_rows
from framework.kinematics.mechanism import Mechanism, reference_length
from framework.numerics.arrays import Array
from framework.tolerances import EXPORT_ROUNDING

ROUNDED_ROW = 10 * EXPORT_ROUNDING  # relative singular value of rounding; least in the catalogue: 8e-3


def assemble_mechanism(mechanism: Mechanism) -> tuple[Mechanism, Closing]:
    """Close the loops at the reference, without rows that are redundant except for rounding.

    A mechanism may also close to the last digit in the pose in which it was drawn, where its rounding then
    locks it. So rows are also excluded if they are redundant except for rounding at nearby poses.

    Returns:
        The mechanism whose `rows` close exactly, and its closed pose.

    Raises:
        NotAssembled: the loops do not close, for another reason than rounding; see `close_reference`.
    """
    try:
        closing = close_reference(mechanism)
    except NotAssembled as failure:
        reduced = _exclude_rounded_rows(mechanism, failure.q)
        if reduced is None:
            raise
        return reduced, close_reference(reduced)
    # the size at the closed pose scales the rows, because the size at the file's reference may be far off
    sized = replace(mechanism, length=reference_length(mechanism.model, closing.q, mechanism.frames))
    matrix = joint_loops_matrix(sized, closing.q)
    if numerical_rank(matrix) > numerical_rank(matrix, ROUNDED_ROW):
        reduced = _exclude_rounded_rows(sized, closing.q)
        if reduced is not None and _are_rows_redundant_nearby(sized, reduced, closing.q):
            return replace(reduced, length=mechanism.length), closing
    return mechanism, closing


def rounded_gap(mechanism: Mechanism, q: Array) -> float:
    """Compute the largest residual of the rounded rows over configurations q (T, nq) [m or rad]."""
    if not mechanism.rounded.names:
        return 0.0
    return float(np.abs(loop_equations(mechanism.rounded, frames_at(mechanism, q)).residual).max())


def _exclude_rounded_rows(mechanism: Mechanism, q: Array) -> Mechanism | None:
    """Move rows that are redundant except for rounding at q (nq,) to `rounded`; None without any."""
    rows = mechanism.rows
    matrix = joint_loops_matrix(mechanism, q)
    rank = numerical_rank(matrix, ROUNDED_ROW)
    if largest_gap(mechanism, q) > EXPORT_ROUNDING or rank == len(rows.names):
        return None
    order = pivot_rows(matrix)
    independent, others = np.sort(order[:rank]), np.sort(order[rank:])
    return replace(mechanism, rows=rows.take(independent), rounded=rows.take(others))


def _are_rows_redundant_nearby(mechanism: Mechanism, reduced: Mechanism, q: Array) -> bool:
    """Return whether the rows of `reduced` imply all others, except for rounding, at poses near q (nq,)."""
    poses = nearby_configurations(reduced, q)
    ranks = {numerical_rank(joint_loops_matrix(mechanism, pose), ROUNDED_ROW) for pose in poses}
    gaps = [largest_gap(mechanism, pose) for pose in poses]
    return ranks == {len(reduced.rows.names)} and max(gaps) <= EXPORT_ROUNDING
