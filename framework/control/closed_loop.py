"""A controller on robots that are not quite as it believes: sampling, delay, noise, saturation, friction."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from framework.arrays import Array, IntArray
from framework.control.estimation import Controller, Measurement, RobotState
from framework.control.reference import Reference
from framework.control.run_monitor import PERIODS_PER_CHECK, ControlLoop, Run, RunMonitor
from framework.control.variation import Spread, Variation, noise_of, vary
from framework.errors import InvalidInput, NotAssembled
from framework.kinematics.frames import integrate
from framework.linalg.ordered_sums import matvec
from framework.simulation import Stepper
from framework.simulation.schemes import State
from framework.simulation.world_forces import WorldForces

MAX_JOINT_STEP = 3.0  # [rad, robot lengths] that a joint may move in one sampling period: more is a runaway
FRICTION_SMOOTHING = 0.02  # of the largest planned motor speed: below, Coulomb friction is smoothed
MIN_SPEED = 1e-12  # [rad/s] for motors that stand still all the time: 0 / 0 otherwise


class DelayLine(NamedTuple):
    """Torques that arrive a whole number of sampling periods late, each run by its own."""

    delays: IntArray  # (R,)
    past: deque[Array]

    @staticmethod
    def of(controller: Controller, variations: Sequence[Variation]) -> DelayLine:
        """Return the delays of R varied robots."""
        ref = controller.reference
        periods = np.rint([variation.delay / ref.period for variation in variations])
        delays = np.minimum(periods, len(ref.times)).astype(np.intp)  # longer: never in this motion
        return DelayLine(delays, deque(maxlen=int(delays.max(initial=0)) + 1))

    def delay(self, torque: Array) -> Array:
        """Return the torques (R, n_a) that act now, the first ones at the beginning."""
        self.past.append(torque)
        if len(self.past) == 1:
            return torque
        late = np.minimum(self.delays, len(self.past) - 1)
        return np.array([self.past[-1 - d][r] for r, d in enumerate(late)])


def torque_limit(reference: Reference, loop: ControlLoop) -> Array:
    """Return the largest motor torques (n_a,) [N m].

    Raises:
        InvalidInput: a limit that is no torque.
    """
    default = 10 * np.abs(reference.torque).max(axis=0)
    if loop.limit is None:
        motors = reference.robot.description.actuators
        in_file = np.array([motor.torque_limit for motor in motors], dtype=float)
        return np.where(np.isnan(in_file), default, in_file)
    limit = np.asarray(loop.limit, dtype=float)
    if limit.shape not in ((), (1,), default.shape) or not np.all(limit > 0):
        raise InvalidInput(f"limit: needs {len(default)} positive torques [N m], got {list(loop.limit)}")
    return np.broadcast_to(limit, default.shape)


def run_closed_loop(
    controller: Controller,
    loop: ControlLoop,
    spread: Spread,
    variations: Sequence[Variation],
    *,
    record: bool = False,
    advanced: Callable[[float], None] = lambda share: None,
) -> Run:
    """Drive R varied robots along the plan from rest, all from the start of the plan.

    `record` keeps all torques; `advanced` is called with the share of the motion that is done.

    Raises:
        InvalidInput: the loops of a varied robot do not close; a limit that is no torque.
    """
    ref, limit = controller.reference, torque_limit(controller.reference, loop)
    robots, last = _Robots.of(controller, spread, variations), len(ref.times) - 1
    line = DelayLine.of(controller, variations)
    monitor = RunMonitor.of(len(variations), ref.robot)
    q, v = robots.start
    for k in range(last + 1):
        if k % PERIODS_PER_CHECK == 0 or k == last:
            advanced(k / last)
            monitor.check(ref.times[k], robots.platform(k, q, v), ref.x[k])
        with np.errstate(all="ignore"):
            command = controller.torque(k, robots.measure(k, q, v, loop.sensors))
        torque = line.delay(np.clip(np.nan_to_num(command, nan=0.0), -limit, limit))
        monitor.act(torque, record=record)
        if k == last or not monitor.alive.any():
            break
        q, v = robots.step(k, q, v, torque)
        # one run without numbers would leave none in stacked solves: runs that are over stand at their start
        slow = np.abs(v) * ref.period < MAX_JOINT_STEP * ref.robot.column_scale
        monitor.end(ref.times[k + 1], np.asarray(~(np.isfinite(q).all(axis=1) & slow.all(axis=1))))
        running = monitor.alive[:, None]
        q, v = np.where(running, q, robots.start.q), np.where(running, v, robots.start.v)
    return monitor.verdict(loop, variations)


class _Robots(NamedTuple):
    """R varied robots with their encoders, the friction of their motors and the world."""

    reference: Reference
    stepper: Stepper
    start: State  # q (R, nq), v (R, nv)
    world: WorldForces
    friction: Array  # (R, n_a) [N m] Coulomb friction of the motors
    slow: Array  # (n_a,) [rad/s] motor speeds below which that is smoothed, small for this plan
    noise: Array | None  # (K, R, 2, nv) of the encoders

    @staticmethod
    def of(controller: Controller, spread: Spread, variations: Sequence[Variation]) -> _Robots:
        """Return the robots at rest at the start of the plan, loops closed."""
        ref, count = controller.reference, len(variations)
        world = WorldForces.of(ref.robot, ref.wrenches, ref.law)
        try:
            stepper = Stepper.of([vary(ref.robot, each) for each in variations], like=ref.robot)
            torque, q = np.tile(ref.torque[0], (count, 1)), np.tile(ref.motion.q[0], (count, 1))
            start = stepper.start(q, None, torque, world=world)
        except NotAssembled as error:
            raise InvalidInput(
                f"places: with so large a spread a robot cannot be assembled: {error}"
            ) from None
        noise = noise_of(ref.robot, spread, [each.seed for each in variations], len(ref.times))
        friction = np.array([each.friction for each in variations]) * np.abs(ref.torque).max(axis=0)
        slow = FRICTION_SMOOTHING * np.maximum(np.abs(ref.motor_speed).max(axis=0), MIN_SPEED)
        return _Robots(ref, stepper, start, world, friction, slow, noise)

    def platform(self, k: int, q: Array, v: Array) -> Array:
        """Compute platform coordinates (R, n) at instant k."""
        return self.reference.robot.platform.unwrap(self.stepper.platform(q, v)[0], self.reference.x[k])

    def measure(self, k: int, q: Array, v: Array, sensors: str) -> Measurement:
        """Return the readings of the encoders at instant k, noise included."""
        ref, robot = self.reference, self.reference.robot
        offset = np.zeros_like(v) if self.noise is None else self.noise[k][:, 0]
        rates = v if self.noise is None else v + self.noise[k][:, 1]
        n, motors = robot.gear_ratio, robot.actuated
        angle, speed = n * (robot.actuated_coordinates(q) + offset[:, motors]), n * rates[:, motors]
        if sensors == "motors":
            return Measurement(angle, speed, None)
        from_joints = np.linalg.pinv(ref.N[k])  # (n, nv)
        x = self.platform(k, q, v) + matvec(from_joints, offset)
        dx = ref.dx[k] + matvec(from_joints, rates - ref.motion.v[k])
        return Measurement(angle, speed, RobotState(integrate(robot, q, offset), rates, x, dx))

    def step(self, k: int, q: Array, v: Array, torque: Array) -> State:
        """Return the states one period after instant k under motor torques (R, n_a)."""
        ref, world = self.reference, None
        if self.world.acts:
            middle = np.repeat(min(ref.times[k] + 0.5 * ref.period, ref.times[-1]), len(q))
            models = [robot.model for robot in self.stepper.stack.robots]
            world = self.world(ref.robot, middle, integrate(ref.robot, q, 0.5 * ref.period * v), models)
        speed = ref.robot.gear_ratio * v[:, ref.robot.actuated]
        friction = self.friction * np.tanh(speed / self.slow)
        return self.stepper.step(q, v, torque - friction, ref.period, world=world)
