"""Controllers by name, with the planned motion, the measurements and the state estimates that they use.

With encoders only on the motors, the platform coordinates follow from the motor angles by the inverse of G =
d(motor angles)/dx. Like A, G is singular at Type 2. The naive estimate amplifies noise without bound there.
The aware estimate takes the planned values in the directions that the motors do not determine.

Feedforward: planned torques with proportional and derivative feedback at each motor. The planned torque is
finite at the crossing, and the feedback does not invert A. So the controller works at a singularity without
change.

Time-varying LQR on the manifold of closed loops: the dynamics are linearised along the plan in platform
coordinates, in which they are regular at Type 2. G loses rank there, so that the motors do not control one
direction for an instant. The Riccati equation takes this into account: the gains before and after the
crossing correct the errors in that direction. After Bordalba, Ros and Porta, A Singularity-Robust LQR
Controller for Parallel Robots, IROS 2018.

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

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from framework.dynamics.forces import tree_forces
from framework.dynamics.forward_dynamics import forward_derivatives
from framework.dynamics.motor_limits import motor_limits
from framework.dynamics.open_loop import MotorControl
from framework.dynamics.pointwise_dynamics import motor_inertia
from framework.errors import InvalidInput, check_choice
from framework.kinematics.closures import closure_drift, loop_equations, scale_jacobian
from framework.kinematics.external_wrenches import AppliedWrench, ExternalWrenches
from framework.kinematics.frames import frame_motions, frames_at, integrate
from framework.kinematics.linearised_loops import scaled_loops
from framework.kinematics.loop_ranges import align_bases
from framework.kinematics.motion_rates import Motion, joint_rates
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.law import MotionLaw
from framework.numerics.arrays import Array, ReadOnlyArrays
from framework.numerics.ordered_sums import matmul, matvec, solve
from framework.planning.result import CrossingPlan
from framework.tolerances import SAME_PLACE

# ------------------------------------------------------------------ the planned motion


MAX_SAMPLES = 200_000  # of a planned motion


@dataclass(frozen=True, eq=False)
class Reference(ReadOnlyArrays):
    """The planned motion at the K sampling instants k * `period`."""

    robot: ParallelRobot  # the controller's model
    period: float  # [s]
    times: Array  # (K,) [s]
    motion: Motion  # q (K, nq), v, a (K, nv)
    x: Array  # (K, n) platform coordinates [m, rad]
    dx: Array  # (K, n) their rates
    ddx: Array  # (K, n) their accelerations
    torque: Array  # (K, n_a) [N m; N of motors of slides], motor side, without dry friction
    torque_limit: Array  # (n_a,) limits that the plan was made for, motor side; infinite without
    period_torque: Array  # (K, n_a) torque half a period after each instant, to be constant over the period
    motor_angle: Array  # (K, n_a) [rad, m], motor side
    motor_speed: Array  # (K, n_a) [rad/s, m/s], motor side
    N: Array  # (K, nv, n) dq/dx at constant deflections of the springs
    law: MotionLaw  # path parameter over time
    wrenches: ExternalWrenches  # external wrenches, as planned

    @cached_property
    def motor_maps(self) -> Array:
        """Motor angles per robot length or radian of the platform, (K, n_a, n), motor side."""
        robot = self.robot
        return robot.gear_ratio[:, None] * self.N[:, robot.actuated] * robot.platform_scale

    @cached_property
    def motor_thresholds(self) -> Array:
        """Singular values (n,) below which the motors do not determine the platform."""
        return fading_thresholds(self.motor_maps)

    @property
    def planned_wrenches(self) -> dict[str, Array]:
        """External wrenches (K, 6) along the planned motion, on base axes, by frame."""
        frames = self.motion.linearised.frames
        return self.wrenches.evaluate_on_base_axes(self.robot, frames, np.asarray(self.law(self.times)))


def reference_of(plan: CrossingPlan, *, period: float) -> Reference:
    """Sample the plan every `period` seconds.

    Raises:
        InvalidInput: the period is not positive, longer than a tenth of the motion, or so short that
            there would be more than 200000 samples.
    """
    shortest = plan.duration / MAX_SAMPLES
    longest = plan.duration / 10
    if not (np.isfinite(period) and shortest < period <= longest):
        raise InvalidInput(
            f"period: must lie in ({shortest:g}, {longest:g}] s for a motion of {plan.duration:g} s, "
            f"got {period!r}"
        )

    robot = plan.robot
    dynamics = plan.dynamics
    # rounding must not lose the instant at the end
    count = int(np.floor(plan.duration / period * (1 + SAME_PLACE))) + 1
    times = np.minimum(period * np.arange(count), plan.duration)
    middles = np.minimum(times + period / 2, plan.duration)  # of the sampling periods
    motion = dynamics.motion(times)
    x = plan.platform(times)  # (K, n)
    return Reference(
        robot=robot,
        period=period,
        times=times,
        motion=motion,
        x=x,
        dx=plan.platform(times, order=1),
        ddx=plan.platform(times, order=2),
        torque=dynamics.torques(times),
        torque_limit=motor_limits(robot, "torque_limit", plan.request.torque_limit),
        period_torque=dynamics.torques(middles),
        motor_angle=plan.motor_angle(times),
        motor_speed=plan.motor_angle(times, order=1),
        N=joint_rates_by_platform(robot, motion, x),
        law=plan.law,
        wrenches=dynamics.wrenches,
    )


def joint_rates_by_platform(robot: ParallelRobot, motion: Motion, x: Array) -> Array:
    """Compute N = dq/dx (T, nv, n) at x (T, n) along a motion, at constant deflections."""
    twists = np.moveaxis(robot.platform.rate_matrix(x), 2, 0)  # (n, T, n) one twist for each unit rate of x
    no_deflection_rates = np.zeros((len(x), robot.n_e))
    rates = joint_rates(robot, motion.linearised, twists, no_deflection_rates)  # (n, T, nv)
    return np.moveaxis(rates, 0, 2)


# ------------------------------------------------------------------ controllers


class RobotState(NamedTuple):
    """Configuration and platform of R runs with their rates, measured or estimated."""

    q: Array  # (R, nq)
    v: Array  # (R, nv) joint rates
    x: Array  # (R, n) platform coordinates [m, rad]
    dx: Array  # (R, n) their rates


class Measurement(NamedTuple):
    """The readings of the encoders of R runs."""

    motor_angle: Array  # (R, n_a) [rad, m], motor side
    motor_speed: Array  # (R, n_a) [rad/s, m/s], motor side
    state: RobotState | None  # None with encoders only on the motors


class Controller(Protocol):
    """A controller for one reference, without internal state."""

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


def fading_thresholds(matrices: Array, *, fading_ratio: float = 0.25) -> Array:
    """Return a share of the largest singular values (k,) along a plan, for `solve_damped`.

    A singular value is small beside a Type 2 singularity, where it is small against its own values elsewhere
    on the plan. It may be small against the other singular values in every pose: a light leg, a short lever.

    Args:
        matrices: (K, m, k) along the plan, m >= k.
    """
    return fading_ratio * np.linalg.svd(matrices, compute_uv=False).max(axis=0)


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

    @staticmethod
    def tune(
        reference: Reference,
        *,
        frequency: float = 40.0,  # [rad/s] natural, of each motor
        # share of the damping that stops a rotor within one sampling period; a share of 2 is unstable
        max_sampled_damping: float = 0.5,
    ) -> FeedforwardPD:
        """Tune each motor to a natural frequency, critically damped.

        The inertia is that of a motor moving alone at the start of the motion. If the robot has springs, a
        fast motion of a motor moves only its rotor. Then the frequency w is lowered so far that the damping
        gain k_d = 2 w inertia is at most `max_sampled_damping` times rotor inertia over sampling period.
        """
        robot = reference.robot
        inertia = motor_inertia(robot, reference.motion.q[0])
        w = np.full(robot.n_a, frequency)
        if robot.n_e and robot.rotor_inertia.all():
            highest = max_sampled_damping * robot.rotor_inertia / (2 * inertia * reference.period)
            w = np.minimum(w, highest)
        return FeedforwardPD(reference, MotorControl.of(inertia, w))

    def torque(self, k: int, measurement: Measurement) -> Array:
        """Compute motor torques (R, n_a) [N m, N], motor side, at sampling instant k.

        They are the planned torques plus feedback of the errors of the measured motor angles and speeds.
        """
        ref = self.reference
        angle_error = ref.motor_angle[k] - measurement.motor_angle
        speed_error = ref.motor_speed[k] - measurement.motor_speed
        return ref.period_torque[k] + self.feedback.torque(angle_error, speed_error)


# ------------------------------------------------------------------ linear-quadratic regulator


@dataclass(frozen=True, eq=False)
class TimeVaryingLQR:
    """tau = tau_plan + gain [x error; dx error]."""

    reference: Reference
    gain: Array  # (K, n_a, 2n)

    @staticmethod
    def tune(
        reference: Reference,
        *,
        position_deviation: float = 1e-3,  # [robot lengths]
        speed_deviation: float = 2e-2,  # [robot lengths/s]
    ) -> TimeVaryingLQR:
        """Compute the gains of least quadratic cost.

        The cost is the integral of e' Q e + u' R u for errors e = [x error; dx error] and torque corrections
        u. The weights are diagonal: 1 / `position_deviation`^2 for positions, 1 / `speed_deviation`^2 for
        speeds and 1 / (peak torque of the plan)^2 for torques.

        Raises:
            InvalidInput: the robot has springs.
        """
        robot = reference.robot
        if robot.n_e:
            raise InvalidInput(
                f"controller lqr: for rigid robots; {robot.name} has the springs "
                f"{', '.join(robot.elastic_names)}: use feedforward"
            )
        # (2, n) deviations of equal cost, of positions and of speeds, in the units of each coordinate
        deviations = np.outer([position_deviation, speed_deviation], robot.platform_scale)
        Q = np.diag(1 / deviations.ravel() ** 2)
        R = np.eye(robot.n_a) / np.abs(reference.torque).max() ** 2
        A, B = linearise_error(reference)  # of the error dynamics
        return TimeVaryingLQR(reference, solve_riccati(A, B, Q, R, reference.period))

    def torque(self, k: int, measurement: Measurement) -> Array:
        """Compute motor torques (R, n_a) [N m, N], motor side, at sampling instant k.

        They are the planned torques plus the gain of the instant times the errors of the platform.
        """
        ref = self.reference
        state = estimate_state(ref, k, measurement, aware=True)
        error = np.concatenate([ref.x[k] - state.x, ref.dx[k] - state.dx], axis=1)
        return ref.period_torque[k] + matvec(self.gain[k], error)


def linearise_error(reference: Reference) -> tuple[Array, Array]:
    """Compute A (K, 2n, 2n), B (K, 2n, n_a) of the error dynamics along the plan.

    With the deviations e = [x; dx] and tau from the planned motion, de/dt = A e + B tau, where
    A = [[0, 1], [d(ddx)/dx, d(ddx)/d(dx)]] and B = [[0], [d(ddx)/dtau]].
    """
    slopes = forward_derivatives(
        reference.robot,
        reference.motion.q,
        reference.motion.v,
        reference.torque,
        wrenches=reference.planned_wrenches,
        turning=[entry.frame for entry in reference.wrenches.entries if entry.turns],
    )
    by_x = slopes.acceleration_y  # (K, n, n)
    by_torque = slopes.acceleration_torque  # (K, n, n_a)
    identity = np.broadcast_to(np.eye(reference.robot.n), by_x.shape)
    A = np.block([[np.zeros_like(by_x), identity], [by_x, slopes.acceleration_dy]])
    return A, np.concatenate([np.zeros_like(by_torque), by_torque], axis=1)


def solve_riccati(A: Array, B: Array, Q: Array, R: Array, period: float) -> Array:
    """Solve the discrete Riccati equation backwards in time for gains (K, n_a, 2n).

    Args:
        A, B: (K, 2n, 2n) and (K, 2n, n_a) of the error dynamics de/dt = A e + B tau.
        Q, R: (2n, 2n) and (n_a, n_a) weights of errors and torque corrections.
        period: sampling period h [s].

    With constant torques over a period h, e_(k+1) = F e_k + G tau_k and [F, G; 0, 1] = exp([A, B; 0, 0] h).
    For the cost-to-go e' P e after a period the gain is L = (R + G' P G)^-1 G' P F. The cost-to-go before the
    period has the matrix Q + L' R L + (F - G L)' P (F - G L).
    """
    from scipy.linalg import expm

    count, states, inputs = B.shape  # K, 2n, n_a
    generator = np.zeros((count, states + inputs, states + inputs))  # [A, B; 0, 0] h
    generator[:, :states] = np.concatenate([A, B], axis=2) * period
    transition = expm(generator)
    F = transition[:, :states, :states]
    G = transition[:, :states, states:]
    gain = np.empty((count, inputs, states))
    P = Q  # cost-to-go at the end of the motion
    for k in reversed(range(count)):
        PG = P @ G[k]  # P is symmetric, so G' P F = (P G)' F
        gain[k] = np.linalg.solve(R + G[k].T @ PG, PG.T @ F[k])
        closed_loop = F[k] - G[k] @ gain[k]
        P = Q + gain[k].T @ R @ gain[k] + closed_loop.T @ P @ closed_loop
    return gain


# ------------------------------------------------------------------ computed torque


@dataclass(frozen=True, eq=False)
class ComputedTorque:
    """Computed torque in platform coordinates, naive or aware of the singularity."""

    reference: Reference
    multipliers: Array | None  # (K, m) of the plan, for the aware controller; None for the naive one
    thresholds: Array  # (n_p,) singular values of P below which the aware controller does not invert P
    frequency: float = 20.0  # [rad/s] natural, of the platform, critically damped

    @staticmethod
    def tune(reference: Reference, *, aware: bool) -> ComputedTorque:
        """Return the controller that is aware of the singularity, or the naive one.

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
        multipliers = _planned_multipliers(reference, J) if aware else None
        return ComputedTorque(reference, multipliers, fading_thresholds(J[:, :, robot.following]))

    def torque(self, k: int, measurement: Measurement) -> Array:
        """Compute motor torques (R, n_a) [N m, N], motor side, at sampling instant k.

        They are infinite where the naive controller divides by zero. The open tree needs the generalised
        forces r. Its passive joints (p) determine the multipliers lambda of the loops by P' lambda = r_p. The
        motors (a) then need tau = r_a - J_a' lambda on the joint side.
        """
        ref = self.reference
        robot = ref.robot
        state = estimate_state(ref, k, measurement, aware=self.multipliers is not None)
        w = self.frequency  # critically damped: k_d = 2 w, k_p = w^2
        # the commanded acceleration (R, n) of the platform: planned, plus feedback of errors
        ddx = ref.ddx[k] + 2 * w * (ref.dx[k] - state.dx) + w**2 * (ref.x[k] - state.x)

        motion = _constrained_motion(ref, k, state, ddx)
        r = tree_forces(robot, motion) * robot.column_scale  # (R, nv)
        # J' (R, nv, m), scaled to be dimensionless, with one row for each joint
        J_T = scale_jacobian(robot, motion.loops, robot.loop_rotation).transpose(0, 2, 1)
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

    s = np.full(len(state.q), reference.law(reference.times[k]))  # path parameter of the planned wrenches
    return _Motion(state.q, v, a, J, reference.wrenches.evaluate(robot, frames, s))


def _planned_multipliers(reference: Reference, J: Array) -> Array:
    """Compute the multipliers lambda (K, m) of the scaled loop rows J (K, m, nv) along the plan.

    At the crossing the passive rows P' lambda = r_p do not determine lambda. All rows together,
    J' lambda = r - S' tau, do so, where r are the forces of the open tree, tau is the planned torque on the
    joint side, without the torque that accelerates rotors, and S selects the motors.
    """
    robot = reference.robot
    motion = reference.motion
    rotor_torque = robot.rotor_inertia * robot.gear_ratio * motion.a[:, robot.actuated]
    loop_forces = tree_forces(robot, motion)  # r (K, nv), from which S' tau is subtracted
    loop_forces[:, robot.actuated] -= robot.gear_ratio * (reference.torque - rotor_torque)
    inverse = np.linalg.pinv(J.transpose(0, 2, 1))  # (K, m, nv)
    return np.matvec(inverse, loop_forces * robot.column_scale)


# ------------------------------------------------------------------ all by name


CONTROLLERS: Mapping[str, Callable[[Reference], Controller]] = {
    "feedforward": FeedforwardPD.tune,
    "lqr": TimeVaryingLQR.tune,
    "computed_torque": lambda reference: ComputedTorque.tune(reference, aware=True),
    "naive_computed_torque": lambda reference: ComputedTorque.tune(reference, aware=False),
}


def tuned_controller(name: str, reference: Reference) -> Controller:
    """Return the controller of a name, with its default gains.

    Raises:
        InvalidInput: unknown name, or a robot that the controller cannot drive.
    """
    check_choice("controller", name, CONTROLLERS)
    return CONTROLLERS[name](reference)
