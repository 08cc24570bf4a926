"""From recorded samples to the motion of all joints: filtered, differentiated, loops closed.

Angles, platform and torques pass the same filter without delay (scipy: a Butterworth filter of order 4,
forwards and backwards), derivatives are those of splines of degree 5 through what is left (scipy, too). Kept
are instants half a period of the cutoff apart, whose noise is then nearly independent, away from the ends of
the recording. The signs of the motors' speeds, on which dry friction depends, pass the filter as the torques
do.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from framework.arrays import Array, IntArray
from framework.errors import InvalidInput, NotAssembled, Type2Singularity, point
from framework.identification.recording import Recording, uniform_period
from framework.kinematics.continuation.pose_stack import follow_motors
from framework.kinematics.continuation.tracking import assemble
from framework.kinematics.inverse_kinematics import close_loops, require_square
from framework.kinematics.linearised_loops import ClosedStack, LinearisedLoops, linearised_at
from framework.kinematics.loop_matrices import clearance
from framework.kinematics.motion_rates import Motion, freeze_deflections, joint_rates, motion_at
from framework.kinematics.parallel_robot import ParallelRobot
from framework.linalg.rotations import whole_turns
from framework.tolerances import MAX_MOTOR_MISFIT

ORDER, SPLINE_DEGREE = 4, 5  # of the filter, of the splines
MIN_INSTANTS = 8
MIN_SAMPLES = 64
SIGNAL_TO_NOISE = 10.0  # of spectra: where a signal ends
SMOOTHING_BINS = 9  # of a spectrum
MAX_CUTOFF = 0.4  # of the sampling rate: half of it is the limit of any sampling
MIN_PERIODS = 8  # of the cutoff in a recording
END_PERIODS = 1.0  # of the cutoff, at either end, that are left out


@dataclass(frozen=True, eq=False)
class MeasuredMotion:
    """A recorded motion at instants whose noise is nearly independent, with measured torques."""

    source: str  # of the poses: motors or platform
    cutoff: float  # [Hz] of the filter
    times: Array  # (T,)
    motion: Motion
    signs: Array  # (T, n_a) of the motors' speeds, filtered
    torque: Array  # (T, n_a) filtered, motor side
    torque_noise: Array  # (n_a,) standard deviation of what noise is left in it
    motor_misfit: float  # [rad, robot lengths] of poses by the platform to the motors' joints; 0 by motors


def measured_motion(
    robot: ParallelRobot,
    data: Recording,
    *,
    cutoff: float | None = None,
    poses: str | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> MeasuredMotion:
    """Compute the motion of all joints that was recorded.

    Args:
        cutoff: of the filter [Hz]; by default where the spectra of the angles meet their noise.
        poses: what they come from: "motors", or "platform" (all its coordinates measured), which passes Type
            2 singularities; by default motors, unless they lead to one.
        progress: called with the number of poses that the motors have led to.

    Raises:
        InvalidInput: columns that are missing, too few samples, unequal time steps, a cutoff out of range,
            torques that are zero throughout, a platform that contradicts the motors.
        NotAssembled: the loops do not close on the way; Type2Singularity of motors.
    """
    require_square(robot)
    period = uniform_period(data)
    if len(data) < MIN_SAMPLES:
        raise InvalidInput(f"{data.source}: {len(data)} samples; at least {MIN_SAMPLES} are needed")
    joints = _from_reference(robot, data.columns("motor_angle", robot.actuator_names) / robot.gear_ratio)
    torque = data.columns("torque", robot.actuator_names)
    for joint, column in zip(robot.actuator_names, torque.T, strict=True):
        if not column.any():
            raise InvalidInput(
                f"{data.source}: torque_{joint} is zero at all samples; measured torques are needed"
            )
    complete = data.has("platform", robot.axis_names)
    least, most = MIN_PERIODS / (len(data) * period), MAX_CUTOFF / period
    if cutoff is None:
        cutoff = _cutoff(data, joints, period, least, most)
    elif not least <= cutoff <= most:
        raise InvalidInput(f"cutoff: needs {least:.3g} to {most:.3g} Hz for these data, got {cutoff:g}")
    margin = int(np.ceil(END_PERIODS / (cutoff * period)))
    angles = _with_derivatives(joints, period, cutoff)
    kept = np.arange(margin, len(data) - margin, max(round(0.5 / (cutoff * period)), 1))
    if len(kept) < MIN_INSTANTS:
        raise InvalidInput(
            f"{data.source}: {len(kept)} instants are left between the ends, at least "
            f"{MIN_INSTANTS} are needed: record longer, or give a cutoff above {cutoff:.3g} Hz"
        )
    smooth = _filtered(torque, period, cutoff)
    noise = np.std(torque - smooth, axis=0) * np.sqrt(2.0 * cutoff * period)
    if poses not in (None, "motors", "platform"):
        raise InvalidInput(f"poses: needs motors or platform, got {poses!r}")
    source, motion, misfit = "motors", None, 0.0
    if poses != "platform":
        try:
            motion = _by_motors(robot, [rows[kept] for rows in angles], progress)
        except NotAssembled:
            if poses == "motors" or not complete:
                raise
    if motion is None:
        x = data.columns("platform", robot.axis_names)
        source, motion = "platform", _by_platform(robot, x, period, cutoff, kept)
        misfit = _motor_misfit(robot, data.source, motion, angles[0][kept], kept)
    signs = _filtered(np.sign(angles[1]), period, cutoff)[kept]
    times = data.column("time")[kept]
    return MeasuredMotion(source, cutoff, times, motion, signs, smooth[kept], noise, misfit)


def _from_reference(robot: ParallelRobot, joints: Array) -> Array:
    """Return motors' joints (T, n_a) less whole turns, to begin within half a turn of the reference."""
    away = joints[0] - robot.actuated_coordinates(robot.reference.q[None])[0]
    return joints - np.where(robot.sliding[robot.actuated], 0.0, whole_turns(away))


def _cutoff(data: Recording, joints: Array, period: float, least: float, most: float) -> float:
    """Return the frequency [Hz] at which the angles' last spectrum meets its noise, within a range."""
    from scipy.ndimage import uniform_filter1d

    count = len(joints)
    straight = joints[0] + np.linspace(0.0, 1.0, count)[:, None] * (joints[-1] - joints[0])
    window = np.hanning(count)[:, None]
    power = np.abs(np.fft.rfft((joints - straight) * window, axis=0)) ** 2
    power = uniform_filter1d(power, SMOOTHING_BINS, axis=0, mode="nearest")
    floor = np.median(power[len(power) // 2 :], axis=0)
    above = power > SIGNAL_TO_NOISE * np.maximum(floor, np.finfo(float).tiny)
    first = [int(np.argmin(column)) if not column.all() else len(column) for column in above.T]
    frequency = max(first) / (count * period)
    if least > most:
        raise InvalidInput(f"{data.source}: {count} samples are too few to filter")
    return float(np.clip(frequency, least, most))


def _filtered(values: Array, period: float, cutoff: float) -> Array:
    """Return values (T, k) without what is above the cutoff [Hz], without delay."""
    from scipy.signal import butter, sosfiltfilt

    sections = butter(ORDER, cutoff, fs=1.0 / period, output="sos")
    padding = min(len(values) - 1, int(np.ceil(3.0 / (cutoff * period))))
    return sosfiltfilt(sections, values, axis=0, padlen=padding)


def _with_derivatives(values: Array, period: float, cutoff: float) -> list[Array]:
    """Return values (T, k) without what is above the cutoff [Hz], and their first and second derivatives."""
    from scipy.interpolate import make_interp_spline

    times = period * np.arange(len(values))
    spline = make_interp_spline(times, _filtered(values, period, cutoff), k=SPLINE_DEGREE)
    return [spline(times, order) for order in range(3)]


def _by_motors(robot: ParallelRobot, angles: list[Array], progress: Callable[[int], None]) -> Motion:
    """Compute the motion of all joints for motor joints, their rates and accelerations (T, n_a)."""
    q_a, dq_a, ddq_a = angles
    q = _poses_by_motors(robot, q_a, progress)
    linearised = linearised_at(robot, q, None)
    _check_apart(robot, q, linearised)
    units = np.broadcast_to(np.eye(robot.n)[:, None], (robot.n, len(q), robot.n))
    rates = joint_rates(robot, linearised, units, np.zeros((len(q), 0))).transpose(1, 2, 0)  # (T, nv, n)
    to_twist = np.linalg.pinv(rates[:, robot.actuated])
    v = np.einsum("tvn,tna,ta->tv", rates, to_twist, dq_a)
    drifting = freeze_deflections(robot, q, v, np.zeros_like(v))
    missing = ddq_a - drifting.a[:, robot.actuated]
    return freeze_deflections(robot, q, v, drifting.a + np.einsum("tvn,tna,ta->tv", rates, to_twist, missing))


def _poses_by_motors(robot: ParallelRobot, q_a: Array, progress: Callable[[int], None]) -> Array:
    """Follow the motors' joints (T, n_a) and return the poses (T, nq).

    Raises:
        Type2Singularity: the assembly mode ends at an instant or on the way to one.
    """
    q: list[Array] = []
    try:
        for pose in follow_motors(robot, q_a):
            q.append(pose.q)
            progress(len(q))
    except Type2Singularity as end:
        raise _type2_of_motors(robot, end.q, end.platform, end.residual, len(q) / len(q_a)) from end
    return np.array(q)


def _check_apart(robot: ParallelRobot, q: Array, linearised: LinearisedLoops) -> None:
    """Refuse motors that may pass a Type 2 singularity between two instants: a mode of many is then taken.

    So where the least singular value of P, going on as it did, comes to zero before the next instant; the
    way back of another mode looks like that from both sides.
    """
    value = clearance(robot, linearised)
    change = np.diff(value)
    meets = np.zeros(len(value), dtype=bool)
    meets[1:-1] = (value[1:-1] + change[:-1] <= 0.0) | (value[1:-1] - change[1:] <= 0.0)
    if not meets.any():
        return
    k = int(np.flatnonzero(meets)[0])
    x = robot.platform.coordinates(linearised.frames)[k]
    raise _type2_of_motors(robot, q[k], x, float(linearised.gap[k]), k / len(q))


def _type2_of_motors(
    robot: ParallelRobot, q: Array, x: Array, residual: float, share: float
) -> Type2Singularity:
    """Return the refusal of motors that pass Type 2 beside q (nq,), after this share of the recording."""
    return Type2Singularity(
        f"{robot.name}: the recorded motors pass a Type 2 singularity or come near one beside "
        f"{', '.join(robot.axis_names)} = {point(x)}, where they do not say how the robot goes on; the poses "
        f"must come from the measured platform (platform_{robot.axis_names[0]} ...)",
        q=q,
        residual=residual,
        share=share,
        platform=x,
    )


def _by_platform(robot: ParallelRobot, x: Array, period: float, cutoff: float, kept: IntArray) -> Motion:
    """Compute the motion of all joints for measured platform coordinates (samples, n)."""
    x, dx, ddx = (rows[kept] for rows in _with_derivatives(x, period, cutoff))
    near, q = assemble(robot, x[0]).q, []
    for place in x:
        near = close_loops(robot, place[None], near[None]).q[0]
        q.append(near)
    stack = np.array(q)
    return motion_at(robot, ClosedStack(stack, x, linearised_at(robot, stack, x)), dx, ddx)


def _motor_misfit(robot: ParallelRobot, source: str, motion: Motion, q_a: Array, samples: IntArray) -> float:
    """Compute the largest distance of poses to the motors' joints q_a (T, n_a) [rad, robot lengths].

    Whole turns of hinges count as none.

    Raises:
        InvalidInput: it is more than a file that is a little wrong explains.
    """
    off = robot.actuated_coordinates(motion.q) - q_a
    off = np.abs(np.where(robot.sliding[robot.actuated], off, off - whole_turns(off)))
    off /= robot.column_scale[robot.actuated]
    k, motor = np.unravel_index(int(off.argmax()), off.shape)
    largest = float(off[k, motor])
    if largest > MAX_MOTOR_MISFIT:
        raise InvalidInput(
            f"{source}: at sample {int(samples[k]) + 1} motor_angle_{robot.actuator_names[motor]} "
            f"contradicts the measured platform: its joint is {largest:.3g} rad (slides: robot lengths) off "
            f"where the platform has it, the limit is {MAX_MOTOR_MISFIT:g}; look at zero, sign and gear "
            f"ratio, or at the assembly mode of the robot file"
        )
    return largest
