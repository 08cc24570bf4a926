"""Loops of an overconstrained mechanism whose dimensions were rounded.

With exact dimensions some rows of an overconstrained loop repeat others. Written with seven digits they do so
but for 1e-7, and no pose closes them all. Rows that are independent beyond such rounding close exactly. The
gap of the others is measured along each motion and stands in its certificate.
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

ROUNDED_ROW = 10 * EXPORT_ROUNDING  # singular value over the largest; the catalogue's weakest row has 8e-3


def assemble_mechanism(mechanism: Mechanism) -> tuple[Mechanism, Closing]:
    """Close the loops at the reference, without rows that repeat others but for rounding.

    Returned are the mechanism whose `rows` close exactly, and its closed pose. A mechanism may close to the
    last digit in the pose of its drawing, and its rounding locks it there. So rows that repeat others at
    poses nearby, too, are set aside.

    Raises:
        NotAssembled: the loops do not close, for another reason than rounding; see `close_reference`.
    """
    try:
        closing = close_reference(mechanism)
    except NotAssembled as failure:
        reduced = _set_rounded_rows_aside(mechanism, failure.q)
        if reduced is None:
            raise
        return reduced, close_reference(reduced)
    # with its size at the closed pose for the length, which scales the rows
    sized = replace(mechanism, length=reference_length(mechanism.model, closing.q, mechanism.frames))
    matrix = joint_loops_matrix(sized, closing.q)
    if numerical_rank(matrix) > numerical_rank(matrix, ROUNDED_ROW):
        reduced = _set_rounded_rows_aside(sized, closing.q)
        if reduced is not None and _are_rows_redundant_nearby(sized, reduced, closing.q):
            return replace(reduced, length=mechanism.length), closing
    return mechanism, closing


def rounded_gap(mechanism: Mechanism, q: Array) -> float:
    """Compute the largest gap of the rounded rows [m or rad] over configurations q (T, nq)."""
    if not mechanism.rounded.names:
        return 0.0
    return float(np.abs(loop_equations(mechanism.rounded, frames_at(mechanism, q)).residual).max())


def _set_rounded_rows_aside(mechanism: Mechanism, q: Array) -> Mechanism | None:
    """Move rows that repeat others but for rounding at q to `rounded`.

    None if there are no such rows at q (nq,).
    """
    rows = mechanism.rows
    matrix = joint_loops_matrix(mechanism, q)
    rank = numerical_rank(matrix, ROUNDED_ROW)
    if largest_gap(mechanism, q) > EXPORT_ROUNDING or rank == len(rows.names):
        return None
    order = pivot_rows(matrix)
    independent, others = np.sort(order[:rank]), np.sort(order[rank:])
    return replace(mechanism, rows=rows.take(independent), rounded=rows.take(others))


def _are_rows_redundant_nearby(mechanism: Mechanism, reduced: Mechanism, q: Array) -> bool:
    """Whether the rows of `reduced` imply all others at poses near q (nq,).

    They do so but for rounding.
    """
    poses = nearby_configurations(reduced, q)
    ranks = {numerical_rank(joint_loops_matrix(mechanism, pose), ROUNDED_ROW) for pose in poses}
    gaps = [largest_gap(mechanism, pose) for pose in poses]
    return ranks == {len(reduced.rows.names)} and max(gaps) <= EXPORT_ROUNDING
