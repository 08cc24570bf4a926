"""Time-varying LQR and LQG on the linear model of a plan, for rigid and elastic robots, with a known delay.

The dynamics about the plan are regular at Type 2 (`linear_model`). The motors do not control one direction
for an instant there; the Riccati equation takes this into account: the gains before and after the crossing
correct the errors in that direction. After Bordalba, Ros and Porta, A Singularity-Robust LQR Controller for
Parallel Robots, IROS 2018.

`lqr` measures the whole state. `lqg` estimates it, and disturbances theta with it, by a Kalman filter from
the sensors that it has. As theta is in the model, the gains contain the feedforward against it, with
foresight over the crossing. A known delay is not noise: the state is predicted with the torques that are on
their way.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from framework.control.controllers import Measurement, estimate_state
from framework.control.deviation import Feedback, Observer, Plant
from framework.control.linear_model import LinearModel, linearise_plan
from framework.control.reference import Reference
from framework.control.sensors import (
    IMU_NOISE,
    LEAST_NOISE,
    PLATFORM_NOISE,
    STATE,
    ControlLoop,
    LoopSensors,
    sensors_of,
)
from framework.control.variations import Spread
from framework.errors import InvalidInput
from framework.kinematics.frames import difference
from framework.numerics.arrays import Array
from framework.numerics.ordered_sums import matvec
from framework.tolerances import RANK_ROUNDING

UNIFORM = 1 / np.sqrt(3)  # standard deviation of a uniform distribution over its largest deviation
GRAVITY_DEVIATION = 0.1  # [m/s^2] along each axis: a base that stands off by half a degree


@dataclass(frozen=True)
class Weights:
    """Deviations of equal cost, and what the model leaves out.

    The numbers were chosen on one upright five-bar with elastic drives and rods, 1 ms of delay, and served on
    ten others; `LinearModels.tune_lqg` multiplies them where another robot or spread needs it.
    """

    # under half of the tolerance of runs, 2.5e-3; a speed that covers it in 50 ms costs as much
    position: float = 1e-3  # [robot lengths, rad] of the platform
    speed: float = 2e-2  # [robot lengths/s, rad/s]
    # share of each motor's peak torque in the plan: at 1 the torque of the noise grows, at 0.1 the error
    torque: float = 0.3
    # standard deviations of what the Kalman filter does not model. A payload wrong by 10 %, uniform, is worth
    # 0.06 of the acceleration: half of this is left when it is estimated
    acceleration: float = 0.03  # of the platform, share of gravity and of the plan's largest acceleration
    motor_torque: float = 0.05  # share of each motor's peak torque, as dry friction in the studies
    correlation: float = 0.02  # [s] time over which both persist, in which motions of 8 Hz change
    # of encoders behind springs, share of the largest deflection: that by which springs are wrong in the
    # studies. An encoder that is trusted to its last bit breaks the filter: it reads unmodelled deflections
    deflection: float = 0.2

    def with_noise(self, factor: float) -> Weights:
        """Return the weights with more noise of accelerations and motor torques."""
        return replace(self, acceleration=factor * self.acceleration, motor_torque=factor * self.motor_torque)


@dataclass(frozen=True, eq=False)
class Regulator:
    """tau = tau_plan - gain z, of the deviations z (N,) that an observer estimates from readings."""

    reference: Reference
    model: LinearModel
    gain: Array  # (K, n_a, N)
    delay: int  # [periods] known, from measurement to torque
    observer: Observer
    sensors: LoopSensors | None  # that are read; None: h and h', which are measured

    @property
    def feedback(self) -> Feedback:
        """The torques by z, observed."""
        return Feedback(self.gain, self.delay, self.observer)

    def start(self, runs: int) -> RegulatorRun:
        """Return the controller of R runs at the start of the plan."""
        return RegulatorRun(self, np.zeros((runs, self.gain.shape[2])), [])

    def torque(self, k: int, measurement: Measurement) -> Array:
        """Compute motor torques (R, n_a) [N m, N] of runs that have followed the plan up to instant k."""
        run = self.start(len(measurement.motor_angle))
        planned = self.reference.period_torque
        run.sent = [planned[min(j + self.delay, len(planned) - 1)] for j in range(k)]
        return run.torque(k, measurement)


@dataclass(eq=False)
class RegulatorRun:
    """A regulator with the state of R runs."""

    regulator: Regulator
    z: Array  # (R, N) deviations at the last instant
    sent: list[Array]  # (R, n_a) torques sent at all instants so far

    @property
    def reference(self) -> Reference:
        """The planned motion."""
        return self.regulator.reference

    def torque(self, k: int, measurement: Measurement) -> Array:
        """Compute motor torques (R, n_a) [N m, N], motor side, at sampling instant k."""
        own = self.regulator
        ref, columns = own.reference, own.model.columns
        F, G, C, D = own.observer.plant
        planned = ref.period_torque
        readings = measurement.readings
        if own.sensors is None:  # h and h' (R, 2m), less the planned ones, are measured
            state, motion = estimate_state(ref, k, measurement, aware=True), ref.motion
            joints = difference(ref.robot, motion.q[[k]], state.q)[:, columns]
            rates = (state.v - motion.v[k])[:, columns]
            readings = np.concatenate([state.x - ref.x[k], joints, state.dx - ref.dx[k], rates], axis=1)
        if readings is None:
            raise InvalidInput("lqg: needs the readings of its sensors in the measurement")
        z, expected = self.z, matvec(C[k], self.z)
        if self.sent:
            if measurement.command is not None:
                self.sent[-1] = measurement.command  # limited
            acting = self._deviation(k - 1)
            z = matvec(F[k - 1], z) + matvec(G[k - 1], acting)
            # deflections are in static balance with the torque of the last period
            expected = matvec(C[k], z) + matvec(D[k], acting)
        self.z = z = z + matvec(own.observer.gain[k], readings - expected)

        # predict through the periods whose torques have been sent
        target = min(k + own.delay, len(planned) - 1)
        for j in range(k, target):
            z = matvec(F[j], z)
            if self.sent:
                z = z + matvec(G[j], self._deviation(j))
        command = planned[target] - matvec(own.gain[target], z)
        self.sent.append(command)
        return command

    def _deviation(self, k: int) -> Array:
        """Return the torque (R, n_a) that acts in the period after instant k, less the planned one."""
        return self.sent[max(k - self.regulator.delay, 0)] - self.reference.period_torque[k]


# ------------------------------------------------------------------ gains


def tune_lqr(
    reference: Reference, *, loop: ControlLoop | None = None, weights: Weights | None = None
) -> Regulator:
    """Compute the time-varying gains of least quadratic cost, for a measured state.

    Raises:
        InvalidInput: the robot has springs, and its state is not measured.
    """
    loop, weights = loop or ControlLoop(), weights or Weights()
    robot = reference.robot
    if robot.n_e and not sensors_of(robot, loop).state:
        raise InvalidInput(
            f"controller lqr: without the sensor {STATE} for rigid robots; {robot.name} has the springs "
            f"{', '.join(robot.elastic_names)}: use lqg, or feedforward"
        )
    model = linearise_plan(reference)
    plant = plant_with_readings(model, None, reference)
    exact = Observer(plant, np.ascontiguousarray(plant.C.swapaxes(1, 2)), np.zeros(2 * model.m))
    gain = regulator_gains(reference, model, weights)
    return Regulator(reference, model, gain, loop.delayed_periods(reference.period), exact, None)


def disturbances_of(spread: Spread) -> tuple[str, ...]:
    """Return the kinds of disturbances that a spread of robots has."""
    sizes = {"payload": spread.payload, "friction": spread.friction, "springs": spread.stiffness}
    return tuple(kind for kind, size in sizes.items() if size)


def prior_starts(reference: Reference, model: LinearModel, spread: Spread) -> Array:
    """Return independent starts S (N, c) of z = (h, h', theta), so that z z' is S S' in the mean.

    Dry friction is uniform from 0, so its mean is common to all motors: a start of its own. Friction of each
    motor about zero instead would leave out that all motors are late together.
    """
    robot, length = reference.robot, reference.robot.platform_scale
    columns = robot.column_scale[model.columns]
    sizes = {
        "payload": spread.payload * UNIFORM,
        "friction": spread.friction * UNIFORM / 2,
        "spring": spread.stiffness * UNIFORM,
        "gravity": GRAVITY_DEVIATION,
        "torque": 0.05,  # share of the peaks
    }
    kinds = [name.split()[0] for name in model.names]
    theta = [sizes[kind] for kind in kinds]
    # robots begin at rest on the plan: small errors, with which the filter starts regular
    independent = np.concatenate([2e-4 * length, 1e-3 * columns, 1e-4 * length, 1e-3 * columns, theta])
    common = np.zeros_like(independent)
    common[2 * model.m :] = [spread.friction / 2 if kind == "friction" else 0.0 for kind in kinds]
    return np.column_stack([np.diag(independent), common])


def regulator_gains(reference: Reference, model: LinearModel, weights: Weights) -> Array:
    """Compute the gains (K, n_a, N) of least quadratic cost.

    The cost is the sum of z' Q z + u' R u for deviations z and torque corrections u. The weights are
    diagonal: 1 / deviation^2 for positions and speeds of the platform, and for torques.
    """
    n, m = reference.robot.n, model.m
    Q = np.zeros((model.A.shape[1],) * 2)
    scale = reference.robot.platform_scale
    platform = np.arange(n)
    Q[platform, platform] = 1 / (weights.position * scale) ** 2
    Q[m + platform, m + platform] = 1 / (weights.speed * scale) ** 2
    peak = np.maximum(reference.peak_torque, RANK_ROUNDING * reference.peak_torque.max())
    R = np.diag(1 / (weights.torque * peak) ** 2)
    return solve_riccati(model.F, model.G, Q, R)


def solve_riccati(F: Array, G: Array, Q: Array, R: Array) -> Array:
    """Solve the discrete Riccati equation backwards in time for gains (K, n_a, N).

    Args:
        F, G: (K, N, N) and (K, N, n_a) of z_(k+1) = F_k z_k + G_k u_k.
        Q, R: (N, N) and (n_a, n_a) weights of deviations and torque corrections.

    For the cost-to-go z' P z after a period the gain is L = (R + G' P G)^-1 G' P F. The cost-to-go before the
    period has the matrix Q + L' R L + (F - G L)' P (F - G L).
    """
    gain = np.empty((len(G), *G.shape[:0:-1]))
    P = Q  # cost-to-go at the end of the motion
    for k in reversed(range(len(G))):
        PG = P @ G[k]  # P is symmetric, so G' P F = (P G)' F
        gain[k] = np.linalg.solve(R + G[k].T @ PG, PG.T @ F[k])
        closed_loop = F[k] - G[k] @ gain[k]
        P = Q + gain[k].T @ R @ gain[k] + closed_loop.T @ P @ closed_loop
    return gain


def tune_filter(
    reference: Reference,
    model: LinearModel,
    plant: Plant,
    sensors: LoopSensors,
    spread: Spread,
    weights: Weights,
    prior: Array,
) -> Observer:
    """Compute the Kalman filter of a plant that sensors read.

    Args:
        prior: independent starts (N, c) of z, see `prior_starts`.
    """
    robot, period = reference.robot, reference.period
    F, C = plant.F, plant.C
    deviation, trust = _reading_deviations(reference, sensors, spread)
    R = deviation**2 + (weights.deflection * trust) ** 2

    # accelerations that the model leaves out, over one period
    n, m = robot.n, model.m
    persistence = np.sqrt(weights.correlation * period)
    gravity = np.linalg.norm(robot.model.gravity.linear) * robot.platform_scale / robot.length  # (n,)
    largest = gravity + np.abs(reference.ddx).max(axis=0)
    noise = np.zeros((len(C), 2 * m))
    noise[:, m : m + n] = weights.acceleration * largest * persistence
    by_torque = np.abs(model.B[:, m + n : 2 * m]) @ reference.peak_torque
    noise[:, m + n :] = weights.motor_torque * persistence * by_torque

    gain = np.empty(C.swapaxes(1, 2).shape)
    P = prior @ prior.T
    states = np.arange(2 * m)
    for k in range(len(C)):
        PC = P @ C[k].T
        gain[k] = np.linalg.solve(C[k] @ PC + np.diag(R), PC.T).T
        rest = np.eye(len(P)) - gain[k] @ C[k]
        P = rest @ P @ rest.T + gain[k] * R @ gain[k].T  # Joseph's form stays positive
        P = F[k] @ P @ F[k].T
        P[states, states] += noise[k] ** 2
    return Observer(plant, gain, deviation)


def plant_with_readings(model: LinearModel, sensors: LoopSensors | None, reference: Reference) -> Plant:
    """Return the linear model in discrete time, with readings y = C z + D tau.

    Encoders behind springs read deflections in static balance with z and tau. Without sensors the readings
    are h and h'.
    """
    count, N, n_a = model.G.shape
    m, n, period = model.m, reference.robot.n, reference.period

    def first(size: int) -> tuple[Array, Array]:
        """Return C and D of the first states."""
        return np.broadcast_to(np.eye(size, N), (count, size, N)), np.zeros((count, size, n_a))

    if sensors is None:
        return Plant(model.F, model.G, *first(2 * m))
    S = sensors.S
    rows = [(S @ model.joints, S @ model.joints_by_torque)]
    if sensors.platform:
        rows.append(first(n))
    if sensors.imu:  # mean of the last period, (dx_k - dx_(k-1)) / T with z_(k-1) = F^-1 (z_k - G tau)
        inverse = np.linalg.inv(model.F[:-1])
        C, D = np.zeros((count, n, N)), np.zeros((count, n, n_a))
        C[1:] = (np.eye(N) - inverse)[:, m : m + n] / period
        D[1:] = (inverse @ model.G[:-1])[:, m : m + n] / period
        rows.append((C, D))
    C, D = (np.concatenate(part, axis=1) for part in zip(*rows, strict=True))
    return Plant(model.F, model.G, C, D)


def _reading_deviations(reference: Reference, sensors: LoopSensors, spread: Spread) -> tuple[Array, Array]:
    """Compute two standard deviations (s,) of readings: of the noise, and of the deflection behind them."""
    robot = reference.robot
    deflected = (
        np.abs(robot.coordinates.positions(reference.motion.q)[:, robot.elastic])
        / robot.column_scale[robot.elastic]
    )
    behind = np.where(np.isin(sensors.columns, robot.actuated), 0.0, deflected.max(initial=0.0))
    scale = robot.column_scale[sensors.columns]  # (s,) unit of the noise
    noise = [np.hypot(sensors.step / np.sqrt(12), np.maximum(spread.noise, LEAST_NOISE) * scale)]
    trust = [behind * scale]
    if sensors.platform:
        noise.append(np.maximum(spread.noise, PLATFORM_NOISE) * robot.platform_scale)
        trust.append(np.zeros(robot.n))
    if sensors.imu:
        noise.append(np.full(robot.n, IMU_NOISE))
        trust.append(np.full(robot.n, 10 * IMU_NOISE))
    return np.concatenate(noise), np.concatenate(trust)
