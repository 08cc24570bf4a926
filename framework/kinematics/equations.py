"""The table of a robot's equations and the sparsity of their Jacobian, which do not depend on q."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from framework.arrays import IntArray, ReadOnlyArrays
from framework.kinematics.mechanism import Mechanism
from framework.kinematics.pinocchio_memory import scratch_of
from framework.kinematics.platform import PlatformCoordinates
from framework.linalg.banded_lu import Band
from framework.linalg.sparsity import Part, Sparsity
from framework.model.loop_rows import LoopRows


@dataclass(frozen=True, eq=False)
class Equations(ReadOnlyArrays):
    """F = [platform - x ; closures]: n + m equations, and where their Jacobian has entries."""

    loops: LoopRows  # the m independent ones
    bodies: IntArray  # (n + m,) the frame that the wrench of each equation acts on
    n: int  # of the platform's equations, which come first
    pattern: Sparsity  # (n + m, nv)
    columns: IntArray  # those that follow when x and q_e are given: actuated, then passive
    moving: Part  # all rows, these columns: square if planning is possible
    elastic: Part  # all rows, the columns of the springs
    passive: Part  # loops only, the passive columns: square without redundant motors
    moving_band: Band | None  # None if not square
    passive_band: Band | None

    @staticmethod
    def of(
        mechanism: Mechanism, platform: PlatformCoordinates, loops: LoopRows, columns: IntArray, n_a: int
    ) -> Equations:
        """Return the table of loop equations and `columns`, of which the first n_a have motors."""
        carried, n = scratch_of(mechanism).carried, platform.n
        own = platform.felt_by(carried[0])
        signs = np.concatenate([own, carried[loops.second] - carried[loops.first]])
        direct = np.zeros_like(signs)
        direct[n:] = loops.coupling_jacobian(signs.shape[1])
        pattern = Sparsity.of(signs, direct)
        rows = np.arange(pattern.shape[0])
        moving = pattern.part(rows, columns)
        passive = pattern.part(rows[n:], columns[n_a:])
        bands = [
            Band.of(part.row, part.column, part.shape[0]) if part.shape[0] == part.shape[1] > 0 else None
            for part in (moving, passive)
        ]
        return Equations(
            loops=loops,
            bodies=np.concatenate([np.zeros(n, dtype=np.intp), loops.second]),
            n=n,
            pattern=pattern,
            columns=columns,
            moving=moving,
            elastic=pattern.part(rows, mechanism.elastic),
            passive=passive,
            moving_band=bands[0],
            passive_band=bands[1],
        )
