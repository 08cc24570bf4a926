"""A motion sampled for the screen: where every joint is, what the motors give, how near the singularity is.

A proven plan and an unproved law (the torques sampled as they come) make the same film; only the first may
claim finite torques, and `proved` says which it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from framework.arrays import Array
from framework.crossing.plan import plan_crossing, uncertified_law
from framework.crossing.result import CrossingPlan
from framework.dynamics.finite_differences import finite_difference_torques
from framework.dynamics.forces import tree_forces
from framework.dynamics.result import SingularityCrossing
from framework.errors import UnboundedTorque
from framework.kinematics.assembly import passive_columns
from framework.kinematics.inverse_kinematics import ClosedStack, close_loops, joint_rates, motion_at
from framework.kinematics.tracking import track_path
from framework.model import ParallelRobot
from framework.motion.law import MotionLaw
from framework.motion.path import Path, along
from framework.singularity.classification import singularity_measure, unit_twist

FRAMES = 481


@dataclass(frozen=True, eq=False)
class Instant:
    """A singular instant of a film: `wrench` is t_s . W_p there [N, or N m for a pure turn]."""

    time: float
    s: float
    platform: Array  # (n,)
    wrench: float


@dataclass(frozen=True, eq=False)
class Film:
    """F frames of a motion with its loops closed in each of them.

    `W_p` is the wrench that all bodies' inertia and weight ask of the platform, W_p = (dq/dx)' r with r the
    forces of the open tree: with massless legs the payload's. `t_s` is the least controlled twist, of unit
    size where |g| is least; on the locus t_s . W_p is condition (8).
    """

    robot: ParallelRobot
    name: str
    path: Path
    law: MotionLaw
    plan: CrossingPlan | None  # None: the law has no proof
    refusal: str  # why there is no plan, or ""
    time: Array  # (F,) [s]
    q: Array  # (F, nq)
    x: Array  # (F, n)
    torque: Array  # (F, n_a) motor side; not finite where an unproved law divides by zero
    deflection: Array  # (F, n_e)
    g: Array  # (F,)
    t_s: Array  # (F, n)
    W_p: Array  # (F, n)
    instants: tuple[Instant, ...]
    drawn_rigid: bool = False  # asked for with springs, which an unproved law would tear

    @property
    def proved(self) -> bool:
        return self.plan is not None


def film_motion(robot: ParallelRobot, path: Path, *, name: str = "", **options: Any) -> Film:
    """Plan the motion and film it; a motion with a pole is filmed from its unproved law.

    Args:
        name: what stands above the picture, such as Scene C.
        options: of `plan_crossing`.

    Raises:
        As `plan_crossing`, but no UnboundedTorque.
    """
    try:
        plan = plan_crossing(robot, path, **options)
    except UnboundedTorque as refusal:
        return _film_unproved(robot, path, name, str(refusal), options)
    return film_plan(plan, name=name)


def film_plan(plan: CrossingPlan, *, name: str = "") -> Film:
    """The film of a proven plan; each crossing is a frame of its own."""
    times = _frame_times(plan.duration, [crossing.time for crossing in plan.dynamics.crossings])
    closed = close_loops(plan.robot, plan.platform(times), plan.dynamics.configuration(times))
    rates = [along(plan.path, [plan.law(times, k) for k in range(order + 1)])[order] for order in (1, 2)]
    deflection = [plan.deflection(times, order) for order in range(3)]
    g, t_s, W_p = _singularity_along(plan.robot, closed, rates=rates, deflection=deflection[1:])
    return Film(
        robot=plan.robot,
        name=name,
        path=plan.path,
        law=plan.law,
        plan=plan,
        refusal="",
        time=times,
        q=closed.q,
        x=closed.x,
        torque=plan.torque(times),
        deflection=deflection[0],
        g=g,
        t_s=t_s,
        W_p=W_p,
        instants=_instants(plan.dynamics.crossings),
    )


def _film_unproved(
    robot: ParallelRobot, path: Path, name: str, refusal: str, options: dict[str, Any]
) -> Film:
    """The law as it is, on the rigid robot: at the pole an elastic one's loops would tear."""
    known = ("duration", "times", "speeds", "at", "smoothness")
    law, crossings = uncertified_law(robot, path, **{key: options[key] for key in known if key in options})
    rigid = ParallelRobot.from_description(robot.description, flexibility="rigid")
    raw = finite_difference_torques(rigid, path, law, samples=FRAMES)
    x, dx, ddx = along(path, [law(raw.time, order) for order in range(3)])
    closed = close_loops(rigid, x, track_path(rigid, path).guess(law(raw.time)))
    still = np.zeros((FRAMES, 0))
    g, t_s, W_p = _singularity_along(rigid, closed, rates=(dx, ddx), deflection=(still, still))
    return Film(
        robot=rigid,
        name=name,
        path=path,
        law=law,
        plan=None,
        refusal=refusal,
        time=raw.time,
        q=closed.q,
        x=closed.x,
        torque=raw.torque,
        deflection=raw.deflection,
        g=g,
        t_s=t_s,
        W_p=W_p,
        instants=_instants(crossings),
        drawn_rigid=robot.n_e > 0,
    )


def _instants(crossings: Sequence[SingularityCrossing]) -> tuple[Instant, ...]:
    return tuple(Instant(found.time, found.s, found.platform, found.wrench) for found in crossings)


def _frame_times(duration: float, instants: list[float]) -> Array:
    """Equidistant frames, the nearest of them moved onto each instant."""
    times = np.linspace(0.0, duration, FRAMES)
    for instant in instants:
        times[np.argmin(np.abs(times - instant))] = instant
    return times


def _singularity_along(
    robot: ParallelRobot, closed: ClosedStack, *, rates: Sequence[Array], deflection: Sequence[Array]
) -> tuple[Array, Array, Array]:
    """g (F,), t_s (F, n) and W_p (F, n) along a motion; g is not a number where every joint has a motor.

    `rates` are dx, ddx (F, n), `deflection` the first two time derivatives of q_e (F, n_e).
    """
    motion = motion_at(robot, closed, *rates, *deflection)
    forces = tree_forces(robot, motion)
    still = np.zeros((len(forces), robot.n_e))
    W_p = np.empty((len(forces), robot.n))
    for k in range(robot.n):
        unit = np.zeros_like(W_p)
        unit[:, k] = 1.0
        W_p[:, k] = np.sum(joint_rates(robot, closed.system, unit, still) * forces, axis=1)
    if not len(passive_columns(robot)):
        return np.full(len(forces), np.nan), np.zeros_like(W_p), W_p
    measure = singularity_measure(robot, closed.system)
    twist = np.einsum("tnv,tv->tn", closed.system.platform, measure.motion)
    size = unit_twist(robot, twist[int(np.argmin(np.abs(measure.g)))]) or 1.0
    return measure.g, twist / size, W_p
