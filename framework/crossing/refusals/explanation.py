"""Advice beside the reason of a refusal, and the check of limits that a plan must keep."""

from __future__ import annotations

from framework.crossing.durations import OptimalDurations, optimal_durations, polynomial_durations
from framework.crossing.feasibility import feasibility_on_path
from framework.crossing.refusals.remedies import remedy_of
from framework.crossing.request import Request
from framework.crossing.result import CrossingPlan
from framework.errors import LimitsExceeded, NoLaw, UnboundedTorque
from framework.singularity.points_on_path import SearchedPath


def with_explanation(refusal: NoLaw, searched: SearchedPath, request: Request) -> NoLaw:
    """Return the refusal with condition (8) at each singular point, durations and a remedy appended."""
    sentences = [str(refusal)]
    sentences += [
        feasibility.short_sentence for feasibility in feasibility_on_path(searched) if feasibility is not None
    ]
    polynomial = polynomial_durations(searched, request.smoothness)
    if polynomial is not None:
        sentences.append(polynomial.sentence)
    optimal = _untried_durations(searched, request)
    if optimal is not None and optimal.shortest != 0.0:  # without limits nothing bounds it
        sentences.append(optimal.sentence)
    remedy = remedy_of(refusal, searched.branch.robot, request, optimal)
    return NoLaw("; ".join(sentences), proof=refusal.proof, evidence=refusal.evidence).advising(remedy)


def with_remedy(pole: UnboundedTorque, searched: SearchedPath, request: Request) -> UnboundedTorque:
    """Return the refusal of a law that does not meet condition (8), with the remedy."""
    optimal = _untried_durations(searched, request)
    return pole.advising(remedy_of(pole, searched.branch.robot, request, optimal))


def _untried_durations(searched: SearchedPath, request: Request) -> OptimalDurations | None:
    """Return the durations of the optimal law if the request excludes that law, else None."""
    return None if request.may_be_optimal else optimal_durations(searched, request)


def check_limits(plan: CrossingPlan) -> None:
    """Raise LimitsExceeded where a plan with `keep_limits` exceeds limits."""
    exceeded = plan.exceeded if plan.request.keep_limits else {}
    if exceeded:
        listed = "; ".join(f"{joint}: {excess}" for joint, excess in exceeded.items())
        raise LimitsExceeded(f"{plan.robot.name}: the motion leaves limits: {listed}", exceeded=exceeded)
