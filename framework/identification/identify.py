"""Identification of inertial and motor parameters from motor angles, torques and time.

Base parameters are estimated by weighted least squares from the rows N' Y theta = N' S tau
(`base_parameters`). Noise e of the torques is noise G' e of these rows, with G of `platform_wrench`. At a
Type 2 singularity G' e has no component along the twist t_s of the escaping motion, and errors of the motion
dominate there. So the noise of a row has a lower bound, which limits the row's weight.

From the base parameters follow parameters of bodies that can exist, near the robot file's values. The misfit
to the data is a quadratic form in all parameters. A prior keeps parameters that the data do not determine at
the file's values. The pseudo-inertia of every body must be positive semidefinite (Wensing, Kim and Slotine,
IEEE Robotics and Automation Letters 3(1), 2018), and rotor inertia, damping and friction must not be
negative. This is a semidefinite program. Links fixed to one another form one body; the prior divides its
parameters among the links.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from framework.dynamics.body_parameters import pseudo_inertia
from framework.errors import InvalidInput, NotConverged
from framework.identification.base_parameters import (
    BaseParameters,
    LinkParameters,
    ParameterRegressor,
    base_parameters,
    collect_link_parameters,
    parameter_regressor,
    read_inertial_parameters,
    with_masses_and_motors,
    write_inertial,
)
from framework.identification.combinations import merge_rows
from framework.identification.measured_motion import MeasuredMotion, measured_motion
from framework.identification.recording import HELD_OUT_EVERY, Recording, load_recording
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.model.description import RobotDescription
from framework.model.robot_file_writer import write_robot_file
from framework.numerics.arrays import Array, BoolArray, Names, ReadOnlyArrays
from framework.numerics.cone_program import Affine, LinearMatrix, Unsolved, least_norm_semidefinite
from framework.numerics.fields import positive
from framework.numerics.ordered_sums import singular_values
from framework.numerics.output import Document, plain, select_fields
from framework.tolerances import MIN_NOISE_RATIO, RANK_ROUNDING, SIGNIFICANT_DEVIATIONS

# An additional row with a small deviation keeps an undetermined base parameter near the file's value. This is
# the ratio of that deviation to the estimated one, and the largest ratio to the parameter's size. The
# smallest ratio to the size is its square, as the inverse square of the deviation enters a matrix.
UNSEEN_SPREAD = 1e-3


class Rows(NamedTuple):
    """Equations A theta = b for the p parameters, with independent noise of one common size."""

    matrix: Array  # (rows, p) A
    right: Array  # (rows,) b


@dataclass(frozen=True, eq=False)
class Identification(ReadOnlyArrays):
    """Identified parameters, validated by torques that were held out.

    Attributes:
        base: the base parameters of the robot.
        values, deviations: (rank,) estimated base parameters and their standard deviations; a deviation is
            infinite if these data do not determine the parameter.
        parameters: (p,) values of `base.parameters` that physically possible bodies can have, as near as
            possible to the file's values.
        links, link_values: parameters of single links and their identified values. Base parameters that these
            data do not determine keep the file's values. All parameters keep them if the file predicts the
            held-out torques better.
        error_before, error_after: (n_a,) errors of held-out motor torques that the file and `parameters`
            predict: root mean square error over root mean square of the measured torques. They are NaN if all
            held-out instants are near Type 2.
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
    noise: float  # ratio of the rows' noise to the torques' noise; 1 if there are no other errors
    cutoff: float  # [Hz]
    poses: str  # source of the poses: motors or platform
    motor_misfit: float  # [rad, robot lengths] largest offset of the motors' joints from their angles
    instants: int
    seconds: float

    @property
    def undetermined(self) -> Names:
        """Names of base parameters whose standard deviation exceeds their size."""
        return self._base_names(_find_undetermined(self.base, self.values, self.deviations))

    @property
    def keeps_file(self) -> bool:
        """Whether the file's parameters stay: the file predicts held-out torques better."""
        return bool((self.link_values == self.links.values).all())

    @property
    def changed(self) -> Names:
        """Names of base parameters that differ significantly from the file's values."""
        change = np.abs(self.values - self.base.values)
        return self._base_names(change > SIGNIFICANT_DEVIATIONS * self.deviations)

    def _base_names(self, mask: BoolArray) -> Names:
        """Return the names of the base parameters in a mask (rank,)."""
        return tuple(self.base.names[k] for k in np.flatnonzero(mask))

    @property
    def _description(self) -> RobotDescription:
        """The robot's description with the identified parameters."""
        return with_masses_and_motors(self.robot, self.links, self.link_values)

    def identified_robot(self) -> ParallelRobot:
        """Return the robot with the identified parameters."""
        return ParallelRobot.from_description(self._description)

    def write(self, folder: str | Path, *, overwrite: bool = False) -> Path:
        """Write the robot file and the URDF with the identified parameters; return the robot file.

        Raises:
            OutputError: the folder cannot be written; they would overwrite the files that were read or,
                without `overwrite`, files that somebody has edited.
        """
        comments = ["Its parameters were identified."]
        return write_robot_file(self._description, folder, comments=comments, overwrite=overwrite)

    def to_dict(self) -> Document:
        """Return all numbers, for JSON."""
        motors = self.robot.actuator_names
        keys = ("name", "value", "standard_deviation", "file")
        columns = (self.base.names, self.values, self.deviations, self.base.values)
        document: Document = {
            "robot": self.robot.name,
            **select_fields(self.base, "rank", "gap", "certain"),
            "base_parameters": [dict(zip(keys, row, strict=True)) for row in zip(*columns, strict=True)],
            **select_fields(self, "changed", "undetermined"),
            "parameters": dict(zip(self.base.parameters, self.parameters, strict=True)),
            "torque_error_before": dict(zip(motors, self.error_before, strict=True)),
            "torque_error_after": dict(zip(motors, self.error_after, strict=True)),
            **select_fields(self, "noise", "cutoff", "poses", "motor_misfit", "instants", "seconds"),
        }
        return plain(document)


def identify(
    robot: ParallelRobot,
    data: Recording | str | Path,
    *,
    cutoff: float | None = None,
    poses: str | None = None,
    prior: float = 1.0,
    massless: bool = False,
    progress: Callable[[int], None] = lambda done: None,
) -> Identification:
    """Identify inertial parameters, rotor inertias and friction from a recorded motion.

    Args:
        data: a recording with time, motor angles and torques, and the platform if the motion passes Type 2;
            or the name of its CSV file.
        cutoff: cutoff frequency of the filter [Hz]; by default where the angles' spectra become noise.
        poses: "motors" or "platform", from which poses are computed; by default the motors, then the platform
            if that fails.
        prior: ratio of the standard deviations of the file's values to the sizes of the parameters.
        massless: whether to include bodies that have no mass in the file.
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

    # equations of the recorded motion, without the instants held out for validation
    data = load_recording(robot, data)
    measured = measured_motion(robot, data, cutoff=cutoff, poses=poses, progress=progress)
    regressor = parameter_regressor(robot, measured.motion, base.described, signs=measured.signs)
    test = _mask_held_out(measured.times)
    rows = _whiten(robot, regressor, measured, ~test)
    if len(rows.right) <= base.rank:
        raise InvalidInput(
            f"{data.source}: {len(rows.right)} equations at {np.count_nonzero(~test)} instants for "
            f"{base.rank} base parameters; record longer, or give a cutoff above {measured.cutoff:.3g} Hz"
        )

    # estimate the base parameters, then bodies that can exist
    estimate = _estimate_base_parameters(base, rows)
    file_values = base.described.values  # (p,)
    links = collect_link_parameters(robot, base.described)
    link_values = _fit_possible_bodies(base, links, rows, estimate, prior)
    parameters = file_values + links.to_parameters @ (link_values - links.values)

    # predict the torques held out, and keep the file's values if they predict them better
    error_before = torque_error(robot, regressor, measured, test, file_values)
    error_after = torque_error(robot, regressor, measured, test, parameters)
    if np.linalg.norm(error_before) <= np.linalg.norm(error_after):
        link_values = links.values
        parameters = file_values
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
    """Return the equations of the instants in a mask (T,), whitened by the noise of the `measured` torques.

    The terms of the equations N' Y theta + constant = G' tau are those of the `regressor`. If the torques
    have the standard deviations E, a diagonal matrix, the wrench W = G' tau has the covariance
    G' E E G = V diag(variance) V'. Multiplied by diag(variance)^(-1/2) V' the rows have independent unit
    noise.
    """
    scale = robot.platform_scale  # divides moments, so that they compare with forces
    # (n_a,) not zero, even if torques without noise were recorded
    noise = np.maximum(measured.torque_noise, RANK_ROUNDING * np.abs(measured.torque).max(axis=0))
    wrench_noise = regressor.motors * noise / scale[:, None]  # (T, n, n_a) G' E
    variance, axes = np.linalg.eigh(wrench_noise @ wrench_noise.swapaxes(1, 2))  # ascending
    least_variance = MIN_NOISE_RATIO**2 * variance[:, -1:]  # of errors of the motion
    deviation = np.sqrt(np.maximum(variance, least_variance))  # (T, n)
    weights = axes.swapaxes(1, 2) / deviation[..., None] / scale  # (T, n, n) diag(variance)^(-1/2) V'
    wrench = np.matvec(regressor.motors, measured.torque) - regressor.constant  # (T, n)
    matrix = (weights @ regressor.matrix)[instants]  # (instants, n, p)
    return Rows(merge_rows(matrix), np.matvec(weights, wrench)[instants].ravel())


def _find_undetermined(base: BaseParameters, values: Array, deviations: Array) -> BoolArray:
    """Return a mask (rank,) of base parameters with deviations (rank,) above their size.

    The size of a parameter is the larger one of the estimated `values` (rank,) and the file's value.
    """
    return deviations > np.maximum(np.abs(values), np.abs(base.values))


def _mask_held_out(times: Array) -> BoolArray:
    """Return a mask (T,) of the times (T,) held out for validation.

    The duration is divided into equal blocks, of which the last of every HELD_OUT_EVERY is held out.
    """
    share = (times - times[0]) / (times[-1] - times[0])
    count = 5 * HELD_OUT_EVERY  # of blocks
    blocks = np.minimum((share * count).astype(int), count - 1)  # (T,) index of each instant's block
    return blocks % HELD_OUT_EVERY == HELD_OUT_EVERY - 1


class BaseEstimate(NamedTuple):
    """Least squares estimates of the base parameters."""

    values: Array  # (rank,) SI units
    deviations: Array  # (rank,) standard deviations; infinite if the rows do not determine the parameter
    noise: float  # of the rows, assumed as 1


def _estimate_base_parameters(base: BaseParameters, rows: Rows) -> BaseEstimate:
    """Estimate the base parameters by least squares (Gautier 1997).

    The base parameters beta, in units of their sizes, solve A beta = b. With A = U S V' the solution is
    V S^-1 U' b, and its covariance is noise^2 V S^-2 V'. The squared noise is the sum of squared residuals
    per degree of freedom. Parameters with a component along directions of zero singular value have infinite
    deviations. The `rows` are whitened, so their noise is 1 if torques have no other errors.
    """
    leading = base.combinations.leading
    sizes = base.described.sizes[leading]
    A = rows.matrix[:, leading] * sizes  # (rows, rank)
    U, sigma, V_rows = np.linalg.svd(A, full_matrices=False)
    is_seen = sigma > RANK_ROUNDING * sigma[0]  # directions that the rows determine
    inverse = V_rows[is_seen].T / sigma[is_seen]  # (rank, seen) V S^-1
    beta = inverse @ (U.T @ rows.right)[is_seen]
    residual = rows.right - A @ beta
    noise = float(np.sqrt(residual @ residual / (len(residual) - np.count_nonzero(is_seen))))
    deviations = sizes * (noise * np.linalg.norm(inverse, axis=1))
    unseen_part = np.sum(V_rows[~is_seen] ** 2, axis=0)  # (rank,) squared
    deviations[unseen_part > RANK_ROUNDING] = np.inf
    return BaseEstimate(sizes * beta, deviations, noise)


def _fit_possible_bodies(
    base: BaseParameters, links: LinkParameters, rows: Rows, estimate: BaseEstimate, prior: float
) -> Array:
    """Fit parameters (u,) of possible links and motors to the rows.

    For each undetermined base parameter an additional row with a small deviation keeps the parameter near the
    file's value.

    Args:
        base, links: the base parameters, and the parameters of single links and motors.
        rows: whitened equations of the p parameters of bodies and motors.
        estimate: least squares estimate of the base parameters from the same rows.
        prior: ratio of the file's standard deviations to the sizes of the parameters, `links.prior_sizes`.
    """
    # deviations of the additional rows: far below the estimated ones and the sizes of the parameters, but not
    # so small that their inverse squares swamp the other entries of the matrix
    sizes = base.described.sizes[base.combinations.leading]  # (rank,)
    small = np.clip(UNSEEN_SPREAD * estimate.deviations, UNSEEN_SPREAD**2 * sizes, UNSEEN_SPREAD * sizes)
    is_unseen = _find_undetermined(base, estimate.values, estimate.deviations)
    prior_rows = base.combinations.coefficients[is_unseen] / small[is_unseen, None]

    # Normal equations (p, p), (p,) of all rows, about the file's values. Additional rows have the residual 0.
    information = rows.matrix.T @ rows.matrix / estimate.noise**2 + prior_rows.T @ prior_rows
    misfit = rows.right - rows.matrix @ base.described.values
    residual = rows.matrix.T @ misfit / estimate.noise**2
    return fit_possible_parameters(base.robot, links, information, residual, prior)


def torque_error(
    robot: ParallelRobot,
    regressor: ParameterRegressor,
    measured: MeasuredMotion,
    instants: BoolArray,
    parameters: Array,
) -> Array:
    """Compute root mean square errors (n_a,) of predicted torques, relative to the torques.

    The errors e of the measured torques tau solve G' e = W - G' tau, with the wrench W that the parameters
    predict. Only those instants count at which G is well conditioned. If there are none, the result is NaN.

    Args:
        regressor: terms of the equations at the T instants of the motion `measured`.
        instants: mask (T,) of the instants to be predicted.
        parameters: (p,) values of the parameters of `TorqueParameters`.
    """
    G_transposed = regressor.motors  # (T, n, n_a)
    scaled_G = G_transposed / robot.platform_scale[:, None] / robot.column_scale[robot.actuated]
    least = singular_values(scaled_G / robot.gear_ratio)[:, -1]  # (T,)
    is_predicted = instants & (least > MIN_NOISE_RATIO * least.max())
    if not is_predicted.any():
        return np.full(robot.n_a, np.nan)
    G_transposed = G_transposed[is_predicted]
    torque = measured.torque[is_predicted]
    wrench = regressor.matrix[is_predicted] @ parameters + regressor.constant[is_predicted]
    missing_wrench = wrench - np.matvec(G_transposed, torque)
    error = np.matvec(np.linalg.pinv(G_transposed), missing_wrench)  # (predicted, n_a)
    error_size, torque_size = (np.sqrt(np.mean(values**2, axis=0)) for values in (error, torque))
    return error_size / np.maximum(torque_size, np.finfo(float).tiny)


# ------------------------------------------------------------------ bodies that can exist


def fit_possible_parameters(
    robot: ParallelRobot, links: LinkParameters, information: Array, residual: Array, prior: float
) -> Array:
    """Compute the most probable physically possible parameters (u,) of links and motors.

    They minimise |A T (theta - theta_file) - r|^2 + |(theta - theta_file) / deviation|^2, where the matrix
    T = `to_parameters` adds up links to bodies, and the deviation is prior * `links.prior_sizes`. Let theta =
    best + change y, where `best` is the unconstrained minimum and `change` turns the quadratic form into
    |y|^2. Then the shortest y with possible parameters is the solution.

    Args:
        information, residual: A' A (p, p) and A' r (p,) of rows A with unit noise.
        prior: ratio of the file's standard deviations to the sizes of the parameters, `links.prior_sizes`.

    Raises:
        NotConverged: the solver does not converge.
    """
    best, change = _minimise_misfit(links, information, residual, prior * links.prior_sizes)

    # the shortest y with semidefinite pseudo-inertias, and with motor parameters that are not negative
    cones = [_inertia_cone(links.values[part], change[part], best[part]) for part in links.link_slices]
    motors = links.motor_slice
    deviations = prior * links.prior_sizes[motors]
    not_negative = Affine(change[motors] / deviations[:, None], best[motors] / deviations)
    y = least_norm_semidefinite(cones, not_negative)
    if isinstance(y, Unsolved):
        raise NotConverged(
            f"{robot.name}: no parameters of bodies that can exist were found ({y.status})",
            residual=float(np.linalg.norm(residual)),
        )

    values = best + change @ y
    values[motors] = np.maximum(values[motors], 0.0)  # against rounding
    for part in links.link_slices:
        if (values[part] != links.values[part]).any():
            link = Element("link")
            write_inertial(link, values[part])
            values[part] = read_inertial_parameters(link)  # exactly as a file would store this link
    return values


def _minimise_misfit(
    links: LinkParameters, information: Array, residual: Array, deviation: Array
) -> tuple[Array, Array]:
    """Minimise misfit plus prior without constraints; return minimum (u,) and `change` (u, u).

    For any y, misfit plus prior at the parameters minimum + change y exceeds its least value by |y|^2. In
    units of the prior deviations (u,), with T = `to_parameters`, the quadratic form has the matrix
    T' A'A T + 1 = V diag(w) V'. The minimum differs from the file's values by V diag(1 / w) V' T' A'r.

    Args:
        links: the parameters of links and motors, with T and the file's values.
        information, residual: A'A (p, p) and A'r (p,) of rows A with unit noise.
        deviation: (u,) prior standard deviations of the parameters.
    """
    T = links.to_parameters * deviation  # (p, u) in units of the prior deviations
    w, V = np.linalg.eigh(T.T @ information @ T + np.eye(len(deviation)))
    root = np.sqrt(np.maximum(w, 1.0))  # with the prior no eigenvalue is below 1
    change = deviation[:, None] * V / root
    return links.values + change @ (V.T @ (T.T @ residual) / root), change


def _inertia_cone(file_values: Array, change: Array, best: Array) -> LinearMatrix:
    """Return the scaled pseudo-inertia D P D of a link, affine in y (u,).

    P belongs to the link's parameters best + change y, with `best` (10,) and `change` (10, u). D belongs to
    the `file_values` (10,). D P D has eigenvalues of the order of 1 or less, of which negative ones of
    the size of rounding are allowed.
    """
    D = _balancing_scale(file_values)
    slopes = np.moveaxis(D @ pseudo_inertia(change.T) @ D, 0, 2)  # (4, 4, u)
    offset = D @ pseudo_inertia(best) @ D
    return LinearMatrix(slopes, offset + RANK_ROUNDING * np.eye(4))


def _balancing_scale(parameters: Array) -> Array:
    """Compute the diagonal D (4, 4) that gives D P D mass 1 and largest second moment 1.

    P is the pseudo-inertia (4, 4) of a link's parameters (10,). Its diagonal holds three second moments and
    the mass. Rounding in D P D is then relative to 1, whatever the units and the link.
    """
    diagonal = np.diag(pseudo_inertia(parameters))
    largest = diagonal[:3].max()
    if largest == 0.0:  # a point mass at the origin has no moments: they get the scale of the mass
        largest = diagonal[3]
    return np.diag(1.0 / np.sqrt([largest, largest, largest, diagonal[3]]))
