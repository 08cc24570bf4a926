"""Feedforward and computed torque, with planned motion, measurements and estimated states.

With encoders only on the motors, the platform coordinates follow from the motor angles by the inverse of G =
d(motor angles)/dx. Like A, G is singular at Type 2. The naive estimate amplifies noise without bound there.
The aware estimate takes the planned values in the directions that the motors do not determine.

Feedforward: planned torques with proportional and derivative feedback at each motor. The planned torque is
finite at the crossing, and the feedback does not invert A. So the controller works at a singularity without
change.

Computed torque: the inverse dynamics of the measured state, naive or aware of the singularity. Both
controllers command the platform acceleration ddx_c = ddx + k_d (dx error) + k_p (x error) and compute torques
from P' lambda = r_p, tau = r_a - J_a' lambda (see `framework.dynamics.forces`). P loses rank at a Type 2
singularity. The naive controller inverts P nevertheless; condition (8) holds for the plan, but not for the
feedback added to it. The aware controller starts from the planned multipliers, which are finite at the
crossing, and corrects them only in directions in which P is regular: in which its singular value is not small
against its values elsewhere on the plan (`fading_thresholds`). Away from singularities both controllers are
equal. After Pagis, Bouton, Briot and Martinet, Enlarging parallel robot workspace through Type-2
singularity crossing, Control Engineering Practice 39, 2015, who switch to a model that stays consistent near
the singularity.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from framework.control.deviation import Plant, closed_loop_deviation
from framework.control.linear_model import DISTURBANCES, LinearModel, linearise_plan
from framework.control.reference import Reference, fading_thresholds
from framework.control.sensors import ControlLoop
from framework.dynamics.forces import tree_forces
from framework.dynamics.open_loop import MotorControl
from framework.dynamics.pointwise_dynamics import motor_inertia
from framework.errors import InvalidInput, check_choice
from framework.kinematics.closures import closure_drift, loop_equations, scale_jacobian
from framework.kinematics.external_wrenches import AppliedWrench
from framework.kinematics.frames import frame_motions, frames_at, integrate
from framework.kinematics.linearised_loops import scaled_loops
from framework.kinematics.loop_ranges import align_bases
from framework.numerics.arrays import Array
from framework.numerics.fields import CheckedNumbers, NotNegative, Positive
from framework.numerics.ordered_sums import matmul, matvec, solve

# ------------------------------------------------------------------ controllers


@dataclass(frozen=True)
class Tuning(CheckedNumbers):
    """What a designer may choose of the controllers."""

    # [rad/s] of feedforward (each motor) and computed torque (the platform); None: 40 and 20, or less as the
    # delay demands
    bandwidth: Positive | None = None
    integral: NotNegative = 0.0  # [1/s] of feedforward and computed torque, against constant disturbances
    # of lqr and lqg: torque corrections, as shares of the peak, that cost as much as a deviation of the
    # platform by 1e-3 robot lengths; a larger share gives faster control
    torque_share: Positive = 0.3
    # of lqg: kinds of DISTURBANCES that are estimated; None: those of the spread of robots
    estimates: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        """Check signs and names."""
        super().__post_init__()
        for name in self.estimates or ():
            check_choice("estimates", name, DISTURBANCES)


class RobotState(NamedTuple):
    """Configuration and platform of R runs with their rates, measured or estimated."""

    q: Array  # (R, nq)
    v: Array  # (R, nv) joint rates
    x: Array  # (R, n) platform coordinates [m, rad]
    dx: Array  # (R, n) their rates


class Measurement(NamedTuple):
    """The readings of the sensors of R runs."""

    motor_angle: Array  # (R, n_a) [rad, m], motor side
    motor_speed: Array  # (R, n_a) [rad/s, m/s], motor side
    state: RobotState | None  # None unless the whole state is measured
    readings: Array | None = None  # (R, s) of the sensors, less the planned ones, see `sensors_of`
    command: Array | None = None  # (R, n_a) torque of the last instant, as limited; None at first


class Controller(Protocol):
    """A controller for one reference.

    One with a state per run also has `start(runs)`, which returns the controller of R runs at the start of
    the plan; this is called at all instants in order.
    """

    @property
    def reference(self) -> Reference:
        """The planned motion that the controller follows."""

    def torque(self, k: int, measurement: Measurement) -> Array:
        """Compute motor torques (R, n_a) [N m, N], motor side, at sampling instant k."""
        ...


def estimate_state(reference: Reference, k: int, measurement: Measurement, *, aware: bool) -> RobotState:
    """Return the measured state at instant k, or an estimate from the motors.

    The state is measured if all joints have encoders. The estimate is one Newton step from the plan: the
    offset d (n,) of the platform, in robot lengths and radians, solves G d = measured - planned motor angles
    with G (n_a, n) of `motor_maps`; the joints are off the plan by N d. Rates are estimated in the same way.

    Args:
        measurement: of R runs.
        aware: whether the small singular values of G near the singularity are damped (`solve_damped`). If
            not, the estimate is infinite where G is singular.
    """
    if measurement.state is not None:
        return measurement.state
    robot = reference.robot
    N = reference.N[k]  # (nv, n) dq/dx
    G = reference.motor_maps[k]  # (n_a, n)
    angle_offset = measurement.motor_angle - reference.motor_angle[k]
    speed_offset = measurement.motor_speed - reference.motor_speed[k]
    motor_offsets = np.stack([angle_offset, speed_offset])  # (2, R, n_a)
    if aware:
        offsets = solve_damped(G[None], motor_offsets, reference.motor_thresholds)
    else:
        offsets = matvec(solve(G[None], np.eye(len(G))[None]), motor_offsets)
    x_offset, dx_offset = offsets * robot.platform_scale  # (R, n) each
    return RobotState(
        q=integrate(robot, reference.motion.q[k], matvec(N, x_offset)),
        v=reference.motion.v[k] + matvec(N, dx_offset),
        x=reference.x[k] + x_offset,
        dx=reference.dx[k] + dx_offset,
    )


def solve_damped(matrices: Array, right: Array, thresholds: Array) -> Array:
    """Solve matrices (R, m, k) for right-hand sides (..., R, m) by damped least squares.

    The solutions have the shape (..., R, k). A single matrix (1, m, k) serves all right-hand sides. The
    inverse of a singular value sigma below its threshold t, of `thresholds` (k,), is sigma / t^2 instead of
    1 / sigma, which is continuous at t and falls to zero with sigma. The solution is NaN for a matrix that is
    not finite; the decomposition of such a matrix would raise an error for all R of them.
    """
    is_finite = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))[:, None]  # (R, 1)
    U, sigma, V_rows = np.linalg.svd(np.where(is_finite[:, None], matrices, 0.0), full_matrices=False)
    inverse = np.where(sigma > thresholds, 1.0 / np.maximum(sigma, thresholds), sigma / thresholds**2)
    components = inverse * matvec(U.transpose(0, 2, 1), right)  # along the right singular vectors
    return np.where(is_finite, matvec(V_rows.transpose(0, 2, 1), components), np.nan)


# ------------------------------------------------------------------ feedforward


@dataclass(frozen=True, eq=False)
class FeedforwardPD:
    """tau = tau_plan + k_p (motor angle error) + k_d (motor speed error)."""

    reference: Reference
    feedback: MotorControl  # gains k_p, k_d of each motor

    delay: int = 0  # [periods] known, from measurement to torque
    integral: float = 0.0  # [1/s] the integral of the angle error counts k_p times this

    @staticmethod
    def tune(
        reference: Reference, *, loop: ControlLoop | None = None, tuning: Tuning | None = None
    ) -> FeedforwardPD:
        """Tune each motor to a natural frequency, critically damped.

        The inertia is that of a motor moving alone at the start of the motion. The bandwidth is by default
        40 rad/s, or less with a long delay T from measurement to torque: at most MAX_PHASE / T. For a robot
        with springs, of which fast motions move the rotor alone, it is the one with the least predicted
        deviation from errors of the torques at T and one period more (`closed_loop_deviation`), of
        BANDWIDTHS.

        Args:
            loop: its known delay.
        """
        robot, period, tuning = reference.robot, reference.period, tuning or Tuning()
        delay = 0 if loop is None else loop.delayed_periods(period)
        inertia = motor_inertia(robot, reference.motion.q[0])
        bandwidth = tuning.bandwidth
        if bandwidth is None and robot.n_e:
            bandwidth = _bandwidth_of_springs(reference, inertia, delay)
        bandwidth = bandwidth or default_bandwidth(delay * period, period, DEFAULT_BANDWIDTH)
        return FeedforwardPD(reference, MotorControl.of(inertia, bandwidth), delay, tuning.integral)

    def start(self, runs: int) -> IntegralRun:
        """Return the controller of R runs at the start of the plan."""
        return IntegralRun(self)

    def error(self, k: int, measurement: Measurement) -> Array:
        """Compute the errors (R, n_a) [rad, m] of the motors' angles at sampling instant k."""
        return self.reference.motor_angle[k] - measurement.motor_angle

    def torque(self, k: int, measurement: Measurement, offset: Array | float = 0.0) -> Array:
        """Compute motor torques (R, n_a) [N m, N], motor side, at sampling instant k.

        They are the torques planned for the period in which they act, plus feedback of the errors of the
        measured motor angles and speeds. An `offset` (R, n_a) is added to the errors of angles.
        """
        ref = self.reference
        angle_error = self.error(k, measurement) + offset
        speed_error = ref.motor_speed[k] - measurement.motor_speed
        planned = ref.period_torque[min(k + self.delay, len(ref.times) - 1)]
        return planned + self.feedback.torque(angle_error, speed_error)


DEFAULT_BANDWIDTH = 40.0  # [rad/s] of feedforward
PLATFORM_BANDWIDTH = 20.0  # [rad/s] of computed torque
# bandwidth times the delay from measurement to the middle of the period in which a torque acts. The loop of
# a critically damped double integrator crosses at 2.06 of its frequency with a phase margin of 76 degrees
# less 118 degrees times this number: 40 degrees are left
MAX_PHASE = 0.3
# [rad/s] tried for robots with springs; the last does nothing
BANDWIDTHS = DEFAULT_BANDWIDTH * 2.0 ** -np.arange(13)


def default_bandwidth(delay: float, period: float, largest: float) -> float:
    """Return a bandwidth [rad/s] that a delay [s] and one sampling period more do not destabilise."""
    return min(largest, MAX_PHASE / (delay + 1.5 * period))


def _bandwidth_of_springs(reference: Reference, inertia: Array, delay: int) -> float:
    """Return the bandwidth [rad/s] of least predicted deviation of the platform, see `FeedforwardPD.tune`."""
    robot = reference.robot
    model = linearise_plan(reference, ("torque",))
    plant = Plant.of(model)
    start = np.eye(model.A.shape[1])[:, 2 * model.m :]  # (N, n_a) an error of each torque
    largest = default_bandwidth(delay * reference.period, reference.period, DEFAULT_BANDWIDTH)

    bandwidths = BANDWIDTHS[largest >= BANDWIDTHS]
    if not len(bandwidths):
        return largest
    gains = [motor_gains(reference, model, MotorControl.of(inertia, one)) for one in bandwidths]
    gain = np.stack(gains, axis=1)  # (K, bandwidths, n_a, N)
    deviations = [
        closed_loop_deviation([plant] * len(bandwidths), start, gain, periods).z[:, :, : robot.n]
        for periods in (delay, delay + 1)
    ]
    worst = (np.maximum(*deviations) / robot.platform_scale).max(axis=(1, 2))  # (bandwidths,)
    return float(bandwidths[np.argmin(worst)])


def motor_gains(reference: Reference, model: LinearModel, feedback: MotorControl) -> Array:
    """Return the gain (K, n_a, N) by which feedback of the motors corrects torques for deviations z."""
    robot, m = reference.robot, model.m
    angle = robot.gear_ratio[:, None] * model.joints[:, robot.actuated]  # (K, n_a, N)
    # its rate: that of the matrix, and that of h, which is h'
    speed = np.gradient(angle, reference.period, axis=0)
    speed[:, :, m : 2 * m] += angle[:, :, :m]
    return feedback.k_p[:, None] * angle + feedback.k_d[:, None] * speed


# ------------------------------------------------------------------ computed torque


@dataclass(frozen=True, eq=False)
class ComputedTorque:
    """Computed torque in platform coordinates, naive or aware of the singularity."""

    reference: Reference
    multipliers: Array | None  # (K, m) of the plan, for the aware controller; None for the naive one
    thresholds: Array  # (n_p,) singular values of P below which the aware controller does not invert P
    bandwidth: float = PLATFORM_BANDWIDTH  # [rad/s] natural frequency of the platform, critically damped
    integral: float = 0.0  # [1/s] the integral of the platform's error counts k_p times this

    @staticmethod
    def tune(
        reference: Reference,
        *,
        aware: bool,
        loop: ControlLoop | None = None,
        tuning: Tuning | None = None,
    ) -> ComputedTorque:
        """Return the controller that is aware of the singularity, or the naive one.

        The bandwidth of the platform is by default 20 rad/s, or less with a long delay.

        Args:
            aware: whether the controller is aware of the singularity.
            loop: its known delay.

        Raises:
            InvalidInput: the robot has springs, or redundant motors.
        """
        robot = reference.robot
        if robot.n_e or robot.n_a != robot.n:
            raise InvalidInput(
                f"controller computed_torque: for rigid robots with as many motors as platform axes; "
                f"{robot.name} has {robot.n_e} springs, {robot.n_a} motors, {robot.n} axes: use feedforward"
            )
        J = scaled_loops(robot, reference.motion.linearised)  # (K, m, nv)
        multipliers = None
        if aware:
            # At the crossing the passive rows P' lambda = r_p do not determine lambda. All rows together,
            # J' lambda = r - S' tau, do so, with the forces r of the open tree, and the planned torque tau on
            # the joint side, without that of rotors
            rotor_torque = robot.rotor_inertia * robot.gear_ratio * reference.motion.a[:, robot.actuated]
            loop_forces = tree_forces(robot, reference.motion)  # (K, nv)
            loop_forces[:, robot.actuated] -= robot.gear_ratio * (reference.torque - rotor_torque)
            inverse = np.linalg.pinv(J.transpose(0, 2, 1))  # (K, m, nv)
            multipliers = np.matvec(inverse, loop_forces * robot.column_scale)
        thresholds = fading_thresholds(J[:, :, robot.following])
        tuning, delay = tuning or Tuning(), 0.0 if loop is None else loop.delay
        default = default_bandwidth(delay, reference.period, PLATFORM_BANDWIDTH)
        bandwidth = tuning.bandwidth or default
        return ComputedTorque(reference, multipliers, thresholds, bandwidth, tuning.integral)

    def start(self, runs: int) -> IntegralRun:
        """Return the controller of R runs at the start of the plan."""
        return IntegralRun(self)

    def error(self, k: int, measurement: Measurement) -> Array:
        """Compute the errors (R, n) [m, rad] of the platform at sampling instant k."""
        state = estimate_state(self.reference, k, measurement, aware=self.multipliers is not None)
        return self.reference.x[k] - state.x

    def torque(self, k: int, measurement: Measurement, offset: Array | float = 0.0) -> Array:
        """Compute motor torques (R, n_a) [N m, N], motor side, at sampling instant k.

        An `offset` (R, n) is added to the errors of x. The torques are infinite where the naive controller
        divides by zero.
        """
        ref = self.reference
        robot = ref.robot
        state = estimate_state(ref, k, measurement, aware=self.multipliers is not None)
        w = self.bandwidth  # critically damped: k_d = 2 w, k_p = w^2
        # the commanded acceleration (R, n) of the platform: planned, plus feedback of errors
        ddx = ref.ddx[k] + 2 * w * (ref.dx[k] - state.dx) + w**2 * (ref.x[k] - state.x + offset)

        motion = _constrained_motion(ref, k, state, ddx)
        r = tree_forces(robot, motion) * robot.column_scale  # (R, nv)
        # J' (R, nv, m), scaled to be dimensionless, with one row for each joint
        J_T = scale_jacobian(robot, motion.loops, robot.loop_lengths).transpose(0, 2, 1)
        P_T = J_T[:, robot.following]
        r_p = r[:, robot.following]

        if self.multipliers is None:  # naive
            multipliers = solve(P_T, r_p)
        else:
            planned = self.multipliers[k]
            multipliers = planned + solve_damped(P_T, r_p - matvec(P_T, planned), self.thresholds)

        # torques behind the gears (R, nv), and those that accelerate the rotors
        torque = (r - matvec(J_T, multipliers)) / robot.column_scale
        rotor_torque = robot.rotor_inertia * robot.gear_ratio * motion.a[:, robot.actuated]
        return rotor_torque + torque[:, robot.actuated] / robot.gear_ratio


@dataclass(eq=False)
class IntegralRun:
    """Feedforward or computed torque with the integrals of the errors of R runs."""

    controller: FeedforwardPD | ComputedTorque
    error_integral: Array | float = 0.0  # (R, n_a) [rad s] of motors, (R, n) [m s, rad s] of the platform

    def torque(self, k: int, measurement: Measurement) -> Array:
        """Compute motor torques (R, n_a) [N m, N], motor side, at sampling instant k."""
        own = self.controller
        if not own.integral:
            return own.torque(k, measurement)
        self.error_integral = self.error_integral + own.reference.period * own.error(k, measurement)
        return own.torque(k, measurement, own.integral * self.error_integral)


class _Motion(NamedTuple):
    """The motions of R runs, with the Jacobian of their loop equations."""

    q: Array  # (R, nq)
    v: Array  # (R, nv)
    a: Array  # (R, nv)
    loops: Array  # (R, m, nv) J
    wrenches: tuple[AppliedWrench, ...]  # external ones at these poses


def _constrained_motion(reference: Reference, k: int, state: RobotState, ddx: Array) -> _Motion:
    """Compute joint rates and accelerations in a `state`, for platform accelerations ddx (R, n).

    The Jacobian X of the platform and J of the loops form F = [X; J]. The rates solve F v = [twist; 0], the
    accelerations F a = [twist rate; 0] - drift. Both are infinite if the platform does not determine the
    joints. The wrenches are those of the plan at instant k.

    Each run is solved by itself. `motion_at` would factorise all runs as one band matrix, so rounding would
    depend on the number of runs.
    """
    robot = reference.robot
    rows = robot.spanning_loops
    columns = robot.moving  # of the joints that move without springs
    frames = frames_at(robot, state.q)
    J = loop_equations(rows, frames).jacobian
    planned = reference.motion.linearised.combination  # (K, R, m), or None if all rows are independent
    sizes = robot.equations.span_scale[:, None]
    if planned is not None:
        scaled = J[:, :, columns] * robot.column_scale[columns] / sizes
        combination = align_bases(scaled, planned[k] * sizes) / sizes
        J = matmul(combination.swapaxes(1, 2), J)
    F = np.concatenate([robot.platform.jacobian(frames), J], axis=1)[:, :, columns]  # (R, n + m, columns)
    twist, twist_rate = robot.platform.twist(state.x, state.dx, ddx)
    v, a = np.zeros((2, len(state.q), robot.nv))
    loop_rates = np.zeros(J.shape[:2])  # (R, m) of closed loops
    v[:, columns] = solve(F, np.concatenate([twist, loop_rates], axis=1))

    motions = frame_motions(robot, frames, v)
    platform_part = twist_rate - robot.platform.drift(motions)
    loop_part = -closure_drift(rows, motions, state.q, v)
    if planned is not None:
        loop_part = matvec(combination.swapaxes(1, 2), loop_part)
    a[:, columns] = solve(F, np.concatenate([platform_part, loop_part], axis=1))

    # path coordinate of the planned wrenches, if any
    s = np.full(len(state.q), reference.law(reference.times[k]) if reference.wrenches.entries else np.nan)
    return _Motion(state.q, v, a, J, reference.wrenches.evaluate(robot, frames, s))
