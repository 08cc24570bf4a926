"""A controller on robots that differ from its model, with sampling, delay, noise, saturation and friction.

`Spread` says how far the robots differ, `draw` draws the differences of one robot, a `Variation`.
`run_closed_loop` drives the robots, ends diverged runs and decides which runs pass.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.control.controllers import Controller, Measurement, Reference, RobotState
from framework.dynamics.motor_limits import motor_limits
from framework.errors import InvalidInput, NotAssembled, check_choice
from framework.kinematics.frames import integrate
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, BoolArray, IntArray, Names, ReadOnlyArrays
from framework.numerics.fields import not_negative, positive
from framework.numerics.ordered_sums import matvec
from framework.simulation import Stepper
from framework.simulation.drive import WorldForces
from framework.simulation.equations import State
from framework.tolerances import AT_REST

# ------------------------------------------------------------------ how robots differ from the model


@dataclass(frozen=True)
class Spread:
    """The spread of each quantity about the model, zero by default.

    The spread of a uniform distribution is its largest deviation, that of a normal distribution its standard
    deviation.
    """

    payload: float = 0.0  # share of the platform body's inertia, uniform to both sides
    stiffness: float = 0.0  # share of each spring's stiffness, uniform to both sides
    places: float = 0.0  # [m] standard deviation of each coordinate of each joint's position
    friction: float = 0.0  # Coulomb friction of each motor, share of the plan's peak torque, uniform from 0
    delay: float = 0.0  # [s] from measurement to torque, uniform from 0, rounded to sampling periods
    noise: float = 0.0  # [rad, robot lengths] standard deviation of each encoder
    speed_noise: float = 0.0  # [rad/s, robot lengths/s] standard deviation of measured speeds

    def __post_init__(self) -> None:
        """Check that no deviation is negative, and that shares are below 1."""
        for name, value in vars(self).items():
            not_negative(name, value)
        for name in ("payload", "stiffness"):
            if getattr(self, name) >= 1:
                raise InvalidInput(f"{name}: must be a share below 1, got {getattr(self, name)!r}")


@dataclass(frozen=True, eq=False)
class Variation:
    """The differences of one robot from the model, reproducible by a seed."""

    seed: tuple[int, int]  # seed of the study, number of the run
    payload: float  # factor on the platform body's inertia
    stiffness: Array  # (n_e,) factors
    shifts: Array  # (joints, 3) [m] of the joints' positions
    friction: Array  # (n_a,) Coulomb friction, share of the plan's peak torque
    delay: float  # [s]


def draw(robot: ParallelRobot, spread: Spread, seed: tuple[int, int]) -> Variation:
    """Draw the variation of one robot, independent of all others.

    Args:
        spread: of each quantity about the model `robot`.
        seed: seed of the study, number of the run.
    """
    random = np.random.default_rng(seed)
    # drawing in another order would give other results for the same seed
    return Variation(
        seed=seed,
        payload=1 + spread.payload * random.uniform(-1, 1),
        stiffness=1 + spread.stiffness * random.uniform(-1, 1, robot.n_e),
        shifts=spread.places * random.standard_normal((robot.model.njoints - 1, 3)),
        friction=spread.friction * random.uniform(0, 1, robot.n_a),
        delay=spread.delay * random.uniform(0, 1),
    )


def draw_noise(
    robot: ParallelRobot, spread: Spread, seeds: Sequence[tuple[int, int]], samples: int
) -> Array | None:
    """Draw encoder noise (samples, R, 2, nv) of positions and speeds; None without noise.

    Positions are in rad or m, speeds in rad/s or m/s.

    Args:
        spread: standard deviations of the noise.
        seeds: those of the R variations.
        samples: number of sampling instants.
    """
    if not (spread.noise or spread.speed_noise):
        return None
    deviations = np.array([spread.noise, spread.speed_noise])[:, None]  # (2, 1)
    shape = (samples, 2, robot.nv)
    # the additional 1 in the seed makes the sequences independent of those of `draw`
    runs = [np.random.default_rng((*seed, 1)).standard_normal(shape) for seed in seeds]
    return np.stack(runs, axis=1) * deviations * robot.column_scale


def apply_variation(robot: ParallelRobot, variation: Variation) -> ParallelRobot:
    """Return the robot with the inertia, joint positions and spring stiffness of a variation.

    With shifted joints the loops close at another configuration. Loop equations that are redundant in all
    poses are left out: they hold only for exact positions, and a real machine has clearance in its joints.

    The payload factor applies to the inertia of the platform's link or, if that link has no inertia, to the
    moving body that carries the platform's frame. The closed-loop simulation applies friction and delay.
    """
    model = robot.model.copy()
    frame = model.frames[robot.frames[0]]  # the platform's frame
    joint = frame.parentJoint
    payload = frame.placement.act(frame.inertia) if frame.inertia.mass > 0 else model.inertias[joint]
    parameters = model.inertias[joint].toDynamicParameters()  # (10,): mass, first moments, inertia
    # parameters of bodies that move as one add up, so their sum changes by the change of the payload
    parameters += (variation.payload - 1) * payload.toDynamicParameters()
    if parameters[0] > 0:  # only a body with mass has an inertia to change
        model.inertias[joint] = pin.Inertia.FromDynamicParameters(parameters)
    for k, shift in enumerate(variation.shifts, start=1):  # joint 0 is the world
        model.jointPlacements[k].translation += shift
    return replace(
        robot,
        model=model,
        stiffness=robot.stiffness * variation.stiffness,
        rows=robot.spanning_loops,  # now all that there are
        structure=replace(
            robot.structure,
            independent=np.arange(len(robot.loops.names)),
            spanning=np.arange(len(robot.spanning_loops.names)),
        ),
    )


# ------------------------------------------------------------------ the closed loop


SENSORS = ("motors", "joints")  # where the encoders are
MAX_DEVIATION = 1.0  # [robot lengths, rad] of the platform from the plan; a larger one ends the run
PERIODS_PER_CHECK = 5  # sampling periods between two comparisons of the platform with the plan
FRICTION_SMOOTHING = 0.02  # share of the largest planned motor speed below which friction is smoothed
MIN_SPEED = 1e-12  # [rad/s] in place of 0 for motors that never move, against 0 / 0


@dataclass(frozen=True)
class ControlLoop:
    """Tolerances, torque limits and sensors of all runs.

    A run passes if the platform always stays within `tolerance` of the plan and ends within `end` of the end
    of the path.
    """

    tolerance: float = 2.5e-3  # [robot lengths, rad]
    end: float = 2.5e-3  # [robot lengths, rad]
    # (n_a,) largest motor torques [N m, N]; None: those of the plan, or 10 times its peaks
    limit: tuple[float, ...] | None = None
    sensors: str = "motors"  # encoders on the motors, or on all "joints"

    def __post_init__(self) -> None:
        """Check tolerances and the name of the sensors."""
        positive("tolerance", self.tolerance)
        positive("end", self.end)
        check_choice("sensors", self.sensors, SENSORS)


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
        # the option of the loop is called limit, that of the robot file torque_limit
        raise InvalidInput(str(reason).removeprefix("torque_")) from None
    return np.where(np.isfinite(limits), limits, 10 * np.abs(reference.torque).max(axis=0))


def run_closed_loop(
    controller: Controller,
    loop: ControlLoop,
    spread: Spread,
    variations: Sequence[Variation],
    report_progress: Callable[[float], None] = lambda share: None,
) -> Run:
    """Drive R varied robots along the plan, from rest at its start.

    In every sampling period the encoders are read, the controller commands torques, the torques are limited
    and delayed, and the robots move. Runs that diverge end early.

    Args:
        loop: torque limits, sensors and tolerances.
        spread: standard deviations of the encoders' noise; all other differences are in `variations`.
        variations: one for each of the R robots.
        report_progress: called with the finished share of the motion.

    Raises:
        InvalidInput: the loops of a varied robot do not close; an invalid torque limit.
    """
    ref = controller.reference
    limit = torque_limit(ref, loop)
    robots = _VariedRobots.of(ref, spread, variations)
    last = len(ref.times) - 1
    lost = np.full(len(variations), np.inf)  # (R,) [s] instants at which runs diverged
    x: list[Array] = []  # (R, n) platform coordinates of each check
    # torques (K, R, n_a) that the controller commands, and those of the motors, which follow with a delay
    commands, torques = np.zeros((2, last + 1, len(variations), ref.robot.n_a))
    q, v = robots.start  # (R, nq), (R, nv)
    for k in range(last + 1):
        if k % PERIODS_PER_CHECK == 0 or k == last:
            report_progress(k / last)
            x.append(robots.platform_coordinates(k, q, v))
            is_near = _deviation(ref, x[-1], ref.x[k]) < MAX_DEVIATION  # false for NaN
            lost = np.where(is_near, lost, np.minimum(lost, ref.times[k]))

        # a controller may divide by zero at Type 2: an undefined torque counts as none
        with np.errstate(all="ignore"):
            command = controller.torque(k, robots.measure(k, q, v, loop.sensors))
        commands[k] = np.clip(np.nan_to_num(command, nan=0.0), -limit, limit)
        # each run has its own delay, a number of periods; until it has passed, the first command applies
        torques[k] = commands[np.maximum(k - robots.delays, 0), np.arange(len(variations))]
        if k == last or np.isfinite(lost).all():
            break

        q, v = robots.step(k, q, v, torques[k])
        has_diverged = _have_diverged(ref, q, v)
        lost = np.where(has_diverged, np.minimum(lost, ref.times[k + 1]), lost)
        # runs that are lost wait at their start, as NaN in one run would spoil the stacked solution of all
        is_running = np.isinf(lost)[:, None]
        q = np.where(is_running, q, robots.start.q)
        v = np.where(is_running, v, robots.start.v)
    return _judge(ref, loop, variations, lost, np.array(x), torques[: k + 1])


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

    Args:
        ref: the planned motion at K sampling instants.
        variations: of the R robots from the model.
        lost: (R,) instants [s] at which runs diverged, infinite for the others.
        x: (checks, R, n) platform coordinates, every PERIODS_PER_CHECK sampling periods.
        torque: (periods, R, n_a) [N m] of the motors.
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


def _have_diverged(
    ref: Reference,
    q: Array,
    v: Array,
    *,
    # [rad, robot lengths] of a joint in one sampling period; a faster run has diverged
    max_joint_step: float = 3.0,
) -> BoolArray:
    """Return a mask (R,) of the runs with joints that are not finite or too fast.

    q (R, nq) and v (R, nv) are the configurations and the joint rates of the runs.
    """
    is_slow = np.abs(v) * ref.period < max_joint_step * ref.robot.column_scale  # false for NaN
    is_valid = np.isfinite(q).all(axis=1) & is_slow.all(axis=1)
    return np.asarray(~is_valid)


class _VariedRobots(NamedTuple):
    """R varied robots with encoders, delays, motor friction and external wrenches."""

    reference: Reference  # the planned motion
    stepper: Stepper  # computes the motion of all robots over one period
    start: State  # q (R, nq), v (R, nv)
    world: WorldForces  # external wrenches
    delays: IntArray  # (R,) [sampling periods] from measurement to torque, at most the whole motion
    friction: Array  # (R, n_a) [N m] Coulomb friction of the motors
    smoothing_speed: Array  # (n_a,) [rad/s] motor speed below which friction is smoothed
    noise: Array | None  # (K, R, 2, nv) of the encoders, in positions and in speeds; None without noise

    @staticmethod
    def of(ref: Reference, spread: Spread, variations: Sequence[Variation]) -> _VariedRobots:
        """Place the robots at the start of the plan, with its speed, loops closed.

        Args:
            spread: standard deviations of the encoders' noise.
            variations: the other differences of each robot from the model.

        Raises:
            InvalidInput: the loops of a varied robot do not close.
        """
        # close the loops of each robot near the planned start
        world = WorldForces.of(ref.robot, ref.wrenches, ref.law)
        try:
            varied_robots = [apply_variation(ref.robot, variation) for variation in variations]
            stepper = Stepper.of(varied_robots, like=ref.robot)
            copies = (len(variations), 1)
            q = np.tile(ref.motion.q[0], copies)
            v = ref.motion.v
            planned = np.where(np.abs(v[0]) > AT_REST * np.abs(v).max(), v[0], 0.0)
            torque = np.tile(ref.torque[0], copies)
            start = stepper.start(q, np.tile(planned, copies), torque, world=world)
        except NotAssembled as error:
            raise InvalidInput(
                f"places: with so large a spread a robot cannot be assembled: {error}"
            ) from None

        # delays, at most the whole motion; noise of the encoders; friction, in shares of the peak torques
        periods = np.rint([variation.delay / ref.period for variation in variations])
        delays = np.minimum(periods, len(ref.times)).astype(np.intp)
        seeds = [variation.seed for variation in variations]
        noise = draw_noise(ref.robot, spread, seeds, len(ref.times))
        shares = np.array([variation.friction for variation in variations])
        friction = shares * np.abs(ref.torque).max(axis=0)
        smoothing_speed = FRICTION_SMOOTHING * np.maximum(np.abs(ref.motor_speed).max(axis=0), MIN_SPEED)
        return _VariedRobots(ref, stepper, start, world, delays, friction, smoothing_speed, noise)

    def platform_coordinates(self, k: int, q: Array, v: Array) -> Array:
        """Compute platform coordinates (R, n) at instant k, with angles near the planned ones.

        q (R, nq) and v (R, nv) are the configurations and joint rates of the R robots.
        """
        x, _ = self.stepper.platform(q, v)  # without the rates
        return self.reference.robot.platform.unwrap(x, self.reference.x[k])

    def measure(self, k: int, q: Array, v: Array, sensors: str) -> Measurement:
        """Read the encoders at instant k, with their noise.

        q (R, nq) and v (R, nv) are the configurations and joint rates, `sensors` is one of SENSORS. With
        encoders on all joints the platform is measured too. The noise of the joints becomes noise of the
        platform by dx/dq, the pseudo-inverse of the planned N = dq/dx.
        """
        ref = self.reference
        robot = ref.robot
        noise = np.zeros_like(v)
        rates = v
        if self.noise is not None:
            noise, rate_noise = self.noise[k].swapaxes(0, 1)  # (R, nv) each
            rates = v + rate_noise
        angle = robot.gear_ratio * (robot.actuated_coordinates(q) + noise[:, robot.actuated])
        speed = robot.gear_ratio * rates[:, robot.actuated]
        if sensors == "motors":
            return Measurement(angle, speed, state=None)

        dx_dq = np.linalg.pinv(ref.N[k])  # (n, nv)
        x = self.platform_coordinates(k, q, v) + matvec(dx_dq, noise)
        # the rates of the platform follow from those of the joints, as offsets from the plan
        dx = ref.dx[k] + matvec(dx_dq, rates - ref.motion.v[k])
        return Measurement(angle, speed, RobotState(integrate(robot, q, noise), rates, x, dx))

    def step(self, k: int, q: Array, v: Array, torque: Array) -> State:
        """Compute the states one period after instant k under motor torques `torque` (R, n_a) [N m].

        At instant k the robots have the configurations q (R, nq) and the joint rates v (R, nv). External
        wrenches are evaluated in the middle of the period, at a configuration predicted from the present
        rates.
        """
        ref = self.reference
        world = None  # forces of the external wrenches
        if self.world.acts:
            middle_time = np.repeat(min(ref.times[k] + 0.5 * ref.period, ref.times[-1]), len(q))  # (R,)
            q_middle = integrate(ref.robot, q, 0.5 * ref.period * v)
            models = [equations.robot.model for equations in self.stepper.equations]
            world = self.world(ref.robot, middle_time, q_middle, models)
        speed = ref.robot.gear_ratio * v[:, ref.robot.actuated]
        friction = self.friction * np.tanh(speed / self.smoothing_speed)  # a smooth sign of the speed
        return self.stepper.step(q, v, torque - friction, ref.period, world=world)
