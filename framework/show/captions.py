"""Sentences about a film: they state its facts, and nothing else."""

from __future__ import annotations

import numpy as np

from framework.catalogue import CatalogueEntry, find_entry
from framework.dynamics.result import SingularityCrossing
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array
from framework.planning.result import CrossingPlan
from framework.planning.scenes import scene_path
from framework.show.film import Film

NEGLIGIBLE_SHARE = 1e-3  # of a force or an acceleration in its largest value: less is called zero in captions

PROVEN = (
    "Proven: the torque is finite at all times. Its series on {0.nodes} nodes leaves out {0.tail:.0e} of it; "
    "an unbounded torque would leave 1e-3 of it or more. The loops stay closed to {0.max_closure_error:.0e} "
    "(m or rad)."
)


def display_name(name: str) -> str:
    """Return a name in words: five bar for five_bar."""
    return name.replace("_", " ")


def plan_name(plan: CrossingPlan, folder: str) -> str:
    """Return the scene of a saved plan as `show --scene` names scenes; its folder without one."""
    request = plan.request
    keys = ("duration", "times", "speeds", "at", "optimize")
    requested = [request.path, *(getattr(request, key) for key in keys)]
    for name, scene in plan.robot.description.scenes.items():
        if [scene_path(scene), *(getattr(scene, key) for key in keys)] == requested:
            return f"Scene {name}"
    return f"Plan {folder}"


def wrench_kind(robot: ParallelRobot) -> str:
    """Return the kind of t_s . W_p: a force along t_s, or a torque about t_s of a turning platform."""
    return "force along" if np.any(robot.translations) else "torque about"


def unit(robot: ParallelRobot) -> str:
    """Return the unit of t_s . W_p."""
    return "N" if np.any(robot.translations) else "N m"


def describe_motors(robot: ParallelRobot, limit: Array, peak: float, *, reason: str = "") -> str:
    """Describe motors by their torque limits (n_a,) and the peak torque, 0 without one.

    `reason` tells why the peak torque sets the limit.
    """
    if np.ptp(limit) > 0 or len(set(robot.torque_units)) > 1:
        return "motors at their limits"
    times = f" ({limit[0] / peak:.2g} × peak{reason})" if peak > 0 else ""
    return f"motors of {limit[0]:.3g} {robot.torque_units[0]}{times}"


def subtitle(film: Film) -> str:
    """Describe the film in a few words."""
    if not len(film.robot.passive):
        return "every joint has a motor: no Type 2 singularity"
    if not film.instants:
        return "keeps clear of the singularity"
    if not film.proved:
        return f"goes through while it asks for {wrench_kind(film.robot)} t_s: fails"
    if all(coasts(film, instant) for instant in film.instants):
        return "goes through coasting: works"
    return f"goes through while it asks for no {wrench_kind(film.robot)} t_s: works"


def film_summary(film: Film) -> str:
    """Describe the motion at its singular instants in a few sentences."""
    if not film.instants:
        regular = "This motion meets no Type 2 singularity: the motors hold the platform all the way."
        return f"{regular} {_peak(film)}"
    when = ", ".join(f"{instant.time:.3g} s" for instant in film.instants)
    kind = wrench_kind(film.robot)
    if film.proved:
        return (
            f"This motion crosses the Type 2 singularity at t = {when} with finite torque: at that instant "
            f"it asks for no {kind} t_s (t_s · W_p = 0). {_peak(film)}"
        )
    wrench = max(abs(instant.wrench) for instant in film.instants)
    rigid = " It is drawn with rigid parts: on springs the loops would tear." if film.drawn_rigid else ""
    return (
        f"This motion meets the Type 2 singularity at t = {when} while it asks for {wrench:.3g} "
        f"{unit(film.robot)} {kind.split()[1]} t_s: no motor torque is large enough. The curve "
        f"of the torque goes off the scale there; it has no bound.{rigid}"
    )


def why(robot: ParallelRobot) -> str:
    """Return the catalogue's reason for a robot's singularities; empty for other robots."""
    entry = _entry(robot)
    return "" if entry is None else entry.why


def catalogue_entry(robot: ParallelRobot) -> str:
    """Return the catalogue's summary of a robot and its source; empty for other robots."""
    entry = _entry(robot)
    return "" if entry is None else f"{entry.summary}. Source: {entry.source}."


def _entry(robot: ParallelRobot) -> CatalogueEntry | None:
    entry = find_entry(robot.name)
    return entry if entry is not None and entry.file == robot.description.file else None


def explain_crossing(film: Film, instant: SingularityCrossing) -> str:
    """Explain why a proven motion asks for nothing along t_s at a singular instant."""
    if film.plan is None:
        return ""
    if coasts(film, instant):
        zero = "here the acceleration itself is zero (s″ = 0): it coasts across"
    elif _share(film, instant) < NEGLIGIBLE_SHARE:
        zero = "here it needs none at all (W_p = 0)"
    elif not np.all(film.robot.translations):
        zero = "W_p does no work along t_s"
    else:
        zero = "W_p stands at a right angle to t_s"
    kind = wrench_kind(film.robot)
    return f"By its timing the motion needs no {kind} t_s at this instant (t_s · W_p = 0); {zero}."


def coasts(film: Film, instant: SingularityCrossing) -> bool:
    """Whether neither force nor acceleration along the path is asked for at that instant."""
    speeding = np.abs(film.law(film.time, 2)).max()
    acceleration = abs(float(film.law(np.array([instant.time]), 2)[0]))
    return _share(film, instant) < NEGLIGIBLE_SHARE and acceleration < NEGLIGIBLE_SHARE * speeding


def proof(film: Film) -> str:
    """Return the proof of a plan's finite torque, with its numbers; empty without a plan."""
    if film.plan is None:
        return ""
    return PROVEN.format(film.plan.certificate)


def parts(film: Film) -> str:
    """Return the flexibility with which a film was computed, in words."""
    plan, robot = film.plan, film.robot
    if not robot.n_e or plan is None:
        return "rigid parts"
    return f"{display_name(robot.flexibility)}, {plan.geometry} geometry"


def _peak(film: Film) -> str:
    """Return the largest motor torque of a film in words."""
    peaks = np.abs(film.torque).max(axis=0)
    strongest = np.argmax(peaks)
    return f"Peak torque {peaks[strongest]:.3g} {film.robot.torque_units[strongest]} ({parts(film)})."


def _share(film: Film, instant: SingularityCrossing) -> float:
    """Return |W_p| at an instant over its largest value of the film."""
    size = np.linalg.norm(film.W_p, axis=1)
    return float(size[film.frame_at(instant.time)] / (size.max() or 1.0))
