"""The facts that describe a plan, each a label, a value and a unit.

The printed plan, the tables of the HTML report and the captions of films take their facts from here. t_s is
the twist of the platform that the motors do not control at a crossing, and W_p the wrench that the motion
requires.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from framework.errors import point
from framework.kinematics.frames import frames_at
from framework.kinematics.inverse_kinematics import driven_turns
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.optimal_law import OptimalLaw
from framework.model.description import FrameWrench
from framework.numerics.arrays import Array
from framework.planning.motor_use import CURVE
from framework.planning.neglected_effects import NeglectedEffect
from framework.planning.request import PEAK_SAMPLES, specification_of
from framework.planning.result import Crossing, CrossingPlan
from framework.singularity.type2 import moves_point
from framework.tolerances import FILE_ROUNDING

# Texts of facts. The fields {0....} are those of a crossing, a loaded point or the certificate of a plan.
CROSSING = (
    "t = {0.time:.6g} s at s = {0.s:.15f}, {place}",
    "t_s = {twist}, s' = {0.speed:.6g} 1/s, s\" = {acceleration:.6g} 1/s2, |t_s . W_p| {0.residual:.1e} of "
    "its peak",
)
LOADED = "singular under its loads at s = {0.s:.9f}, {0.distance:.2g} {1} from there"
IDLE_TURNS = "{turns}; what nothing holds there: {0.max_held_torque:.1e} N m or N"
ROUNDED = "loops that repeat others stay open by {0.rounded_gap:.1e} m or rad"
MUCH_LEFT_OUT = (
    "what is left out is worth more than the plan's own torques: plan with it, --flexibility, or more "
    "gently, a higher --smoothness or a longer duration"
)
MOVING_ENDS = (
    "the motors start and stop with {0.end_speed:.1e} of their largest speed: the springs carry inertia; a "
    "higher --smoothness mends it"
)
OVERSHOOT = (
    "the law overshoots its ends (s from {0:.6g} to {1:.6g}); other times or speeds, or a higher "
    "--smoothness, avoid it"
)


class Fact(NamedTuple):
    """A label, a value and its unit in words; an empty label continues the fact above."""

    label: str
    value: str  # a number, or words with their units
    unit: str = ""

    @property
    def text(self) -> str:
        """The value with its unit."""
        return f"{self.value} {self.unit}".rstrip()

    @property
    def line(self) -> str:
        """The fact as a line of a printed report."""
        return f"  {self.label:<16}  {self.text}"


def join_facts(facts: Iterable[Fact]) -> str:
    """Return facts as one phrase, each with its label."""
    return ", ".join(f"{fact.label} {fact.text}" for fact in facts)


def motion_facts(plan: CrossingPlan) -> list[Fact]:
    """Return the facts about the motion of a plan, the certificate and the faults.

    The order is: wrenches, crossings, torques, certificate, effects left out, warnings.
    """
    wrenches = [Fact("wrench", wrench_text(wrench)) for wrench in plan.dynamics.wrenches.entries]
    torque = Fact("peak torque", torque_text(plan.robot, plan.peak_torque))
    left_out = [Fact("left out", neglected_text(plan.robot, effect)) for effect in plan.neglected]
    certificate, warnings = _certificate_summary(plan), _warning_facts(plan)
    return [*wrenches, *_crossing_facts(plan), torque, *_use_facts(plan), *certificate, *left_out, *warnings]


def _use_facts(plan: CrossingPlan) -> list[Fact]:
    """Return the shares of its limits that each motor uses; none without curves or RMS limits."""
    if specification_of(plan.robot, plan.request).drives is None:
        return []
    by_joint: dict[str, list[str]] = {}
    for use in plan.motor_use:
        place = f" ({use.size_text}, t = {use.time:.4g} s)" if use.limit == CURVE else ""
        by_joint.setdefault(use.joint, []).append(f"{100 * use.ratio:.1f} % of its {use.limit}{place}")
    texts = [f"{joint} {', '.join(shares)}" for joint, shares in by_joint.items()]
    return [Fact("" if number else "motors use", text) for number, text in enumerate(texts)]


def smoothness_facts(plan: CrossingPlan) -> list[Fact]:
    """Return the fact about cost and smoothness of an optimal law; none for other laws."""
    best, law = plan.optimality, plan.law
    if best is None or not isinstance(law, OptimalLaw):
        return []
    goal = best.specification.goal.replace("_", " ")
    times = "time" if law.turns == 1 else "times"
    text = f"{100 * best.gap:.2g} % above the least {goal} found; its speed turns {law.turns} {times}"
    return [Fact("smoothed", text)]


def torque_facts(robot: ParallelRobot, torques: Iterable[float], digits: int = 6) -> list[Fact]:
    """Return the torque [N m, N] of each motor, to a number of significant digits."""
    motors = zip(robot.actuator_names, torques, robot.torque_units, strict=True)
    return [Fact(joint, f"{torque:.{digits}g}", unit) for joint, torque, unit in motors]


def torque_text(robot: ParallelRobot, torques: Mapping[str, float], digits: int = 6) -> str:
    """Return the torques of motors with their units, in words.

    Args:
        torques: [N m, N] of all motors by joint, in the order of the robot's motors.
        digits: significant digits.
    """
    return join_facts(torque_facts(robot, torques.values(), digits))


def twist_text(robot: ParallelRobot, twist: Array) -> str:
    """Return the twist t_s on the platform's axes in words."""
    return f"{point(twist)} of unit {'speed' if moves_point(robot, twist) else 'turning rate'}"


def wrench_text(wrench: FrameWrench) -> str:
    """Return force and moment of an external wrench in words.

    For a table of wrenches over s, these are the largest force and the largest moment.
    """
    axes = f"axes of {'the frame' if wrench.turns else 'the base'}"
    if wrench.rows.ndim == 1:  # one constant wrench (6,)
        force, moment = point(wrench.rows[:3]), point(wrench.rows[3:])
        return f"on {wrench.frame}: force {force} N, moment {moment} N m, {axes}"
    force_peak = np.linalg.norm(wrench.rows[:, 1:4], axis=1).max()  # rows (s, force, moment)
    moment_peak = np.linalg.norm(wrench.rows[:, 4:], axis=1).max()
    return (
        f"on {wrench.frame}: a table of {len(wrench.rows)} rows over s, force up to {force_peak:.6g} N, "
        f"moment up to {moment_peak:.6g} N m, {axes}"
    )


def neglected_text(robot: ParallelRobot, neglected: NeglectedEffect) -> str:
    """Return a neglected effect with its torque and share of the largest torque, in words."""
    if neglected.torque is None or neglected.share is None:
        return neglected.effect
    motor = robot.actuator_names.index(neglected.motor) if neglected.motor else 0  # for the unit
    joint = f" at {neglected.motor}" if neglected.motor else ""
    share = f"{neglected.share:.2g} times" if neglected.share > 1.0 else f"{100 * neglected.share:.2g} % of"
    worth = f"{neglected.torque:.2g} {robot.torque_units[motor]}{joint}"
    return f"{neglected.effect}: worth {worth}, {share} the largest"


def excess_facts(exceeded: Mapping[str, str]) -> list[Fact]:
    """Return a warning for each joint that exceeds limits; `exceeded` says by how much, by joint."""
    return [Fact("warning", f"{joint} exceeds its limits: {excess}") for joint, excess in exceeded.items()]


def _crossing_facts(plan: CrossingPlan) -> list[Fact]:
    """Return the facts about each crossing: pose, twist, speed, shift under loads."""
    robot, facts = plan.robot, list[Fact]()
    unit = "m" if robot.translations.any() else "rad"
    for crossing, loaded in zip(plan.crossings, plan.loaded_points, strict=True):
        words = {  # fields of the texts CROSSING
            "place": robot.place(crossing.platform),
            "twist": twist_text(robot, crossing.twist),
            "acceleration": round(crossing.acceleration, 9) + 0.0,  # -0.0 becomes 0.0
        }
        texts = [text.format(crossing, **words) for text in CROSSING]
        facts += map(Fact, ("crossing", ""), texts)
        if robot.description.platform.joints:
            facts.append(Fact("", _frame_text(plan, crossing)))
        if loaded is not None:
            facts.append(Fact("", LOADED.format(loaded, unit)))
    return facts or [Fact("crossing", "none")]


def _frame_text(plan: CrossingPlan, crossing: Crossing) -> str:
    """Describe the platform's frame at a crossing: its place, and its twist in t_s."""
    robot = plan.robot
    frames = frames_at(robot, plan.configuration(crossing.time)[None])
    velocity, turn = np.split(robot.platform.frame_twist(frames, crossing.twist[None])[0], 2)
    return (
        f"{robot.description.platform.frame} at {point(frames.platform_origin[0])} m, in t_s with the "
        f"velocity {point(velocity)} and the turn {point(turn)}"
    )


def certificate_facts(plan: CrossingPlan) -> list[Fact]:
    """Return the numbers that prove the torques of a plan."""
    certificate = plan.certificate
    facts = [
        Fact("tail", f"{certificate.tail:.1e}"),
        Fact("nodes", f"{certificate.nodes}"),
        Fact("passes", f"{certificate.passes}"),
        Fact("loops closed to", f"{certificate.max_closure_error:.1e}", "m or rad"),
        Fact("joints in balance to", f"{certificate.max_residual_torque:.1e}", "N m or N"),
        Fact("speed at the ends", f"{certificate.end_speed:.1e}", "of the largest"),
    ]
    if plan.geometry == "deformed":
        facts.append(Fact("deflections settled to", f"{certificate.change:.1e}"))
    return facts


def _certificate_summary(plan: CrossingPlan) -> list[Fact]:
    """Return the certificate as one fact, and facts about idle turns and rounded loops if any.

    Nothing holds an idle turn against the torque `max_held_torque` that the motion would need there. Rounded
    loops are redundant loop equations that rounded data leave open by `rounded_gap`.
    """
    certificate = plan.certificate
    facts = [Fact("certificate", join_facts(certificate_facts(plan)))]
    if certificate.max_held_torque:
        robot, driven = plan.robot, driven_turns(plan.robot)
        kinds = {
            "held still": np.setdiff1d(robot.structure.idle, driven),
            "as damping or armature of their balls drives them": driven,
        }
        names = {
            kind: ", ".join(map(robot.coordinates.turn_name, columns)) for kind, columns in kinds.items()
        }
        turns = "; ".join(f"{joints} {kind}" for kind, joints in names.items() if joints)
        facts.append(Fact("idle turns", IDLE_TURNS.format(certificate, turns=turns)))
    if certificate.rounded_gap:
        facts.append(Fact("rounded", ROUNDED.format(certificate)))
    return facts


def _warning_facts(plan: CrossingPlan) -> list[Fact]:
    """Return warnings about neglected effects, exceeded limits, moving ends and overshoot."""
    certificate, facts = plan.certificate, excess_facts(plan.exceeded)
    if any((effect.share or 0.0) > 1.0 for effect in plan.neglected):
        facts.insert(0, Fact("warning", MUCH_LEFT_OUT))
    if certificate.end_speed > FILE_ROUNDING and not any(plan.request.ends.moving):
        facts.append(Fact("warning", MOVING_ENDS.format(certificate)))
    if not certificate.monotone:
        s = plan.law(np.linspace(0.0, plan.duration, PEAK_SAMPLES))
        facts.append(Fact("warning", OVERSHOOT.format(s.min(), s.max())))
    return facts
