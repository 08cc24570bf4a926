"""Calibration of the geometry from motor angles and measured poses, or parts of poses.

Damped Gauss-Newton steps solve for all poses and parameters together, with a prior at the robot file's values
and Huber's weights against outliers. Directions that the data do not determine keep the file's values and are
reported.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from framework.errors import InvalidInput, NotConverged, check_choice
from framework.identification.calibration_equations import (
    Measurements,
    ParameterEquations,
    eliminate_poses,
    encoder_names,
    measurement_offsets,
    select_measurements,
)
from framework.identification.combinations import Combinations, find_combinations, format_combination
from framework.identification.geometry import Geometry, parametrise_geometry
from framework.identification.recording import Recording, load_recording
from framework.kinematics.continuation.motor_curves import close_at_motors
from framework.kinematics.continuation.pose_stack import forward_kinematics_stack
from framework.kinematics.frames import frames_at, integrate_columns
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.model.robot_file_writer import write_robot_file
from framework.numerics.arrays import Array, ReadOnlyArrays
from framework.numerics.fields import positive
from framework.numerics.output import Document, plain, select_fields
from framework.tolerances import LOOP_GAP, MAX_NOISE_RATIO, MAX_PRIOR_DEVIATIONS, RANK_ROUNDING

LENGTH_ERROR = 1e-3  # [m] standard deviation of the file's lengths, as of a machine shop
ANGLE_ERROR = float(np.radians(1.0))  # [rad] standard deviation of the file's angles
NOISE = {"motor_angle": 3e-5, "joint": 1e-4, "platform": 2e-5}  # standard deviations [rad, m], by kind
HELD_OUT_EVERY = 4  # instants: one of so many is kept for validation
MIN_RESPONSE = 1e-6  # of a measurement to a direction, over its largest motion [robot lengths, rad]
HUBER = 2.0  # residual of an instant over the median residual, above which its weight falls
MAX_STEPS, FIRST_DAMPING, MAX_DAMPING = 60, 1e-3, 1e9  # damping is over the prior's weight
CONVERGED = 1e-6  # largest change of a parameter in the last step, over its prior deviation
DEVIATIONS = 3.0  # standard deviations at which Student's distribution is compared with the normal one
LEAST_NOISE = 1e-3  # residuals over the assumed noise that count as rounding


@dataclass(frozen=True, eq=False)
class Calibration(ReadOnlyArrays):
    """A calibrated geometry, validated by poses that were not used.

    Attributes:
        values, deviations: (p,) of `geometry.names` [m, rad], off the file's, with standard deviations.
        combinations: of the parameters that the data determine; other directions keep the prior.
        error_before, error_after: (m,) by column of `measured`, root mean square error of predictions from
            the motors' angles at instants held out; zero for the motors themselves.
        noise: residual over the assumed noise, by which deviations are scaled; 1 if the data are too few to
            estimate it. If it is estimated, deviations are widened by Student's t, so that an interval of
            three deviations has the same probability as with known noise.
        degrees_of_freedom: number of equations less number of parameters that they determine; the noise is
            estimated if it is at least 1.
    """

    robot: ParallelRobot
    geometry: Geometry
    measured: Measurements
    values: Array
    deviations: Array
    combinations: Combinations
    unseen: tuple[str, ...]
    error_before: Array
    error_after: Array
    noise: float
    degrees_of_freedom: float
    outliers: tuple[int, ...]  # instants that count for less than half
    instants: int
    steps: int
    seconds: float

    def calibrated_robot(self) -> ParallelRobot:
        """Return the robot with the calibrated geometry."""
        return ParallelRobot.from_description(self.geometry.description(self.values))

    def write(self, folder: str | Path) -> Path:
        """Write the robot file and the URDF with the calibrated geometry; return the robot file.

        Raises:
            OutputError: the folder cannot be written, or they would overwrite the files that were read.
        """
        description = self.geometry.description(self.values)
        return write_robot_file(description, folder, comments=["Its geometry was calibrated."])

    def to_dict(self) -> Document:
        """Return all numbers, for JSON."""
        parameters = zip(self.geometry.names, self.values, self.deviations, strict=True)
        errors = zip(self.measured.names, self.error_before, self.error_after, strict=True)
        document: Document = plain(
            {
                "robot": self.robot.name,
                "rank": self.combinations.rank,
                "gap": self.combinations.gap,
                "parameters": {
                    name: {"value": value, "standard_deviation": deviation}
                    for name, value, deviation in parameters
                },
                "unseen": self.unseen,
                "errors_held_out": {
                    name: {"before": before, "after": after}
                    for name, before, after in islice(errors, self.measured.driven, None)
                },
                **select_fields(
                    self, "noise", "degrees_of_freedom", "outliers", "instants", "steps", "seconds"
                ),
            }
        )
        return document


def calibrate(
    robot: ParallelRobot,
    data: Recording | str | Path,
    *,
    joints: Sequence[str] | None = None,
    noise: Mapping[str, float] | None = None,
    length_error: float = LENGTH_ERROR,
    angle_error: float = ANGLE_ERROR,
    progress: Callable[[int], None] = lambda steps: None,
) -> Calibration:
    """Calibrate the origins of joints and closure frames by measured poses.

    Args:
        data: motor angles, with coordinates of the platform or angles of other joints; or the name of its
            file.
        joints: whose origins are calibrated; by default all between the base and the frames of the platform
            and of closures, see `parametrise_geometry`.
        noise: standard deviations of measurements, by kind: `motor_angle`, `joint`, `platform`.
        length_error, angle_error: standard deviations of the file's dimensions [m, rad].
        progress: called with the number of steps tried.

    Raises:
        InvalidInput: wrong or too few data; redundant motors; unknown joints or kinds of noise.
        NotAssembled: the loops do not close at some motor angles.
        NotConverged: the steps do not settle, or settle far outside the errors that the file may have.
    """
    expect_robot(robot)
    started = clock.perf_counter()
    noise = noise or {}
    _check_errors(noise, length_error=length_error, angle_error=angle_error)
    geometry = parametrise_geometry(robot, joints)
    data = load_recording(robot, data)
    measured = select_measurements(geometry, data, {**NOISE, **noise})
    is_test = np.arange(len(data)) % HELD_OUT_EVERY == HELD_OUT_EVERY - 1
    if not is_test.any():
        raise InvalidInput(f"{data.source}: {len(data)} rows; at least {HELD_OUT_EVERY} are needed")
    start = _solve_poses(geometry.model, measured)
    used = measured.select_instants(~is_test)
    prior = np.where(geometry.turning, angle_error, length_error)
    solver = GaussNewton(geometry.model, used, start[~is_test], prior)
    solver.run(robot.name, progress)
    _check_plausible(robot, geometry, solver.values / prior, solver.noise)
    combinations, at_file = _find_combinations(geometry, used, start[~is_test], prior)
    test = measured.select_instants(is_test)
    error_before = _prediction_error(geometry.model, test, start[is_test], np.zeros_like(prior))
    error_after = _prediction_error(geometry.model, test, start[is_test], solver.values)
    return Calibration(
        robot=robot,
        geometry=geometry,
        measured=measured,
        values=solver.values,
        deviations=solver.deviations,
        combinations=combinations,
        unseen=_describe_unseen(geometry, used, start[~is_test], at_file, combinations),
        error_before=error_before,
        error_after=error_after,
        noise=solver.noise,
        degrees_of_freedom=solver.freedom,
        outliers=tuple(np.flatnonzero(~is_test)[solver.weights**2 < 0.5].tolist()),
        instants=len(data),
        steps=solver.count,
        seconds=clock.perf_counter() - started,
    )


def _check_errors(noise: Mapping[str, float], **file_errors: float) -> None:
    """Refuse unknown kinds of noise and errors that are not positive."""
    for name in noise:
        check_choice("kind of noise", name, NOISE)
    for name, value in {**noise, **file_errors}.items():
        positive(name, value)


def _solve_poses(model: ParallelRobot, measured: Measurements) -> Array:
    """Solve the forward kinematics q (T, nq) at the measured motor angles.

    The geometry is the file's.
    """
    stack = forward_kinematics_stack(model, measured.values[:, : measured.driven])
    for refusal in stack.refused.values():
        raise refusal
    return stack.q


def _find_combinations(
    geometry: Geometry, measured: Measurements, q: Array, prior: Array
) -> tuple[Combinations, ParameterEquations]:
    """Find the parameter combinations that data or loops determine at q (T, nq).

    q are poses of the file's geometry. Return also the equations there.
    """
    equations = eliminate_poses(geometry.model, measured, q)
    loop_rows = equations.loop_slopes * LOOP_GAP / measured.noise.min()  # in units of the noise
    rows = np.concatenate([merge_rows(equations.matrix), merge_rows(loop_rows)])
    return find_combinations(rows, prior), equations


def _check_plausible(robot: ParallelRobot, geometry: Geometry, deviations: Array, noise: float) -> None:
    """Refuse implausible noise, or changes (p,) in prior deviations."""
    if noise > MAX_NOISE_RATIO:
        raise NotConverged(
            f"{robot.name}: what is left of the data is {noise:.3g} times the noise that is assumed; raise "
            f"length_error or angle_error, give the noise, or look at the data",
            residual=noise,
        )
    worst = np.abs(deviations).argmax()
    if abs(deviations[worst]) > MAX_PRIOR_DEVIATIONS:
        raise NotConverged(
            f"{robot.name}: {geometry.names[worst]} would be off by {abs(deviations[worst]):.3g} standard "
            f"deviations of what the file may be wrong by; raise length_error or angle_error, or "
            f"look at the data",
            residual=float(abs(deviations[worst])),
        )


def _prediction_error(model: ParallelRobot, measured: Measurements, q: Array, values: Array) -> Array:
    """Compute root mean square errors (m,) of measurements predicted by motor angles.

    From q (T, nq) the motors are moved to their measured angles and the parameters to `values` (p,), then the
    loops are closed.
    """
    motor_steps = measured.values[:, : measured.driven] - model.actuated_coordinates(q)
    steps = np.hstack([motor_steps, np.tile(values, (len(q), 1))])
    q = integrate_columns(model, q, np.concatenate([model.actuated, model.elastic]), steps)
    poses = close_at_motors(model, q, np.zeros((len(q), model.model.nv)), q)
    if not poses.closed.all():
        worst = int(np.argmin(poses.closed))
        raise NotConverged(
            f"{model.name}: at pose {worst + 1} of those held out the loops do not close at the measured "
            f"motor angles; these data are of another robot, or the file is too far off",
            residual=float(poses.linearised.gap[worst]),
        )
    return np.sqrt(np.mean(measurement_offsets(model, measured, poses.linearised.frames).offset ** 2, axis=0))


def _describe_unseen(
    geometry: Geometry,
    measured: Measurements,
    q: Array,
    equations: ParameterEquations,
    combinations: Combinations,
) -> tuple[str, ...]:
    """Describe the parameter directions that the data do not determine, with remedies.

    A direction moves the joints so that all measurements stay the same. Another sensor would show it if the
    sensor's value changes along this motion.
    """
    model = geometry.model
    unused = {name: slope for name, slope in _sensor_slopes(model, q).items() if name not in measured.names}
    sentences = []
    for direction in combinations.unseen:
        motion = np.zeros((len(q), model.model.nv))
        motion[:, model.joints] = equations.follow @ direction
        motion[:, model.elastic] = direction
        least = MIN_RESPONSE * np.abs(motion / model.column_scale).max()
        shown = (name for name, slope in unused.items() if np.abs(np.vecdot(slope, motion)).max() > least)
        name = next(shown, None)
        advice = f"{name} would show it" if name else "no pose or joint angle depends on it"
        sentences.append(f"{describe_unseen_direction(geometry.names, direction)}; {advice}")
    return tuple(sentences)


def _sensor_slopes(model: ParallelRobot, q: Array) -> dict[str, Array]:
    """Compute derivatives (T, nv) of all measurable quantities at q (T, nq), by name.

    These are the position and the rotation of the platform's frame, and the angles of single joints.
    """
    jacobian = frames_at(model, q).frame_jacobian(0)  # (T, 6, nv)
    axes = [*(f"platform_{axis}" for axis in "xyz"), *(f"the platform's turn about {axis}" for axis in "xyz")]
    sensors = {axis: jacobian[:, k] for k, axis in enumerate(axes)}
    for column, name in encoder_names(model).items():
        sensors[name] = np.tile(np.eye(model.model.nv)[column], (len(q), 1))
    return sensors


def describe_unseen_direction(names: Sequence[str], direction: Array) -> str:
    """Describe a direction (p,) of parameters that data do not determine.

    If two parameters change by the same amount, data determine their difference; if by opposite ones, their
    sum.
    """
    used = np.flatnonzero(direction)
    if len(used) == 1:
        return f"{names[used[0]]} not at all"
    if len(used) == 2:
        first, second = direction[used]
        if abs(abs(first) - abs(second)) < MIN_RESPONSE * abs(first):
            kind = "difference" if first * second > 0 else "sum"
            return f"{names[used[0]]} and {names[used[1]]} only as their {kind}"
    return f"no change by {format_combination(names, direction)}"


class GaussNewton:
    """Damped Gauss-Newton method for parameters and poses.

    The cost is the sum of squared residuals over the noise, weighted by instant, plus the squared values over
    their prior deviations.

    values, deviations: (p,) differences of the parameters from the file's, and their standard deviations.
    weights: (T,) square roots of Huber's weights of the instants.
    noise: residual over the assumed noise; freedom: degrees of freedom of this estimate.
    """

    def __init__(self, model: ParallelRobot, measured: Measurements, q: Array, prior: Array) -> None:
        """Start at the file's parameters, all instants of full weight, with the assumed noise."""
        self.model = model
        self.measured = measured
        self.q = q
        self.prior = prior
        self.values = np.zeros(len(prior))
        self.weights = np.ones(len(q))
        self.noise = 1.0
        self.freedom = 0.0
        self.count = 0
        self.deviations = prior

    def run(self, name: str, progress: Callable[[int], None]) -> None:
        """Iterate until no parameter changes; `name` is the robot's.

        A step that raises the cost is repeated with ten times the damping (Levenberg and Marquardt). Poses
        follow the parameters linearly.
        """
        damping = FIRST_DAMPING
        equations = eliminate_poses(self.model, self.measured, self.q)
        cost = self._update_weights(equations)
        for self.count in range(1, MAX_STEPS + 1):
            progress(self.count)
            change = self._damped_step(equations, damping)
            q = self._move_poses(equations, change)
            values = self.values + change
            next_equations = eliminate_poses(self.model, self.measured, q)
            if not self._cost(next_equations, values) <= cost * (1.0 + RANK_ROUNDING) + RANK_ROUNDING:
                damping *= 10.0
                if damping > MAX_DAMPING:
                    break
                continue
            self.q = q
            self.values = values
            equations = next_equations
            damping = max(0.1 * damping, 1e-12)
            cost = self._update_weights(equations)
            if np.abs(change / self.prior).max() < CONVERGED:
                self._estimate_deviations(equations)
                return
        raise NotConverged(
            f"{name}: calibration does not settle after {self.count} steps; the file is too far off for "
            f"these data, or they are of another robot",
            residual=cost,
        )

    def _move_poses(self, equations: ParameterEquations, change: Array) -> Array:
        """Return the poses (T, nq) after a change (p,) of the parameters.

        Joints follow the parameters as the linearised loops demand.
        """
        joint_step = equations.step + equations.follow @ change  # (T, k)
        parameter_step = np.tile(change, (len(joint_step), 1))
        columns = np.concatenate([self.model.joints, self.model.elastic])
        return integrate_columns(self.model, self.q, columns, np.hstack([joint_step, parameter_step]))

    def _weighted_rows(self, equations: ParameterEquations) -> tuple[Array, Array]:
        """Return rows (N, p) of unit noise on parameters over prior deviations.

        Also their residuals (N,). The first rows are the data's, weighted by instant; the others are loop
        equations that no joint can close.
        """
        weights = self.weights[:, None] / self.noise
        matrix = np.concatenate(
            [merge_rows(weights[..., None] * equations.matrix), merge_rows(equations.loop_slopes)]
        )
        residual = np.concatenate([(weights * equations.right).ravel(), equations.open_loops.ravel()])
        return matrix * self.prior, residual

    def _damped_step(self, equations: ParameterEquations, damping: float) -> Array:
        """Compute the damped Gauss-Newton step (p,) of the parameters.

        In units of the prior deviations the rows [data; 1; sqrt(damping)] step = -[residual; values; 0] are
        solved by least squares.
        """
        matrix, residual = self._weighted_rows(equations)
        identity = np.eye(len(self.prior))
        rows = np.concatenate([matrix, identity, np.sqrt(damping) * identity])
        residuals = np.concatenate([residual, self.values / self.prior, np.zeros(len(self.prior))])
        Q, R = np.linalg.qr(rows)
        return -self.prior * np.linalg.solve(R, Q.T @ residuals)

    def _cost(self, equations: ParameterEquations, values: Array) -> float:
        """Compute the cost of equations at parameters `values` (p,), see the class."""
        residual = self._weighted_rows(equations)[1]
        return float(residual @ residual + np.sum((values / self.prior) ** 2))

    def _update_weights(self, equations: ParameterEquations) -> float:
        """Update the noise and Huber's weights of the instants; return the cost.

        The noise is the median residual. An instant whose residual is above HUBER times the noise has the
        weight HUBER noise / residual, so that its cost grows linearly (Huber, Annals of Mathematical
        Statistics 35, 1964).
        """
        rank_per_instant = equations.right.shape[1] - self.measured.driven
        sizes = np.sqrt(np.sum(equations.right**2, axis=1) / max(rank_per_instant, 1))
        self._estimate_noise(equations, np.median(sizes))
        self.weights = np.sqrt(np.minimum(1.0, HUBER * self.noise / np.maximum(sizes, RANK_ROUNDING)))
        return self._cost(equations, self.values)

    def _estimate_deviations(self, equations: ParameterEquations) -> None:
        """Set the noise by all residuals, and deviations of the parameters.

        With R'R = the normal matrix of data and prior, deviations are the norms of the rows of R^-1.
        """
        from scipy.special import ndtr, stdtrit  # takes time to import

        residual = self.weights[:, None] * equations.right
        count = equations.right.size - self.measured.driven * len(self.q)
        self._estimate_noise(equations, np.sqrt(np.sum(residual**2) / max(count, 1)))
        matrix, _ = self._weighted_rows(equations)
        R = np.linalg.qr(np.concatenate([matrix, np.eye(len(self.prior))]), mode="r")
        self.deviations = self.prior * np.linalg.norm(np.linalg.inv(R), axis=1)
        if self.freedom >= 1.0:
            self.deviations *= stdtrit(self.freedom, ndtr(DEVIATIONS)) / DEVIATIONS

    def _estimate_noise(self, equations: ParameterEquations, residual: float) -> None:
        """Estimate the noise s (over the assumed one), and the degrees of freedom.

        `residual` is the root mean square of the N residuals. A fit of N equations with a prior determines
        r(s) = sum of w^2 / (w^2 + s^2) parameters, with w the singular values of the rows: the effective
        number of parameters of ridge regression (Hastie, Tibshirani and Friedman, The Elements of Statistical
        Learning, 2009, section 3.4.1). Its residuals have the expected sum of squares s^2 (N - r(s)) = N
        residual^2, which is solved for s; the left side grows with s. With a freedom N - r below 1 the noise
        is the assumed one.
        """
        count = equations.right.size - self.measured.driven * len(self.q)
        powers = self._squared_singular_values(equations)

        def degrees_of_freedom_at(noise: float) -> float:
            return count - float(np.sum(powers / (powers + noise**2)))

        self.noise = 1.0
        self.freedom = degrees_of_freedom_at(LEAST_NOISE)
        if self.freedom < 1.0:
            return
        from scipy.optimize import brentq  # takes time to import

        def noise_equation(noise: float) -> float:
            return float(noise**2 * degrees_of_freedom_at(noise) - count * residual**2)

        high = max(residual * np.sqrt(count), 1.0)
        self.noise = LEAST_NOISE
        if noise_equation(LEAST_NOISE) < 0.0:
            self.noise = float(brentq(noise_equation, LEAST_NOISE, high, xtol=RANK_ROUNDING * LEAST_NOISE))
        self.freedom = degrees_of_freedom_at(self.noise)

    def _squared_singular_values(self, equations: ParameterEquations) -> Array:
        """Compute squared singular values (p,) of A S.

        A are the data's rows, S S' is the covariance of the prior. The prior combines the deviations D and
        the slopes L of loop equations that no joint can close: (S S')^-1 = D^-2 + L'L. With L D = U diag(w)
        V' that is S = D V diag(1 + w^2)^(-1/2).
        """
        size = len(self.prior)
        # zero rows make w and V complete where there are fewer loop equations than parameters
        loops = np.concatenate([merge_rows(equations.loop_slopes) * self.prior, np.zeros((size, size))])
        triangle = np.linalg.qr(loops, mode="r")  # the same w and V as all rows, at (p, p)
        _, w, V_transposed = np.linalg.svd(triangle)
        rows = merge_rows(self.weights[:, None, None] * equations.matrix) * self.prior
        rows = rows @ V_transposed.T / np.sqrt(1.0 + w**2)
        return np.linalg.eigvalsh(rows.T @ rows).clip(0.0)


def merge_rows(stack: Array) -> Array:
    """Merge a stack (T, m, p) into one matrix (T m, p)."""
    return stack.reshape(-1, stack.shape[2])
