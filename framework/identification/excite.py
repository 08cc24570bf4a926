"""Periodic motions that show parameters: designed within limits, and checked by forward simulation.

Each platform coordinate is a constant and a few harmonics of one period P, which start at rest:

    x(t) = c + sum of a_h cos(h w t) + b_h sin(h w t),    sum of h b_h = 0,    sum of h^2 a_h = 0,

with w = 2 pi / P (Swevers et al., IEEE Transactions on Robotics and Automation 13(5), 1997). The torques of
such a motion, with white noise of the sensors, determine parameters with the covariance (W'W)^-1, where W are
the equations of the torques over their noise. An evolution strategy with one parent and one child (Rechenberg
1973) minimises the mean logarithm of the deviations: a child that violates a limit is refused. The motion is
then driven by its torques and by feedback of the motors in a simulation, and identified from what sensors
record there.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.dynamics.motor_limits import Limit, motor_limits
from framework.dynamics.open_loop import MotorControl
from framework.dynamics.pointwise_dynamics import motor_inertia
from framework.errors import InvalidInput, NoAnswer, whole_number
from framework.identification.base_parameters import (
    BaseParameters,
    base_parameters,
    collect_link_parameters,
    gravity_scale,
    parameter_regressor,
)
from framework.identification.identify import Identification, IdentifiedQuantity, identify
from framework.identification.least_squares import posterior_root
from framework.identification.measured_motion import MIN_SAMPLES
from framework.identification.recording import Recording, Sensors, record_sensors
from framework.identification.unknowns import choose_unknowns, is_narrowed
from framework.kinematics.assembly import MAX_NEWTON_STEP
from framework.kinematics.continuation.forward_kinematics import forward_kinematics, motors_are_free
from framework.kinematics.continuation.tracking import assemble
from framework.kinematics.inverse_kinematics import close_each, require_square
from framework.kinematics.linearised_loops import (
    LinearisedLoops,
    clearance,
    linearised_at_reference,
    type1_matrix,
)
from framework.kinematics.motion_rates import motion_at
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import shares_beyond_limits
from framework.laws.law import check_duration
from framework.numerics.arrays import Array, ReadOnlyArrays, join
from framework.numerics.fields import positive
from framework.numerics.ordered_sums import singular_values
from framework.numerics.output import Document, plain
from framework.simulation import Simulation, simulate
from framework.tolerances import SAME_PLACE

HARMONICS = np.array([1, 2, 3, 5, 8, 12])  # a decade of frequencies: weight rules slow, inertia fast motions
INSTANTS = 6 * int(HARMONICS[-1])  # of a period, in the search: six of the fastest wave, which miss 1/7 of it
TRIALS = 400  # motions that the search tries: a few for each of about 30 amplitudes, in seconds
GRAVITY = 9.81  # [m/s^2] default limit of the platform's acceleration: inertial forces as large as weights
MAX_SAMPLES = 100_000  # of the simulated recording: 200 s at 500 Hz, 100 MB of equations
CHUNK = 512  # instants whose regressors of all joints are in memory at once, 10 MB each
SEARCH_SHARE = 0.9  # of limits that the search uses: between six instants a wave exceeds them by up to 1/7


class PeriodicMotion(NamedTuple):
    """The motion of platform and motors at T instants."""

    times: Array  # (T,) [s]
    q: Array  # (T, nq)
    x: Array  # (T, n) platform coordinates
    angle: Array  # (T, n_a) motor side [rad, m]
    speed: Array  # (T, n_a) motor side
    torque: Array  # (T, n_a) motor side [N m, N], dry friction included
    friction: Array  # (T, n_a) part of the torque by dry friction
    rows: Array  # (T, n_a, r) derivatives of the torque with respect to the base parameters


@dataclass(frozen=True, eq=False)
class Excitation(ReadOnlyArrays):
    """A motion that shows parameters, with what a simulated recording of this motion determines.

    Attributes:
        identification: of the simulated recording, by which the robot file's own values are the truth.
        tracking_error: largest distance of the simulated platform from the motion [robot lengths, rad].
        improvement: geometric mean of deviations by the first motion tried, over those by the best one; of
            the base parameters that the best one shows.
    """

    robot: ParallelRobot
    period: float  # [s]
    motion: PeriodicMotion
    simulation: Simulation
    identification: Identification
    tracking_error: float
    improvement: float
    trials: int

    def to_csv(self) -> str:
        """Return the motion as CSV text with the columns of motion.csv."""
        robot = self.robot
        motion = self.motion
        kinds = ("motor_angle", "torque", "motor_velocity")
        names = ["time", *(f"{kind}_{joint}" for kind in kinds for joint in robot.actuator_names)]
        names += [f"platform_{axis}" for axis in robot.axis_names]
        values = [motion.times[:, None], motion.angle, motion.torque, motion.speed, motion.x]
        return Recording("motion", tuple(names), np.concatenate(values, axis=1)).as_csv()

    def record(self, robot: ParallelRobot, sensors: Sensors | None = None) -> Recording:
        """Record a simulation of another robot that is driven along this motion; dry friction included."""
        return _simulate(robot, self.motion, sensors or Sensors())[1]

    @property
    def shown(self) -> tuple[IdentifiedQuantity, ...]:
        """The quantities that the simulated recording shows."""
        return tuple(quantity for quantity in self.identification.quantities if quantity.shown)

    @property
    def refusal(self) -> NoAnswer | None:
        """The reason why nothing of what was asked is shown; None if something is."""
        if self.shown:
            return None
        return NoAnswer(
            "no motion that was tried shows any of what is asked apart from the rest; "
            "crossing identify --all names the sums that torques show",
            name=self.robot.name,
        )

    def to_dict(self) -> Document:
        """Return all numbers but those of the motion, for JSON."""
        motors = self.robot.actuator_names
        document: Document = {
            "robot": self.robot.name,
            "period": self.period,
            "duration": self.motion.times[-1],
            "improvement": self.improvement,
            "trials": self.trials,
            "tracking_error": self.tracking_error,
            "largest_torque": dict(zip(motors, np.abs(self.motion.torque).max(axis=0), strict=True)),
            "largest_speed": dict(zip(motors, np.abs(self.motion.speed).max(axis=0), strict=True)),
            "start": dict(zip(self.robot.axis_names, self.motion.x[0], strict=True)),
            "quantities": [
                {**quantity._asdict(), "digits": digits(quantity)}
                for quantity in self.identification.quantities
            ],
        }
        return plain(document)


def digits(quantity: IdentifiedQuantity) -> float:
    """Return the decimal digits of a quantity: log10 of value over deviation."""
    return max(float(np.log10(max(abs(quantity.file), 1e-300) / quantity.deviation)), 0.0)


def excite(
    robot: ParallelRobot,
    *,
    duration: float = 10.0,
    only: Sequence[str] = (),
    torque_limit: Limit = None,
    speed_limit: Limit = None,
    acceleration: float = GRAVITY,
    clearance_share: float = 0.3,
    sensors: Sensors | None = None,
    trials: int = TRIALS,
    seed: int = 0,
    progress: Callable[[float], None] = lambda done: None,
) -> Excitation:
    """Design a periodic motion that shows parameters, checked by simulation.

    Args:
        duration: of the motion [s], one period or more.
        only: the parameters to be shown, as in `identify`; by default all.
        torque_limit, speed_limit: of the motors, as in `plan_crossing`; by default those of the robot file.
        acceleration: limit of the platform's [m/s^2]; for turns times the robot's length.
        clearance_share: least distance from Type 1 and Type 2 singularities, over that of the reference.
        sensors: of the simulated recording; by default those of `Sensors` at 500 Hz.
        trials: motions that the search tries.
        seed: of the search.
        progress: called with the number of trials done.

    Raises:
        InvalidInput: an unknown name, or a limit out of range.
        NoAnswer: no motion near the reference keeps the limits.
    """
    check_duration(duration)
    positive("acceleration", acceleration)
    positive("clearance_share", clearance_share)
    trials = whole_number("trials", trials, 0, sys.maxsize)
    seed = whole_number("seed", seed, 0, sys.maxsize)
    sensors = sensors or Sensors(rate=500.0)
    samples = duration * sensors.rate
    if not MIN_SAMPLES <= samples <= MAX_SAMPLES:
        raise InvalidInput(
            f"duration: {duration:g} s at {sensors.rate:g} Hz are {samples:.6g} samples, of at least "
            f"{MIN_SAMPLES} and at most {MAX_SAMPLES}"
        )
    require_square(robot)
    base = base_parameters(robot)
    # the highest harmonic reaches the limit of the acceleration with a tenth of the robot's length
    highest = np.sqrt(acceleration / (0.1 * robot.length)) / (2.0 * np.pi)  # [Hz]
    design = _Design(
        robot=robot,
        base=base,
        columns=choose_unknowns(base, collect_link_parameters(robot, base.described), only).design,
        noise_share=max(sensors.torque_noise, 1e-6) * np.sqrt(INSTANTS / samples),
        duration=duration,
        period=duration / max(1, round(duration * highest / HARMONICS[-1])),
        torque_limit=motor_limits(robot, "torque_limit", torque_limit),
        speed_limit=motor_limits(robot, "speed_limit", speed_limit),
        acceleration=acceleration,
        clearance=clearance_share * _distances(robot, linearised_at_reference(robot))[0],
    )
    z, q, improvement = _search(design, trials, np.random.default_rng(seed), progress)
    motion = _complete(design, z, q, sensors.rate)
    simulation, recording = _simulate(robot, motion, sensors)
    x = simulation.platform(motion.times)
    return Excitation(
        robot=robot,
        period=design.period,
        motion=motion,
        simulation=simulation,
        identification=identify(robot, recording, only=only),
        tracking_error=float(np.abs((x - motion.x) / robot.platform_scale).max()),
        improvement=improvement,
        trials=trials,
    )


def _distances(robot: ParallelRobot, linearised: LinearisedLoops) -> Array:
    """Compute distances (T, 2) from Type 1 and Type 2: least singular values."""
    type_1 = singular_values(type1_matrix(robot, linearised))[:, -1]
    return np.stack([type_1, clearance(robot, linearised)], axis=1)


@dataclass(frozen=True, eq=False)
class _Design:
    """The limits of a family of motions, and the base parameters to be shown.

    A motion is z (K, n): K functions of time for each coordinate, over the scale of the platform.
    """

    robot: ParallelRobot
    base: BaseParameters
    columns: Array  # (r, k) derivatives of the base parameters by `Unknowns` that are asked for
    noise_share: float  # of the torques over their largest value, for one mean instant of the recording
    duration: float
    period: float
    torque_limit: Array  # (n_a,) motor side
    speed_limit: Array  # (n_a,) motor side
    acceleration: float  # [m/s^2] largest of the platform
    clearance: Array  # (2,) least distances from Type 1 and Type 2

    def functions(self, times: Array) -> Array:
        """Compute the K functions (3, T, K) with two derivatives at times (T,): a constant, then waves.

        The waves span all harmonics that start at rest, with amplitudes that fall with the frequency.
        """
        w = 2.0 * np.pi / self.period * HARMONICS
        phase = np.outer(times, w)
        cosine, sine = np.cos(phase), np.sin(phase)
        waves = [(cosine, sine), (-w * sine, w * cosine), (-(w**2) * cosine, -(w**2) * sine)]
        at_rest = np.zeros((2, 2 * len(w)))
        at_rest[0, len(w) :] = 1.0  # each amplitude is over its frequency: speeds w b / w, accelerations w a
        at_rest[1, : len(w)] = HARMONICS
        _, _, V_rows = np.linalg.svd(at_rest)
        shapes = V_rows[2:].T / np.tile(HARMONICS, 2)[:, None]  # (2 H, 2 H - 2)
        constant = np.zeros((3, len(times), 1))
        constant[0] = 1.0
        return np.concatenate([constant, np.array([np.hstack(pair) for pair in waves]) @ shapes], axis=2)

    def evaluate(self, z: Array, times: Array, guess: Array, share: float = 1.0) -> PeriodicMotion | str:
        """Compute a motion z (K, n) at times (T,), or name the violated limit.

        Args:
            guess: (T, nq) of the poses.
            share: of the limits that the motion may use.
        """
        robot = self.robot
        x, dx, ddx = robot.platform_scale * (self.functions(times) @ z)  # (T, n) each
        x = x + robot.reference.x
        size = np.linalg.norm(ddx / robot.platform_scale, axis=1).max() * robot.length
        if size > share * self.acceleration:
            return f"the platform's acceleration reaches {size:.3g} m/s^2"
        closed = close_each(robot, x, guess, farthest=MAX_NEWTON_STEP)
        if not closed.closed.all():
            return "the loops do not close everywhere"
        beyond = shares_beyond_limits(robot.limits, closed.q)
        if beyond.any():
            joint = robot.limits[int(beyond.max(axis=0).argmax())].joint
            return f"{joint} leaves its range"
        is_near = share * _distances(robot, closed.linearised).min(axis=0) < self.clearance  # (2,)
        if is_near.any():
            return f"it comes near a Type {1 + int(is_near.argmax())} singularity"
        motion = motion_at(robot, closed.linearised, dx, ddx)
        speed = robot.gear_ratio * motion.v[:, robot.actuated]
        if (np.abs(speed) > share * self.speed_limit).any():
            return "a motor exceeds its speed limit"
        regressor = parameter_regressor(robot, motion, self.base.described)
        to_motors = np.linalg.pinv(regressor.motors)  # (T, n_a, n)
        rows = to_motors @ regressor.matrix[:, :, self.base.combinations.leading]
        torque = rows @ self.base.values + np.matvec(to_motors, regressor.constant)
        if (np.abs(torque) > share * self.torque_limit).any():
            return "a motor exceeds its torque limit"
        dry = robot.joint_friction[robot.actuated] * np.sign(speed) / robot.gear_ratio
        angle = robot.gear_ratio * robot.actuated_coordinates(closed.q)
        return PeriodicMotion(times, closed.q, x, angle, speed, torque, dry, rows)

    def deviation_shares(self, motion: PeriodicMotion) -> Array:
        """Compute the shares (m,) of base parameters' prior deviations left by the data."""
        noise = self.noise_share * np.abs(motion.torque).max(axis=0) + np.finfo(float).tiny  # (n_a,)
        W = np.concatenate(motion.rows @ self.columns / noise[:, None])  # (T n_a, k)
        by_prior = np.linalg.norm(self.columns, axis=1)
        free = by_prior > 0.0  # (r,) of these m
        return np.linalg.norm(self.columns[free] @ posterior_root(W), axis=1) / by_prior[free]


def _search(
    design: _Design, trials: int, random: np.random.Generator, progress: Callable[[float], None]
) -> tuple[Array, Array, float]:
    """Search the motion z (K, n) of least cost by an evolution strategy.

    The cost is the mean logarithm of the deviations of base parameters. Return z, its poses q (INSTANTS, nq),
    and how many times smaller the deviations of what it shows are than those by the first motion.
    """
    success = 1.5  # growth of the step after a success
    least_step = 1e-3  # [rad, robot lengths]
    largest_step = 0.05
    robot = design.robot
    times = design.period * np.arange(INSTANTS) / INSTANTS
    guess = np.tile(robot.reference.q, (INSTANTS, 1))
    z = 0.1 * random.standard_normal((2 * len(HARMONICS) - 1, robot.n))
    for _ in range(24):
        best = design.evaluate(z, times, guess, SEARCH_SHARE)
        if isinstance(best, PeriodicMotion):
            break
        z = 0.5 * z
    if isinstance(best, str):
        raise NoAnswer(
            f"no motion near the reference keeps the limits: however small, {best}", name=robot.name
        )
    step = largest_step
    first = shares = design.deviation_shares(best)
    for k in range(trials):
        progress(k + 1)
        child = z + step * random.standard_normal(z.shape)
        motion = design.evaluate(child, times, best.q, SEARCH_SHARE)
        lower = design.deviation_shares(motion) if isinstance(motion, PeriodicMotion) else shares
        if isinstance(motion, PeriodicMotion) and np.log(lower).sum() < np.log(shares).sum():
            z, best, shares = child, motion, lower
            step *= success
        else:
            step *= success**-0.25  # one success in five keeps its size
        if step < least_step:  # stuck at a limit
            step = largest_step
    shown = is_narrowed(shares, np.ones(len(shares)))
    return z, best.q, float(np.exp(np.mean(np.log(first[shown] / shares[shown])))) if shown.any() else 1.0


def _complete(design: _Design, z: Array, q: Array, rate: float) -> PeriodicMotion:
    """Compute a motion z (K, n) at `rate` [Hz], made smaller until the limits hold at all instants.

    `q` (INSTANTS, nq) are its poses at the instants of the search.
    """
    times = np.arange(int(design.duration * rate * (1.0 + SAME_PLACE)) + 1) / rate
    coarse = design.period * np.arange(INSTANTS) / INSTANTS
    nearest = np.round(times / design.period * INSTANTS).astype(int) % INSTANTS
    chunks = np.array_split(np.arange(len(times)), 1 + len(times) // CHUNK)
    for _ in range(40):
        motion = design.evaluate(z, coarse, q)
        if isinstance(motion, PeriodicMotion):
            q = motion.q
            parts = [design.evaluate(z, times[chunk], q[nearest[chunk]]) for chunk in chunks]
            refused = [part for part in parts if isinstance(part, str)]
            if not refused:
                return join([part for part in parts if isinstance(part, PeriodicMotion)])
            motion = refused[0]
        z = 0.97 * z
    raise NoAnswer(f"the motion found does not keep the limits: {motion}", name=design.robot.name)


# ------------------------------------------------------------------ the check by simulation


def _simulate(robot: ParallelRobot, motion: PeriodicMotion, sensors: Sensors) -> tuple[Simulation, Recording]:
    """Drive a robot along a motion by torques and feedback of the motors; return what sensors record.

    The simulated robot has no dry friction; that of its own speed is added to the recorded torques.
    """
    from scipy.interpolate import make_interp_spline  # slow to import

    start = assemble(robot, motion.x[0]).q
    if motors_are_free(robot):  # motors wait where the motion begins: another robot's platform is elsewhere
        start = forward_kinematics(robot, motion.angle[0] / robot.gear_ratio, near=start).q
    frequency = 10.0 * np.sqrt(gravity_scale(robot) / robot.length)  # [rad/s] of the feedback
    control = MotorControl.of(motor_inertia(robot, start), frequency)
    planned = make_interp_spline(motion.times, motion.torque - motion.friction, k=5)
    angle = make_interp_spline(motion.times, motion.angle, k=5)
    speed = angle.derivative()
    gear = robot.gear_ratio

    def drive(t: Array, q: Array, v: Array) -> Array:
        """Compute torques (T, n_a) at times t (T,), q (T, nq) and v (T, nv)."""
        angle_error = angle(t) - gear * robot.actuated_coordinates(q)
        return np.asarray(planned(t) + control.torque(angle_error, speed(t) - gear * v[:, robot.actuated]))

    simulation = simulate(
        robot,
        lambda t, q, v: drive(np.array([t]), q[None], v[None])[0],
        method="stiff",
        start=start,
        start_velocity=np.zeros(robot.nv),
        duration=float(motion.times[-1]),
    )

    def measured_torque(t: Array) -> Array:
        """Compute the torques (T, n_a) with dry friction at times t (T,)."""
        q, v = simulation.configuration(t), simulation.velocity(t)
        dry = robot.joint_friction[robot.actuated] * np.sign(v[:, robot.actuated]) / gear
        return drive(t, q, v) + dry

    return simulation, record_sensors(simulation, measured_torque, sensors)
