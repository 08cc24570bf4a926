"""The table of all reasons to say no to a plan, in the order in which they are asked."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from framework.dynamics.elasticity import solve_deflections
from framework.dynamics.inverse_dynamics import resolve
from framework.dynamics.refusals import unresolved_error, unsettled_error
from framework.dynamics.residuals import check_idle_joints, measure_residuals
from framework.dynamics.restoration import solve_balance
from framework.dynamics.singularity_crossings import (
    check_bounded,
    check_crossings,
    check_kind,
    rigid_crossings,
)
from framework.errors import (
    LimitsExceeded,
    LoadedJoint,
    NoAnswer,
    NoLaw,
    NotAssembled,
    NotConverged,
    OutOfReach,
    SingularPath,
    SpringsTooSoft,
    Type1Singularity,
    UnboundedTorque,
    UncontrolledMotions,
)
from framework.kinematics.assembly import close_reference
from framework.kinematics.continuation.tracking import escape_error, track_path
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.motion_rates import motion_at
from framework.planning.condition import condition_at, crossing_point
from framework.planning.crossing_points import check_crossable, check_one_condition_each
from framework.planning.optimal.elastic_balance import find_law_in_balance
from framework.planning.optimal.limit_refusals import refuse_law
from framework.planning.optimal.optimal_motion import optimal_motion
from framework.planning.optimal.optimal_task import check_speeds, check_unfolded
from framework.planning.optimal.rest_of_springs import check_rest
from framework.planning.optimal.undeformed_law import find_law
from framework.planning.plan import plan_request
from framework.planning.polynomial import polynomial_motion
from framework.planning.refusals.explanation import check_limits, with_explanation
from framework.planning.refusals.turning_back import check_advance
from framework.planning.timing import choose_timing
from framework.singularity.piecewise_measure import panels
from framework.singularity.points_on_path import search_path


class Reason(NamedTuple):
    """A reason to refuse a plan: its sentence, the error raised, the functions that decide."""

    why: str
    error: type[NoAnswer]
    decided_by: tuple[Callable[..., Any], ...]


def _reason(why: str, error: type[NoAnswer], *decided_by: Callable[..., Any]) -> Reason:
    return Reason(why, error, decided_by)


PATH = (  # springs at rest
    _reason("the loops do not close at the reference, or far from it", NotAssembled, close_reference),
    _reason("the path leaves the workspace", OutOfReach, track_path),
    _reason("a leg is stretched or folded on the path", Type1Singularity, track_path, search_path),
    _reason("the path runs along the singular locus", SingularPath, panels),
    _reason("g is not resolved, or needs dropped loop equations", NotConverged, panels, search_path),
)
SINGULAR_POINTS = (
    _reason("motions escape that cannot be told apart", UncontrolledMotions, search_path, escape_error),
    _reason("a singular point is not of Type 2", NoLaw, check_kind),
    _reason(
        "several motions escape, not all across the locus", UncontrolledMotions, check_kind, escape_error
    ),
    _reason("the path starts or ends on the locus", NoLaw, check_crossable),
)
POLYNOMIAL_LAW = (
    _reason("a touch, or several motions: more than one condition", NoLaw, check_one_condition_each),
    _reason('the path is orthogonal to t_s: s" has no effect on t_s . W_p', NoLaw, condition_at),
    _reason("too many crossings, or no times and speeds at which a law advances", NoLaw, choose_timing),
    _reason("its conditions repeat or contradict each other", NoLaw, polynomial_motion),
    _reason("the law runs back or leaves the path", NoLaw, check_advance),
)
OPTIMAL_LAW = (
    _reason("springs make two crossings of a touch, or none", NoLaw, check_unfolded),
    _reason("no speed meets what is left of condition (8)", NoLaw, check_speeds),
    _reason(
        "no law meets the conditions of several motions", UncontrolledMotions, check_speeds, escape_error
    ),
    _reason("a motor cannot hold an end of the path, or limits are too low", NoLaw, refuse_law),
    _reason("no law is found, for no reason of its limits", NotConverged, refuse_law),
    _reason("law and damping do not settle", NotConverged, find_law),
    _reason("springs and damping at once are not supported", NoLaw, optimal_motion),
    _reason("law and springs do not settle together", NotConverged, optimal_motion),
    _reason("springs do not start or stop at rest", NotConverged, check_rest),
)
MOTION = (  # under either law, or one of the user's own
    _reason("the motion stops on the locus", NoLaw, rigid_crossings),
    _reason("condition (8) is not met: t_s . W_p is not zero at a crossing", UnboundedTorque, check_bounded),
    _reason("the deflected robot has no singular point near the crossing", NoLaw, crossing_point),
    _reason('deflected, the path is orthogonal to t_s: s" has no effect', NotConverged, condition_at),
    _reason("loops do not close on the way, or rates do not exist", NotAssembled, close_loops, motion_at),
    _reason(
        "no deflections cause the forces that hold them", NotConverged, solve_deflections, unsettled_error
    ),
    _reason(
        "no law near this one has deflections in balance", NotConverged, solve_balance, find_law_in_balance
    ),
    _reason("even springs much stiffer would give beyond all sense", SpringsTooSoft, solve_balance),
    _reason("springs tear the loops open", NotConverged, resolve),
    _reason("torques, deflections or a near miss are not resolved", NotConverged, unresolved_error),
    _reason("the deflected robot meets a singularity of its own", NoLaw, check_crossings),
    _reason("a loop equation tears that was redundant at the reference", NotAssembled, measure_residuals),
    _reason("a joint is loaded that nothing holds", LoadedJoint, check_idle_joints),
)
PLAN = (
    _reason("the polynomial that was asked for exceeds the limits of the file", NoLaw, plan_request),
    _reason("neither law is found; says what either lacks", NoLaw, plan_request, with_explanation),
    _reason("neither law is resolved; says what either lacks", NotConverged, plan_request),
    _reason("limits are left that were to be kept", LimitsExceeded, check_limits),
)
REASONS = (*PATH, *SINGULAR_POINTS, *POLYNOMIAL_LAW, *OPTIMAL_LAW, *MOTION, *PLAN)
