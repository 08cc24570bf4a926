"""Equilibria of many configurations under a growing load with locked motors, by continuation.

The equilibria under a growing share of weight and wrench form a curve, which is followed by pseudo-arclength
continuation (`arclength`) as long as the tangent stiffness is positive definite. So the equilibrium reached
is connected with the unloaded configuration without a jump, and curves may be flat or steep in the share.
Where the share turns back (a fold: snap-through) the turning point is solved for directly. A bifurcation
(buckling) is bracketed.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from framework.dynamics.forces import all_spring_forces
from framework.dynamics.stiffness import (
    CompliantMotions,
    compliant_motions,
    deflects_little,
    require_springs,
)
from framework.dynamics.tangent_stiffness import (
    EquilibriumEquations,
    Load,
    check_wrench,
    evaluate_equilibrium,
    tangent_stiffness,
)
from framework.kinematics.continuation.arclength import LOAD_STEP, CurveReason, Curves
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.modes import mode_signs
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, ArrayLike, BoolArray, IntArray, ReadOnlyArrays
from framework.tolerances import EIGENVALUE_ROUNDING


class LoadReason(IntEnum):
    """The outcome for one configuration: the load is carried, or the reason for failure."""

    CARRIED = 0
    GIVES_WAY = 1  # snaps through or buckles: the stiffness is lost before the whole load is applied
    TOO_SOFT = 2  # deflections beyond `MAX_DEFLECTION`
    OTHER_MODE = 3  # carried, but in another assembly mode, reached through Type 2
    NOT_CONVERGED = 4


LOAD_WORDS = {
    LoadReason.CARRIED: "carries the load",
    LoadReason.GIVES_WAY: "gives way: snaps through or buckles under the load",
    LoadReason.TOO_SOFT: "deflects by more than linear springs mean",
    LoadReason.OTHER_MODE: "led through Type 2 by the load",
    LoadReason.NOT_CONVERGED: "not converged",
}
LOAD_REASONS = {
    CurveReason.ARRIVED: LoadReason.CARRIED,
    CurveReason.TURNED: LoadReason.GIVES_WAY,
    CurveReason.LEFT: LoadReason.TOO_SOFT,
    CurveReason.STALLED: LoadReason.NOT_CONVERGED,
}


@dataclass(frozen=True, eq=False)
class LoadedStack(ReadOnlyArrays):
    """T configurations under the load, or under a share where the reason is not `CARRIED`."""

    q: Array  # (T, nq)
    reason: NDArray[np.uint8]  # (T,) `LoadReason`
    share: Array  # (T,) largest share of the load that was reached
    free: CompliantMotions  # at q, but K is the stiffness under load, not that of the springs alone


def loaded_stack(robot: ParallelRobot, q: Array, *, wrench: ArrayLike | None = None) -> LoadedStack:
    """Follow equilibria under growing weight and wrench from unloaded assembled configurations q (T, nq).

    Args:
        wrench: external wrench (n,) [N, N m] ON the platform, on its axes; None for weight alone.

    Raises:
        InvalidInput: the robot has no springs, or the wrench has no potential.
    """
    require_springs(robot)
    load = Load(
        check_wrench(robot, wrench),
        share=np.zeros(len(q)),
        preload=all_spring_forces(robot, q, robot.all_stiffness),  # in balance without load
    )

    def evaluate(q_on_curve: Array, share: Array, rows: IntArray) -> EquilibriumEquations:
        """Evaluate the equilibrium of the configurations `rows` (R,) under shares (R,) of the load."""
        return evaluate_equilibrium(robot, q_on_curve, Load(load.w, share, load.preload[rows]))

    motors_at_rest = np.zeros((len(q), robot.nv))
    ends, reasons = Curves(robot, robot.unlocked, motors_at_rest, evaluate).follow(
        q,
        load.share,
        evaluate_equilibrium(robot, q, load),
        longest=np.full(len(q), LOAD_STEP),
        to_rounding=True,
        accept=lambda ends: (_is_stable(ends.equations.H), deflects_little(robot, ends.points.q)),
    )
    reason = np.array([LOAD_REASONS[CurveReason(end)] for end in reasons], dtype=np.uint8)

    # a load that is carried may have led the robot into another assembly mode
    linearised = linearised_at(robot, ends.q)
    _, start_sign = mode_signs(robot, linearised_at(robot, q))  # (T,) of the assembly mode
    _, end_sign = mode_signs(robot, linearised)
    reason[(end_sign != start_sign) & (reason == LoadReason.CARRIED)] = LoadReason.OTHER_MODE
    free = compliant_motions(robot, linearised, ends.q)
    under_load = tangent_stiffness(robot, linearised, ends.q, free.Z, load._replace(share=ends.share))
    return LoadedStack(ends.q, reason, ends.share, free._replace(K=under_load))


def _is_stable(H: Array) -> BoolArray:
    """Return whether tangent stiffness matrices H (T, d, d) are positive definite, (T,)."""
    values = np.linalg.eigvalsh(H)  # (T, d) ascending
    rounding = EIGENVALUE_ROUNDING * np.abs(values).max(axis=1, keepdims=True, initial=0.0)
    return np.asarray((values > rounding).all(axis=1))
