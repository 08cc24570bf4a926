"""Calibration of the geometry from motor angles and measured poses, or parts of poses.

Damped Gauss-Newton steps on all poses and parameters at once, with a prior about the robot file and Huber's
weights against outliers. Directions that the data do not determine stay at the file's values, and are named.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from framework.arrays import Array, ReadOnlyArrays
from framework.errors import InvalidInput, NotConverged, check_choice
from framework.identification.calibration_equations import (
    Measurements,
    ParameterEquations,
    eliminate_poses,
    joint_names,
    measurements_of,
    offsets,
)
from framework.identification.combinations import Combinations, combination_text, determined_combinations
from framework.identification.geometry import Geometry, geometry_of
from framework.identification.recording import Recording, recording_of
from framework.kinematics.closures import loop_equations
from framework.kinematics.continuation.pose_stack import forward_kinematics_stack
from framework.kinematics.frames import frames_at, integrate_columns
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.model.robot_file_writer import write_robot_file
from framework.output import Document, plain
from framework.tolerances import LOOP_GAP, MAX_NOISE_RATIO, MAX_PRIOR_DEVIATIONS, RANK_ROUNDING

LENGTH_ERROR = 1e-3  # [m] of the file, as a machine shop makes it
ANGLE_ERROR = float(np.radians(1.0))  # [rad] likewise
NOISE = {"motor_angle": 3e-5, "joint": 1e-4, "platform": 2e-5}  # standard deviations [rad, m], by kind
HELD_OUT_EVERY = 4  # instants
MAX_CLOSING_STEPS = 20
MIN_RESPONSE = 1e-6  # of a measurement to a direction, over its largest motion [robot lengths, rad]
HUBER = 2.0  # of the usual residual of an instant: larger ones have less weight
MAX_STEPS, FIRST_DAMPING, MAX_DAMPING = 60, 1e-3, 1e9  # damping is a share of the prior's weight
CONVERGED = 1e-6  # of the prior: the largest change of a parameter in the last step
DEVIATIONS = 3.0  # at which Student's distribution and the normal one are compared
LEAST_NOISE = 1e-3  # of residuals over the assumed noise: rounding


@dataclass(frozen=True, eq=False)
class Calibration(ReadOnlyArrays):
    """A calibrated geometry, validated by poses that were held out.

    Attributes:
        values, deviations: (p,) of `geometry.names` [m, rad], about the file's, with standard deviations.
        combinations: of the parameters that the data determine; unseen directions keep the prior.
        error_before, error_after: (m,) by column of `measured`, root mean square of predictions from the
            motors' angles at instants held out; zero for the motors themselves.
        noise: residual over the assumed noise; deviations are scaled by it. It is 1, the assumed noise, if
            the data are too few to estimate it. Else deviations are widened by Student's t for an estimated
            noise: three of them have the probability of three of a known noise.
        degrees_of_freedom: equations less the parameters that they determine; noise is estimated from 1
            upwards.
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
                "noise": self.noise,
                "degrees_of_freedom": self.degrees_of_freedom,
                "outliers": self.outliers,
                "instants": self.instants,
                "steps": self.steps,
                "seconds": self.seconds,
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
    """Calibrate the origins of joints and closure frames from motor angles and measured poses.

    Args:
        data: motor angles, with coordinates of the platform or angles of other joints; or the file of it.
        joints: whose origins are calibrated, by default all that lead to the platform and to frames of
            closures, see `geometry_of`.
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
    geometry = geometry_of(robot, joints)
    data = recording_of(robot, data)
    measured = measurements_of(geometry, data, {**NOISE, **noise})
    test = np.arange(len(data)) % HELD_OUT_EVERY == HELD_OUT_EVERY - 1
    if not test.any():
        raise InvalidInput(f"{data.source}: {len(data)} rows; at least {HELD_OUT_EVERY} are needed")
    start = _start(geometry.model, measured)
    used = measured.rows(~test)
    prior = np.where(geometry.turning, angle_error, length_error)
    solver = GaussNewton(geometry.model, used, start[~test], prior)
    solver.run(robot.name, progress)
    _check_plausible(robot, geometry, solver.values / prior, solver.noise)
    combinations, at_file = _determine(geometry, used, start[~test], prior)
    before, after = (
        _prediction_error(geometry.model, measured.rows(test), start[test], values)
        for values in (np.zeros_like(prior), solver.values)
    )
    return Calibration(
        robot=robot,
        geometry=geometry,
        measured=measured,
        values=solver.values,
        deviations=solver.deviations,
        combinations=combinations,
        unseen=_describe_unseen(geometry, used, start[~test], at_file, combinations),
        error_before=before,
        error_after=after,
        noise=solver.noise,
        degrees_of_freedom=solver.freedom,
        outliers=tuple(np.flatnonzero(~test)[solver.weights**2 < 0.5].tolist()),
        instants=len(data),
        steps=solver.count,
        seconds=clock.perf_counter() - started,
    )


def _check_errors(noise: Mapping[str, float], **file_errors: float) -> None:
    """Raise InvalidInput for unknown kinds of noise and errors that are not positive."""
    for name in noise:
        check_choice("kind of noise", name, NOISE)
    for name, value in {**noise, **file_errors}.items():
        if not (np.isfinite(value) and value > 0):
            raise InvalidInput(f"{name}: needs a positive number, got {value!r}")


def _start(model: ParallelRobot, measured: Measurements) -> Array:
    """Return the configurations (T, nq) of the robot file at the measured motor angles."""
    stack = forward_kinematics_stack(model, measured.values[:, : measured.driven])
    for refusal in stack.refused.values():
        raise refusal
    return stack.q


def _determine(
    geometry: Geometry, measured: Measurements, q: Array, prior: Array
) -> tuple[Combinations, ParameterEquations]:
    """Compute the combinations that data or loops determine at poses q of the file's geometry."""
    equations = eliminate_poses(geometry.model, measured, q)
    loops = equations.loop_slopes * LOOP_GAP / measured.noise.min()  # of the size of measurements
    rows = np.concatenate([rows_of(equations.matrix), rows_of(loops)])
    return determined_combinations(rows, prior), equations


def _check_plausible(robot: ParallelRobot, geometry: Geometry, share: Array, noise: float) -> None:
    """Refuse residuals, and changes over their prior (p,), beyond the assumed errors of the file."""
    if noise > MAX_NOISE_RATIO:
        raise NotConverged(
            f"{robot.name}: what is left of the data is {noise:.3g} times the noise that is assumed; raise "
            f"length_error or angle_error, give the noise, or look at the data",
            residual=noise,
        )
    worst = np.abs(share).argmax()
    if abs(share[worst]) > MAX_PRIOR_DEVIATIONS:
        raise NotConverged(
            f"{robot.name}: {geometry.names[worst]} would be off by {abs(share[worst]):.3g} standard "
            f"deviations of what the file may be wrong by; raise length_error or angle_error, or "
            f"look at the data",
            residual=float(abs(share[worst])),
        )


def _prediction_error(model: ParallelRobot, measured: Measurements, q: Array, values: Array) -> Array:
    """Compute errors (m,), root mean square, of predictions by motors' angles and parameters (p,)."""
    q = integrate_columns(model, q, model.elastic, np.tile(values, (len(q), 1)))
    lengths = model.column_scale[model.joints]
    sizes = 1.0 / model.row_lengths[model.structure.independent]
    for _ in range(MAX_CLOSING_STEPS):
        frames = frames_at(model, q)
        loops = loop_equations(model.loops, frames)
        offset, slope = offsets(model, measured, frames)
        driven = slice(0, measured.driven)
        matrix = np.concatenate([sizes[:, None] * loops.jacobian, slope[:, driven]], axis=1)
        right = np.concatenate([sizes * loops.residual, offset[:, driven]], axis=1)
        inverse = np.linalg.pinv(matrix[:, :, model.joints] * lengths, rcond=RANK_ROUNDING)
        q = integrate_columns(model, q, model.joints, -lengths * np.einsum("tkr,tr->tk", inverse, right))
        if np.abs(right).max() < RANK_ROUNDING:
            break
    else:
        worst = np.abs(right).max(axis=1).argmax()
        raise NotConverged(
            f"{model.name}: at pose {worst + 1} of those held out the loops do not close at the measured "
            f"motor angles; these data are of another robot, or the file is too far off",
            residual=float(np.abs(right[worst]).max()),
        )
    return np.sqrt(np.mean(offsets(model, measured, frames_at(model, q)).offset ** 2, axis=0))


def _describe_unseen(
    geometry: Geometry,
    measured: Measurements,
    q: Array,
    equations: ParameterEquations,
    combinations: Combinations,
) -> tuple[str, ...]:
    """Describe the directions of the parameters that the data do not determine, with a remedy each."""
    model = geometry.model
    sensors = {name: slope for name, slope in _sensors(model, q).items() if name not in measured.names}
    sentences = []
    for direction in combinations.unseen:
        motion = np.zeros((len(q), model.model.nv))
        motion[:, model.joints] = equations.follow @ direction
        motion[:, model.elastic] = direction
        least = MIN_RESPONSE * np.abs(motion / model.column_scale).max()
        responses = {name: np.abs(np.einsum("tv,tv->t", slope, motion)) for name, slope in sensors.items()}
        by = next((name for name, response in responses.items() if response.max() > least), None)
        advice = f"{by} would show it" if by else "no pose or joint angle depends on it"
        sentences.append(f"{unseen_text(geometry.names, direction)}; {advice}")
    return tuple(sentences)


def _sensors(model: ParallelRobot, q: Array) -> dict[str, Array]:
    """Return the derivatives (T, nv) of all numbers that may be measured at q (T, nq), by name."""
    frames = frames_at(model, q)
    axes = [*(f"platform_{axis}" for axis in "xyz"), *(f"the platform's turn about {axis}" for axis in "xyz")]
    sensors = {axis: frames.jacobian[:, 0, k] for k, axis in enumerate(axes)}
    for column, name in joint_names(model).items():
        sensors[name] = np.tile(np.eye(model.model.nv)[column], (len(q), 1))
    return sensors


def unseen_text(names: Sequence[str], direction: Array) -> str:
    """Return a direction that data do not determine, in words."""
    used = np.flatnonzero(direction)
    if len(used) == 1:
        return f"{names[used[0]]} not at all"
    if len(used) == 2:
        first, second = direction[used]
        if abs(abs(first) - abs(second)) < MIN_RESPONSE * abs(first):
            kind = "difference" if first * second > 0 else "sum"
            return f"{names[used[0]]} and {names[used[1]]} only as their {kind}"
    return f"no change by {combination_text(names, direction)}"


class GaussNewton:
    """Damped Gauss-Newton steps for parameters and poses.

    values, deviations: (p,) of the parameters about the file's, and their standard deviations.
    weights: (T,) roots of Huber's weights of the instants.
    noise: residual over the assumed noise; freedom: degrees of freedom of this estimate.
    """

    def __init__(self, model: ParallelRobot, measured: Measurements, q: Array, prior: Array) -> None:
        self.model, self.measured, self.q, self.prior = model, measured, q, prior
        self.values, self.weights = np.zeros(len(prior)), np.ones(len(q))
        self.noise, self.freedom, self.count = 1.0, 0.0, 0
        self.deviations = prior

    def run(self, name: str, progress: Callable[[int], None]) -> None:
        """Take steps until the parameters rest."""
        damping, equations = FIRST_DAMPING, eliminate_poses(self.model, self.measured, self.q)
        cost = self._weigh(equations)
        for self.count in range(1, MAX_STEPS + 1):
            progress(self.count)
            change = self._change(equations, damping)
            joints = equations.step + equations.follow @ change
            parameters = np.tile(change, (len(joints), 1))
            columns = np.concatenate([self.model.joints, self.model.elastic])
            q = integrate_columns(self.model, self.q, columns, np.concatenate([joints, parameters], axis=1))
            stepped = eliminate_poses(self.model, self.measured, q)
            stepped_cost = self._cost(stepped, self.values + change)
            if not stepped_cost <= cost * (1.0 + RANK_ROUNDING) + RANK_ROUNDING:
                damping *= 10.0
                if damping > MAX_DAMPING:
                    break
                continue
            self.q, self.values, equations = q, self.values + change, stepped
            damping = max(0.1 * damping, 1e-12)
            cost = self._weigh(equations)
            if np.abs(change / self.prior).max() < CONVERGED:
                self._finish(equations)
                return
        raise NotConverged(
            f"{name}: calibration does not settle after {self.count} steps; the file is too far off for "
            f"these data, or they are of another robot",
            residual=cost,
        )

    def _system(self, equations: ParameterEquations) -> tuple[Array, Array]:
        """Return rows on scaled parameters, of unit noise, and their right sides; the prior left out."""
        weights = self.weights[:, None] / self.noise
        matrix = np.concatenate(
            [rows_of(weights[..., None] * equations.matrix), rows_of(equations.loop_slopes)]
        )
        right = np.concatenate([(weights * equations.right).ravel(), equations.open_loops.ravel()])
        return matrix * self.prior, right

    def _change(self, equations: ParameterEquations, damping: float) -> Array:
        matrix, right = self._system(equations)
        damped = np.sqrt(damping) * np.eye(len(self.prior))
        rows = np.concatenate([matrix, np.eye(len(self.prior)), damped])
        targets = np.concatenate([right, self.values / self.prior, np.zeros(len(self.prior))])
        q, r = np.linalg.qr(rows)
        return -self.prior * np.linalg.solve(r, q.T @ targets)

    def _cost(self, equations: ParameterEquations, values: Array) -> float:
        right = self._system(equations)[1]
        return float(right @ right + np.sum((values / self.prior) ** 2))

    def _weigh(self, equations: ParameterEquations) -> float:
        """Set noise and Huber's weights by the usual instant; return the cost."""
        ranks = equations.right.shape[1] - self.measured.driven
        size = np.sqrt(np.sum(equations.right**2, axis=1) / max(ranks, 1))
        self._set_noise(equations, np.median(size))
        self.weights = np.sqrt(np.minimum(1.0, HUBER * self.noise / np.maximum(size, RANK_ROUNDING)))
        return self._cost(equations, self.values)

    def _finish(self, equations: ParameterEquations) -> None:
        """Set the noise of all instants, and the deviations."""
        from scipy.special import ndtr, stdtrit  # takes time to import

        right = self.weights[:, None] * equations.right
        count = equations.right.size - self.measured.driven * len(self.q)
        self._set_noise(equations, np.sqrt(np.sum(right**2) / max(count, 1)))
        matrix, _ = self._system(equations)
        upper = np.linalg.qr(np.concatenate([matrix, np.eye(len(self.prior))]), mode="r")
        self.deviations = self.prior * np.linalg.norm(np.linalg.inv(upper), axis=1)
        if self.freedom >= 1.0:
            self.deviations *= stdtrit(self.freedom, ndtr(DEVIATIONS)) / DEVIATIONS

    def _set_noise(self, equations: ParameterEquations, residual: float) -> None:
        """Estimate the noise of equations from their residuals at the fit, over the assumed noise.

        A fit of N equations of noise s with a prior has residuals s sqrt(N - r), r = sum of w^2 / (w^2 + s^2)
        the number of parameters that it determines, w the singular values of the rows: the left side of
        s^2 (N - r) = N residual^2 grows with s.
        """
        count = equations.right.size - self.measured.driven * len(self.q)
        powers = self._powers(equations)

        def freedom(noise: float) -> float:
            return count - float(np.sum(powers / (powers + noise**2)))

        self.noise, self.freedom = 1.0, freedom(LEAST_NOISE)
        if self.freedom < 1.0:
            return
        from scipy.optimize import brentq  # takes time to import

        def excess(noise: float) -> float:
            return float(noise**2 * freedom(noise) - count * residual**2)

        high = max(residual * np.sqrt(count), 1.0)
        self.noise = LEAST_NOISE
        if excess(LEAST_NOISE) < 0.0:
            self.noise = float(brentq(excess, LEAST_NOISE, high, xtol=RANK_ROUNDING * LEAST_NOISE))
        self.freedom = freedom(self.noise)

    def _powers(self, equations: ParameterEquations) -> Array:
        """Return squared singular values (p,) of the data's scaled rows on motions that the loops allow."""
        size = len(self.prior)
        loops = np.concatenate([rows_of(equations.loop_slopes) * self.prior, np.zeros((size, size))])
        _, values, axes = np.linalg.svd(np.linalg.qr(loops, mode="r"))
        rows = rows_of(self.weights[:, None, None] * equations.matrix) * self.prior
        rows = rows @ axes.T / np.sqrt(1.0 + values**2)
        return np.linalg.eigvalsh(rows.T @ rows).clip(0.0)


def rows_of(stack: Array) -> Array:
    """Return the rows (T m, p) of a stack (T, m, p) below one another."""
    return stack.reshape(-1, stack.shape[2])
