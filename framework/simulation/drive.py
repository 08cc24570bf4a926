"""What drives a simulated robot: motor torques and external wrenches.

Motor torques are planned, a function of time, or feedback of the state; a `Drive` computes all of them by one
call. It also holds the external wrenches, since a table of wrenches may be given along the planned motion,
and forces of the world that are functions of time and state, such as springs between two points. A wrench w
on a frame causes the generalised forces J' w, with pinocchio's Jacobian J (6, nv) of the frame's origin on
base axes. Nothing of the inverse dynamics is used here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from inspect import Parameter, signature
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
import pinocchio as pin

from framework.errors import InvalidInput, finite_numbers, real_numbers
from framework.kinematics.external_wrenches import NO_WRENCHES, ExternalWrenches, wrench_slope
from framework.kinematics.frames import FrameStack, integrate, scratch_of
from framework.kinematics.mechanism import frame_index
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, ArrayLike
from framework.numerics.chebyshev import TimeFunction

AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
PathCoordinate = Callable[[Array], Array]  # from instants (T,) [s] to path coordinates s (T,)


# ------------------------------------------------------------------ external wrenches


ForceFunction = Callable[[float, Array, Array], ArrayLike]  # of t [s], q (nq,) and v (nv,)


class StateForce(NamedTuple):
    """A force on a joint or a wrench on a frame, a function of time and state."""

    place: str  # joint that moves, link, or joint that does not
    columns: range | None  # rates of the joint; None for a frame
    function: ForceFunction  # [N m, N] along these; of a frame force and moment (6,) at it, base axes

    @staticmethod
    def of(robot: ParallelRobot, place: str, function: ForceFunction) -> StateForce:
        """Return the force on a joint or frame of a name.

        Raises:
            InvalidInput: unknown name, or no function.
        """
        if not callable(function):
            raise InvalidInput(f"forces: {place}: needs a function of t, q, v, got {type(function).__name__}")
        model = robot.model
        if model.existJointName(place):
            joint = model.joints[model.getJointId(place)]
            return StateForce(place, range(joint.idx_v, joint.idx_v + joint.nv), function)
        ExternalWrenches.of({place: np.zeros(6)}).check_frames(robot)
        return StateForce(place, None, function)

    def __call__(self, robot: ParallelRobot, t: float, q: Array, v: Array) -> Array:
        """Compute the generalised force (nv,) [N m, N]."""
        value = np.atleast_1d(self.function(t, q, v))
        where = f"forces: {self.place} at t = {t:.9g} s"
        if self.columns is None:
            frame = frame_index(robot.model, self.place)
            jacobian = pin.computeFrameJacobian(robot.model, scratch_of(robot).data, q, frame, AXES)
            force: Array = finite_numbers(where, value, 6) @ jacobian
            return force
        force = np.zeros(robot.nv)
        force[self.columns] = finite_numbers(where, value, len(self.columns))
        return force


@dataclass(frozen=True, eq=False)
class WorldForces:
    """The generalised forces that the world exerts on a robot: external wrenches, functions of the state."""

    wrenches: ExternalWrenches
    path_coordinate: PathCoordinate | None  # None if all wrenches are constant
    functions: tuple[StateForce, ...] = ()

    @staticmethod
    def of(
        robot: ParallelRobot, wrenches: ExternalWrenches, path_coordinate: PathCoordinate | None
    ) -> WorldForces:
        """Return the forces of external wrenches on a robot.

        Args:
            path_coordinate: path coordinate s (T,) at instants (T,) [s]; None without a planned motion.

        Raises:
            InvalidInput: a wrench acts on an unknown frame, or is a table over s and there is no motion that
                determines s.
        """
        wrenches.check_frames(robot)
        # frames of the wrenches that are tables over the path, with a row for each s
        tables = [entry.frame for entry in wrenches.entries if entry.rows.ndim == 2]
        if tables and path_coordinate is None:
            raise InvalidInput(
                f"wrenches: {tables[0]}: a table over the path needs a planned motion, which determines s; "
                f"give 6 numbers"
            )
        return WorldForces(wrenches, path_coordinate)

    @property
    def acts(self) -> bool:
        """Whether any wrench or force acts."""
        return bool(self.wrenches.entries or self.functions)

    def __call__(
        self, robot: ParallelRobot, t: Array, q: Array, v: Array, models: Sequence[pin.Model] | None = None
    ) -> Array:
        """Compute the generalised forces (T, nv) [N m, N] at times t (T,) [s], q (T, nq) and v (T, nv).

        Args:
            models: a pinocchio model for each state, of robots that differ from `robot` in numbers alone,
                such as lengths in the runs of a `Stepper`; by default that of `robot` for all.
        """
        data = scratch_of(robot).data
        s = self._path_coordinates(t)
        models = [robot.model] * len(q) if models is None else models
        force = np.zeros((len(q), robot.nv))
        for entry in self.wrenches.entries:
            frame = frame_index(robot.model, entry.frame)
            wrenches = entry(s)  # (T, 6)
            for k, configuration in enumerate(q):
                # the Jacobian (6, nv); the call also updates data.oMf, the placement of the frame
                jacobian = pin.computeFrameJacobian(models[k], data, configuration, frame, AXES)
                wrench = wrenches[k]
                if entry.turns:  # the wrench is given on the frame's axes: rotate force and moment
                    wrench = (wrench.reshape(2, 3) @ data.oMf[frame].rotation.T).ravel()
                force[k] += wrench @ jacobian
        return force + self._forces_of_state(robot, t, q, v)

    def _forces_of_state(self, robot: ParallelRobot, t: Array, q: Array, v: Array) -> Array:
        """Compute the generalised forces (T, nv) of the functions."""
        force = np.zeros((len(q), robot.nv))
        for one in self.functions:
            for k, instant in enumerate(map(float, t)):
                force[k] += one(robot, instant, q[k], v[k])
        return force

    def gains(self, robot: ParallelRobot, t: float, q: Array, v: Array) -> Array | None:
        """Compute the derivatives (2, nv, nv) of the functions by q (nq,) and v (nv,); None without any."""
        if not self.functions:
            return None
        return state_derivatives(robot, partial(self._forces_of_state, robot), t, q, v)

    def slope(self, robot: ParallelRobot, t: Array, frames: FrameStack) -> Array:
        """Compute the derivatives (T, nv, nv) of the wrenches' forces by steps of q, at t (T,) [s]."""
        wrenches = self.wrenches.evaluate(robot, frames, self._path_coordinates(t))
        slopes = (wrench_slope(robot, frames.screws, wrench) for wrench in wrenches)
        return sum(slopes, start=np.zeros((len(t), robot.nv, robot.nv)))

    def _path_coordinates(self, t: Array) -> Array:
        """Return s (T,) at t (T,) [s]; 0 if all wrenches are constant."""
        return np.zeros(len(t)) if self.path_coordinate is None else self.path_coordinate(t)


def state_derivatives(
    robot: ParallelRobot, function: Callable[[Array, Array, Array], Array], t: float, q: Array, v: Array
) -> Array:
    """Compute the derivatives (2, k, nv) of k functions of t (T,), q (T, nq), v (T, nv) by q and v."""
    # [rad, m; rad/s, m/s] step of the differences
    step = 1e-7
    nv = robot.nv
    times = np.full(nv, t)
    # central differences; row k of the stacks of nv states steps joint k
    steps = step * np.eye(nv)
    same_q, same_v = np.tile(q, (nv, 1)), np.tile(v, (nv, 1))
    ahead, back = integrate(robot, q, steps), integrate(robot, q, -steps)
    by_q = function(times, ahead, same_v) - function(times, back, same_v)  # (nv, k)
    by_v = function(times, same_q, v + steps) - function(times, same_q, v - steps)
    return np.stack([by_q.T, by_v.T]) / (2 * step)


NO_FORCES = WorldForces(ExternalWrenches(), path_coordinate=None)


# ------------------------------------------------------------------ motor torques


@runtime_checkable
class PlannedMotion(Protocol):
    """Planned torques with their motion, as returned by `inverse_dynamics`."""

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
    """Return the planned motion in a `source`; None without one.

    The source is a plan, which has its motion as `dynamics`, or a planned motion itself.
    """
    for candidate in (getattr(source, "dynamics", None), source):
        if isinstance(candidate, PlannedMotion):
            return candidate
    return None


@dataclass(frozen=True, eq=False)
class Drive:
    """Motor torques and external wrenches of a simulated robot."""

    robot: ParallelRobot
    # computes torques (T, n_a) [N m], motor side, at times (T,), q (T, nq) and v (T, nv)
    function: Callable[[Array, Array, Array], Array]
    feedback: bool  # whether torques depend on the state; if not, q and v are ignored
    breaks: tuple[float, ...]  # instants [s] at which the torque or one of its derivatives jumps
    world: WorldForces = NO_FORCES

    def __call__(self, t: Array, q: Array, v: Array) -> Array:
        """Compute the motor torques (T, n_a) [N m] at times t (T,) [s], q (T, nq) and v (T, nv).

        Raises:
            InvalidInput: a torque is not finite.
        """
        torque = self.function(t, q, v)
        is_finite = np.isfinite(torque).all(axis=1)  # (T,)
        if not is_finite.all():
            raise InvalidInput(f"torque: not finite at t = {t[~is_finite][0]:.9g} s")
        return torque

    def edges(self, duration: float) -> list[float]:
        """Return the edges [s] of the stretches with smooth torque, from 0 to the duration."""
        return [0.0, *(t for t in self.breaks if 0 < t < duration), duration]

    def torques_without_feedback(self, t: Array) -> Array | None:
        """Compute torques (T, n_a) [N m] that depend on time alone; None with feedback."""
        no_state = np.empty((len(t), 0))
        return None if self.feedback else self(t, no_state, no_state)

    def shift_breaks(self, t: Array) -> Array:
        """Move each time t [s] on a break to just before the break.

        A break is the end of a step, so the torque before the break applies there.
        """
        for instant in self.breaks:
            # The end of a step, time + length, may miss the break by a few units in the last place.
            # Such a time moves to 8 units before the break: rounding does not carry it beyond again.
            unit = np.spacing(instant)
            is_break = np.abs(t - instant) <= 4 * unit
            t = np.where(is_break, instant - 8 * unit, t)
        return t

    def gains(self, t: float, q: Array, v: Array) -> Array | None:
        """Compute the derivatives (2, n_a, nv) of a feedback torque by q (nq,) and v (nv,) at t [s].

        None without feedback.
        """
        return state_derivatives(self.robot, self, t, q, v) if self.feedback else None

    @staticmethod
    def of(
        robot: ParallelRobot,
        source: Any,
        breaks: Sequence[float] = (),
        wrenches: Mapping[str, Any] | None = None,
        forces: Mapping[str, ForceFunction] | None = None,
    ) -> Drive:
        """Make the drive from a `source`: a planned motion, torque(t) or torque(t, q, v).

        A Drive is returned unchanged.

        Args:
            breaks: instants [s] at which torque(t) jumps or has a kink.
            wrenches: external wrenches; None for those of the planned motion, if any.
            forces: functions of t, q, v by joint or frame, see `StateForce`.

        Raises:
            InvalidInput: the source is none of these; a plan has another number of motors; wrenches are
                invalid; or breaks or wrenches are given with a Drive, which has its own.
        """
        if isinstance(source, Drive):
            if len(breaks) or wrenches is not None or forces:
                raise InvalidInput(
                    "torque: a Drive has its own breaks and wrenches; leave out these and forces"
                )
            return source

        instants = finite_numbers("breaks", breaks, real_numbers("breaks", breaks).size).tolist()
        motion = planned_motion(source)
        planned_wrenches = getattr(motion, "wrenches", NO_WRENCHES)
        applied = planned_wrenches if wrenches is None else ExternalWrenches.of(wrenches)
        world = WorldForces.of(robot, applied, getattr(motion, "law", None))
        functions = tuple(StateForce.of(robot, *item) for item in (forces or {}).items())
        world = replace(world, functions=functions)
        if motion is not None:
            return _drive_by_plan(robot, motion, instants, world)

        if not callable(source):
            raise InvalidInput(
                f"torque: needs a plan, a result of inverse_dynamics, torque(t) or torque(t, q, v), got "
                f"{type(source).__name__}"
            )
        count = _count_arguments(source)
        if count not in (1, 3):
            raise InvalidInput(f"torque: takes (t) or (t, q, v), this one asks for {count} arguments")
        has_feedback = count == 3

        def torques_at(t: Array, q: Array, v: Array) -> Array:
            """Compute torques (T, n_a), calling the function at each instant with (t) or (t, q, v)."""
            torques = np.empty((len(t), robot.n_a))
            for k, instant in enumerate(map(float, t)):
                torque = source(instant, q[k], v[k]) if has_feedback else source(instant)
                where = f"torque: at t = {instant:.9g} s"
                # what runs away is told by its motion, so that any torque is allowed here
                largest = np.finfo(float).max
                torques[k] = finite_numbers(where, np.atleast_1d(torque), robot.n_a, largest=largest)
            return torques

        return Drive(robot, torques_at, has_feedback, tuple(sorted(instants)), world)


def _drive_by_plan(
    robot: ParallelRobot, motion: PlannedMotion, breaks: Sequence[float], world: WorldForces
) -> Drive:
    """Make the drive from a planned motion, without dry friction, as the simulated robot has none.

    `breaks` are further instants [s] at which the torque jumps or has a kink.
    """
    motors = np.shape(motion.torque(0.0))[-1]
    if motors != robot.n_a:
        raise InvalidInput(f"torque: the plan drives {motors} motors, {robot.name} has {robot.n_a}")
    # a result of `inverse_dynamics` has torques without dry friction, smooth between their edges; a motion of
    # another kind may mean anything by the name `torques`
    frictionless: Callable[[Array], Array] = motion.torque
    edges = np.empty(0)
    torques = getattr(motion, "torques", None)
    if isinstance(torques, TimeFunction):
        frictionless = torques
        edges = torques.edges
    all_breaks = sorted([*map(float, edges[1:-1]), *breaks])
    return Drive(
        robot, lambda t, q, v: frictionless(t), feedback=False, breaks=tuple(all_breaks), world=world
    )


def _count_arguments(function: Callable[..., Any]) -> int:
    """Count the required positional arguments of a callable; 0 for a builtin without a signature."""
    try:
        parameters = signature(function).parameters.values()
    except ValueError:
        return 0
    positional = (Parameter.POSITIONAL_ONLY, Parameter.POSITIONAL_OR_KEYWORD)
    return sum(p.kind in positional and p.default is Parameter.empty for p in parameters)
