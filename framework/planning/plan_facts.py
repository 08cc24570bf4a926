"""The facts that describe a plan, each a label and a text with units.

Each fact is a line of the printed plan and a row of the table in the HTML report.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from framework.errors import point
from framework.kinematics.inverse_kinematics import driven_turns
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.optimal_law import OptimalLaw
from framework.model.frame_wrench import FrameWrench
from framework.numerics.arrays import Array
from framework.planning.neglected_effects import NeglectedEffect
from framework.planning.result import CrossingPlan
from framework.singularity.type2 import moves_point

CROSSING = (
    "t = {0.time:.6g} s at s = {0.s:.15f}, {place}",
    "t_s = {twist}, s' = {0.speed:.6g} 1/s, s\" = {acceleration:.6g} 1/s2, |t_s . W_p| {0.residual:.1e} of "
    "its peak",
)
LOADED = "singular under its loads at s = {0.s:.9f}, {0.distance:.2g} {1} from there"
CERTIFICATE = (
    "tail {0.tail:.1e} on {0.nodes} nodes, {0.passes} {passes}{settled}, loops closed to "
    "{0.max_closure_error:.1e}, joints in balance to {0.max_residual_torque:.1e} N m or N"
)
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
MOVING_END_SPEED = 1e-6  # speed at the ends relative to the motors' largest, above which there is a warning


class Fact(NamedTuple):
    """A label and a text with units; an empty label continues the fact above."""

    label: str
    text: str

    @property
    def line(self) -> str:
        """The fact as a line of a printed report."""
        return f"  {self.label:<16}  {self.text}"


def motion_facts(plan: CrossingPlan) -> list[Fact]:
    """Return the facts about the motion of a plan, the certificate and the faults.

    The order is: wrenches, crossings, torques, certificate, effects left out, warnings.
    """
    wrenches = [Fact("wrench", wrench_text(wrench)) for wrench in plan.dynamics.wrenches.entries]
    torque = Fact("peak torque", torque_text(plan.robot, plan.peak_torque))
    left_out = [Fact("left out", neglected_text(plan.robot, effect)) for effect in plan.neglected]
    proof, warnings = _certificate_facts(plan), _warning_facts(plan)
    return [*wrenches, *_crossing_facts(plan), torque, *proof, *left_out, *warnings]


def smoothness_facts(plan: CrossingPlan) -> list[Fact]:
    """Return the fact about cost and smoothness of an optimal law; none for other laws."""
    best, law = plan.optimality, plan.law
    if best is None or not isinstance(law, OptimalLaw):
        return []
    goal = best.specification.goal.replace("_", " ")
    times = "time" if law.turns == 1 else "times"
    text = f"{100 * best.gap:.2g} % above the least {goal} found; its speed turns {law.turns} {times}"
    return [Fact("smoothed", text)]


def torque_text(robot: ParallelRobot, torques: Mapping[str, float], digits: int = 6) -> str:
    """Return the torques of motors with their units, in words."""
    units = zip(torques.items(), robot.torque_units, strict=True)
    return ", ".join(f"{joint} {torque:.{digits}g} {unit}" for (joint, torque), unit in units)


def twist_text(robot: ParallelRobot, twist: Array) -> str:
    """Return the twist t_s on the platform's axes in words."""
    return f"{point(twist)} of unit {'speed' if moves_point(robot, twist) else 'turning rate'}"


def wrench_text(wrench: FrameWrench) -> str:
    """Return force and moment of an external wrench in words.

    For a table of wrenches over s, these are the largest force and the largest moment.
    """
    axes = f"axes of {'the frame' if wrench.turns else 'the base'}"
    if wrench.rows.ndim == 1:
        force, moment = point(wrench.rows[:3]), point(wrench.rows[3:])
        return f"on {wrench.frame}: force {force} N, moment {moment} N m, {axes}"
    force_peak = np.linalg.norm(wrench.rows[:, 1:4], axis=1).max()  # rows (s, force, moment)
    moment_peak = np.linalg.norm(wrench.rows[:, 4:], axis=1).max()
    return (
        f"on {wrench.frame}: a table of {len(wrench.rows)} rows over s, force up to {force_peak:.6g} N, "
        f"moment up to {moment_peak:.6g} N m, {axes}"
    )


def neglected_text(robot: ParallelRobot, neglected: NeglectedEffect) -> str:
    """Return a neglected effect with its torque, in words."""
    if neglected.torque is None or neglected.share is None:
        return neglected.effect
    motor = robot.actuator_names.index(neglected.motor) if neglected.motor else 0
    joint = f" at {neglected.motor}" if neglected.motor else ""
    share = f"{neglected.share:.2g} times" if neglected.share > 1.0 else f"{100 * neglected.share:.2g} % of"
    worth = f"{neglected.torque:.2g} {robot.torque_units[motor]}{joint}"
    return f"{neglected.effect}: worth {worth}, {share} the largest"


def excess_facts(exceeded: Mapping[str, str]) -> list[Fact]:
    """Return warnings about joints that exceed their limits."""
    return [Fact("warning", f"{joint} exceeds its limits: {excess}") for joint, excess in exceeded.items()]


def _crossing_facts(plan: CrossingPlan) -> list[Fact]:
    """Return the facts about each crossing: pose, twist, speed, shift under loads."""
    robot, facts = plan.robot, list[Fact]()
    unit = "m" if robot.translations.any() else "rad"
    for crossing, loaded in zip(plan.crossings, plan.loaded_points, strict=True):
        words = {
            "place": robot.place(crossing.platform),
            "twist": twist_text(robot, crossing.twist),
            "acceleration": round(crossing.acceleration, 9) + 0.0,
        }
        texts = [text.format(crossing, **words) for text in CROSSING]
        facts += map(Fact, ("crossing", ""), texts)
        if loaded is not None:
            facts.append(Fact("", LOADED.format(loaded, unit)))
    return facts or [Fact("crossing", "none")]


def _certificate_facts(plan: CrossingPlan) -> list[Fact]:
    """Return the facts of the certificate, with idle turns and rounded loops if any."""
    robot, certificate = plan.robot, plan.certificate
    is_deformed = plan.geometry == "deformed"
    settled = f", deflections settled to {certificate.change:.1e}" if is_deformed else ""
    passes = "pass" if certificate.passes == 1 else "passes"
    facts = [Fact("certificate", CERTIFICATE.format(certificate, passes=passes, settled=settled))]
    if certificate.max_held_torque:
        facts.append(Fact("idle turns", IDLE_TURNS.format(certificate, turns=_idle_turns(robot))))
    if certificate.rounded_gap:
        facts.append(Fact("rounded", ROUNDED.format(certificate)))
    return facts


def _warning_facts(plan: CrossingPlan) -> list[Fact]:
    """Return warnings about neglected effects, exceeded limits, moving ends and overshoot."""
    certificate, facts = plan.certificate, excess_facts(plan.exceeded)
    if any((effect.share or 0.0) > 1.0 for effect in plan.neglected):
        facts.insert(0, Fact("warning", MUCH_LEFT_OUT))
    if certificate.end_speed > MOVING_END_SPEED:
        facts.append(Fact("warning", MOVING_ENDS.format(certificate)))
    if not certificate.monotone:
        s = plan.law(np.linspace(0.0, plan.duration, 2001))
        facts.append(Fact("warning", OVERSHOOT.format(s.min(), s.max())))
    return facts


def _idle_turns(robot: ParallelRobot) -> str:
    """Return the idle turns held still, and the turns that balls drive, in words."""
    driven = driven_turns(robot)
    kinds = {
        "held still": np.setdiff1d(robot.structure.idle, driven),
        "as damping or armature of their balls drives them": driven,
    }
    names = {kind: ", ".join(map(robot.coordinates.name_of, columns)) for kind, columns in kinds.items()}
    return "; ".join(f"{joints} {kind}" for kind, joints in names.items() if joints)
