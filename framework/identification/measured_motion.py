"""The motion of all joints from recorded samples: filter, differentiate, close the loops.

Angles, platform and torques pass the same filter without delay: a Butterworth filter of order 4, applied
forwards and backwards (scipy). Derivatives are those of splines of degree 5 through the filtered samples
(scipy). The instants used are half a period of the cutoff frequency apart, so that their noise is nearly
independent, and away from the ends of the recording. The signs of the motors' speeds, on which dry friction
depends, pass the same filter as the torques, so that they correspond.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.errors import InvalidInput, NotAssembled, Type2Singularity
from framework.identification.recording import Recording, uniform_period
from framework.kinematics.continuation.forward_kinematics import follow_motors
from framework.kinematics.continuation.tracking import assemble
from framework.kinematics.inverse_kinematics import close_loops, require_square
from framework.kinematics.linearised_loops import ClosedStack, LinearisedLoops, clearance, linearised_at
from framework.kinematics.motion_rates import Motion, freeze_deflections, motion_at, motor_speeds
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, IntArray
from framework.numerics.rotations import whole_turns
from framework.tolerances import MAX_MOTOR_MISFIT

MIN_SAMPLES = 64  # of a recording


@dataclass(frozen=True, eq=False)
class MeasuredMotion:
    """A recorded motion at instants whose noise is nearly independent."""

    source: str  # of the poses: motors or platform
    cutoff: float  # [Hz] of the filter
    times: Array  # (T,)
    motion: Motion
    signs: Array  # (T, n_a) filtered signs of the motors' speeds
    torque: Array  # (T, n_a) filtered, motor side
    torque_noise: Array  # (n_a,) standard deviations of the noise that remains after filtering
    motor_misfit: float  # [rad, robot lengths] largest offset of the motors; 0 if poses are from motors


def measured_motion(
    robot: ParallelRobot,
    data: Recording,
    *,
    cutoff: float | None = None,
    poses: str | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> MeasuredMotion:
    """Compute the recorded motion of all joints, with filtered torques.

    The noise of the filtered torques is estimated from the part that the filter removes. White noise fills
    the band up to half the sampling rate, and the filter passes the share 2 cutoff period of this band.

    Args:
        cutoff: cutoff frequency of the filter [Hz]; by default the frequency above which the angles' spectra
            are noise.
        poses: "motors" computes poses from the motor angles, "platform" from measured platform coordinates,
            which works at Type 2 singularities too. The default is "motors", then "platform" if that fails.
        progress: called with the number of poses computed from the motors.

    Raises:
        InvalidInput: columns are missing, samples too few, time steps unequal, the cutoff out of range, or a
            torque always zero; or the platform contradicts the motors.
        NotAssembled: the loops do not close at some pose.
        Type2Singularity: the motors pass a Type 2 singularity.
    """
    require_square(robot)
    period = uniform_period(data)
    if len(data) < MIN_SAMPLES:
        raise InvalidInput(f"{data.source}: {len(data)} samples; at least {MIN_SAMPLES} are needed")
    if poses not in (None, "motors", "platform"):
        raise InvalidInput(f"poses: needs motors or platform, got {poses!r}")
    joints = _read_motor_joints(robot, data)
    torque = _read_torques(robot, data)

    # filter angles and torques, and estimate the noise that remains
    low_pass = _LowPass(period, _choose_cutoff(data, joints, period, cutoff))
    instants = low_pass.choose_instants(len(data))
    filtered_torque = low_pass.filter(torque)
    passed_share = 2.0 * low_pass.cutoff * period  # of the power of white noise
    torque_noise = np.std(torque - filtered_torque, axis=0) * np.sqrt(passed_share)
    filtered_joints = low_pass.differentiate(joints)  # (3, samples, n_a) with two derivatives

    # close the loops, from the motors if possible, else from the platform
    motor_joints = filtered_joints[:, instants]  # (3, T, n_a)
    source = "motors"
    misfit = 0.0
    motion = None
    if poses != "platform":
        may_fail = poses is None and data.has("platform", robot.axis_names)
        motion = _try_motors(robot, motor_joints, progress, may_fail=may_fail)
    if motion is None:
        source = "platform"
        x = low_pass.differentiate(data.columns("platform", robot.axis_names))  # (3, samples, n)
        motion = _motion_of_platform(robot, x[:, instants])
        misfit = _motor_misfit(robot, data.source, motion, motor_joints[0], instants)
    return MeasuredMotion(
        source=source,
        cutoff=low_pass.cutoff,
        times=data.column("time")[instants],
        motion=motion,
        signs=low_pass.filter(np.sign(filtered_joints[1]))[instants],  # of the rates, filtered like torques
        torque=filtered_torque[instants],
        torque_noise=torque_noise,
        motor_misfit=misfit,
    )


def _read_torques(robot: ParallelRobot, data: Recording) -> Array:
    """Return the measured torques (samples, n_a) [N m, N].

    Raises:
        InvalidInput: a torque is zero at all samples.
    """
    torque = data.columns("torque", robot.actuator_names)
    for joint, column in zip(robot.actuator_names, torque.T, strict=True):
        if not column.any():
            raise InvalidInput(
                f"{data.source}: torque_{joint} is zero at all samples; measured torques are needed"
            )
    return torque


def _read_motor_joints(robot: ParallelRobot, data: Recording) -> Array:
    """Return the motors' joints (samples, n_a) [rad, m], on the joint side of the gears.

    Whole turns are subtracted, so that each joint starts within half a turn of the reference.
    """
    joints = data.columns("motor_angle", robot.actuator_names) / robot.gear_ratio
    offset = joints[0] - robot.actuated_coordinates(robot.reference.q[None])[0]
    return joints - np.where(robot.sliding[robot.actuated], 0.0, whole_turns(offset))


def _choose_cutoff(
    data: Recording,
    joints: Array,
    period: float,
    cutoff: float | None,
    *,
    max_cutoff: float = 0.4,  # over the sampling rate; 0.5 is the Nyquist frequency
    min_periods: int = 8,  # periods of the cutoff in a recording; one is left out at either end
) -> float:
    """Return `cutoff` [Hz] or, if None, the frequency above which all spectra are noise.

    The recording must last for `min_periods` of the cutoff, with 1 / `max_cutoff` samples in each of them.

    Args:
        data: the recording.
        joints: (samples, n_a) positions of the motors' joints.
        period: sampling period [s].

    Raises:
        InvalidInput: the cutoff is outside the range that the recording allows.
    """
    lowest = min_periods / (len(data) * period)
    highest = max_cutoff / period
    if cutoff is None:
        return float(np.clip(_signal_frequency(joints, period), lowest, highest))
    if not lowest <= cutoff <= highest:
        raise InvalidInput(f"cutoff: needs {lowest:.3g} to {highest:.3g} Hz for these data, got {cutoff:g}")
    return cutoff


def _signal_frequency(
    joints: Array,
    period: float,
    *,
    signal_to_noise: float = 10.0,  # of a power spectrum; below this ratio a frequency counts as noise
    smoothing_bins: int = 9,  # frequencies over which a power spectrum is averaged
) -> float:
    """Return the frequency [Hz] above which the spectra of all joints are noise.

    The joints (samples, n_a) are sampled with a period [s]. The noise level of a joint is the median of the
    upper half of its smoothed power spectrum. The straight line between the ends is subtracted from each
    signal, and a window is applied, so that the ends of the recording add no high frequencies.
    """
    from scipy.ndimage import uniform_filter1d

    count = len(joints)
    chord = np.linspace(joints[0], joints[-1], count)  # (samples, n_a)
    window = np.hanning(count)[:, None]
    raw_power = np.abs(np.fft.rfft((joints - chord) * window, axis=0)) ** 2  # (bins, n_a)
    power = uniform_filter1d(raw_power, smoothing_bins, axis=0, mode="nearest")
    noise = np.median(power[len(power) // 2 :], axis=0)
    is_signal = power > signal_to_noise * np.maximum(noise, np.finfo(float).tiny)  # (bins, n_a)
    precedes_noise = np.logical_and.accumulate(is_signal, axis=0)  # true up to the first noise bin
    return precedes_noise.sum(axis=0).max() / (count * period)  # a bin is 1 / (count period) wide


class _LowPass(NamedTuple):
    """A low-pass filter without delay for uniform samples."""

    period: float  # [s] of the samples
    cutoff: float  # [Hz]

    def filter(self, values: Array, *, order: int = 4) -> Array:
        """Filter values (samples, k) forwards and backwards, which cancels the delay."""
        from scipy.signal import butter, sosfiltfilt

        sections = butter(order, self.cutoff, fs=1.0 / self.period, output="sos")
        # three periods of the cutoff at either end, in which the filter settles
        padding = min(len(values) - 1, math.ceil(3.0 / (self.cutoff * self.period)))
        return sosfiltfilt(sections, values, axis=0, padlen=padding)

    def differentiate(self, values: Array, *, spline_degree: int = 5) -> Array:
        """Return filtered values (samples, k) and two time derivatives, (3, samples, k)."""
        from scipy.interpolate import make_interp_spline

        times = self.period * np.arange(len(values))
        spline = make_interp_spline(times, self.filter(values), k=spline_degree)
        return np.array([spline(times, order) for order in range(3)])

    def choose_instants(self, count: int) -> IntArray:
        """Return indices (T,) of samples half a period of the cutoff apart, without the ends.

        `count` is the number of samples.
        """
        samples_per_period = 1.0 / (self.cutoff * self.period)  # of the cutoff frequency
        margin = math.ceil(samples_per_period)
        stride = max(round(0.5 * samples_per_period), 1)
        return np.arange(margin, count - margin, stride)


def _try_motors(
    robot: ParallelRobot, joints: Array, progress: Callable[[int], None], *, may_fail: bool
) -> Motion | None:
    """Compute the motion from the motors' joints (3, T, n_a); None if the motors do not determine poses.

    Args:
        joints: positions, rates and accelerations, on the joint side of the gears.
        progress: called with the number of poses computed.
        may_fail: whether to return None instead of raising the error.
    """
    try:
        return _motion_of_motors(robot, joints, progress)
    except NotAssembled:
        if not may_fail:
            raise
        return None


def _motion_of_motors(robot: ParallelRobot, joints: Array, progress: Callable[[int], None]) -> Motion:
    """Compute the motion of all joints from motor positions, rates and accelerations.

    `joints` (3, T, n_a) are on the joint side of the gears, and `progress` is called with the number of poses
    computed. N are the joint rates for unit twists of the platform, and N_a the rows of N that belong to
    motors. Then v = N N_a^+ dq_a and a = drift + N N_a^+ (ddq_a - drift_a). The drift is the joint
    acceleration at zero acceleration of the platform, drift_a its rows that belong to motors.
    """
    q_a, dq_a, ddq_a = joints
    q = _poses_of_motors(robot, q_a, progress)  # (T, nq)
    linearised = linearised_at(robot, q)
    _check_clearance(robot, q, linearised)
    _, N = motor_speeds(robot, linearised)  # (T, nv, n)
    joints_per_motor = N @ np.linalg.pinv(N[:, robot.actuated])  # (T, nv, n_a)
    v = np.matvec(joints_per_motor, dq_a)
    drift = freeze_deflections(robot, q, v, np.zeros_like(v)).a
    a = drift + np.matvec(joints_per_motor, ddq_a - drift[:, robot.actuated])
    return freeze_deflections(robot, q, v, a)


def _poses_of_motors(robot: ParallelRobot, q_a: Array, progress: Callable[[int], None]) -> Array:
    """Follow the motors' joints (T, n_a) [rad, m]; return the poses (T, nq).

    Args:
        progress: called with the number of poses computed.

    Raises:
        Type2Singularity: the motors reach a singularity before the last instant.
    """
    q: list[Array] = []
    try:
        for pose in follow_motors(robot, q_a):
            q.append(pose.q)
            progress(len(q))
    except Type2Singularity as end:
        raise _type2_error(robot, end.q, end.platform, end.residual, len(q) / len(q_a)) from end
    return np.array(q)


def _check_clearance(robot: ParallelRobot, q: Array, linearised: LinearisedLoops) -> None:
    """Raise Type2Singularity if the motors may pass one between two poses q (T, nq).

    Beyond a singularity motor angles do not determine the mode of the robot. A singularity is possible if the
    clearance, extrapolated linearly through two neighbouring instants, reaches zero at the instant after them
    or before them.

    Args:
        linearised: loops at q.
    """
    clearances = clearance(robot, linearised)  # (T,)
    change = np.diff(clearances)
    inner = clearances[1:-1]
    next_value = inner + change[:-1]  # extrapolated through an instant and the one before it
    previous_value = inner - change[1:]  # through an instant and the one after it
    may_vanish = (next_value <= 0.0) | (previous_value <= 0.0)
    if not may_vanish.any():
        return
    k = 1 + int(may_vanish.argmax())  # the first of these instants
    x = robot.platform.coordinates(linearised.frames)[k]
    raise _type2_error(robot, q[k], x, float(linearised.gap[k]), k / len(q))


def _type2_error(robot: ParallelRobot, q: Array, x: Array, residual: float, share: float) -> Type2Singularity:
    """Return the error for motors that pass Type 2 near q (nq,) and platform coordinates x (n,).

    Args:
        residual: largest residual of the loop equations at q [m or rad].
        share: share of the recording before the singularity.
    """
    return Type2Singularity(
        f"{robot.name}: the recorded motors pass a Type 2 singularity or come near one beside "
        f"{robot.place(x)}, where they do not determine how the robot continues; the poses "
        f"must come from the measured platform (platform_{robot.axis_names[0]} ...)",
        q=q,
        residual=residual,
        share=share,
        platform=x,
    )


def _motion_of_platform(robot: ParallelRobot, platform: Array) -> Motion:
    """Compute the motion of all joints from x, dx and ddx of the platform, (3, T, n)."""
    x, dx, ddx = platform
    q = np.empty((len(x), robot.model.nq))
    pose = assemble(robot, x[0]).q[None]  # (1, nq), a stack of one configuration
    for k in range(len(x)):
        pose = close_loops(robot, x[k : k + 1], pose).q  # from the previous pose
        q[k] = pose[0]
    return motion_at(robot, ClosedStack(q, x, linearised_at(robot, q, x)), dx, ddx)


def _motor_misfit(robot: ParallelRobot, source: str, motion: Motion, q_a: Array, samples: IntArray) -> float:
    """Compute the largest offset of poses from the motors' joints q_a (T, n_a).

    The offset of a hinge is in radians, up to whole turns, that of a slide in robot lengths.

    Args:
        motion: with poses from the measured platform.
        source: name of the recording, for messages.
        samples: (T,) indices of the instants in the recording.

    Raises:
        InvalidInput: the offset is too large to be a small error of the file.
    """
    offset = robot.actuated_coordinates(motion.q) - q_a  # (T, n_a) [rad, m]
    turns = np.where(robot.sliding[robot.actuated], 0.0, whole_turns(offset))
    distance = np.abs(offset - turns) / robot.column_scale[robot.actuated]
    k, motor = np.unravel_index(distance.argmax(), distance.shape)  # instant and motor of the largest one
    largest = float(distance[k, motor])
    if largest > MAX_MOTOR_MISFIT:
        raise InvalidInput(
            f"{source}: at sample {samples[k] + 1} motor_angle_{robot.actuator_names[motor]} "
            f"contradicts the measured platform: its joint is {largest:.3g} rad (slides: robot lengths) off "
            f"where the platform has it, the limit is {MAX_MOTOR_MISFIT:g}; look at zero, sign and gear "
            f"ratio, or at the assembly mode of the robot file"
        )
    return largest
