"""Calibration of the geometry from motor angles and fully or partly measured poses.

A damped Gauss-Newton method solves for all poses and parameters together. The robot file's values are a
prior, and Huber's weights reduce the influence of outliers. Parameter directions that the data do not
determine keep the file's values, and are reported.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from framework.errors import InvalidInput, NoAnswer, NotAssembled, NotConverged, check_choice
from framework.identification.base_parameters import random_poses
from framework.identification.combinations import (
    COEFFICIENT_ROUNDING,
    Combinations,
    describe_unseen_direction,
    find_combinations,
)
from framework.identification.conversions import Conversions, load_recording, refuse_mistaken_columns
from framework.identification.geometry import (
    Geometry,
    Measurements,
    ParameterEquations,
    eliminate_poses,
    measurement_offsets,
    parametrise_geometry,
    place_fixtures,
    select_measurements,
    sensor_slopes,
)
from framework.identification.least_squares import posterior_root
from framework.identification.measured_motion import motor_distances
from framework.identification.recording import HELD_OUT_EVERY, TOUCH, Recording
from framework.kinematics.continuation.forward_kinematics import forward_kinematics_stack
from framework.kinematics.continuation.motor_curves import close_at_motors
from framework.kinematics.continuation.tracking import assemble, reach_of_links
from framework.kinematics.frames import difference, frames_at, integrate_columns
from framework.kinematics.inverse_kinematics import close_each
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import shares_beyond_limits
from framework.model.robot_file_writer import write_robot_file
from framework.numerics.arrays import Array, IntArray, Names, ReadOnlyArrays
from framework.numerics.fields import positive
from framework.numerics.output import Document, plain, select_fields
from framework.numerics.rotations import whole_turns
from framework.tolerances import (
    LOOP_GAP,
    MAX_MOTOR_MISFIT,
    MAX_NOISE_RATIO,
    MAX_PRIOR_DEVIATIONS,
    RANK_ROUNDING,
)

LENGTH_ERROR = 1e-3  # [m] standard deviation of the file's lengths, typical of a machine shop
ANGLE_ERROR = float(np.radians(1.0))  # [rad] standard deviation of the file's angles
NOISE = {"motor_angle": 3e-5, "joint": 1e-4, "platform": 2e-5}  # standard deviations [rad, m], by kind


class FurtherPoses(NamedTuple):
    """Poses to measure next, with the same sensors."""

    platform: Array  # (k, n)
    deviations: Array  # (p,) of the parameters if these are measured too [m, rad]


@dataclass(frozen=True, eq=False)
class Calibration(ReadOnlyArrays):
    """A calibrated geometry, validated by poses that were held out.

    Attributes:
        values, deviations: (p,) changes of `geometry.names` from the file [m, rad], and their standard
            deviations.
        combinations: the parameter combinations that the data determine; other directions keep the prior.
        unseen: descriptions of the directions that the data do not determine, with remedies.
        further: poses that show most of what these data leave to the file.
        poses: source of the poses from which the fit starts: motors, or platform where motors lead to other
            poses than the measured ones, or to none.
        error_before, error_after: (m,) root mean square errors of the columns of `measured`, predicted from
            the source at the instants held out; zero for the source itself.
        noise: ratio of the residual to the assumed noise, by which deviations are scaled; 1 if the data are
            too few to estimate it. If the noise is estimated, deviations are widened by Student's t, so that
            an interval of three deviations has the same probability as with known noise.
        degrees_of_freedom: number of equations minus number of parameters that they determine; the noise is
            estimated if this is at least 1.
    """

    robot: ParallelRobot
    geometry: Geometry
    measured: Measurements
    values: Array
    deviations: Array
    combinations: Combinations
    unseen: Names
    further: FurtherPoses
    poses: str
    error_before: Array
    error_after: Array
    noise: float
    degrees_of_freedom: float
    outliers: tuple[int, ...]  # instants with a weight below one half
    outlier_rows: Names  # where they stand in the file
    instants: int
    left_out: int  # rows of the file without all numbers, or that repeat the one before
    steps: int
    seconds: float

    def errors_held_out(self) -> list[tuple[str, float, float]]:
        """Return name and errors before and after [rad, m] of each column but the source."""
        before, after = self.error_before.tolist(), self.error_after.tolist()
        errors = [*zip(self.measured.names, before, after, strict=True)]
        del errors[self.measured.columns_of(self.poses)]
        return errors

    def calibrated_robot(self) -> ParallelRobot:
        """Return the robot with the calibrated geometry."""
        return ParallelRobot.from_description(self.geometry.description(self.values))

    def write(self, folder: str | Path, *, overwrite: bool = False) -> Path:
        """Write the robot file and the URDF with the calibrated geometry; return the robot file.

        Raises:
            OutputError: the folder cannot be written; they would overwrite the files that were read or,
                without `overwrite`, files that somebody has edited.
        """
        description = self.geometry.description(self.values)
        comments = ["Its geometry was calibrated."]
        return write_robot_file(description, folder, comments=comments, overwrite=overwrite)

    def to_dict(self) -> Document:
        """Return all numbers, for JSON."""
        parameters = zip(self.geometry.names, self.values, self.deviations, strict=True)
        keys = ("noise", "degrees_of_freedom", "outliers", "outlier_rows", "instants", "left_out")
        document: Document = {
            "robot": self.robot.name,
            **select_fields(self.combinations, "rank", "gap"),
            "poses": self.poses,
            "parameters": {
                name: {"value": value, "standard_deviation": deviation}
                for name, value, deviation in parameters
            },
            "unseen": self.unseen,
            "further_poses": {
                "platform": [dict(zip(self.robot.axis_names, x, strict=True)) for x in self.further.platform],
                "standard_deviations": dict(zip(self.geometry.names, self.further.deviations, strict=True)),
            },
            "errors_held_out": {
                name: {"before": before, "after": after} for name, before, after in self.errors_held_out()
            },
            **select_fields(self, *keys, "steps", "seconds"),
        }
        return plain(document)


def calibrate(
    robot: ParallelRobot,
    data: Recording | str | Path,
    *,
    joints: Sequence[str] | None = None,
    noise: Mapping[str, float] | None = None,
    length_error: float = LENGTH_ERROR,
    angle_error: float = ANGLE_ERROR,
    conversions: Conversions | None = None,
    progress: Callable[[int], None] = lambda steps: None,
) -> Calibration:
    """Calibrate the origins of joints and closure frames from measured poses.

    Args:
        data: a recording of motor angles and of platform coordinates or angles of other joints; or the name
            of its file.
        joints: joints whose origins are calibrated, and closures whose lengths are; by default all lengths,
            and all joints between the base and the frames of the platform and of closures. Or names of
            numbers under `parameters:` of the robot file, on which these depend.
        noise: standard deviations of measurements by kind: `motor_angle`, `joint`, `platform` [rad, m].
        length_error, angle_error: standard deviations of the file's dimensions [m, rad].
        conversions: units, signs and exchanged columns of the data.
        progress: called with the number of steps tried.

    Raises:
        InvalidInput: data are wrong or too few; motors are redundant; joints or kinds of noise are unknown.
        NotAssembled: the loops do not close at some motor angles.
        NotConverged: the steps do not converge, or converge far outside the errors assumed of the file.
    """
    started = clock.perf_counter()
    for name in noise or {}:
        check_choice("kind of noise", name, NOISE)
    noises = {**NOISE, **(noise or {})}
    for name, value in {**noises, "length_error": length_error, "angle_error": angle_error}.items():
        positive(name, value)
    geometry = parametrise_geometry(robot, joints)
    data = load_recording(robot, data, conversions).complete()
    measured = select_measurements(geometry, data, noises)
    is_test = np.arange(len(data)) % HELD_OUT_EVERY == HELD_OUT_EVERY - 1
    if not is_test.any():
        raise InvalidInput(f"{data.source}: {len(data)} rows; at least {HELD_OUT_EVERY} are needed")
    _refuse_mistaken_columns(geometry, data, noises)
    q, source = _solve_poses(geometry, measured, _solve_at_motors)  # (T, nq)
    geometry = place_fixtures(geometry, measured, q)
    prior = geometry.prior(length_error, angle_error)  # (p,) standard deviations

    # fit the parameters to three quarters of the instants
    training = measured.select_instants(~is_test)
    training_q = q[~is_test]
    fit = fit_geometry(geometry, training, training_q, prior, progress)
    _check_plausible(geometry, fit.values / prior, fit.noise)
    # what measurements or loops determine is examined at the file's geometry; the slopes of measurements are
    # over the noise, those of the loops over LOOP_GAP, which is far smaller
    equations = eliminate_poses(geometry, training, training_q, np.zeros_like(prior))
    loop_rows = np.concatenate(equations.loop_slopes) * LOOP_GAP / measured.noise.min()
    combinations = find_combinations(np.concatenate([*equations.matrix, loop_rows]), prior)

    outliers = np.flatnonzero(~is_test)[fit.weights**2 < 0.5].tolist()
    # predict the other instants with the file's parameters, and with the fitted ones
    test = measured.select_instants(is_test)
    predict_error = partial(_prediction_error, geometry, test, q[is_test], source)
    return Calibration(
        robot=robot,
        geometry=geometry,
        measured=measured,
        values=fit.values,
        deviations=fit.deviations,
        combinations=combinations,
        unseen=_describe_unseen(geometry, training, training_q, equations, combinations),
        further=_choose_further_poses(geometry, training, prior, fit),
        poses=source,
        error_before=predict_error(np.zeros_like(prior)),
        error_after=predict_error(fit.values),
        noise=fit.noise,
        degrees_of_freedom=fit.degrees_of_freedom,
        outliers=tuple(outliers),
        outlier_rows=tuple(map(data.row, outliers)),
        instants=len(data),
        left_out=data.left_out,
        steps=fit.steps,
        seconds=clock.perf_counter() - started,
    )


def _solve_poses(
    geometry: Geometry, measured: Measurements, solve: Callable[[ParallelRobot, Array], Array]
) -> tuple[Array, str]:
    """Solve the poses q (T, nq) at the measured motors, else at the measured platform; name which of both.

    Beyond a Type 2 singularity, where assembly modes meet, motors lead to another pose than the measured one
    or to none. A platform that is measured whole does determine the pose, in the reference's working mode.

    Args:
        solve: `_solve_at_motors`, or that with a memory.

    Raises:
        NotAssembled: the loops do not close at some motor angles, and the platform does not help.
    """
    model = geometry.model
    has_platform = len(measured.axes) == model.n
    try:
        q = solve(model, measured.values[:, measured.columns_of("motors")])
    except NotAssembled:
        by_platform = _solve_at_platform(geometry, measured) if has_platform else None
        if by_platform is None:
            raise
        return by_platform, "platform"
    if has_platform:
        x = measured.values[:, measured.columns_of("platform")]
        offset = model.platform.residual(frames_at(model, q), x) / model.platform_scale
        if np.abs(offset).max() > MAX_MOTOR_MISFIT:
            by_platform = _solve_at_platform(geometry, measured)
            if by_platform is not None:
                return by_platform, "platform"
    return q, "motors"


def _solve_at_motors(model: ParallelRobot, motors: Array) -> Array:
    """Solve the forward kinematics q (T, nq) at motor joints (T, n_a).

    Raises:
        NotAssembled: the loops do not close at some of them.
    """
    for rows in (motors[:1], motors):  # columns in a wrong unit are refused at the first instant
        stack = forward_kinematics_stack(model, rows)
        for refusal in stack.refused.values():
            raise refusal  # of the first refused instant
    return stack.q


def _solve_at_platform(geometry: Geometry, measured: Measurements) -> Array | None:
    """Solve the poses q (T, nq) of the measured platform; None out of reach, or where motors contradict."""
    robot, model = geometry.robot, geometry.model
    motors = measured.values[:, measured.columns_of("motors")]  # (T, n_a)
    platform = measured.values[:, measured.columns_of("platform")]  # (T, n)
    # motors slide as far as they are measured, if they do not contradict, and other slides without bound
    travel = np.full(robot.nv, np.inf)
    travel[robot.actuated] = np.abs(motors).max(axis=0) + MAX_MOTOR_MISFIT * robot.length
    distances = np.linalg.norm(platform[:, robot.platform.sliding], axis=1)  # (T,) [m] from the base
    if distances.max() > reach_of_links(robot, travel):
        return None
    robot_q = []
    for x, q_a in zip(platform, motors, strict=True):
        try:
            robot_q.append(assemble(robot, x).q)
        except (NoAnswer, InvalidInput):
            return None
        offset = q_a - robot.actuated_coordinates(robot_q[-1][None])
        if motor_distances(robot, offset).max() > MAX_MOTOR_MISFIT:
            return None
    # the model has the robot's joints, in the same order between those of its parameters
    motion = difference(robot, robot.reference.q, np.array(robot_q))[:, robot.joints]
    start = np.tile(model.reference.q, (len(motion), 1))
    q = integrate_columns(model, start, model.joints, motion)
    turns = whole_turns(motors - model.actuated_coordinates(q))
    turns[:, robot.sliding[robot.actuated]] = 0.0
    return integrate_columns(model, q, model.actuated, turns)


def _refuse_mistaken_columns(geometry: Geometry, data: Recording, noise: dict[str, float]) -> None:
    """Raise InvalidInput if a recording fits the file's geometry once one column is changed.

    Changes are those of `refuse_mistaken_columns`, such as another sign or unit.
    """
    max_instants = 24  # each change needs the poses at all of them
    poses: dict[bytes, Array] = {}  # (T, nq) by the motors' positions, which most changes leave as they are

    def solve(model: ParallelRobot, motors: Array) -> Array:
        """Solve the poses at motor joints (T, n_a) that have not been solved yet."""
        key = motors.tobytes()
        if key not in poses:
            poses[key] = _solve_at_motors(model, motors)
        return poses[key]

    def misfit(recording: Recording) -> float:
        """Compute the mean squared offset of measurements from the model, over their squared spread."""
        measured = select_measurements(geometry, recording, noise)  # values (T, m)
        q, source = _solve_poses(geometry, measured, solve)
        placed = place_fixtures(geometry, measured, q)
        unchanged = np.zeros(len(placed.names))  # the parameters are those of the file
        offset, *_ = measurement_offsets(
            placed, geometry.model, measured, frames_at(geometry.model, q), unchanged
        )
        spread = measured.values.std(axis=0)  # (m,)
        is_touch = [name.startswith(TOUCH) for name in measured.names]
        spread[is_touch] = geometry.robot.length  # in place of their own, as touches are about zero
        counted = np.delete(np.arange(len(spread)), measured.columns_of(source))  # not those that poses meet
        offset_square = np.mean((offset / measured.noise)[:, counted] ** 2)
        spread_square = np.mean((spread / measured.noise)[counted] ** 2)
        return float(offset_square / spread_square)

    some = data.rows(slice(None, None, max(1, len(data) // max_instants)))
    refuse_mistaken_columns(some, ("motor_angle", "joint", "platform", "distance"), misfit)


def _check_plausible(geometry: Geometry, prior_ratios: Array, noise_ratio: float) -> None:
    """Raise NotConverged for implausible noise, or implausible changes of the parameters.

    Args:
        prior_ratios: (p,) changes of the parameters over their prior standard deviations.
        noise_ratio: of the residual to the assumed noise.
    """
    if noise_ratio > MAX_NOISE_RATIO:
        raise NotConverged(
            f"the residual of the data is {noise_ratio:.3g} times the assumed noise; "
            f"raise length_error or angle_error, give the noise, or look at the data",
            name=geometry.robot.name,
            residual=noise_ratio,
        )
    worst = np.abs(prior_ratios).argmax()
    largest = float(abs(prior_ratios[worst]))
    if largest > MAX_PRIOR_DEVIATIONS:
        raise NotConverged(
            f"{geometry.names[worst]} would differ from the file by {largest:.3g} "
            f"times the file's assumed error; raise length_error or angle_error, or look at the data",
            name=geometry.robot.name,
            residual=largest,
        )


def _prediction_error(
    geometry: Geometry, measured: Measurements, q: Array, source: str, values: Array
) -> Array:
    """Compute root mean square errors (m,) [rad, m] of measurements predicted from those of the source.

    Motors or platform are moved to their measured positions, and the parameters to `values` (p,). Then the
    loops are closed.

    Raises:
        NotConverged: the loops do not close.
    """
    model = geometry.with_lengths(values)
    leading = measured.values[:, measured.columns_of(source)]  # (T, n_a) or (T, n)
    dimensions = geometry.dimensions(values)
    if source == "motors":
        steps = leading - model.actuated_coordinates(q)
        start = _move_poses(model, q, model.actuated, steps, dimensions)
        closed = close_at_motors(model, start, np.zeros((len(start), model.model.nv)), start)
    else:
        start = _move_poses(model, q, model.actuated[:0], np.zeros((len(q), 0)), dimensions)
        closed = close_each(model, leading, start)
    if not closed.closed.all():
        worst = np.argmin(closed.closed)
        raise NotConverged(
            f"at pose {worst + 1} of those held out the loops do not close at the measured "
            f"{source}; these data are of another robot, or the file is too far off",
            name=model.name,
            residual=float(closed.linearised.gap[worst]),
        )
    frames = closed.linearised.frames
    offset, *_ = measurement_offsets(geometry, model, measured, frames, values)  # (T, m)
    return np.sqrt(np.mean(offset**2, axis=0))


def _move_poses(model: ParallelRobot, q: Array, columns: IntArray, steps: Array, change: Array) -> Array:
    """Move columns (k,) of q (T, nq) by steps (T, k), and the dimensions by a change (g,).

    The first dimensions are the elastic columns of the model, the others are no joints.
    """
    parameter_steps = np.tile(change[: model.n_e], (len(q), 1))
    columns = np.concatenate([columns, model.elastic])
    return integrate_columns(model, q, columns, np.hstack([steps, parameter_steps]))


def _describe_unseen(
    geometry: Geometry,
    measured: Measurements,
    q: Array,
    equations: ParameterEquations,
    combinations: Combinations,
) -> Names:
    """Describe the parameter directions that the data do not determine, with remedies.

    A step along such a direction moves the joints while all measurements stay the same. A sensor that was not
    used would determine the direction if its value changes during this motion.

    Args:
        measured, q, equations: measurements, poses (T, nq) and equations of the instants of the fit.
        combinations: of the parameters, with the undetermined directions `unseen`.
    """
    model = geometry.model
    slopes = sensor_slopes(model, q)
    to_dimensions = geometry.slopes(np.zeros(len(geometry.names)))
    unused = [name for name in slopes if name not in measured.names]
    sentences = []
    for direction in combinations.unseen:
        motion = np.zeros((len(q), model.model.nv))
        motion[:, model.joints] = equations.joint_slopes @ direction  # keeps the loops closed
        motion[:, model.elastic] = (to_dimensions @ direction)[: model.n_e]
        # a sensor shows the direction if its value changes by more than rounding
        rounding = COEFFICIENT_ROUNDING * np.abs(motion / model.column_scale).max()
        changes = {name: np.abs(np.vecdot(slopes[name], motion)).max() for name in unused}
        sensor = next((name for name, change in changes.items() if change > rounding), None)
        advice = f"{sensor} would show it" if sensor else "no pose or joint angle depends on it"
        sentences.append(f"{describe_unseen_direction(geometry.names, direction)}; {advice}")
    return tuple(sentences)


def _choose_further_poses(
    geometry: Geometry, measured: Measurements, prior: Array, fit: GeometryFit
) -> FurtherPoses:
    """Choose the poses whose measurements add most to those of the fit.

    Of random poses within the joints' ranges each one chosen multiplies the determinant of the information
    most: by det(1 + A C A'), where A are its equations and C is the covariance so far (D-optimal design;
    Fedorov, "Theory of Optimal Experiments", 1972).
    """
    count = 6  # as many as an afternoon allows, and more than a leg has unknowns
    candidates = 100
    try:
        q, x = random_poses(geometry.model, candidates, np.random.default_rng(0))
    except NotAssembled:  # no platform poses beside the reference
        return FurtherPoses(np.empty((0, geometry.model.n)), fit.deviations)
    is_within = ~shares_beyond_limits(geometry.model.limits, q).any(axis=1)
    q, x = q[is_within], x[is_within]
    blank = replace(measured, values=np.zeros((len(q), len(measured.names))))  # equations do not need these
    rows = eliminate_poses(geometry, blank, q, fit.values).matrix * prior / fit.noise  # (candidates, m, p)
    root = fit.root / prior[:, None]
    covariance = root @ root.T
    start = np.diag(covariance)
    chosen = []
    for _ in range(min(count, len(q))):
        spread = rows @ covariance @ rows.swapaxes(1, 2) + np.eye(rows.shape[1])  # (candidates, m, m)
        best = int(np.argmax(np.linalg.slogdet(spread)[1]))
        gain = rows[best] @ covariance  # (m, p)
        covariance = covariance - gain.T @ np.linalg.solve(spread[best], gain)
        chosen.append(best)
    return FurtherPoses(x[chosen], fit.deviations * np.sqrt(np.diag(covariance) / start))


# ------------------------------------------------------------------ the fit


class GeometryFit(NamedTuple):
    """Changes of p parameters from the file, fitted to T instants."""

    values: Array  # (p,) [m, rad]
    root: Array  # (p, p) S, where S S' is their covariance by data and prior
    deviations: Array  # (p,) widened by Student's t
    weights: Array  # (T,) square roots of Huber's weights, which multiply residuals
    noise: float  # ratio of the residual to the assumed noise
    degrees_of_freedom: float
    steps: int  # that were tried


def fit_geometry(
    geometry: Geometry,
    measured: Measurements,
    q: Array,
    prior: Array,
    progress: Callable[[int], None],
) -> GeometryFit:
    """Fit parameters and poses by a damped Gauss-Newton method.

    The cost is a sum of squares: of the residuals over the noise, weighted by instant; of loop equations that
    no joint can close; and of the parameters' changes over their prior deviations. A step that raises it is
    repeated with ten times the damping (Levenberg and Marquardt). With each step of the parameters the poses
    take the step that keeps the linearised loops closed and the residuals least.

    Args:
        q: (T, nq) poses by the file's geometry.
        prior: (p,) standard deviations of the file's parameters [m, rad].
        progress: called with the number of steps tried.

    Raises:
        NotConverged: the steps do not converge.
    """
    max_steps = 200  # a ball bar beside a plane of poses leads through a curved valley in 130
    max_damping = 1e9  # relative to the prior
    converged = 1e-6  # largest change of a parameter in the last step, over its prior deviation
    width = 3.0  # deviations at whose probability Student's quantile widens
    from scipy.special import ndtr, stdtrit  # slow to import

    model = geometry.model
    values = np.zeros_like(prior)
    damping = 1e-3
    equations = eliminate_poses(geometry, measured, q, values)
    state = _weigh(equations, values, prior, np.ones(len(q)))
    cost = state.cost(equations, values, prior)
    steps = 0
    while steps < max_steps and damping <= max_damping:
        steps += 1
        progress(steps)
        # step the parameters, and the joints with them
        change = state.step(damping)  # (p,)
        joint_steps = equations.joint_step + equations.joint_slopes @ change
        dimension_steps = geometry.dimensions(values + change) - geometry.dimensions(values)  # (g,)
        next_q = _move_poses(model, q, model.joints, joint_steps, dimension_steps)
        following = eliminate_poses(geometry, measured, next_q, values + change)

        # the cost must not rise by more than rounding, nor become NaN
        allowed = cost * (1.0 + RANK_ROUNDING) + RANK_ROUNDING
        if not state.cost(following, values + change, prior) <= allowed:
            damping *= 10.0
            continue

        q, values, equations = next_q, values + change, following
        damping = max(0.1 * damping, 1e-12)  # never 0, from which it could not rise again
        state = _weigh(equations, values, prior, state.weights)
        cost = state.cost(equations, values, prior)  # of the new weights, to compare the next step with
        if np.abs(change / prior).max() < converged:
            break
    else:
        raise NotConverged(
            f"calibration does not converge after {steps} steps; the file is too far off for these data, "
            f"they are of another robot, or they pass a Type 2 singularity, behind which motors do not tell "
            f"the pose",
            name=model.name,
            residual=cost,
        )

    # the noise from all residuals, and deviations widened to the probability of three normal ones
    count = len(q) * equations.per_instant
    squares = np.sum((state.weights[:, None] * equations.residual) ** 2)
    noise, freedom = _estimate_noise(state.s, count, float(np.sqrt(squares / count)))
    root = state.root / np.sqrt(1.0 + (state.s / noise) ** 2)
    widening = stdtrit(freedom, ndtr(width)) / width if freedom >= 1.0 else 1.0
    deviations = widening * np.linalg.norm(root, axis=1)
    return GeometryFit(values, root, deviations, state.weights, noise, freedom, steps)


class _Weighted(NamedTuple):
    """Linear equations of the unknowns y with parameters = root y, weighted by instant.

    By the prior and the loop equations that no joint can close, y are independent unit normals. The data say
    s y + right = noise, and the gradient of the other terms of the cost by y is `gradient`.
    """

    root: Array  # (p, p)
    s: Array  # (p,) singular values
    right: Array  # (p,)
    gradient: Array  # (p,)
    weights: Array  # (T,) square roots of Huber's weights
    noise: float  # over the assumed noise

    def step(self, damping: float) -> Array:
        """Compute the damped Gauss-Newton step (p,) of the parameters."""
        s, right = self.s / self.noise, self.right / self.noise
        return -self.root @ ((s * right + self.gradient) / (s**2 + 1.0 + damping))

    def cost(self, equations: ParameterEquations, values: Array, prior: Array) -> float:
        """Compute the dimensionless cost of `fit_geometry` at parameters (p,), weights and noise fixed."""
        scale = self.weights[:, None] / self.noise
        parts = (scale * equations.residual, equations.loop_residual, values / prior)
        return float(sum(np.sum(part**2) for part in parts))


def _weigh(equations: ParameterEquations, values: Array, prior: Array, weights: Array) -> _Weighted:
    """Reduce the equations to p, with the noise and the weights that residuals give, from earlier ones (T,).

    The noise is estimated from the median residual. An instant with a residual r above the noise times
    h = `huber_ratio` has Huber's weight h noise / r, so that its cost grows linearly (Huber, Annals of
    Mathematical Statistics 35, 1964).
    """
    huber_ratio = 2.0
    p = len(prior)
    loops = np.concatenate(equations.loop_slopes)
    prior_root = prior[:, None] * posterior_root(loops * prior)
    residuals = np.sqrt(np.sum(equations.residual**2, axis=1) / equations.per_instant)  # (T,)

    def reduce_rows(weights: Array) -> Array:
        """Reduce the weighted equations and residuals to R (p + 1, p + 1)."""
        rows = np.concatenate(weights[:, None, None] * equations.matrix) @ prior_root
        right = (weights[:, None] * equations.residual).ravel()
        augmented = np.concatenate([np.column_stack([rows, right]), np.zeros((p + 1, p + 1))])
        return np.asarray(np.linalg.qr(augmented, mode="r"))

    sizes = np.asarray(np.linalg.svd(reduce_rows(weights)[:p, :p], compute_uv=False), float)  # (p,)
    noise, _ = _estimate_noise(sizes, len(weights) * equations.per_instant, float(np.median(residuals)))
    weights = np.sqrt(np.minimum(1.0, huber_ratio * noise / np.maximum(residuals, RANK_ROUNDING)))
    R = reduce_rows(weights)
    U, s, V_rows = np.linalg.svd(R[:p, :p])
    root = prior_root @ V_rows.T
    gradient = root.T @ (values / prior**2) + (loops @ root).T @ equations.loop_residual.ravel()
    return _Weighted(root, s, U.T @ R[:p, p], gradient, weights, noise)


def _estimate_noise(s: Array, count: int, residual: float) -> tuple[float, float]:
    """Compute the noise n, relative to the assumed noise, and the degrees of freedom N - r(n).

    `residual` is the root mean square of the N residuals. With a prior, a fit of N equations determines only
    r(n) = sum of s^2 / (s^2 + n^2) parameters, where s are the singular values of the rows. This is the
    effective number of parameters of ridge regression (Hastie, Tibshirani and Friedman, The Elements of
    Statistical Learning, 2009, section 3.4.1). The expected sum of squared residuals n^2 (N - r(n)) grows
    with n, and n solves n^2 (N - r(n)) = N residual^2. If less than one degree of freedom is left, the noise
    is the assumed noise, n = 1. Residuals below `least_noise` count as rounding.
    """
    least_noise = 1e-3  # share of the assumed noise
    from scipy.optimize import brentq  # slow to import

    def freedom_at(noise: float) -> float:
        """Compute the degrees of freedom N - r(n) at n = noise."""
        return count - float(np.sum(s**2 / (s**2 + noise**2)))

    def excess(noise: float) -> float:
        """Compute n^2 (N - r(n)) - N residual^2, which grows with n = noise."""
        return noise**2 * freedom_at(noise) - count * residual**2

    if freedom_at(least_noise) < 1.0:
        return 1.0, freedom_at(least_noise)
    noise = least_noise
    if excess(least_noise) < 0.0:  # else the residuals are rounding
        # with N - r(n) >= 1 the solution is at most sqrt(N) residual
        largest = max(residual * np.sqrt(count), 1.0)
        noise = float(brentq(excess, least_noise, largest, xtol=RANK_ROUNDING * least_noise))
    return noise, freedom_at(noise)
