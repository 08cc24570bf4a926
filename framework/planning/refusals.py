"""All reasons to refuse a plan, roughly in the order in which they are checked.

Each entry has the error, the reason, and below them the functions that decide, in this package or a lower
one, without the prefix `framework.`. Invalid options are refused earlier, by an InvalidInput of
`planning.options` or `planning.request`. A search that a time limit ends raises SearchEnded
(`numerics.time_limit`). `planning.plan` adds the remedy. The code below the table has the records of the
numbers on which a refusal rests, and the refusal of laws that turn back. Condition (8),
alpha s" + beta s'^2 + gamma + delta s' = 0, keeps torques finite where the robot is singular.

On the path, springs at rest:

    NotAssembled: the loops do not close at the reference, or far from it
        kinematics.assembly.close_reference
        kinematics.assembly_search.find_closed_pose
    OutOfReach: the path leaves the workspace
        kinematics.continuation.tracking.track_path
    Type1Singularity: a leg is stretched or folded on the path
        kinematics.continuation.tracking.track_path
        singularity.points_on_path.search_path
    SingularPath: the path runs along the singular locus
        singularity.piecewise_measure.resolve_panels
    NotConverged: g is not resolved, or needs dropped loop equations
        singularity.piecewise_measure.resolve_panels
        singularity.points_on_path.search_path

In joints, into another working mode:

    NoLaw: no line in joints without motors leads from one pose to the other
        planning.joint_path.choose_joint_path

At a singular point:

    UncontrolledMotions: uncontrolled motions that cannot be told apart
        singularity.points_on_path.search_path
        kinematics.continuation.tracking.uncontrolled_error
    NoLaw: a singular point is not of Type 2
        dynamics.singularity_crossings.check_kind
    UncontrolledMotions: several motions are uncontrolled, not all across the locus
        dynamics.singularity_crossings.check_kind
        kinematics.continuation.tracking.uncontrolled_error
    NoLaw: the path starts or ends on the locus
        planning.crossing_points.check_crossable

The polynomial law:

    NoLaw: a touch, or several motions: more than one condition
        planning.crossing_points.check_one_condition_each
    NoLaw: the path is orthogonal to t_s: s" has no effect on t_s . W_p
        planning.condition.require_effect
    NoLaw: too many crossings, or no times and speeds at which a law advances
        planning.polynomial.choose_timing
    NoLaw: the conditions on the polynomial repeat or contradict each other
        planning.polynomial.plan_polynomial
    NoLaw: the law runs back or leaves the path
        planning.refusals.check_advance

The optimal law:

    NoLaw: deflections turn a tangential touch into two crossings, or into none
        planning.optimal.optimal_task.check_single_crossings
    NoLaw: springs and damping with rigid geometry
        planning.optimal.optimal_motion.optimal_motion
    NoLaw: s" has no effect, and no speed meets condition (8)
        planning.optimal.optimal_task.check_speeds
    UncontrolledMotions: no law meets the conditions of several motions
        planning.optimal.optimal_task.check_speeds
        kinematics.continuation.tracking.uncontrolled_error
    NoLaw: a motor cannot hold or drive the robot at an end of the path, or limits are too low
        planning.optimal.undeformed_law.refuse_law
    NoLaw: no law was found from the speed at the start, though from a slower one
        planning.optimal.undeformed_law.refuse_law
    NoLaw: no law was found that crosses at the required times within the limits
        planning.optimal.undeformed_law.refuse_law
    NotConverged: no law is found, although the limits are not the reason
        planning.optimal.undeformed_law.refuse_law
    NotConverged: law and damping do not settle
        planning.optimal.undeformed_law.find_undeformed_law
    NoLaw: the springs give way at an end, at rest, or, to first order, along the path
        planning.optimal.elastic_search.ElasticSearch
    NotConverged: no law within all limits is resolved
        planning.optimal.optimal_motion.optimal_motion
        planning.optimal.best_law.adapt_law
    NotConverged: law and springs do not settle together
        planning.optimal.elastic_search.ElasticSearch
    NotConverged: springs do not start or stop at rest
        planning.optimal.elastic_search.ElasticSearch

The motion, under either law or one of the user's own:

    NoLaw: the motion stops on the locus
        dynamics.singularity_crossings.find_crossed_points
    UnboundedTorque: condition (8) is not met: t_s . W_p is not zero at a crossing
        dynamics.singularity_crossings.check_bounded
    NoLaw: the deflected robot has no singular point near the crossing
        planning.crossing_tracker.track_points
    NotConverged: deflected, the path is orthogonal to t_s: s" has no effect
        planning.condition.require_effect
    NotAssembled: loops do not close along the motion, or rates do not exist
        kinematics.inverse_kinematics.close_loops
        kinematics.motion_rates.motion_at
    NotConverged: no deflections found in equilibrium with their forces
        dynamics.elasticity.solve_deflections
        dynamics.motion_checks.unsettled_error
    NotConverged: no law near this one has deflections in balance
        dynamics.restoration.solve_balance
        planning.optimal.elastic_balance.find_law_in_balance
        planning.polynomial.plan_polynomial
    SpringsTooSoft: the springs, or even stiffer ones, would deflect beyond the range of the model
        dynamics.elasticity.solve_deflections
        dynamics.restoration.solve_balance
    NotConverged: springs tear the loops open
        dynamics.inverse_dynamics.resolve
    NotConverged: torques, deflections or a near miss are not resolved
        dynamics.motion_checks.unresolved_error
    NoLaw: the deflected robot meets a singularity that the undeformed robot does not
        dynamics.singularity_crossings.check_crossings
    NotAssembled: the motion opens a loop equation that was redundant at the reference
        dynamics.motion_checks.measure_residuals
    LoadedJoint: a joint is loaded that nothing holds
        dynamics.motion_checks.check_idle_joints

The plan:

    NoLaw: the polynomial that was asked for exceeds the limits of the file
        planning.plan.plan_request
    NoLaw: neither law is found; the message has both reasons
        planning.plan.plan_request
    NotConverged: neither law is resolved; the message has both reasons
        planning.plan.plan_request
    LimitsExceeded: the plan exceeds limits although `keep_limits` is set
        planning.plan.check_limits
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from framework.errors import NoLaw, format_distinct, round_up
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.law import MotionLaw, law_derivatives
from framework.numerics.arrays import Array
from framework.planning.request import PEAK_SAMPLES
from framework.tolerances import AT_REST, LIMIT_MARGIN, OVERSHOOT

# ------------------------------------------------------------------ proofs, and numbers of searches

# Ratio of advised limits to the least peak found. Limits nearer to that peak hardly admit a smooth law.
RAISED_RATIO = 1.0 + 10.0 * LIMIT_MARGIN
ELASTIC_RATIO = 1.1  # the same, and of durations, for robots with springs, whose laws are smoother
LONGER_DURATIONS = (1.0, 1.02, 1.1)  # over the quickest, tried in turn
LARGEST_RAISE = 10.0  # of limits that are tried: with stronger motors it would be another robot
PRINTED_DIGITS = 4  # of advised limits and durations, which are tried as they are printed


class UnmetCondition(NamedTuple):
    """A condition (8), t_s . W_p = alpha s" + beta s'^2 + gamma = 0 at s, that no motion can meet.

    stop: whether the path starts or ends at s, where s' = s" = 0 and gamma is not zero. Otherwise alpha is
        zero, and beta s'^2 + gamma vanishes for no s'^2 > 0.
    """

    s: float
    alpha: float
    beta: float
    gamma: float
    stop: bool


class StaticFold(NamedTuple):
    """A fold of the static equilibria at an end s of the path, met as the springs get softer.

    compliance: compliance of the softest springs with an equilibrium, divided by that of the robot's springs.
    """

    s: float
    compliance: float


class LeastSoftening(NamedTuple):
    """The softening of an elastic robot at s by its loads, under the best law found.

    rho: share of its singularity measure that the robot loses, to first order in the compliance.
    """

    s: float
    rho: float


class HoldingTorque(NamedTuple):
    """A motor torque that holds or drives the robot at an end s of the path, above the limit.

    joint: name of the motor's joint.
    torque, limit: motor side [N m], or [N] for a sliding motor.
    """

    joint: str
    s: float
    torque: float
    limit: float


class SearchEvidence(NamedTuple):
    """The numbers of a search that found no law; no proof that none exists.

    A search leaves LIMIT_MARGIN of each limit free, so it finds no law whose peak is barely within a limit.

    cells: number of intervals of the piecewise polynomial that represents the squared speed.
    torque_peak: the least peak of torque found in the requested duration and within the speed limits, over
        the torque limits; None if no law was found, or without a torque limit.
    speed_peak: the least peak of speed found in the requested duration and within the torque limits, over the
        speed limits; None as above.
    together: whether limits of torque and of speed must both be raised. Both peaks are then of one law, for
        which the larger of the torque ratio and the squared speed ratio is least.
    options: limits (n_a,) a little above these peaks, motor side, with the margin of the request added and
        with the digits that are printed; several entries are alternatives. None are beyond LARGEST_RAISE.
    quickest: the least duration [s] found within the limits, of the undeformed robot; None without a law.
    limits: options with raised limits for which a plan was found; None without a plan.
    duration: a duration [s] for which a plan was found within the limits; None without a plan.
    start_speed: the derivatives of s at a slower start from which a law was found within the limits.
    without_times: whether a plan was found within the limits with its own times of crossings.
    """

    cells: int
    torque_peak: float | None = None
    speed_peak: float | None = None
    together: bool = False
    options: Sequence[dict[str, Array]] = ()
    quickest: float | None = None
    limits: dict[str, Array] | None = None
    duration: float | None = None
    start_speed: tuple[float, ...] | None = None
    without_times: bool = False

    @property
    def has_peaks(self) -> bool:
        """Whether a law was found that tells the least limits."""
        return self.torque_peak is not None or self.speed_peak is not None

    @property
    def clauses(self) -> tuple[str, ...]:
        """The numbers of the search, in words."""
        parts = []
        peaks = {"torque": self.torque_peak, "speed": self.speed_peak}
        # with enough digits to differ from 1, such as 1.00002
        ratios = {name: format_distinct(peak, 1.0)[0] for name, peak in peaks.items() if peak is not None}
        if self.together:
            parts.append(
                f"a law was found with torques {ratios.get('torque', '')} and speeds "
                f"{ratios.get('speed', '')} times the limits"
            )
        else:
            for quantity, ratio in ratios.items():
                # a peak within the limits is refused if it is within the margin that a search leaves free
                is_within = (peaks[quantity] or 0.0) <= 1.0
                margin = f", and a search stays {LIMIT_MARGIN:.2%} below them" if is_within else ""
                parts.append(f"the least peak of {quantity} found is {ratio} times the limits{margin}")
        if self.quickest is not None:
            parts.append(f"within the limits the quickest law found takes {self.quickest:.4g} s")
        if self.start_speed is not None:
            parts.append(f"a law was found within the limits from s' = {self.start_speed[0]:g} 1/s")
        if self.without_times:
            parts.append("within the limits there is a plan with other times")
        return *parts, f"searched on {self.cells} cells"


def advice_of(robot: ParallelRobot, limits: dict[str, Array]) -> str:
    """Return the advice to raise limits, such as "torque_limit 5 N m with speed_limit 2 rad/s would do".

    Args:
        limits: the advised limits (n_a,), motor side, by the name of their option; all are needed together.
    """
    words = []
    for name, limit in limits.items():
        units = robot.torque_units if "torque" in name else robot.speed_units
        rounded = [f"{round_up(number, PRINTED_DIGITS):.{PRINTED_DIGITS}g}" for number in limit]
        by_joint = zip(robot.actuator_names, rounded, strict=True)
        text = " ".join(f"{joint}={number}" for joint, number in by_joint if number != "inf")
        if len(set(rounded)) == 1 and len(set(units)) == 1:
            text = f"{rounded[0]} {units[0]}"
        words.append(f"{name} {text}")
    return f"{' with '.join(words)} would do"


# ------------------------------------------------------------------ laws that turn back


def check_advance(law: MotionLaw, s: Sequence[float]) -> None:
    """Refuse a law that turns back, leaves the path or repeats a crossing.

    A law may overshoot an end by less than `tolerances.OVERSHOOT` and return to it, as the law of degree 8 in
    the paper's case C does.

    Args:
        s: path coordinates (k,) of the singular points.

    Raises:
        NoLaw: the law has such a fault; the message has its s and time.
    """
    times = np.linspace(0.0, law.duration, PEAK_SAMPLES)
    position, speed = law_derivatives(law, times, 2)
    faults = list[str]()  # the first is stated
    for end, overshoot in ((0.0, -position), (1.0, position - 1.0)):  # how far the law is beyond the end
        worst = np.argmax(overshoot)
        if overshoot[worst] > OVERSHOOT:
            farthest = f"s = {position[worst]:.4g} at t = {times[worst]:.4g} s"
            faults.append(f"leaves the path at s = {end:g}, up to {farthest}")
    is_inside = (position > 0) & (position < 1)
    is_backwards = is_inside & (speed < -AT_REST * np.abs(speed).max())
    if is_backwards.any():
        first = np.argmax(is_backwards)
        faults.append(f"runs backwards at t = {times[first]:.4g} s, s = {position[first]:.4g}")
    for singular in s:
        meetings = times[:-1][np.diff(position > singular)]  # [s] samples after which it passes the point
        if len(meetings) > 1:
            instants = f"{len(meetings)} times (about t = {', '.join(f'{t:.4g}' for t in meetings)} s)"
            faults.append(f"meets the singular point s = {singular:.6g} {instants}")
    if faults:
        clauses = ("choose other times or speeds",)
        raise NoLaw(f"the law does not always advance: it {faults[0]}", clauses=clauses)
