"""Sentences that state the facts of a film, and nothing else."""

from __future__ import annotations

import numpy as np

from framework.catalogue import CatalogueEntry, find_entry
from framework.dynamics.result import SingularityCrossing
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array
from framework.numerics.output import select_fields
from framework.planning.plan_facts import certificate_facts, torque_facts
from framework.planning.result import CrossingPlan
from framework.planning.scenes import scene_path
from framework.show.film import Film

# a force or an acceleration below this share of its peak in the film is called zero in captions
NEGLIGIBLE_SHARE = 1e-3

PROVEN = (
    "Proven: the torque is finite at all times. Its series on {nodes} nodes leaves out {tail} of it; an "
    "unbounded torque would leave 1e-3 of it or more. The loops stay closed to {loops closed to}."
)


def display_name(name: str) -> str:
    """Return a name with blanks for underscores: five bar for five_bar."""
    return name.replace("_", " ")


def describe_saved_plan(plan: CrossingPlan, folder: str) -> str:
    """Return "Scene NAME" if the plan is of that scene, else "Plan FOLDER"."""
    request = plan.request
    keys = ("duration", "times", "speeds", "at", "optimize")
    for name, scene in plan.robot.description.scenes.items():
        same_motion = select_fields(scene, *keys) == select_fields(request, *keys)
        if same_motion and scene_path(scene) == request.path:
            return f"Scene {name}"
    return f"Plan {folder}"


def wrench_kind(robot: ParallelRobot) -> str:
    """Return "force along" (t_s), or "torque about" for a platform that only turns."""
    return "force along" if np.any(robot.translations) else "torque about"


def wrench_unit(robot: ParallelRobot) -> str:
    """Return the unit of t_s . W_p: N, or N m for a platform that only turns."""
    return "N" if np.any(robot.translations) else "N m"


def describe_motors(robot: ParallelRobot, limit: Array, peak: float, *, reason: str = "") -> str:
    """Describe motors by their torque limits (n_a,) and the peak torque.

    Args:
        peak: the peak torque, or 0 where no motion is proved.
        reason: why the limit is a multiple of the peak, as the end of a phrase.
    """
    if np.ptp(limit) > 0 or len(set(robot.torque_units)) > 1:
        return "motors at their limits"
    times = f" ({limit[0] / peak:.2g} × peak{reason})" if peak > 0 else ""
    return f"motors of {limit[0]:.3g} {robot.torque_units[0]}{times}"


def describe_film_briefly(film: Film) -> str:
    """Say in a few words how a film meets the singularity."""
    if not len(film.robot.passive):
        return "every joint has a motor: no Type 2 singularity"
    if not film.instants:
        return "keeps clear of the singularity"
    if not film.proved:
        return f"goes through while it asks for {wrench_kind(film.robot)} t_s: fails"
    if all(_is_coasting(film, instant) for instant in film.instants):
        return "goes through coasting: works"
    return f"goes through while it asks for no {wrench_kind(film.robot)} t_s: works"


def describe_film(film: Film) -> str:
    """Describe how the motion passes its singular instants, in a few sentences."""
    if not film.instants:
        regular = "This motion meets no Type 2 singularity: the motors hold the platform all the way."
        return f"{regular} {_describe_peak(film)}"
    when = ", ".join(f"{instant.time:.3g} s" for instant in film.instants)
    kind = wrench_kind(film.robot)
    if film.proved:
        return (
            f"This motion crosses the Type 2 singularity at t = {when} with finite torque: at that instant "
            f"it asks for no {kind} t_s (t_s · W_p = 0). {_describe_peak(film)}"
        )
    wrench = max(abs(instant.wrench) for instant in film.instants)
    rigid = " It is drawn with rigid parts: on springs the loops would tear." if film.drawn_rigid else ""
    return (
        f"This motion meets the Type 2 singularity at t = {when} while it asks for {wrench:.3g} "
        f"{wrench_unit(film.robot)} {kind.split()[1]} t_s: no motor torque is large enough. The curve "
        f"of the torque goes off the scale there; it has no bound.{rigid}"
    )


def why_singular(robot: ParallelRobot) -> str:
    """Return the catalogue's reason for a robot's singularities; empty for other robots."""
    entry = _catalogue_entry_of(robot)
    return "" if entry is None else entry.why


def describe_catalogue_entry(robot: ParallelRobot) -> str:
    """Return the catalogue's summary of a robot, and its source; empty for others."""
    entry = _catalogue_entry_of(robot)
    return "" if entry is None else f"{entry.summary}. Source: {entry.source}."


def _catalogue_entry_of(robot: ParallelRobot) -> CatalogueEntry | None:
    """Return the catalogue's entry of a robot; None for robots of other files."""
    entry = find_entry(robot.name)
    return None if entry is None or entry.file != robot.description.file else entry


def explain_crossing(film: Film, instant: SingularityCrossing) -> str:
    """Explain why a proved motion needs no force along t_s at a singular instant."""
    if film.plan is None:
        return ""
    if _is_coasting(film, instant):
        zero = "here the acceleration itself is zero (s″ = 0): it coasts across"
    elif _relative_wrench(film, instant) < NEGLIGIBLE_SHARE:
        zero = "here it needs none at all (W_p = 0)"
    elif not np.all(film.robot.translations):
        zero = "W_p does no work along t_s"
    else:
        zero = "W_p stands at a right angle to t_s"
    kind = wrench_kind(film.robot)
    return f"By its timing the motion needs no {kind} t_s at this instant (t_s · W_p = 0); {zero}."


def _is_coasting(film: Film, instant: SingularityCrossing) -> bool:
    """Return whether both W_p and the acceleration s″ are negligible at an instant."""
    largest = np.abs(film.law(film.time, 2)).max()
    acceleration = np.abs(film.law(np.array([instant.time]), 2))
    return (
        _relative_wrench(film, instant) < NEGLIGIBLE_SHARE and acceleration.max() < NEGLIGIBLE_SHARE * largest
    )


def describe_proof(film: Film) -> str:
    """State the proof that a plan's torque is finite, with numbers; empty without a plan."""
    if film.plan is None:
        return ""
    return PROVEN.format_map({fact.label: fact.text for fact in certificate_facts(film.plan)})


def describe_flexibility(film: Film) -> str:
    """Say with which springs and which geometry a film was computed."""
    plan = film.plan
    robot = film.robot
    if not robot.n_e or plan is None:
        return "rigid parts"
    return f"{display_name(robot.flexibility)}, {plan.geometry} geometry"


def _describe_peak(film: Film) -> str:
    """State the largest motor torque of a film."""
    peaks = np.abs(film.torque).max(axis=0)
    strongest = torque_facts(film.robot, peaks, 3)[peaks.argmax()]
    return f"Peak torque {strongest.text} ({describe_flexibility(film)})."


def _relative_wrench(film: Film, instant: SingularityCrossing) -> float:
    """Return |W_p| at an instant over its largest value in the film."""
    size = np.linalg.norm(film.W_p, axis=1)  # (F,)
    return float(size[film.frame_at(instant.time)] / (size.max() or 1.0))
