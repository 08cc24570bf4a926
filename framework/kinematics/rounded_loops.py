"""Loops of an overconstrained mechanism whose dimensions were rounded: they miss one another by a little.

Exact dimensions would let rows of an overconstrained loop repeat others; written with seven digits they do so
but for 1e-7, and no pose closes them all. Rows that are independent beyond such rounding are kept and close
exactly; what the others stay open by is measured along each motion, and stands in its certificate.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.errors import NotAssembled
from framework.kinematics.assembly import Closing, all_loops_matrix, close_reference
from framework.kinematics.closures import loop_equations
from framework.kinematics.frames import frames_at
from framework.kinematics.loop_structure import numerical_rank, row_pivots
from framework.kinematics.mechanism import Mechanism
from framework.tolerances import EXPORT_ROUNDING

ROUNDED_ROW = 10 * EXPORT_ROUNDING  # singular value over the largest; the catalogue's weakest row has 8e-3


class AssembledMechanism(NamedTuple):
    """A mechanism whose `rows` close exactly, and the pose at its reference in which they do."""

    mechanism: Mechanism
    closing: Closing


def assembled_mechanism(mechanism: Mechanism) -> AssembledMechanism:
    """Close the loops at the reference, rows left aside that repeat others but for rounding.

    Raises:
        NotAssembled: they do not close, and rounding is not why; see `close_reference`.
    """
    try:
        return AssembledMechanism(mechanism, close_reference(mechanism))
    except NotAssembled as failure:
        kept = _set_rounded_rows_aside(mechanism, failure.q)
        if kept is None:
            raise
    return AssembledMechanism(kept, close_reference(kept))


def rounded_gap(mechanism: Mechanism, q: Array) -> float:
    """Compute by how much the rounded rows are open at most [m or rad], over configurations q (T, nq)."""
    if not mechanism.rounded.names:
        return 0.0
    return float(np.abs(loop_equations(mechanism.rounded, frames_at(mechanism, q)).residual).max())


def _set_rounded_rows_aside(mechanism: Mechanism, q: Array) -> Mechanism | None:
    """Return the mechanism without rows that repeat others but for rounding at q (nq,), None without such."""
    rows = mechanism.rows
    weights = np.where(rows.rotation, 1.0, 1.0 / mechanism.length)
    gap = np.abs(weights * loop_equations(rows, frames_at(mechanism, q[None])).residual[0]).max()
    matrix = all_loops_matrix(mechanism, q)[:, mechanism.joints]
    rank = numerical_rank(matrix, ROUNDED_ROW)
    if gap > EXPORT_ROUNDING or rank == len(rows.names):
        return None
    order = row_pivots(matrix)
    kept, others = np.sort(order[:rank]), np.sort(order[rank:])
    return replace(mechanism, rows=rows.take(kept), rounded=rows.take(others))
