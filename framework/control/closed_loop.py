"""A controller on robots that differ from its model, with sampling, delay, noise, saturation and friction.

`Spread` says how far the robots differ, `draw` draws the differences of one robot, a `Variation`.
`run_closed_loop` drives the robots, ends diverged runs and decides which runs pass.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.control.controllers import Controller, Measurement, RobotState
from framework.control.reference import Reference
from framework.control.sensors import ControlLoop, LoopSensors, motor_step, sensors_of
from framework.control.variations import Spread, Variation, apply_variation, draw_noise
from framework.dynamics.motor_limits import motor_limits
from framework.errors import InvalidInput, NotAssembled
from framework.kinematics.frames import difference, integrate
from framework.numerics.arrays import Array, BoolArray, IntArray, Names, ReadOnlyArrays
from framework.numerics.ordered_sums import matvec, solve
from framework.simulation import Stepper
from framework.simulation.drive import WorldForces
from framework.simulation.equations import State
from framework.tolerances import AT_REST

# ------------------------------------------------------------------ the closed loop


MAX_JOINT_STEP = 3.0  # [rad, robot lengths] of a joint in one sampling period; a faster run has diverged
MAX_DEVIATION = 1.0  # [robot lengths, rad] of the platform from the plan; a larger one ends the run
# [s] steps of the simulation of robots with springs: one step of 1 ms takes 7 % of the amplitude of a
# vibration of 139 Hz, four take 0.2 %
ELASTIC_STEP = 2.5e-4
PERIODS_PER_CHECK = 5  # sampling periods between two comparisons of the platform with the plan


@dataclass(frozen=True, eq=False, kw_only=True)
class Outcomes(ReadOnlyArrays):
    """The outcomes of R runs."""

    passed: BoolArray  # (R,) whether the platform kept the tolerances of the `ControlLoop`
    why: Names  # (R,) reasons of failures, empty for runs that passed
    tracking_error: Array  # (R,) largest distance of the platform from the plan [robot lengths, rad]
    end_error: Array  # (R,) the same at the end
    peak_torque: Array  # (R, n_a) [N m], motor side
    payload: Array  # (R,) factor on the platform's inertia


@dataclass(frozen=True, eq=False, kw_only=True)
class Run(Outcomes):
    """R runs that were driven together."""

    x: Array  # (checks, R, n) platform coordinates, every PERIODS_PER_CHECK sampling periods
    torque: Array  # (periods, R, n_a) [N m] of the motors, until all runs have ended


def torque_limit(reference: Reference, loop: ControlLoop) -> Array:
    """Return the torque limits (n_a,) [N m, N] of the loop.

    By default they are the limits of the plan, which are those of the robot file unless others were stated. A
    motor without one has 10 times the plan's peak, which only a diverging run asks for.

    Raises:
        InvalidInput: an invalid limit.
    """
    limits = reference.torque_limit
    try:
        if loop.limit is not None:
            limits = motor_limits(reference.robot, "torque_limit", loop.limit)
    except InvalidInput as reason:
        raise reason.naming("limit") from None  # as the option of the loop is called
    return np.where(np.isfinite(limits), limits, 10 * reference.peak_torque)


def torque_range(reference: Reference, loop: ControlLoop) -> tuple[Array, Array]:
    """Return the least and the largest torque (K, n_a) [N m, N] of the loop, at the planned speeds.

    Torques along the speed are also limited by torque-speed curves.
    """
    limit = torque_limit(reference, loop)
    driving = np.minimum(limit, reference.driving_limit)
    speed = reference.motor_speed
    return -np.where(speed < 0.0, driving, limit), np.where(speed > 0.0, driving, limit)


def run_closed_loop(
    controller: Controller,
    loop: ControlLoop,
    spread: Spread,
    variations: Sequence[Variation],
    report_progress: Callable[[float], None] = lambda share: None,
) -> Run:
    """Drive R varied robots along the plan, see `run_closed_loops`."""
    return run_closed_loops([controller], loop, spread, variations, report_progress)[0]


def run_closed_loops(
    controllers: Sequence[Controller],
    loop: ControlLoop,
    spread: Spread,
    variations: Sequence[Variation],
    report_progress: Callable[[float], None] = lambda share: None,
) -> list[Run]:
    """Drive R varied robots with each of C controllers along the plan, from rest at its start.

    In every sampling period the encoders are read, the controllers command torques, the torques are limited
    and delayed, and the robots move. Runs that diverge end early. All runs form one stack, R runs of each
    controller after those of the last one, because numpy takes little longer for a larger stack.

    Args:
        controllers: all with the same reference.
        loop: torque limits, sensors and tolerances.
        spread: standard deviations of the encoders' noise; all other differences are in `variations`.
        variations: one for each of the R robots.
        report_progress: called with the finished share of the motion.

    Raises:
        InvalidInput: the loops of a varied robot do not close; an invalid torque limit.
    """
    ref, runs = controllers[0].reference, len(variations)
    lowest, highest = torque_range(ref, loop)
    robots = _VariedRobots.of(ref, loop, spread, variations, len(controllers))
    # a controller that filters has the `sensors` that it was tuned for; one with a state has `start`, which
    # returns a controller with the states of R runs
    stated = sensors_of(ref.robot, loop)
    own_sensors = [getattr(one, "sensors", None) or stated for one in controllers]
    sensors = [one._replace(state=stated.state) for one in own_sensors]
    see_platform = any(one.see_platform for one in sensors)
    drivers = [one.start(runs) if hasattr(one, "start") else one for one in controllers]
    of_driver = [slice(c * runs, (c + 1) * runs) for c in range(len(drivers))]  # rows of the stack
    count, last = runs * len(drivers), len(ref.times) - 1
    lost = np.full(count, np.inf)  # (C R,) [s] instants at which runs diverged
    x: list[Array] = []  # (C R, n) platform coordinates of each check
    # torques (K, C R, n_a) that the controllers command, and those of the motors, which follow with a delay
    commands, torques = np.zeros((2, last + 1, count, ref.robot.n_a))
    q, v = robots.start  # (C R, nq), (C R, nv)
    platforms: list[Array | None] = [None, None]  # (2, C R, n) x, dx at this instant and at the last one
    for k in range(last + 1):
        is_check = k % PERIODS_PER_CHECK == 0 or k == last
        platform = robots.platform_motion(k, q, v) if is_check or see_platform else None
        platforms = [platform, platforms[0]]
        if is_check and platform is not None:
            report_progress(k / last)
            x.append(platform[0])
            is_near = _deviation(ref, x[-1], ref.x[k]) < MAX_DEVIATION  # false for NaN
            lost = np.where(is_near, lost, np.minimum(lost, ref.times[k]))

        for own, driver, rows in zip(sensors, drivers, of_driver, strict=True):
            seen = [None if one is None else one[:, rows] for one in platforms]
            measured = robots.measure(k, own, q[rows], v[rows], *seen)
            # a controller may divide by zero at Type 2: an undefined torque counts as none
            with np.errstate(all="ignore"):
                command = driver.torque(k, measured._replace(command=commands[k - 1, rows] if k else None))
            commands[k, rows] = np.clip(np.where(np.isnan(command), 0.0, command), lowest[k], highest[k])
        # each run has its own delay, a number of periods; until it has passed, the first command applies
        torques[k] = commands[np.maximum(k - robots.delays, 0), np.arange(count)]
        if k == last or np.isfinite(lost).all():
            break

        q, v = robots.step(k, q, v, torques[k])
        is_slow = np.abs(v) * ref.period < MAX_JOINT_STEP * ref.robot.column_scale  # false for NaN
        is_valid = np.isfinite(q).all(axis=1) & is_slow.all(axis=1)
        lost = np.where(is_valid, lost, np.minimum(lost, ref.times[k + 1]))
        # runs that are lost wait at their start, as NaN in one run would spoil the stacked solution of all
        is_running = np.isinf(lost)[:, None]
        q = np.where(is_running, q, robots.start.q)
        v = np.where(is_running, v, robots.start.v)
    checked, acted = np.array(x), torques[: k + 1]  # (checks, C R, n), (periods, C R, n_a)
    return [_judge(ref, loop, variations, lost[rows], checked[:, rows], acted[:, rows]) for rows in of_driver]


def _deviation(ref: Reference, x: Array, planned: Array) -> Array:
    """Compute deviations (...,) [robot lengths, rad] of platform coordinates x (..., n) from `planned`."""
    return np.abs((x - planned) / ref.robot.platform_scale).max(axis=-1)


def _judge(
    ref: Reference,
    loop: ControlLoop,
    variations: Sequence[Variation],
    lost: Array,
    x: Array,
    torque: Array,
) -> Run:
    """Judge R runs by the tolerances of the control loop; return their outcomes.

    `lost` (R,) are the instants [s] at which runs diverged, infinite for the others; x and torque are those
    of `Run`, with all instants.
    """
    instants = np.minimum(PERIODS_PER_CHECK * np.arange(len(x)), len(ref.times) - 1)  # of the checks
    errors = _deviation(ref, x, ref.x[instants][:, None])  # (checks, R)
    is_lost = np.isfinite(lost)
    tracking_error = np.where(is_lost, MAX_DEVIATION, errors.max(axis=0))
    end_error = np.where(is_lost, MAX_DEVIATION, errors[-1])
    was_running = ref.times[: len(torque), None] < lost  # (periods, R)
    was_running_at_check = ref.times[instants, None] < lost  # (checks, R)

    # say why runs fail
    why = []
    for time, worst, end in zip(lost, tracking_error, end_error, strict=True):
        if np.isfinite(time):
            why.append(f"lost at t = {time:.4g} s")
        elif worst > loop.tolerance:
            why.append(f"{worst:.3g} off the plan on the way")
        elif end > loop.end:
            why.append(f"{end:.3g} off at the end")
        else:
            why.append("")
    return Run(
        passed=np.array([not reason for reason in why]),
        why=tuple(why),
        tracking_error=tracking_error,
        end_error=end_error,
        peak_torque=np.where(was_running[:, :, None], np.abs(torque), 0.0).max(axis=0),
        payload=np.array([variation.payload for variation in variations]),
        x=np.where(was_running_at_check[:, :, None], x, np.nan),
        torque=torque,
    )


class _VariedRobots(NamedTuple):
    """R varied robots with encoders, delays, motor friction and external wrenches, each in C runs."""

    reference: Reference  # the planned motion
    motor_step: Array  # (n_a,) steps of the motors' encoders [rad, m], joint side; 0 without steps
    stepper: Stepper  # computes the motion of all runs over one period
    start: State  # q (C R, nq), v (C R, nv)
    world: WorldForces  # external wrenches
    delays: IntArray  # (C R,) [sampling periods] from measurement to torque, at most the whole motion
    friction: Array  # (C R, n_a) [N m] Coulomb friction of the motors
    noise: Array | None  # (K, R, 2, nv) of the encoders, in positions and in speeds; None without noise

    @staticmethod
    def of(
        ref: Reference, loop: ControlLoop, spread: Spread, variations: Sequence[Variation], copies: int = 1
    ) -> _VariedRobots:
        """Place the robots in C = `copies` runs at the start of the plan, with its speed, loops closed.

        Raises:
            InvalidInput: the loops of a varied robot do not close.
        """
        # close the loops of each robot near the planned start
        world = WorldForces.of(ref.robot, ref.wrenches, ref.law)
        try:
            varied_robots = [apply_variation(ref.robot, variation) for variation in variations]
            stepper = Stepper.of(varied_robots, like=ref.robot)
            runs = (len(variations), 1)
            v = ref.motion.v
            planned = np.where(np.abs(v[0]) > AT_REST * np.abs(v).max(), v[0], 0.0)
            at_start = (np.tile(row, runs) for row in (ref.motion.q[0], planned, ref.torque[0]))
            start = stepper.start(*at_start, world=world)
        except NotAssembled as error:
            raise InvalidInput(
                f"places: with so large a spread a robot cannot be assembled: {error.sentence}"
            ) from None

        # delays, at most the whole motion; friction, in shares of the peak torques
        periods = np.rint([(loop.delay + variation.delay) / ref.period for variation in variations])
        delays = np.minimum(periods, len(ref.times)).astype(np.intp)
        shares = np.array([variation.friction for variation in variations])
        seeds = [variation.seed for variation in variations]
        return _VariedRobots(
            reference=ref,
            motor_step=motor_step(ref.robot, loop),
            stepper=Stepper(stepper.equations * copies, stepper.scheme),
            start=State(*(np.tile(part, (copies, 1)) for part in start)),
            world=world,
            delays=np.tile(delays, copies),
            friction=np.tile(shares * ref.peak_torque, (copies, 1)),
            noise=draw_noise(ref.robot, spread, seeds, len(ref.times)),
        )

    def platform_motion(self, k: int, q: Array, v: Array) -> Array:
        """Compute platform coordinates and rates (2, R, n) at instant k, angles near the planned ones."""
        ref = self.reference
        coordinates, twist = self.stepper.platform(q, v)
        x = ref.robot.platform.unwrap(coordinates, ref.x[k])
        return np.stack([x, solve(ref.robot.platform.rate_matrix(x), twist)])

    def measure(
        self,
        k: int,
        sensors: LoopSensors,
        q: Array,
        v: Array,
        platform: Array | None,
        last: Array | None,
    ) -> Measurement:
        """Read the `sensors` of R runs at instant k, q (R, nq) and v (R, nv), with their noise and steps.

        The noise of the joints becomes noise of the platform by dx/dq, the pseudo-inverse of the planned N =
        dq/dx. Accelerations follow from the platforms' motions (2, R, n) at this instant and the `last` one.
        """
        ref, robot = self.reference, self.reference.robot
        noise, rate_noise = np.zeros((2, *v.shape)) if self.noise is None else self.noise[k].swapaxes(0, 1)
        rates = v + rate_noise
        planned = robot.coordinates.positions(ref.motion.q[[k]])  # (1, nv)
        motors = robot.actuated
        position = robot.actuated_coordinates(q) + noise[:, motors]  # (R, n_a)
        angle = robot.gear_ratio * _round_to(position, self.motor_step)
        speed = robot.gear_ratio * rates[:, motors]

        # readings less the planned ones
        offset = difference(robot, ref.motion.q[[k]], q)  # (R, nv)
        S = sensors.S
        at_plan = matvec(S, planned)  # (1, s)
        reading = at_plan + matvec(S, offset) + noise[:, sensors.columns]
        readings = [_round_to(reading, sensors.step) - at_plan]
        state = None
        if platform is not None and sensors.see_platform:
            x, dx = platform
            if self.noise is not None:
                dx_dq = np.linalg.pinv(ref.N[k])  # (n, nv)
                x, dx = x + matvec(dx_dq, noise), dx + matvec(dx_dq, rate_noise)
            if sensors.state:
                state = RobotState(integrate(robot, q, noise), rates, x, dx)
            if sensors.platform:
                readings.append(x - ref.x[k])
            if sensors.imu:
                before = platform if last is None else last
                change = platform[1] - before[1] - (ref.dx[k] - ref.dx[max(k - 1, 0)])
                readings.append(change / ref.period)
        return Measurement(angle, speed, state, np.concatenate(readings, axis=1))

    def step(self, k: int, q: Array, v: Array, torque: Array) -> State:
        """Compute the states one period after instant k under motor torques `torque` (R, n_a) [N m].

        At instant k the robots have the configurations q (R, nq) and the joint rates v (R, nv). External
        wrenches are evaluated in the middle of the period, at a configuration predicted from the present
        rates.
        """
        ref = self.reference
        steps = max(1, round(ref.period / ELASTIC_STEP)) if ref.robot.n_e else 1
        h = ref.period / steps
        for step in range(steps):
            world = None  # forces of the external wrenches
            if self.world.acts:
                middle = min(ref.times[k] + (step + 0.5) * h, ref.times[-1])
                q_middle = integrate(ref.robot, q, 0.5 * h * v)
                models = self.stepper.models(len(q))
                world = self.world(ref.robot, np.repeat(middle, len(q)), q_middle, v, models)
            speed = ref.robot.gear_ratio * v[:, ref.robot.actuated]
            friction = self.friction * np.tanh(speed / ref.friction_speed)  # a smooth sign of the speed
            q, v = self.stepper.step(q, v, torque - friction, h, world=world)
        return State(q, v)


def _round_to(values: Array, step: Array) -> Array:
    """Round values (..., s) to multiples of steps (s,); a step of 0 rounds nothing."""
    if not step.any():
        return values
    whole = np.round(values / np.where(step > 0, step, 1.0)) * step
    return np.where(step > 0, whole, values)
