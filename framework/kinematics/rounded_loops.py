"""Loops of an overconstrained mechanism whose dimensions were rounded.

With exact dimensions some rows of an overconstrained loop repeat others. Written with seven digits they do so
but for 1e-7, and no pose closes them all. Rows that are independent beyond such rounding close exactly. The
gap of the others is measured along each motion and stands in its certificate.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from framework.arrays import Array
from framework.errors import NotAssembled
from framework.kinematics.assembly import Closing, all_loops_matrix, close_reference
from framework.kinematics.closures import loop_equations, row_weights
from framework.kinematics.frames import frames_at
from framework.kinematics.loop_structure import numerical_rank, row_pivots
from framework.kinematics.mechanism import Mechanism
from framework.tolerances import EXPORT_ROUNDING

ROUNDED_ROW = 10 * EXPORT_ROUNDING  # singular value over the largest; the catalogue's weakest row has 8e-3


class AssembledMechanism(NamedTuple):
    """A mechanism whose `rows` close exactly, and its closed pose at the reference."""

    mechanism: Mechanism
    closing: Closing


def assembled_mechanism(mechanism: Mechanism) -> AssembledMechanism:
    """Close the loops at the reference; set rows aside that repeat others but for rounding.

    Raises:
        NotAssembled: the loops do not close, for another reason than rounding; see `close_reference`.
    """
    try:
        return AssembledMechanism(mechanism, close_reference(mechanism))
    except NotAssembled as failure:
        reduced = _set_rounded_rows_aside(mechanism, failure.q)
        if reduced is None:
            raise
    return AssembledMechanism(reduced, close_reference(reduced))


def rounded_gap(mechanism: Mechanism, q: Array) -> float:
    """Compute the largest gap of the rounded rows [m or rad] over configurations q (T, nq)."""
    if not mechanism.rounded.names:
        return 0.0
    return float(np.abs(loop_equations(mechanism.rounded, frames_at(mechanism, q)).residual).max())


def _set_rounded_rows_aside(mechanism: Mechanism, q: Array) -> Mechanism | None:
    """Set rows aside that repeat others but for rounding at q (nq,); None without any."""
    rows, weights = mechanism.rows, row_weights(mechanism, mechanism.rows.rotation)
    gap = np.abs(weights * loop_equations(rows, frames_at(mechanism, q[None])).residual[0]).max()
    matrix = all_loops_matrix(mechanism, q)[:, mechanism.joints]
    rank = numerical_rank(matrix, ROUNDED_ROW)
    if gap > EXPORT_ROUNDING or rank == len(rows.names):
        return None
    order = row_pivots(matrix)
    independent, others = np.sort(order[:rank]), np.sort(order[rank:])
    return replace(mechanism, rows=rows.take(independent), rounded=rows.take(others))
