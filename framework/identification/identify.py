"""Identification of inertial and motor parameters from motor angles, torques and time.

Base parameters are found by weighted least squares from rows N' Y theta = N' S tau (`torque_parameters`). The
noise of a row is that of the torques, G' e of `platform_wrench`. At a Type 2 singularity G' e has no
component along t_s, and errors of the motion dominate; a least noise bounds the weight of such rows.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from framework.errors import InvalidInput
from framework.identification.base_parameters import (
    BaseParameters,
    ParameterRegressor,
    base_parameters,
    parameter_regressor,
)
from framework.identification.measured_motion import MeasuredMotion, measured_motion
from framework.identification.physical import (
    LinkParameters,
    collect_link_parameters,
    fit_possible_parameters,
    with_masses_and_motors,
)
from framework.identification.recording import Recording, load_recording
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.model.description import RobotDescription
from framework.model.robot_file_writer import write_robot_file
from framework.numerics.arrays import Array, BoolArray, ReadOnlyArrays
from framework.numerics.fields import positive
from framework.numerics.ordered_sums import singular_values
from framework.numerics.output import Document, plain, select_fields
from framework.tolerances import MIN_NOISE_RATIO, RANK_ROUNDING, SIGNIFICANT_DEVIATIONS

HELD_OUT_BLOCKS, HELD_OUT_EVERY = 20, 4  # blocks of time in a recording, every fourth held out
UNSEEN_SPREAD = 1e-3  # of its deviation: how far a base parameter that is not seen may be off the file's
LEAST_SPREAD = 1e-6  # the same over its size: its square is added to a matrix of rows
DEFAULT_PRIOR = 1.0  # standard deviation of the file's values over the size of each body's parameters


class Rows(NamedTuple):
    """Rows A theta = b, of unit noise up to a common scale."""

    matrix: Array  # (rows, p)
    right: Array  # (rows,)


@dataclass(frozen=True, eq=False)
class Identification(ReadOnlyArrays):
    """Identified parameters, validated by torques that were not used.

    Attributes:
        base: the base parameters of the robot.
        values, deviations: (rank,) identified, with their standard deviations, infinite where these data do
            not determine one.
        parameters: (p,) of `base.parameters`: possible bodies, nearest to the file's.
        links, link_values: the same of single links. Along base parameters that these data do not show the
            values are the file's, and all are where the file predicts the torques held out better.
        error_before, error_after: (n_a,) of motor torques held out, by the file and by `parameters`, root
            mean square over that of the measured torques; NaN if all of them are at Type 2.
    """

    robot: ParallelRobot
    base: BaseParameters
    values: Array
    deviations: Array
    parameters: Array
    links: LinkParameters
    link_values: Array
    error_before: Array
    error_after: Array
    noise: float  # of rows over that of the torques alone: 1 without other errors
    cutoff: float  # [Hz]
    poses: str  # their source: motors or platform
    motor_misfit: float  # of these poses to the motors' angles, see `MeasuredMotion`
    instants: int
    seconds: float

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Base parameters whose standard deviation is above their size."""
        return self._base_names(_exceed_their_size(self.base, self.values, self.deviations))

    @property
    def keeps_file(self) -> bool:
        """Whether the file's parameters predict the validation torques better, and stay."""
        return bool((self.link_values == self.links.values).all())

    @property
    def changed(self) -> tuple[str, ...]:
        """Base parameters that differ significantly from the file's values."""
        change = np.abs(self.values - self.base.values)
        return self._base_names(change > SIGNIFICANT_DEVIATIONS * self.deviations)

    def _base_names(self, mask: BoolArray) -> tuple[str, ...]:
        """Return the names of the base parameters in a mask (rank,)."""
        return tuple(self.base.names[k] for k in np.flatnonzero(mask))

    @property
    def _description(self) -> RobotDescription:
        """The robot's description with the identified parameters."""
        return with_masses_and_motors(self.robot, self.links, self.link_values)

    def identified_robot(self) -> ParallelRobot:
        """Return the robot with the identified parameters."""
        return ParallelRobot.from_description(self._description)

    def write(self, folder: str | Path) -> Path:
        """Write the robot file and the URDF with the identified parameters; return the robot file.

        Raises:
            OutputError: the folder cannot be written, or they would overwrite the files that were read.
        """
        return write_robot_file(self._description, folder, comments=["Its parameters were identified."])

    def to_dict(self) -> Document:
        """Return all numbers, for JSON."""
        motors = self.robot.actuator_names
        base = zip(self.base.names, self.values, self.deviations, self.base.values, strict=True)
        document: Document = plain(
            {
                "robot": self.robot.name,
                **select_fields(self.base, "rank", "gap", "certain"),
                "base_parameters": [
                    {"name": name, "value": value, "standard_deviation": deviation, "file": own}
                    for name, value, deviation, own in base
                ],
                **select_fields(self, "changed", "undetermined"),
                "parameters": dict(zip(self.base.parameters, self.parameters, strict=True)),
                "torque_error_before": dict(zip(motors, self.error_before, strict=True)),
                "torque_error_after": dict(zip(motors, self.error_after, strict=True)),
                **select_fields(self, "noise", "cutoff", "poses", "motor_misfit", "instants", "seconds"),
            }
        )
        return document


def identify(
    robot: ParallelRobot,
    data: Recording | str | Path,
    *,
    cutoff: float | None = None,
    poses: str | None = None,
    prior: float = DEFAULT_PRIOR,
    massless: bool = False,
    progress: Callable[[int], None] = lambda done: None,
) -> Identification:
    """Identify inertial parameters, rotor inertias and friction from a recorded motion.

    Args:
        data: with time, motor angles and torques (and the platform, where the motion passes Type 2), or the
            file of it, see `read_recording`.
        cutoff: of the filter [Hz], and poses: "motors" or "platform", see `measured_motion`.
        prior: standard deviation of the file's values, a share of each body's size.
        massless: whether bodies without mass in the file have parameters, too.
        progress: called with the number of poses computed from the motors.

    Raises:
        InvalidInput: wrong or too few data; a robot with springs.
        NotAssembled: the loops do not close along the recorded motion.
        NotConverged: no physically possible parameters were found.
    """
    expect_robot(robot)
    started = clock.perf_counter()
    positive("prior", prior)
    base = base_parameters(robot, massless=massless)
    data = load_recording(robot, data)
    measured = measured_motion(robot, data, cutoff=cutoff, poses=poses, progress=progress)
    regressor = parameter_regressor(robot, measured.motion, base.described, signs=measured.signs)
    test = _is_validation(measured.times)
    rows = _whiten(robot, regressor, measured, ~test)
    if len(rows.right) <= base.rank:
        raise InvalidInput(
            f"{data.source}: {len(rows.right)} equations at {int((~test).sum())} instants for {base.rank} "
            f"base parameters; record longer, or give a cutoff above {measured.cutoff:.3g} Hz"
        )
    estimate = _estimate_base_parameters(base, rows)
    file = base.described.values
    links = collect_link_parameters(robot, base.described)
    link_values = _fit_possible_bodies(robot, base, links, rows, estimate, prior)
    parameters = file + links.to_parameters @ (link_values - links.values)
    error_before = torque_error(robot, regressor, measured, test, file)
    error_after = torque_error(robot, regressor, measured, test, parameters)
    if np.linalg.norm(error_before) <= np.linalg.norm(error_after):  # the file is better, and stays
        link_values = links.values
        parameters = file
        error_after = error_before
    return Identification(
        robot=robot,
        base=base,
        values=estimate.values,
        deviations=estimate.deviations,
        parameters=parameters,
        links=links,
        link_values=link_values,
        error_before=error_before,
        error_after=error_after,
        noise=estimate.noise,
        cutoff=measured.cutoff,
        poses=measured.source,
        motor_misfit=measured.motor_misfit,
        instants=len(measured.times),
        seconds=clock.perf_counter() - started,
    )


def _whiten(
    robot: ParallelRobot, regressor: ParameterRegressor, measured: MeasuredMotion, instants: BoolArray
) -> Rows:
    """Return the rows of the instants in a mask (T,), whitened by the noise G' e of the torques.

    The covariance of a wrench is C = G' E E' G = V diag(variance) V', with E the noise of the torques. Rows
    times diag(variance)^(-1/2) V' are independent and have unit noise.
    """
    scale = robot.platform_scale  # moments over it are compared with forces
    noise = np.maximum(measured.torque_noise, RANK_ROUNDING * np.abs(measured.torque).max(axis=0))
    wrench_noise = regressor.motors * noise / scale[:, None]  # (T, n, n_a) G' E
    variance, axes = np.linalg.eigh(wrench_noise @ wrench_noise.swapaxes(1, 2))  # ascending
    least_variance = MIN_NOISE_RATIO**2 * variance[:, -1:]
    deviation = np.sqrt(np.maximum(variance, least_variance))  # (T, n)
    weights = axes.swapaxes(1, 2) / deviation[..., None] / scale  # diag(variance)^(-1/2) V' (T, n, n)
    wrench = np.matvec(regressor.motors, measured.torque) - regressor.constant  # (T, n)
    matrix = (weights @ regressor.matrix)[instants]
    return Rows(matrix.reshape(-1, matrix.shape[2]), np.matvec(weights, wrench)[instants].ravel())


def _exceed_their_size(base: BaseParameters, values: Array, deviations: Array) -> BoolArray:
    """Return which base parameters have deviations above their size, (rank,).

    Arguments are values and standard deviations (rank,).
    """
    return deviations > np.maximum(np.abs(values), np.abs(base.values))


def _is_validation(times: Array) -> BoolArray:
    """Return which instants (T,) validate: every fourth block of time."""
    share = (times - times[0]) / (times[-1] - times[0])
    blocks = np.minimum((share * HELD_OUT_BLOCKS).astype(int), HELD_OUT_BLOCKS - 1)
    return blocks % HELD_OUT_EVERY == HELD_OUT_EVERY - 1


class BaseEstimate(NamedTuple):
    """Base parameters by least squares."""

    values: Array  # (rank,) SI units
    deviations: Array  # (rank,) standard deviations, infinite where the rows do not determine one
    noise: float  # of the rows over the assumed 1


def _estimate_base_parameters(base: BaseParameters, rows: Rows) -> BaseEstimate:
    """Estimate the base parameters by least squares, A beta = b (Gautier 1997).

    Over their sizes. With A = U S V' the solution is V S^-1 U' b, its covariance noise^2 V S^-2 V'. The noise
    is the root mean square of the residual per degree of freedom. Parameters with a part along directions of
    zero singular value have infinite deviations.
    """
    leading = base.combinations.leading
    sizes = base.described.sizes[leading]
    A = rows.matrix[:, leading] * sizes  # (rows, rank)
    U, sigma, V_rows = np.linalg.svd(A, full_matrices=False)
    is_seen = sigma > RANK_ROUNDING * sigma[0]
    inverse = V_rows[is_seen].T / sigma[is_seen]  # (rank, seen) V S^-1
    beta = inverse @ (U.T @ rows.right)[is_seen]
    residual = rows.right - A @ beta
    noise = float(np.sqrt(residual @ residual / (len(residual) - np.count_nonzero(is_seen))))
    deviations = noise * np.linalg.norm(inverse, axis=1)
    is_undetermined = np.sum(V_rows[~is_seen] ** 2, axis=0) > RANK_ROUNDING
    return BaseEstimate(sizes * beta, np.where(is_undetermined, np.inf, sizes * deviations), noise)


def _fit_possible_bodies(
    robot: ParallelRobot,
    base: BaseParameters,
    links: LinkParameters,
    rows: Rows,
    estimate: BaseEstimate,
    prior: float,
) -> Array:
    """Fit parameters (u,) of possible links and motors to the rows.

    A base parameter that is not seen is kept near the file's value by a further row of small deviation.
    """
    sizes = base.described.sizes[base.combinations.leading]
    spread = np.clip(UNSEEN_SPREAD * estimate.deviations, LEAST_SPREAD * sizes, UNSEEN_SPREAD * sizes)
    is_unseen = _exceed_their_size(base, estimate.values, estimate.deviations)
    file_rows = base.combinations.coefficients[is_unseen] / spread[is_unseen, None]
    information = rows.matrix.T @ rows.matrix / estimate.noise**2 + file_rows.T @ file_rows  # (p, p)
    misfit = rows.right - rows.matrix @ base.described.values
    residual = rows.matrix.T @ misfit / estimate.noise**2  # (p,)
    return fit_possible_parameters(robot, links, information, residual, prior)


def torque_error(
    robot: ParallelRobot,
    regressor: ParameterRegressor,
    measured: MeasuredMotion,
    instants: BoolArray,
    parameters: Array,
) -> Array:
    """Compute the root mean square error of each torque (n_a,) over that of the torque, by parameters (p,).

    The error e solves G' e = W - G' tau with the predicted wrench W. Of the `instants`, a mask (T,), those
    count at which G is well conditioned; NaN without any.
    """
    G_transposed = regressor.motors  # (T, n, n_a)
    scaled_G = G_transposed / robot.platform_scale[:, None] / robot.column_scale[robot.actuated]
    least = singular_values(scaled_G / robot.gear_ratio)[:, -1]
    used = np.flatnonzero(instants & (least > MIN_NOISE_RATIO * least.max()))
    if not len(used):
        return np.full(robot.n_a, np.nan)
    torque = measured.torque[used]
    wrench = regressor.matrix[used] @ parameters + regressor.constant[used]
    missing_wrench = wrench - np.matvec(G_transposed[used], torque)
    error = np.matvec(np.linalg.pinv(G_transposed[used]), missing_wrench)  # (used, n_a)
    error_size, torque_size = (np.sqrt(np.mean(values**2, axis=0)) for values in (error, torque))
    return error_size / np.maximum(torque_size, np.finfo(float).tiny)
