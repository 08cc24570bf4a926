"""Singular points that no law, or not the polynomial, can cross: refused before a law is sought."""

from __future__ import annotations

from collections.abc import Sequence

from framework.crossing.condition import CrossingPoint, coefficients_at, undeformed_crossing
from framework.crossing.refusals.refusal_proofs import UnmetCondition
from framework.dynamics.singularity_crossings import check_kind
from framework.errors import NoLaw
from framework.kinematics.continuation.branch import Branch
from framework.kinematics.parallel_robot import ParallelRobot
from framework.singularity.points_on_path import SingularPoint
from framework.tolerances import SAME_PLACE


def check_crossable(branch: Branch, singular: SingularPoint) -> None:
    """Refuse a singular point that no law can cross.

    Raises:
        UncontrolledMotions, NoLaw: condition (8) does not apply there (see `check_kind`).
        NoLaw: the path starts or ends there.
    """
    check_kind(branch.robot, singular)
    if stops_at(singular):
        end = "starts" if singular.s < 0.5 else "ends"
        alpha, beta, gamma, _ = coefficients_at(branch, undeformed_crossing(singular), deflection=None)
        unmet = UnmetCondition(singular.s, alpha, beta, gamma, stop=True)
        raise NoLaw(
            f"{branch.robot.name}: at s = {singular.s:.6g} the path {end} on a Type 2 singularity; a stop on "
            f"the locus can never be crossed: move the path's end",
            proof=unmet if gamma != 0.0 else None,
        )


def stops_at(singular: SingularPoint) -> bool:
    """Whether the path starts or ends at a singular point."""
    return not SAME_PLACE < singular.s < 1.0 - SAME_PLACE


def check_one_condition_each(robot: ParallelRobot, points: Sequence[SingularPoint | CrossingPoint]) -> None:
    """Refuse a point with more than one condition for the polynomial law.

    At a tangential touch these are condition (8) and its derivative; where several motions escape at once,
    one for each.

    Raises:
        NoLaw: says where and what to do.
    """
    for singular in points:
        if not isinstance(singular, SingularPoint):
            continue
        where = f"{robot.name}: at s = {singular.s:.6g}"
        if singular.corank > 1:
            raise NoLaw(
                f"{where} {singular.corank} motions are uncontrolled at once, each with a condition (8) of "
                f"its own, and the polynomial meets one, the optimal law each"
            )
        if singular.contact == "tangential":
            raise NoLaw(
                f"{where} the path touches the locus without crossing it; finite torques ask for condition "
                f"(8) and its time derivative at once, and the polynomial meets the first, the optimal law "
                f"both; or move the path off the locus or across it"
            )
