"""A controller on robots that are not quite as it believes: sampling, delay, noise, saturation, friction."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pinocchio as pin

from framework.arrays import Array
from framework.control.estimation import Controller, Measurement, RobotState
from framework.control.imperfections import DelayLine, MotorFriction
from framework.control.reference import Reference
from framework.control.run_monitor import PERIODS_PER_CHECK, ControlLoop, Run, RunMonitor
from framework.control.variation import Spread, Variation, noise_of, varied
from framework.errors import InvalidInput, NotAssembled
from framework.kinematics.frames import integrate
from framework.kinematics.parallel_robot import ParallelRobot
from framework.linalg.ordered_sums import matvec
from framework.simulation import Stepper
from framework.simulation.world_forces import WorldForces

MAX_JOINT_STEP = 3.0  # [rad, robot lengths] that a joint may move in one sampling period: more is a runaway


def torque_limit(reference: Reference, loop: ControlLoop) -> Array:
    """Return the largest motor torques (n_a,) [N m].

    Raises:
        InvalidInput: a limit that is no torque.
    """
    default = 10 * np.abs(reference.torque).max(axis=0)
    if loop.limit is None:
        motors = reference.robot.description.actuators
        in_file = [motor.torque_limit for motor in motors]
        return np.where([limit is None for limit in in_file], default, np.array(in_file, dtype=float))
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
    """Drive R varied robots along the plan from rest, all starting where the plan starts.

    `record` keeps all torques; `advanced` is called with the share of the motion that is done.

    Raises:
        InvalidInput: the loops of a varied robot do not close; a limit that is no torque.
    """
    ref, limit = controller.reference, torque_limit(controller.reference, loop)
    nominal, last = ref.robot, len(ref.times) - 1
    stepper, *start = _started(controller, variations)
    q, v = start
    world = _world_of(ref, [robot.model for robot in stepper.stack.robots])
    noise = noise_of(nominal, spread, [variation.seed for variation in variations], last + 1)
    friction = MotorFriction.of(controller, variations)
    line = DelayLine.of(controller, variations)
    monitor = RunMonitor.of(len(variations), nominal)
    for k in range(last + 1):
        if k % PERIODS_PER_CHECK == 0 or k == last:
            advanced(k / last)
            x = nominal.platform.unwrap(stepper.platform(q, v)[0], ref.x[k])
            monitor.check(ref.times[k], x, ref.x[k])
        measurement = _measured(
            ref, k, stepper, q, v, noise=None if noise is None else noise[k], sensors=loop.sensors
        )
        with np.errstate(all="ignore"):
            command = controller.torque(k, measurement)
        torque = line.delayed(np.clip(np.nan_to_num(command, nan=0.0), -limit, limit))
        monitor.act(torque, record=record)
        if k == last or not monitor.alive.any():
            break
        force = world(ref.times[k] + 0.5 * ref.period, integrate(nominal, q, 0.5 * ref.period * v))
        q, v = stepper.step(q, v, torque - friction.torque(v), ref.period, world=force)
        # one run without numbers would leave none in stacked solves: runs that are over stand at their start
        slow = np.abs(v) * ref.period < MAX_JOINT_STEP * nominal.column_scale
        monitor.end(ref.times[k + 1], np.asarray(~(np.isfinite(q).all(axis=1) & slow.all(axis=1))))
        running = monitor.alive[:, None]
        q, v = np.where(running, q, start[0]), np.where(running, v, start[1])
    return monitor.verdict(loop, variations)


def _world_of(reference: Reference, models: Sequence[pin.Model]) -> Callable[[float, Array], Array | None]:
    """Return the generalised forces (R, nv) of the world on R robots at t [s] and q (R, nq)."""
    world = WorldForces.of(reference.robot, reference.wrenches, reference.law)
    if not world.acts:
        return lambda t, q: None
    return lambda t, q: world(reference.robot, np.repeat(min(t, reference.times[-1]), len(q)), q, models)


def _started(controller: Controller, variations: Sequence[Variation]) -> tuple[Stepper, Array, Array]:
    """Return the varied robots at rest at the start of the plan, loops closed: q (R, nq), v (R, nv)."""
    ref = controller.reference
    real = [varied(ref.robot, variation) for variation in variations]
    count = len(real)
    try:
        stepper = Stepper.of(real, like=ref.robot)
        torque, start = np.tile(ref.torque[0], (count, 1)), np.tile(ref.motion.q[0], (count, 1))
        world = WorldForces.of(ref.robot, ref.wrenches, ref.law)
        q, v = stepper.start(start, None, torque, world=world)
    except NotAssembled as error:
        raise InvalidInput(f"places: with so large a spread a robot cannot be assembled: {error}") from None
    return stepper, q, v


def _measured(
    ref: Reference, k: int, stepper: Stepper, q: Array, v: Array, *, noise: Array | None, sensors: str
) -> Measurement:
    """Return what the encoders say, `noise` (R, 2, nv) included."""
    robot = ref.robot
    turned = np.zeros_like(v) if noise is None else noise[:, 0]
    rates = v if noise is None else v + noise[:, 1]
    n, motors = robot.gear_ratio, robot.actuated
    angle, speed = n * (joint_angle(robot, q) + turned[:, motors]), n * rates[:, motors]
    if sensors == "motors":
        return Measurement(angle, speed, None)
    from_joints = np.linalg.pinv(ref.N[k])  # (n, nv)
    x = robot.platform.unwrap(stepper.platform(q, v)[0], ref.x[k]) + matvec(from_joints, turned)
    dx = ref.dx[k] + matvec(from_joints, rates - ref.motion.v[k])
    return Measurement(angle, speed, RobotState(integrate(robot, q, turned), rates, x, dx))


def joint_angle(robot: ParallelRobot, q: Array) -> Array:
    """Return the positions (R, n_a) of the actuated joints [rad, m]."""
    columns = [robot.model.joints[robot.model.getJointId(name)].idx_q for name in robot.actuator_names]
    return np.asarray(q[:, columns])
