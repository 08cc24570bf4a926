"""A controller on robots that are not quite as it believes: sampling, delay, noise, saturation, friction."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from framework.arrays import Array, IntArray, ReadOnlyArrays
from framework.control.estimation import Controller, Measurement, RobotState
from framework.control.reference import Reference
from framework.control.variation import Spread, Variation, noise_of, varied
from framework.errors import InvalidInput, NotAssembled, choose_from
from framework.kinematics.frames import integrate
from framework.kinematics.parallel_robot import ParallelRobot
from framework.linalg.ordered_sums import matvec
from framework.simulation import Stepper

SENSORS = ("motors", "joints")
LOST = 1.0  # [robot lengths, rad] from the plan: the run is over
FASTEST = 3.0  # [rad, robot lengths] that a joint may move in one sampling period: more is a runaway
LOOK = 5  # sampling periods between two looks at where the platform really is
STICKING = 0.02  # Coulomb friction is smoothed below this share of the largest planned motor speed


@dataclass(frozen=True)
class ControlLoop:
    """What every run has in common.

    A run passes if the platform never leaves the plan by more than `tolerance` on the way and ends within
    `end` of the end of the path, in robot lengths and radians. `limit` (n_a) is the largest motor
    torque [N m]; None: the torque limits of the robot file, or else ten times the peaks of the plan.
    """

    tolerance: float = 2.5e-3
    end: float = 2.5e-3
    limit: tuple[float, ...] | None = None
    sensors: str = "motors"  # encoders on the motors alone, or on "joints": all of them

    def __post_init__(self) -> None:
        for name in ("tolerance", "end"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise InvalidInput(f"{name}: must be a positive number, got {value!r}")
        if self.sensors not in SENSORS:
            raise InvalidInput(choose_from("sensors", self.sensors, SENSORS))


@dataclass(frozen=True, eq=False)
class Run(ReadOnlyArrays):
    """What became of R runs; see `Study`."""

    passed: NDArray[np.bool_]  # (R,)
    why: tuple[str, ...]
    tracking_error: Array  # (R,)
    end_error: Array  # (R,)
    peak_torque: Array  # (R, n_a) [N m]
    payload: Array  # (R,)
    x: Array  # (looks, R, n) where the platforms went, every LOOK sampling periods
    torque: Array | None = None  # (K, R, n_a) if it was recorded


def torque_limit(reference: Reference, loop: ControlLoop) -> Array:
    """Largest motor torques (n_a,) [N m]; raises InvalidInput for a limit that is no torque."""
    planned = 10 * np.abs(reference.torque).max(axis=0)
    if loop.limit is None:
        motors = reference.robot.description.actuators
        given = [motor.torque_limit for motor in motors]
        return np.array([p if g is None else g for p, g in zip(planned, given, strict=True)])
    limit = np.asarray(loop.limit, dtype=float)
    if limit.shape not in ((), (1,), planned.shape) or not np.all(limit > 0):
        raise InvalidInput(f"limit: needs {len(planned)} positive torques [N m], got {list(loop.limit)}")
    return np.broadcast_to(limit, planned.shape)


def run_closed_loop(
    controller: Controller,
    loop: ControlLoop,
    spread: Spread,
    variations: Sequence[Variation],
    *,
    record: bool = False,
    advanced: Callable[[float], None] = lambda share: None,
) -> Run:
    """Drive R varied robots along the plan from rest, all starting where the plan starts.

    `record` keeps all torques; `advanced` is called with the share of the motion that is done.

    Raises:
        InvalidInput: the loops of a varied robot do not close; a limit that is no torque.
    """
    ref, limit = controller.reference, torque_limit(controller.reference, loop)
    nominal, last = ref.robot, len(ref.times) - 1
    stepper, *start = _started(controller, variations)
    q, v = start
    noise = noise_of(nominal, spread, [variation.seed for variation in variations], last + 1)
    friction = _Friction.of(controller, variations)
    line = _DelayLine.of(controller, variations)
    watch = _Watch.of(len(variations), nominal)
    for k in range(last + 1):
        if k % LOOK == 0 or k == last:
            advanced(k / last)
            watch.look(ref.times[k], nominal.platform.unwrap(stepper.platform(q, v)[0], ref.x[k]), ref.x[k])
        seen = _measured(
            ref, k, stepper, q, v, noise=None if noise is None else noise[k], sensors=loop.sensors
        )
        with np.errstate(all="ignore"):
            asked = controller.torque(k, seen)
        given = line.delayed(np.clip(np.nan_to_num(asked, nan=0.0), -limit, limit))
        watch.peak = np.fmax(watch.peak, np.where(watch.alive[:, None], np.abs(given), 0.0))
        if record:
            watch.record(given)
        if k == last or not watch.alive.any():
            break
        q, v = stepper.step(q, v, given - friction.torque(v), ref.period)
        # one run without numbers would leave none in stacked solves: runs that are over stand at their start
        slow = np.abs(v) * ref.period < FASTEST * nominal.column_scale
        watch.lose(ref.times[k + 1], np.asarray(~(np.isfinite(q).all(axis=1) & slow.all(axis=1))))
        q, v = (np.where(watch.alive[:, None], now, first) for now, first in zip((q, v), start, strict=True))
    return watch.verdict(loop, variations)


def _started(controller: Controller, variations: Sequence[Variation]) -> tuple[Stepper, Array, Array]:
    """The varied robots at rest at the start of the plan, loops closed: q (R, nq), v (R, nv)."""
    ref = controller.reference
    real = [varied(ref.robot, variation) for variation in variations]
    count = len(real)
    try:
        stepper = Stepper.of(real, like=ref.robot)
        q, v = stepper.start(np.tile(ref.motion.q[0], (count, 1)), None, np.tile(ref.torque[0], (count, 1)))
    except NotAssembled as error:
        raise InvalidInput(f"places: with so large a spread a robot cannot be assembled: {error}") from None
    return stepper, q, v


def _measured(
    ref: Reference, k: int, stepper: Stepper, q: Array, v: Array, *, noise: Array | None, sensors: str
) -> Measurement:
    """What the encoders say, `noise` (R, 2, nv) included."""
    robot = ref.robot
    turned = np.zeros_like(v) if noise is None else noise[:, 0]
    seen = v if noise is None else v + noise[:, 1]
    n, motors = robot.gear_ratio, robot.actuated
    angle, speed = n * (joint_angle(robot, q) + turned[:, motors]), n * seen[:, motors]
    if sensors == "motors":
        return Measurement(angle, speed, None)
    back = np.linalg.pinv(ref.N[k])  # (n, nv)
    x = robot.platform.unwrap(stepper.platform(q, v)[0], ref.x[k]) + matvec(back, turned)
    return Measurement(
        angle,
        speed,
        RobotState(integrate(robot, q, turned), seen, x, ref.dx[k] + matvec(back, seen - ref.motion.v[k])),
    )


def joint_angle(robot: ParallelRobot, q: Array) -> Array:
    """Positions (R, n_a) of the actuated joints [rad, m]."""
    columns = [robot.model.joints[robot.model.getJointId(name)].idx_q for name in robot.actuator_names]
    return np.asarray(q[:, columns])


@dataclass(frozen=True, eq=False)
class _Friction:
    """Coulomb friction on the motors, smoothed at speeds that are small for this plan."""

    size: Array  # (R, n_a) [N m]
    slow: Array  # (n_a,) [rad/s]
    robot: ParallelRobot

    @staticmethod
    def of(controller: Controller, variations: Sequence[Variation]) -> _Friction:
        ref = controller.reference
        size = np.array([variation.friction for variation in variations]) * np.abs(ref.torque).max(axis=0)
        slow = STICKING * np.maximum(np.abs(ref.motor_speed).max(axis=0), 1e-12)
        return _Friction(size, slow, ref.robot)

    def torque(self, v: Array) -> Array:
        """What friction takes (R, n_a) [N m], motor side."""
        speed = self.robot.gear_ratio * v[:, self.robot.actuated]
        return np.asarray(self.size * np.tanh(speed / self.slow))


@dataclass(frozen=True, eq=False)
class _DelayLine:
    """Torques that arrive a whole number of sampling periods late, each run by its own."""

    delays: IntArray  # (R,)
    past: deque[Array]

    @staticmethod
    def of(controller: Controller, variations: Sequence[Variation]) -> _DelayLine:
        ref = controller.reference
        periods = np.rint([variation.delay / ref.period for variation in variations])
        delays = np.minimum(periods, len(ref.times)).astype(np.intp)  # longer: never in this motion
        return _DelayLine(delays, deque(maxlen=int(delays.max(initial=0)) + 1))

    def delayed(self, torque: Array) -> Array:
        """The torques (R, n_a) that act now; the first ones until they have come through."""
        self.past.append(torque)
        if len(self.past) == 1:
            return torque
        late = np.minimum(self.delays, len(self.past) - 1)
        return np.array([self.past[-1 - d][r] for r, d in enumerate(late)])


@dataclass(eq=False)
class _Watch:
    """Follows R runs and judges them."""

    robot: ParallelRobot
    alive: NDArray[np.bool_]
    why: list[str]
    worst: Array
    error: Array
    peak: Array
    seen: list[Array]
    given: list[Array]

    @staticmethod
    def of(count: int, robot: ParallelRobot) -> _Watch:
        zero = np.zeros(count)
        return _Watch(
            robot, np.ones(count, bool), [""] * count, zero, zero, np.zeros((count, robot.n_a)), [], []
        )

    def look(self, time: float, x: Array, planned: Array) -> None:
        """Compare platforms x (R, n) with the plan (n,); lose those that are far off or not finite."""
        size = np.where(self.robot.translations, self.robot.length, 1.0)
        self.error = np.nan_to_num(np.abs((x - planned) / size), nan=LOST).max(axis=1)
        self.lose(time, ~(self.error < LOST))
        self.worst = np.where(self.alive, np.maximum(self.worst, self.error), np.maximum(self.worst, LOST))
        self.seen.append(np.where(self.alive[:, None], x, np.nan))

    def lose(self, time: float, which: NDArray[np.bool_]) -> None:
        """End the runs of which (R,) says so, those that are not over yet."""
        for run in np.flatnonzero(self.alive & which):
            self.why[run] = f"lost at t = {time:.4g} s"
        self.alive = self.alive & ~which

    def record(self, torque: Array) -> None:
        """Keep the torques (R, n_a) of one sampling period."""
        self.given.append(torque)

    def verdict(self, loop: ControlLoop, variations: Sequence[Variation]) -> Run:
        """Who passed, and why the others did not."""
        error = np.where(self.alive, self.error, LOST)
        for run in np.flatnonzero(self.alive & (self.worst > loop.tolerance)):
            self.why[run] = f"{self.worst[run]:.3g} off the plan on the way"
        for run in np.flatnonzero(self.alive & (self.worst <= loop.tolerance) & (error > loop.end)):
            self.why[run] = f"{error[run]:.3g} off at the end"
        return Run(
            passed=self.alive & (self.worst <= loop.tolerance) & (error <= loop.end),
            why=tuple(self.why),
            tracking_error=self.worst,
            end_error=error,
            peak_torque=self.peak,
            payload=np.array([variation.payload for variation in variations]),
            x=np.array(self.seen),
            torque=np.array(self.given) if self.given else None,
        )
