"""The motion of all joints at all samples of a recording: smooth, differentiate, close the loops.

Motor angles or platform coordinates are smoothed by least-squares splines of degree 5, with equally many
samples between two knots. With equal time steps and the spacing h of knots they pass frequencies up to about
1 / 2h.
Generalised cross-validation minimises the estimated error of the curve, RSS / (N - 1.4 m)^2 for N samples and
m coefficients (Gu, "Smoothing Spline ANOVA Models", 2013, section 3.2; the factor 1.4 prevents that
quantisation, which is no white noise, counts as motion). Derivatives need more coefficients than the curve:
with 1.6 m the error that smoothing makes is far below the noise, so that intervals hold. Torques are not
filtered: the least squares of `identify` averages their noise.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from framework.errors import (
    InvalidInput,
    NoAnswer,
    NotAssembled,
    Type2Singularity,
    check_choice,
    list_names,
)
from framework.identification.recording import Recording, are_usual_steps
from framework.kinematics.assembly import Configuration
from framework.kinematics.continuation.forward_kinematics import (
    check_motors_are_free,
    follow_motors,
    motors_are_free,
)
from framework.kinematics.continuation.motor_curves import close_at_motors
from framework.kinematics.continuation.tracking import assemble
from framework.kinematics.frames import frames_at, full_motion
from framework.kinematics.inverse_kinematics import close_loops, require_square
from framework.kinematics.linearised_loops import clearance, linearised_at
from framework.kinematics.motion_rates import Motion, freeze_deflections, motion_at, motor_speeds
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import single_columns
from framework.numerics.arrays import Array, BoolArray, IntArray
from framework.numerics.rotations import whole_turns
from framework.numerics.splines import banded_rows, find_intervals, spline_values
from framework.proofs.working_modes import working_modes
from framework.tolerances import MAX_ACCELERATION_SPREAD, MAX_MOTOR_MISFIT, MIN_SPEED_DEVIATIONS, SPIKE

MIN_SAMPLES = 64  # of a recording


@dataclass(frozen=True, eq=False)
class MeasuredMotion:
    """The recorded motion at all T samples."""

    source: str  # of the poses: motors or platform
    cutoff: float  # [Hz] highest frequency that smoothing passes
    times: Array  # (T,)
    motion: Motion
    errors: SplineErrors  # of the signals from which the motion is computed, motors' joints or platform
    sign_known: BoolArray  # (T, n_a) whether the speed of a motor is above its noise
    acceleration_known: BoolArray  # (T,) not at the ends, in a gap of the samples, nor beside a rest
    torque: Array  # (T, n_a) as recorded, motor side
    motor_misfit: float  # [rad, robot lengths] largest offset of the motors; 0 if poses are from motors


class SplineErrors(NamedTuple):
    """Errors z (m k,) of k splines of m coefficients over their samples' noise, coefficient by coefficient.

    The coefficients of a least squares spline of T samples with independent errors have the information
    (inverse covariance) samples' samples.
    """

    samples: Any  # (T k, m k) sparse, of the samples over their noise by z
    accelerations: Any  # (S k, m k) sparse, of the second derivatives at the S instants of the motion by z


class SmoothedSamples(NamedTuple):
    """k signals with two time derivatives at S of T samples, smoothed by all."""

    values: Array  # (3, S, k)
    cutoff: float  # [Hz]
    rate_error: Array  # (S, k) bounds of the first derivatives' errors
    acceleration_known: BoolArray  # (S,)
    errors: SplineErrors


def measured_motion(
    robot: ParallelRobot,
    data: Recording,
    *,
    cutoff: float | None = None,
    poses: str | None = None,
    start: Mapping[str, float] | None = None,
    instants: IntArray | None = None,
    trial: bool = False,
    progress: Callable[[int], None] = lambda done: None,
) -> MeasuredMotion:
    """Compute the recorded motion of all joints, with the torques at its samples.

    Args:
        cutoff: highest frequency that smoothing passes [Hz]; by default from cross-validation.
        poses: "motors" computes poses from the motor angles, "platform" from measured platform coordinates,
            which works at Type 2 singularities too. The default is "motors", then "platform" if that fails
            or leads elsewhere than measured.
        start: joints' positions near the first row [rad, m], see `begin_at_first_row`.
        instants: (S,) indices of the samples whose poses are computed, by default all; all are smoothed.
        trial: whether columns are changed on trial: the motion begins near the reference, and a platform that
            contradicts the motors is refused.
        progress: called with the number of poses computed from the motors.

    Raises:
        InvalidInput: columns are missing, or the cutoff is out of range; or the platform contradicts the
            motors.
        NotAssembled: the loops do not close at some pose.
        Type2Singularity: the motors pass a Type 2 singularity.
    """
    require_square(robot)
    times = data.column("time")
    if poses not in (None, "motors", "platform"):
        raise InvalidInput(f"poses: needs motors or platform, got {poses!r}")
    if not trial:
        robot = begin_at_first_row(robot, data, start or {})
    instants = np.arange(len(times)) if instants is None else instants
    recorded = _read_motor_joints(robot, data)
    _refuse_jumps(robot, data, recorded)
    joints = smooth(times, recorded, cutoff, times[instants])

    # close the loops, from the motors if possible, else from the platform
    source = "motors"
    misfit = 0.0
    motion = None
    leads_elsewhere = False  # motors, than the platform is measured
    smoothed = joints
    has_platform = data.has("platform", robot.axis_names)
    if poses == "motors" or (poses is None and (motors_are_free(robot) or not has_platform)):
        try:
            motion = _motion_of_motors(robot, joints.values, progress)
        except NotAssembled:
            if poses is not None or not has_platform:
                raise
    if motion is not None and poses is None and has_platform:
        x = data.columns("platform", robot.axis_names)[instants]
        offset = robot.platform.residual(motion.linearised.frames, x) / robot.platform_scale  # (S, n)
        if np.abs(offset[~np.isnan(x).any(axis=1)]).max(initial=0.0) > MAX_MOTOR_MISFIT:
            if trial:
                raise InvalidInput(f"{data.source}: the platform contradicts the motors")
            motion = None
            leads_elsewhere = True
    if motion is None:
        source = "platform"
        # a tracker may be slower than the motors, and begin behind them
        known = data.complete("platform_")
        seen = known.column("time")
        within = (times[instants] >= seen[0]) & (times[instants] <= seen[-1])  # (S,)
        instants = instants[within]
        joints = joints._replace(values=joints.values[:, within], rate_error=joints.rate_error[within])
        smoothed = smooth(seen, known.columns("platform", robot.axis_names), cutoff, times[instants])
        first = (smoothed.values[0, 0] - robot.reference.x) / robot.platform_scale
        if trial and np.abs(first).max() > 1.0:  # a robot length or a radian away
            raise InvalidInput(f"{data.source}: the platform begins far from the reference")
        motion = _motion_of_platform(robot, smoothed.values)
        misfit = _motor_misfit(
            robot, data.rows(instants), motion, joints.values[0], leads_elsewhere=leads_elsewhere
        )
    # where the robot stands still strokes meet; a spline rounds corners of accelerations by about an interval
    times = times[instants]
    sign_known = np.abs(motion.v[:, robot.actuated]) > joints.rate_error  # (S, n_a)
    rest = times[~sign_known.any(axis=1)]
    reach = 0.5 / smoothed.cutoff  # [s] one interval of knots
    has_rest = np.searchsorted(rest, times + reach, side="right") > np.searchsorted(rest, times - reach)
    return MeasuredMotion(
        source=source,
        cutoff=joints.cutoff,
        times=times,
        motion=motion,
        errors=smoothed.errors,
        sign_known=sign_known,
        acceleration_known=smoothed.acceleration_known & ~has_rest,
        torque=data.columns("torque", robot.actuator_names)[instants],
        motor_misfit=misfit,
    )


def check_signals(robot: ParallelRobot, data: Recording, poses: str | None = None) -> None:
    """Raise InvalidInput for columns that are missing, short, zero, begin anew after a turn, or have spikes.

    The platform is checked unless `poses` leave it out.
    """
    kinds = dict.fromkeys(("motor_angle", "torque"), robot.actuator_names)
    if poses != "motors" and data.has("platform", robot.axis_names):
        kinds["platform"] = robot.axis_names
    for kind, endings in kinds.items():
        known = data.complete(f"{kind}_")  # a slower tracker has no number at most samples
        columns = known.columns(kind, endings)  # (T, k)
        if len(known) < MIN_SAMPLES:
            without = "; --poses motors does without" * (kind == "platform")
            raise InvalidInput(
                f"{data.source}: {len(known)} samples of {kind}; at least {MIN_SAMPLES} are needed{without}"
            )
        is_usual = are_usual_steps(known.column("time"))  # (T - 1,)
        for ending, values in zip(endings, columns.T, strict=True):
            _check_column(known, f"{kind}_{ending}", values, is_usual)


def _check_column(data: Recording, name: str, values: Array, is_usual: BoolArray) -> None:
    """Raise InvalidInput for values (T,) that are zero, begin anew after a turn, or have spikes.

    An angle begins anew where it steps by about a turn, and by less than a quarter of a turn at most
    other samples: no motor starts or stops between two samples. Whole numbers alone are counts of an
    encoder. A spike is a sample far from the median of itself and its neighbours, which steps of friction
    leave alone, and which rounding moves by few counts. Only usual time steps (T - 1,) count: over gaps a
    fast motor makes whole turns.
    """
    turns_by_unit = {"": 2.0 * np.pi, "deg": 360.0}
    spread = 0.99  # share of the samples whose distance from the median is noise
    least_spike = 0.05  # of the column's range
    least_counts = 3.0  # of the steps to which a column is rounded, which noise crosses one by one
    is_angle = name.startswith("motor_angle_")
    steps = np.where(is_usual, np.abs(np.diff(values)), 0.0)
    for unit, turn in turns_by_unit.items():
        turns = np.flatnonzero(np.abs(steps - turn) < 0.25 * turn)
        others = np.delete(steps, turns)
        if is_angle and 0 < len(turns) < len(others) and others.max() < 0.25 * turn:
            raise InvalidInput(
                f"{data.source}: {data.row(int(turns[0]) + 1)}: {name} begins anew after a turn; "
                f"{f'--unit {name}={unit} ' * bool(unit)}--unwrap {name} counts on"
            )
    if is_angle and np.ptp(values) and (values == np.round(values)).all():
        raise InvalidInput(
            f"{data.source}: {name} has whole numbers alone, as counts of an encoder: --unit "
            f"{name}=SIZE declares how many radians or metres one of them is"
        )
    if name.startswith("torque_") and not values.any():
        raise InvalidInput(f"{data.source}: {name} is zero at all samples; measured torques are needed")
    beside = np.median([values[:-2], values[1:-1], values[2:]], axis=0)  # (T - 2,)
    distance = np.where(is_usual[:-1] & is_usual[1:], np.abs(values[1:-1] - beside), 0.0)  # (T - 2,)
    count = np.diff(np.unique(values)).min(initial=np.inf)  # least difference of two values
    limit = max(SPIKE * np.quantile(distance, spread), least_spike * np.ptp(values), least_counts * count)
    spikes = 1 + np.flatnonzero(distance > limit)
    if len(spikes):
        rows = list_names([data.row(int(spike)) for spike in spikes], most=8)
        before, spike, after = values[spikes[0] - 1 : spikes[0] + 2]
        raise InvalidInput(
            f"{data.source}: {rows}: a spike, {name} is {spike:.4g} between {before:.4g} and {after:.4g};"
            f" leave such rows out, time may have gaps"
        )


def _read_motor_joints(robot: ParallelRobot, data: Recording) -> Array:
    """Return the motors' joints (T, n_a) [rad, m], on the joint side of the gears.

    Whole turns are subtracted, so that each joint starts within half a turn of the reference.
    """
    joints = data.columns("motor_angle", robot.actuator_names) / robot.gear_ratio
    offset = joints[0] - robot.actuated_coordinates(robot.reference.q[None])[0]
    return joints - np.where(robot.sliding[robot.actuated], 0.0, whole_turns(offset))


def _refuse_jumps(robot: ParallelRobot, data: Recording, joints: Array) -> None:
    """Raise InvalidInput for a hinge that turns by half a turn or more between samples of the usual distance.

    No continuation could tell which way the motors, whose joints are (T, n_a), have gone in between.
    """
    jumps = (np.abs(np.diff(joints, axis=0)) >= np.pi) & ~robot.sliding[robot.actuated]
    jumps &= are_usual_steps(data.column("time"))[:, None]
    if jumps.any():
        k, motor = np.argwhere(jumps)[0].tolist()
        turn = float(joints[k + 1, motor] - joints[k, motor])
        raise InvalidInput(
            f"{data.source}: motor_angle_{robot.actuator_names[motor]} turns its joint by {turn:.3g} rad up "
            f"to {data.row(k + 1)}, half a turn or more from one sample to the next; declare its unit "
            f"(--unit) or that it begins anew after a turn (--unwrap), or record at a higher rate"
        )


def begin_at_first_row(robot: ParallelRobot, data: Recording, start: Mapping[str, float]) -> ParallelRobot:
    """Return the robot with the pose of the first row as its reference.

    The pose is that of joints in `start`, else of columns joint_NAME, else of the measured platform: of its
    working modes the one that has the motors where they are. Motors alone leave the reference. Assembly and
    working mode may differ from those of the file.

    Raises:
        InvalidInput: `start` has an unknown joint.
        NotAssembled: the loops do not close near these joints.
    """
    single = {robot.coordinates.name_of(k): k for k in sorted(single_columns(robot.model))}
    for joint in start:
        check_choice("joint of --start", joint, single)
    sensed = [joint for joint in single if data.has("joint", [joint])]
    data = data.complete("joint_" if start or sensed else "platform_").rows(slice(1))
    if not len(data):
        return robot
    q_a = _read_motor_joints(robot, data)[0]  # (n_a,)
    measured = dict(zip(sensed, data.columns("joint", sensed)[0].tolist(), strict=True))
    if start or measured:
        motors = dict(zip(robot.actuator_names, q_a.tolist(), strict=True))
        stated = {**robot.description.reference, **motors, **measured, **start}
        description = replace(robot.description, reference=stated)
        q = ParallelRobot.from_description(description).reference.q
    elif data.has("platform", robot.axis_names):
        pose = _pose_with_motors(robot, data.columns("platform", robot.axis_names)[0], q_a)
        if pose is None:  # the file, a column or a zero is wrong, which is found later
            return robot
        q = pose
    else:
        return robot
    frames = frames_at(robot, q[None])
    first = Configuration(q, robot.platform.coordinates(frames)[0], robot.reference.residual, 0)
    return replace(robot, reference=first)


def _pose_with_motors(robot: ParallelRobot, x: Array, q_a: Array) -> Array | None:
    """Find the pose (nq,) at x (n,) with the motors' joints near q_a (n_a,), in any working mode."""

    def misfit(q: Array) -> float:
        """Compute the largest offset of the motors' joints from q_a at q (nq,)."""
        return float(motor_distances(robot, robot.actuated_coordinates(q[None])[0] - q_a).max())

    with suppress(NoAnswer):
        q = assemble(robot, x).q
        if misfit(q) <= MAX_MOTOR_MISFIT:
            return q
    fitting = [
        mode.q for mode in working_modes(robot, np.array(x)).modes if misfit(mode.q) <= MAX_MOTOR_MISFIT
    ]
    return min(fitting, key=misfit, default=None)


# ------------------------------------------------------------------ smoothing


def smooth(
    times: Array, samples: Array, cutoff: float | None = None, shown: Array | None = None
) -> SmoothedSamples:
    """Smooth samples (T, k) at increasing times (T,); differentiate twice at instants `shown` (S,).

    The number m of spline coefficients is 2 `cutoff` duration or, by default, that of `_choose_trial`.

    Raises:
        InvalidInput: the cutoff is outside the range that the samples allow.
    """
    min_coefficients = 8
    max_share = 0.5  # of coefficients among the samples; the rest shows the noise
    growth = 1.25  # of the number of coefficients, from one trial to the next
    refinement = 1.6  # coefficients for derivatives, over those for the curve
    noise_runs = 8  # simulated noise from which that of the derivatives is estimated
    from scipy.sparse import diags_array, eye_array, kron  # slow to import

    duration = times[-1] - times[0]
    most = max(int(max_share * len(times)), min_coefficients)
    if cutoff is None:
        highest_count = most / refinement
        steps = int(np.log(highest_count / min_coefficients) / np.log(growth))
        trials = np.geomspace(min_coefficients, highest_count, 1 + steps)
        count = int(refinement * trials[_choose_trial(times, samples, trials.astype(int))])
    else:
        lowest, highest = 0.5 * min_coefficients / duration, 0.5 * most / duration
        if not lowest <= cutoff <= highest:
            raise InvalidInput(
                f"cutoff: needs {lowest:.3g} to {highest:.3g} Hz for these data, got {cutoff:g}"
            )
        count = round(2.0 * cutoff * duration)

    spline = _fit_spline(times, samples, count)
    shown = times if shown is None else shown  # (S,)
    values = np.array([spline(shown, order) for order in range(3)])
    # the noise of the samples, and by simulation that of the derivatives; what smoothing changes of the rates
    squares = np.sum((samples - spline(times)) ** 2, axis=0)
    noise = np.sqrt(squares / (len(times) - count))  # (k,)
    unit_noise = np.random.default_rng(0).standard_normal((len(times), noise_runs))
    noise_spline = _fit_spline(times, unit_noise, count)
    spreads = [np.sqrt(np.mean(noise_spline(shown, order) ** 2, axis=1)) for order in (1, 2)]  # (S,) each
    rate_spread = spreads[0][:, None] * noise  # (S, k)
    coarser = _fit_spline(times, samples, max(min_coefficients, int(count / refinement)))
    rows = []  # of values at all samples, and of accelerations at those shown, by the coefficients
    for t, order in ((times, 0), (shown, 2)):
        intervals = find_intervals(spline.t, spline.k, t)
        columns = intervals[:, None] + np.arange(-spline.k, 1)  # (T, 6) coefficients
        by_coefficients = spline_values(spline.t, spline.k, intervals, t, order)
        rows.append(banded_rows(by_coefficients[:, None], columns, count))
    return SmoothedSamples(
        values=values,
        cutoff=0.5 * count / duration,
        rate_error=MIN_SPEED_DEVIATIONS * rate_spread + np.abs(values[1] - coarser(shown, 1)),
        acceleration_known=spreads[1] < MAX_ACCELERATION_SPREAD * np.median(spreads[1]),
        errors=SplineErrors(
            samples=kron(rows[0], eye_array(len(noise)), format="csr"),
            accelerations=kron(rows[1], diags_array(noise), format="csr"),
        ),
    )


def _fit_spline(times: Array, samples: Array, count: int) -> Any:
    """Fit a spline of `count` coefficients to samples (T, k), with knots equally spaced in samples."""
    degree = 5
    from scipy.interpolate import make_lsq_spline

    samples_before = np.linspace(0, len(times) - 1, count - degree + 1)
    knots = np.interp(samples_before, np.arange(len(times)), times)
    padded = np.concatenate([[times[0]] * degree, knots, [times[-1]] * degree])
    return make_lsq_spline(times, samples, padded, k=degree)


def _choose_trial(times: Array, samples: Array, counts: IntArray) -> int:
    """Return the index among increasing counts (c,) of coefficients that smooths samples (T, k) best.

    The score of cross-validation, multiplied over the signals, takes noise for white. Errors of time stamps
    that last for some samples are not: they look like motion, and the least score has too many coefficients.
    What the squares lose from one count to the next is energy of the coefficients between, that of their
    accelerations is omega^4 times as much. Towards fewer coefficients this falls while they hold noise whose
    spectrum is flatter than omega^-4, and rises where they hold motion. The least score is left for fewer
    coefficients as long as it falls.
    """
    cost = 1.4
    fits = [_fit_spline(times, samples, int(count))(times) for count in counts]
    rounding = np.finfo(float).eps * np.abs(samples).max(axis=0) + np.finfo(float).tiny
    squares = np.mean((samples - np.array(fits)) ** 2, axis=1) + rounding**2  # (c, k)
    scores = np.sum(0.5 * np.log(squares) - np.log(len(times) - cost * counts[:, None]), axis=1)
    lost = np.maximum(-np.diff(squares, axis=0), rounding**2) / np.diff(counts)[:, None]  # (c - 1, k)
    energies = np.sum(np.log(lost), axis=1)
    energies += 2.0 * samples.shape[1] * np.log(counts[:-1] * counts[1:])  # omega^4 of their geometric mean
    chosen = int(np.argmin(scores))
    while 0 < chosen < len(energies) and energies[chosen - 1] < energies[chosen]:
        chosen -= 1
    return chosen


# ------------------------------------------------------------------ poses


def _motion_of_motors(robot: ParallelRobot, joints: Array, progress: Callable[[int], None]) -> Motion:
    """Compute the motion of all joints from motor positions, rates and accelerations.

    Poses are followed from one to the next a `largest_step` apart; Newton's method closes those between from
    the pose before. Beyond a singularity motor angles do not determine the mode of the robot. One is possible
    between two poses if the clearance, extrapolated linearly through two neighbouring instants, reaches zero
    at the instant behind them or the one ahead of them.

    N are the joint rates for unit twists of the platform, and N_a the rows of N that belong to motors. Then
    v = N N_a^+ dq_a and a = drift + N N_a^+ (ddq_a - drift_a). The drift is the joint acceleration at zero
    acceleration of the platform, drift_a its rows that belong to motors.

    Args:
        joints: (3, T, n_a) on the joint side of the gears [rad, m].
        progress: called with the number of poses followed.

    Raises:
        Type2Singularity: the motors reach a singularity before the last instant, or may pass one.
    """
    largest_step = 0.05  # [rad, robot lengths] of a motor between poses that are followed
    check_motors_are_free(robot)
    q_a, dq_a, ddq_a = joints
    travel = np.abs(np.diff(q_a, axis=0, prepend=q_a[:1])) / robot.column_scale[robot.actuated]
    cell = (travel.max(axis=1).cumsum() / largest_step).astype(int)  # (T,) samples of a cell share a guess
    first = np.flatnonzero(np.diff(cell, prepend=-1))
    followed: list[Array] = []
    try:
        for pose in follow_motors(robot, q_a[first]):
            followed.append(pose.q)
            progress(len(followed))
    except Type2Singularity as end:
        share = first[len(followed)] / len(q_a)
        raise _type2_error(robot, end.q, end.platform, end.residual, share) from end
    start = robot.reference.q
    turn = full_motion(robot, robot.actuated, q_a - robot.actuated_coordinates(start[None]))
    guess = np.array(followed)[np.searchsorted(first, np.arange(len(q_a)), side="right") - 1]
    closed = close_at_motors(robot, start, turn, guess)
    linearised = closed.linearised
    clearances = clearance(robot, linearised)  # (T,)
    change = np.diff(clearances)
    extrapolated = clearances[1:-1] + np.minimum(change[:-1], -change[1:])
    is_near = ~closed.closed
    is_near[1:-1] |= extrapolated <= 0.0
    if is_near.any():
        k = int(is_near.argmax())
        x = robot.platform.coordinates(linearised.frames)[k]
        raise _type2_error(robot, closed.q[k], x, float(linearised.gap[k]), k / len(q_a))

    _, N = motor_speeds(robot, linearised)  # (T, nv, n)
    joints_per_motor = N @ np.linalg.pinv(N[:, robot.actuated])  # (T, nv, n_a)
    v = np.matvec(joints_per_motor, dq_a)
    drift = freeze_deflections(robot, closed.q, v, np.zeros_like(v)).a
    a = drift + np.matvec(joints_per_motor, ddq_a - drift[:, robot.actuated])
    return freeze_deflections(robot, closed.q, v, a)


def _type2_error(robot: ParallelRobot, q: Array, x: Array, residual: float, share: float) -> Type2Singularity:
    """Return the error for motors that pass Type 2 near q (nq,) and platform coordinates x (n,).

    Args:
        residual: largest residual of the loop equations at q [m or rad].
        share: share of the recording before the singularity.
    """
    return Type2Singularity(
        f"the recorded motors pass a Type 2 singularity or come near one beside {robot.place(x)}, where they "
        "do not determine how the robot continues; the poses must come from the measured platform "
        f"(platform_{robot.axis_names[0]} ...), or the motion begins elsewhere than the reference (--start), "
        "or a zero is off (--zero)",
        name=robot.name,
        q=q,
        residual=residual,
        share=share,
        platform=x,
    )


def _motion_of_platform(robot: ParallelRobot, platform: Array) -> Motion:
    """Compute the motion of all joints from x, dx and ddx of the platform, (3, T, n).

    Every `stride`-th pose is closed from the one before, and all others from these.
    """
    stride = 16
    x, dx, ddx = platform
    pose = assemble(robot, x[0]).q[None]  # (1, nq), a stack of one configuration
    coarse = []
    for k in range(0, len(x), stride):
        pose = close_loops(robot, x[k : k + 1], pose).q  # from the previous pose
        coarse.append(pose[0])
    q = close_loops(robot, x, np.repeat(coarse, stride, axis=0)[: len(x)]).q
    return motion_at(robot, linearised_at(robot, q, x), dx, ddx)


def _motor_misfit(
    robot: ParallelRobot, data: Recording, motion: Motion, q_a: Array, *, leads_elsewhere: bool
) -> float:
    """Compute the largest offset of poses from the motors' joints q_a (T, n_a).

    The offset of a hinge is in radians, up to whole turns, that of a slide in robot lengths.

    Args:
        data: the recording, for messages.
        motion: with poses from the measured platform.
        leads_elsewhere: whether the motors alone give poses, other ones, for messages.

    Raises:
        InvalidInput: the offset is too large to be a small error of the file.
    """
    offset = robot.actuated_coordinates(motion.q) - q_a  # (T, n_a) [rad, m]
    distance = motor_distances(robot, offset)
    k, motor = np.unravel_index(distance.argmax(), distance.shape)  # instant and motor of the largest one
    largest = float(distance[k, motor])
    if largest > MAX_MOTOR_MISFIT:
        zero = float(np.mean(offset[:, motor]))
        rest = motor_distances(robot, offset - zero)[:, motor].max()
        advice = (
            "look at zero, sign and gear ratio, at the assembly mode of the robot file, or at the frame of "
            "the platform, which --poses motors leaves out"
        )
        if rest < 0.1 * largest:
            reading = -zero * float(robot.gear_ratio[motor])
            advice = (
                f"but its zero alone is off: --zero motor_angle_{robot.actuator_names[motor]}={reading:.9g}"
            )
        if leads_elsewhere:
            advice += "; if the platform is measured in another frame, --poses motors does without it"
        raise InvalidInput(
            f"{data.source}: {data.row(int(k))}: motor_angle_{robot.actuator_names[motor]} "
            f"contradicts the measured platform: its joint is {largest:.3g} rad (slides: robot lengths) off "
            f"where the platform has it, the limit is {MAX_MOTOR_MISFIT:g}; {advice}"
        )
    return largest


def motor_distances(robot: ParallelRobot, offset: Array) -> Array:
    """Return sizes (..., n_a) of offsets of the motors' joints: radians up to whole turns, robot lengths."""
    turns = np.where(robot.sliding[robot.actuated], 0.0, whole_turns(offset))
    return np.abs(offset - turns) / robot.column_scale[robot.actuated]
