"""The drive of a simulated robot: a planned motion, a torque of time or a feedback, called alike.

With it go the wrenches of the world, which may be known along the planned motion alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from inspect import Parameter, signature
from typing import Any, Protocol, cast

import numpy as np

from framework.errors import InvalidInput, finite_numbers
from framework.kinematics.external_wrenches import NO_WRENCHES, ExternalWrenches
from framework.kinematics.frames import integrate
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, ArrayLike
from framework.simulation.world_forces import NO_FORCES, WorldForces

FEEDBACK_DIFFERENCE = 1e-7  # [rad, m] and their rates: a step of the differences of a feedback torque
MOTION = ("duration", "torque", "platform", "configuration", "velocity")  # what a planned motion has


class PlannedMotion(Protocol):
    """Planned torques with their motion, as `inverse_dynamics` returns."""

    @property
    def duration(self) -> float:
        """[s]"""

    def torque(self, t: ArrayLike, order: int = 0) -> Array:
        """Return motor torques (T, n_a), motor side."""

    def platform(self, t: ArrayLike, order: int = 0) -> Array:
        """Return platform coordinates (T, n)."""

    def configuration(self, t: ArrayLike) -> Array:
        """Return all coordinates (T, nq)."""

    def velocity(self, t: ArrayLike, order: int = 1) -> Array:
        """Return all rates (T, nv)."""


def planned_motion(source: Any) -> PlannedMotion | None:
    """Return the planned motion in `source`; None without one.

    It is the inverse dynamics of a plan, or the source itself.
    """
    for candidate in (getattr(source, "dynamics", None), source):
        if all(hasattr(candidate, name) for name in MOTION):
            return cast(PlannedMotion, candidate)
    return None


@dataclass(frozen=True, eq=False)
class Drive:
    """Motor torques (T, n_a) [N m] at times (T,), states q (T, nq) and v (T, nv)."""

    robot: ParallelRobot
    function: Callable[[Array, Array, Array], Array]
    feedback: bool
    breaks: tuple[float, ...]  # instants inside where the torque or a derivative of it jumps [s]
    world: WorldForces = NO_FORCES

    def __call__(self, t: Array, q: Array, v: Array) -> Array:
        """Compute the torques (T, n_a) [N m]; refuse values that are not finite."""
        torque = self.function(t, q, v)
        if not np.all(np.isfinite(torque)):
            when = t[~np.isfinite(torque).all(axis=1)][0]
            raise InvalidInput(f"torque: not finite at t = {when:.9g} s")
        return torque

    def edges(self, duration: float) -> list[float]:
        """Return the edges [s] of stretches on which the torque is smooth.

        The first is 0, the last the duration.
        """
        return [0.0, *(t for t in self.breaks if 0 < t < duration), duration]

    def torques_without_feedback(self, t: Array) -> Array | None:
        """Return the torques (T, n_a) [N m] of times alone; None with feedback."""
        nothing = np.empty((len(t), 0))
        return None if self.feedback else self(t, nothing, nothing)

    def shift_breaks(self, t: Array) -> Array:
        """Move times (T,) on a break to just before the break.

        They belong to the end of the step that began earlier.
        """
        for instant in self.breaks:
            is_break = np.abs(t - instant) <= 4 * np.spacing(instant)
            t = np.where(is_break, instant - 8 * np.spacing(instant), t)
        return t

    def gains(self, t: float, q: Array, v: Array) -> Array | None:
        """Compute the torque's derivatives (2, n_a, nv) by q and by v.

        They are those at one state; None without feedback. They are central differences, those by q along its
        tangent.
        """
        if not self.feedback:
            return None
        nv = self.robot.nv
        steps = FEEDBACK_DIFFERENCE * np.vstack([np.eye(nv), -np.eye(nv)])  # forwards, then backwards
        same_q, same_v = np.tile(q, (2 * nv, 1)), np.tile(v, (2 * nv, 1))
        all_q = np.vstack([integrate(self.robot, q, steps), same_q])  # (4 nv, nq) steps of q, then of v
        all_v = np.vstack([same_v, v + steps])
        torques = self(np.full(4 * nv, t), all_q, all_v)
        ahead, back = torques.reshape(2, 2, nv, -1).swapaxes(0, 1)  # (2, nv, n_a) each, by q and by v
        slopes = (ahead - back) / (2 * FEEDBACK_DIFFERENCE)
        return slopes.swapaxes(1, 2)

    @staticmethod
    def of(
        robot: ParallelRobot,
        source: Any,
        breaks: Sequence[float] = (),
        wrenches: Mapping[str, Any] | None = None,
    ) -> Drive:
        """Return the drive by a planned motion or a callable.

        A callable is torque(t) or torque(t, q, v). A drive is returned as it is.

        Args:
            wrenches: of the world; None: those of the planned motion, if it has any.

        Raises:
            InvalidInput: it is none of these; its first answer comes with the wrong number of torques;
                wrenches that are none; breaks or wrenches beside a drive, which has its own.
        """
        if isinstance(source, Drive):
            if len(breaks) or wrenches is not None:
                raise InvalidInput("torque: a Drive has its own breaks and wrenches; leave out both options")
            return source
        motion = planned_motion(source)
        planned_wrenches = getattr(motion, "wrenches", NO_WRENCHES)
        applied = planned_wrenches if wrenches is None else ExternalWrenches.of(wrenches)
        world = WorldForces.of(robot, applied, getattr(motion, "law", None))
        if motion is not None:
            return _drive_by_plan(robot, motion, breaks, world)
        if not callable(source):
            raise InvalidInput(
                f"torque: needs a plan, a result of inverse_dynamics, torque(t) or torque(t, q, v), got "
                f"{type(source).__name__}"
            )
        count = _count_arguments(source)
        if count not in (1, 3):
            raise InvalidInput(f"torque: takes (t) or (t, q, v), this one asks for {count} arguments")

        def torques_at(t: Array, q: Array, v: Array) -> Array:
            """Compute torques (T, n_a), calling the function at each instant with (t) or (t, q, v)."""
            torques = np.empty((len(t), robot.n_a))
            for k, instant in enumerate(map(float, t)):
                torque = np.atleast_1d(source(*(instant, q[k], v[k])[:count]))
                torques[k] = finite_numbers(f"torque: at t = {instant:.9g} s", torque, robot.n_a)
            return torques

        return Drive(robot, torques_at, count == 3, tuple(sorted(map(float, breaks))), world)


def _drive_by_plan(
    robot: ParallelRobot, motion: PlannedMotion, breaks: Sequence[float], world: WorldForces
) -> Drive:
    """Return the drive by planned torques, without the friction, which no simulated robot has."""
    motors = np.shape(motion.torque(0.0))[-1]
    if motors != robot.n_a:
        raise InvalidInput(f"torque: the plan drives {motors} motors, {robot.name} has {robot.n_a}")
    edges = getattr(getattr(motion, "torques", None), "edges", np.empty(0))
    inner = sorted([*map(float, edges[1:-1]), *breaks])
    smooth = getattr(motion, "torque_without_friction", motion.torque)
    return Drive(robot, lambda t, q, v: smooth(t), False, tuple(inner), world)


def _count_arguments(function: Callable[..., Any]) -> int:
    """Count the required arguments of a callable; 0 for a builtin without a signature."""
    try:
        parameters = signature(function).parameters.values()
    except ValueError:
        return 0
    positional = (Parameter.POSITIONAL_ONLY, Parameter.POSITIONAL_OR_KEYWORD)
    return sum(p.kind in positional and p.default is Parameter.empty for p in parameters)
