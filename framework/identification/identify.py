"""Identification of inertial and motor parameters from motor angles, torques and time.

    recording -> motion of all joints (`measured_motion`) -> equations of the motor torques (`torque_rows`)
    -> weighted least squares (`least_squares`) -> bodies that can exist (`possible_bodies`)
    -> torques held out, predicted by the twin and by simpler models

The twin is accepted only if it predicts the torques held out better than every simpler model: no torque at
all, the robot file, friction alone, and the file with another payload.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import compress
from pathlib import Path
from typing import NamedTuple
from warnings import warn

import numpy as np

from framework.errors import InvalidInput, NoAnswer, NotIdentified, check_choice, list_names
from framework.identification.base_parameters import (
    OF_MOTORS,
    BaseParameters,
    LinkParameters,
    base_parameters,
    central_moments,
    collect_link_parameters,
    with_masses_and_motors,
)
from framework.identification.conversions import Conversions, load_recording, refuse_mistaken_columns
from framework.identification.least_squares import SENSOR_ERRORS, estimate
from framework.identification.measured_motion import (
    begin_at_first_row,
    check_signals,
    measured_motion,
    smooth,
)
from framework.identification.possible_bodies import fit_possible_parameters
from framework.identification.recording import HELD_OUT_EVERY, Recording
from framework.identification.torque_rows import TorqueRows, torque_rows
from framework.identification.unknowns import PAYLOAD, Unknowns, choose_unknowns, is_narrowed, rests_on_data
from framework.kinematics.parallel_robot import ParallelRobot
from framework.model.description import RobotDescription
from framework.model.robot_file_writer import write_robot_file
from framework.numerics.arrays import LEAST_DIVISOR, Array, BoolArray, IntArray, Names, ReadOnlyArrays
from framework.numerics.fields import not_negative, positive
from framework.numerics.output import Document, plain, select_fields
from framework.tolerances import BETTER_DEVIATIONS, RANK_ROUNDING, SAME_PLACE, SIGNIFICANT_DEVIATIONS

BLOCKS = 5 * HELD_OUT_EVERY  # equal parts of a recording, the last of every HELD_OUT_EVERY is held out


class IdentifiedQuantity(NamedTuple):
    """A mass, centre, inertia or motor parameter in SI units, that data determine or not."""

    name: str
    unit: str
    value: float
    deviation: float
    file: float
    determined: bool  # the data show it, and their noise makes most of the deviation
    alone: bool  # exciting motions determine it apart from all else that is asked
    shown: bool  # the data leave less than NARROWED_SHARE of the prior's deviation


class Prediction(NamedTuple):
    """Errors of torques held out, predicted by one model."""

    model: str
    errors: Array  # (n_a,) root mean square error over root mean square torque
    lead: float  # how much worse than the twin, in standard deviations of chance; infinite for the twin


@dataclass(frozen=True, eq=False)
class Identification(ReadOnlyArrays):
    """Identified parameters, validated by torques that were held out.

    Attributes:
        base: the base parameters of the robot.
        values, deviations: (rank,) base parameters estimated from the data, with a prior about the file, and
            their standard deviations. Parameters that were not asked for keep the file's values, with the
            deviation 0.
        determined: (rank,) whether the data leave less than NARROWED_SHARE of the prior's deviation, most of
            which is their noise.
        parameters: (p,) the most probable values of `base.parameters` that bodies can have, by the data and
            a prior about the file. Those that the data do not show stay near the file's values.
        quantities: masses, centres of mass, inertias about these centres, rotors and friction.
        predictions: of the torques held out, the twin's first.
        noise: (n_a,) root mean square residual of the motor torques [N m, N].
        steps: (n_a,) least differences of recorded torques, over their largest values.
    """

    robot: ParallelRobot
    base: BaseParameters
    values: Array
    deviations: Array
    determined: BoolArray
    parameters: Array
    links: LinkParameters
    link_values: Array  # (u,) most probable parameters of `links`
    quantities: tuple[IdentifiedQuantity, ...]
    predictions: tuple[Prediction, ...]
    noise: Array
    steps: Array
    cutoff: float  # [Hz]
    poses: str  # source of the poses: motors or platform
    motor_misfit: float  # [rad, robot lengths] largest offset of the motors' joints from their angles
    instants: int
    left_out: int  # rows of the file without all numbers, or that repeat the one before
    period: float  # [s] median of the time steps
    jitter: float  # [s] largest step minus the least
    equations: int  # of the fit
    order: int  # of the autoregressive noise
    seconds: float

    @property
    def undetermined(self) -> Names:
        """Names of base parameters that the data do not determine."""
        return tuple(compress(self.base.names, ~self.determined))

    @property
    def keeps_file(self) -> bool:
        """Deprecated: whether the file's parameters stay. A twin that is not better raises NotIdentified."""
        warn("Identification.keeps_file goes in 0.9: see NotIdentified", DeprecationWarning, stacklevel=2)
        return bool((self.link_values == self.links.values).all())

    @property
    def changed(self) -> Names:
        """Names of base parameters that differ significantly from the file's values."""
        change = np.abs(self.values - self.base.values)
        is_changed = (change > SIGNIFICANT_DEVIATIONS * self.deviations) & (self.deviations > 0)  # (rank,)
        return tuple(compress(self.base.names, is_changed))

    @property
    def error_before(self) -> Array:
        """Relative errors (n_a,) of the torques held out, predicted by the file."""
        return next(prediction.errors for prediction in self.predictions if prediction.model == "file")

    @property
    def error_after(self) -> Array:
        """Relative errors (n_a,) of the torques held out, predicted by the twin."""
        return self.predictions[0].errors

    @property
    def rivals(self) -> Names:
        """Simpler models that predict the torques held out as well as the twin, the best first."""
        others = sorted(self.predictions[1:], key=lambda prediction: float(np.linalg.norm(prediction.errors)))
        return tuple(other.model for other in others if not other.lead > BETTER_DEVIATIONS)

    @property
    def refusal(self) -> NotIdentified | None:
        """The reason why the twin is not accepted; None if it is."""
        if not self.rivals:
            return None
        return NotIdentified(
            f"the twin predicts the torques held out no better than {self.rivals[0]}; {self._find_reason()}",
            name=self.robot.name,
        )

    def _find_reason(self) -> str:
        """Say why the data determine no twin: `coarse` steps of a torque, or a share left `unexplained`."""
        coarse = 0.05
        unexplained = 0.5
        motors = self.robot.actuator_names
        worst = int(np.argmax(self.steps))
        if self.steps[worst] > coarse:
            return (
                f"torque_{motors[worst]} is recorded in steps of {100 * self.steps[worst]:.0f} % of its "
                f"largest value: record finer steps, or a motion with larger torques"
            )
        least = min(float(np.max(prediction.errors)) for prediction in self.predictions)
        if least > unexplained:
            return (
                f"even the best model leaves {100 * least:.0f} % of a torque: noise, or forces that these "
                f"models do not contain"
            )
        missing = [each.name for each in self.quantities if each.alone and not each.shown]
        more = f" (another motion would show {list_names(missing, most=3)})" if missing else ""
        return (
            f"what these data show beyond it is no larger than their noise{more}: record longer, faster, "
            f"or the motion of crossing excite"
        )

    @property
    def _description(self) -> RobotDescription:
        """The robot's description with the identified parameters."""
        return with_masses_and_motors(self.robot, self.links, self.link_values)

    def identified_robot(self) -> ParallelRobot:
        """Return the robot with the identified parameters, accepted or not."""
        return ParallelRobot.from_description(self._description)

    def write(self, folder: str | Path, *, overwrite: bool = False) -> Path:
        """Write the robot file and the URDF with the identified parameters; return the robot file.

        Raises:
            NotIdentified: a simpler model predicts the torques held out as well.
            OutputError: the folder cannot be written; they would overwrite the files that were read or,
                without `overwrite`, files that somebody has edited.
        """
        if self.refusal is not None:
            raise self.refusal
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
            "accepted": self.refusal is None,
            "quantities": [quantity._asdict() for quantity in self.quantities],
            "base_parameters": [dict(zip(keys, row, strict=True)) for row in zip(*columns, strict=True)],
            **select_fields(self, "changed", "undetermined", "rivals"),
            "parameters": dict(zip(self.base.parameters, self.parameters, strict=True)),
            "torque_error_before": dict(zip(motors, self.error_before, strict=True)),
            "torque_error_after": dict(zip(motors, self.error_after, strict=True)),
            "predictions": {
                prediction.model: dict(zip(motors, prediction.errors, strict=True))
                for prediction in self.predictions
            },
            "noise": dict(zip(motors, self.noise, strict=True)),
            **select_fields(self, "cutoff", "poses", "motor_misfit", "instants", "left_out"),
            **select_fields(self, "period", "jitter", "equations", "order", "seconds"),
        }
        return plain(document)


def identify(
    robot: ParallelRobot,
    data: Recording | str | Path,
    *,
    held_out: Recording | str | Path | None = None,
    only: Sequence[str] = (),
    cutoff: float | None = None,
    poses: str | None = None,
    start: Mapping[str, float] | None = None,
    prior: float = 1.0,
    massless: bool = False,
    sensor_errors: Mapping[str, float] | None = None,
    conversions: Conversions | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> Identification:
    """Identify inertial parameters, rotor inertias and friction from a recorded motion.

    Args:
        data: a recording with time, motor angles and torques, and the platform if the motion passes Type 2;
            or the name of its CSV file.
        held_out: another recording, whose torques validate the twin; by default parts of `data`.
        only: "payload", "friction", "rotor", or names of links, motors' joints or parameters; the others keep
            the file's values. By default all.
        cutoff: highest frequency that smoothing passes [Hz]; by default from cross-validation.
        poses: "motors" or "platform", from which poses are computed; by default the motors, then the platform
            if that fails.
        start: joints' positions near the first row [rad, m], if the motion begins in another mode than the
            reference; by default from columns joint_NAME or the measured platform, else the reference.
        prior: factor of the file's standard deviations; at 1 a mass is off by its own size, friction by a
            typical size of this robot.
        massless: whether to include bodies that have no mass in the file.
        sensor_errors: standard deviations of errors of the torque sensors: `scale` (share of a torque, by
            default 0.005), `offset` (share of its root mean square), `delay` [s].
        conversions: units, signs and exchanged columns of the recordings.
        progress: called with the number of poses computed from the motors.

    Raises:
        InvalidInput: wrong or too few data; a robot with springs; a column that one change would mend.
        NotAssembled: the loops do not close along the recorded motion.
        NotConverged: no physically possible parameters were found.
    """
    started = clock.perf_counter()
    positive("prior", prior)
    errors = {**SENSOR_ERRORS, **(sensor_errors or {})}
    for name, value in errors.items():
        check_choice("sensor error", name, SENSOR_ERRORS)
        not_negative(name, value)
    base = base_parameters(robot, massless=massless)
    links = collect_link_parameters(robot, base.described)
    unknowns = choose_unknowns(base, links, only, prior)

    # equations of the recorded motion, for the fit and for validation
    data = load_recording(robot, data, conversions)
    check_signals(robot, data, poses)
    _refuse_mistaken_columns(robot, base, data, poses, start)
    measured = measured_motion(robot, data, cutoff=cutoff, poses=poses, start=start, progress=progress)
    rows = torque_rows(robot, measured, base)
    if held_out is None:
        is_test = _blocks(measured.times) % HELD_OUT_EVERY == HELD_OUT_EVERY - 1  # the last of these blocks
        test, rows = rows.restrict(is_test), rows.restrict(~is_test)
    else:
        judge = load_recording(robot, held_out, conversions)
        check_signals(robot, judge, poses)
        other = measured_motion(robot, judge, cutoff=cutoff, poses=poses, start=start)
        test = torque_rows(robot, other, base, exact_motion=True)

    # the base parameters, then bodies that can exist, and simpler models
    estimated = estimate(rows, unknowns.design, base.values, errors)
    possible, possible_spread = fit_possible_parameters(robot, links, unknowns, estimated)
    change = possible - links.values
    spread = unknowns.design @ estimated.spread  # (rank, k)
    deviations = np.linalg.norm(spread, axis=1)
    by_file = np.linalg.norm(spread @ estimated.spread.T, axis=1)
    by_prior = np.linalg.norm(unknowns.design, axis=1)
    largest = np.abs(measured.torque).max(axis=0)  # (n_a,)
    steps = [np.diff(np.unique(column)).min(initial=np.inf) for column in measured.torque.T]
    return Identification(
        robot=robot,
        base=base,
        values=base.values + unknowns.design @ estimated.values,
        deviations=deviations,
        determined=is_narrowed(deviations, by_prior) & rests_on_data(deviations, by_file),
        parameters=base.described.values + links.to_parameters @ change,
        links=links,
        link_values=possible,
        quantities=_describe(robot, links, unknowns, possible, possible_spread, estimated.spread),
        predictions=_compare(base, links, rows, test, possible, estimated.offset, only),
        noise=estimated.noise,
        steps=np.minimum(steps, largest) / largest,
        cutoff=measured.cutoff,
        poses=measured.source,
        motor_misfit=measured.motor_misfit,
        instants=len(measured.times),
        left_out=data.left_out,
        period=float(np.median(np.diff(measured.times))),
        jitter=float(np.ptp(np.diff(measured.times))),
        equations=estimated.equations,
        order=estimated.order,
        seconds=clock.perf_counter() - started,
    )


def _blocks(times: Array) -> IntArray:
    """Return the index (T,) of each instant's block among BLOCKS of equal duration."""
    share = (times - times[0]) / (times[-1] - times[0])
    return np.minimum((share * BLOCKS).astype(np.intp), BLOCKS - 1)


# ------------------------------------------------------------------ predictions


def _compare(
    base: BaseParameters,
    links: LinkParameters,
    rows: TorqueRows,
    test: TorqueRows,
    possible: Array,
    offset: Array,
    only: Sequence[str],
) -> tuple[Prediction, ...]:
    """Predict the torques held out by the twin and by simpler models; return the twin's first.

    Args:
        rows, test: equations of the fit, and those held out.
        possible: (u,) parameters of the twin's links and motors.
        offset: (n_a,) of the torque sensors.
    """
    to_base = base.combinations.coefficients @ links.to_parameters  # (rank, u)
    sizes = np.sqrt(np.mean(rows.torque**2, axis=0)) + np.finfo(float).tiny  # (n_a,)

    def fit_alone(part: str, known: Array) -> Array:
        """Fit one part's parameters (rank,) by least squares to what known torques (T, n_a) leave."""
        design = choose_unknowns(base, links, [part]).design  # (rank, k)
        columns = (rows.matrix @ design / sizes[:, None])[rows.valid]  # (equations, k)
        right = ((rows.torque - known) / sizes)[rows.valid]
        return np.asarray(design @ np.linalg.lstsq(columns, right, rcond=RANK_ROUNDING)[0])

    by_file = test.torque - test.constant - test.matrix @ base.values - offset
    models = {
        "twin": by_file - test.matrix @ (to_base @ (possible - links.values)),
        "zero": test.torque,
        "file": by_file,
        "friction alone": test.torque - test.matrix @ fit_alone("friction", np.zeros_like(rows.torque)),
    }
    if tuple(only) != (PAYLOAD,):
        with suppress(InvalidInput):  # the platform has no mass
            known = rows.constant + rows.matrix @ base.values + offset
            models["payload alone"] = by_file - test.matrix @ fit_alone(PAYLOAD, known)
    return _rank_models(models, test)


def _rank_models(models: Mapping[str, Array], test: TorqueRows) -> tuple[Prediction, ...]:
    """Compare residuals (T, n_a) by model with those of the first one.

    A squared error is summed over the motors, each over its mean squared torque, and averaged over each
    block of the recording. Fast blocks have larger errors, of all models alike, so errors are compared by the
    logarithm of their ratio. Its mean over the blocks, by its standard error, has Student's distribution; the
    lead is the normal deviate of the same probability.
    """
    from scipy.special import ndtri, stdtr  # slow to import

    valid = test.valid
    if not valid.any(axis=0).all():
        nothing = np.full(valid.shape[1], np.nan)
        return tuple(Prediction(name, nothing, 0.0) for name in models)
    counts = valid.sum(axis=0)
    sizes = np.sqrt(np.sum(test.torque**2 * valid, axis=0) / counts) + np.finfo(float).tiny  # (n_a,)
    blocks = _blocks(test.times)
    used = np.unique(blocks[valid.any(axis=1)])
    scores = {}
    errors = {}
    for name, residual in models.items():
        squares = (residual / sizes) ** 2 * valid  # (T, n_a)
        errors[name] = np.sqrt(squares.sum(axis=0) / counts)
        means = [squares[blocks == k].sum() / valid[blocks == k].sum() for k in used]
        scores[name] = np.log(np.array(means) + LEAST_DIVISOR)
    first, *others = models
    predictions = [Prediction(first, errors[first], np.inf)]
    freedom = len(used) - 1
    for name in others:
        difference = scores[name] - scores[first]
        error = difference.std(ddof=1) / np.sqrt(len(used)) if freedom else np.inf
        ratio = difference.mean() / max(error, LEAST_DIVISOR)
        predictions.append(Prediction(name, errors[name], float(-ndtri(stdtr(max(freedom, 1), -ratio)))))
    return tuple(predictions)


# ------------------------------------------------------------------ in the words of engineers


BODY_QUANTITIES = {
    "mass": "kg",
    **{f"centre_{axis}": "m" for axis in "xyz"},
    **{f"inertia_{axes}": "kg m^2" for axes in ("xx", "xy", "yy", "xz", "yz", "zz")},
}


def _describe(
    robot: ParallelRobot,
    links: LinkParameters,
    unknowns: Unknowns,
    possible: Array,
    possible_spread: Array,
    spread: Array,
) -> tuple[IdentifiedQuantity, ...]:
    """Return masses, centres, central inertias and motor parameters, with deviations.

    The covariance S S' of the parameters gives that of their quantities, J S S' J', with J by differences.
    Even without noise torques leave `Unknowns.hidden` open: a quantity is shown alone if it hardly varies
    there.

    Args:
        possible, possible_spread: (u,) parameters of links and motors, and a root of their covariance.
        spread: (k, k) a root of the covariance of the unknowns.
    """
    table: list[tuple[str, str]] = []  # names and units of the u quantities
    table += [(f"{link}.{name}", unit) for link in links.links for name, unit in BODY_QUANTITIES.items()]
    for joint, column in zip(robot.actuator_names, robot.actuated, strict=True):
        units = ("kg m^2", "N s/m", "N") if robot.sliding[column] else ("kg m^2", "N m s/rad", "N m")
        table += zip([f"{joint}.{name}" for name in OF_MOTORS], units, strict=True)

    values = _body_quantities(links, possible)
    in_file = _body_quantities(links, links.values)
    steps = 1e-6 * np.linalg.norm(links.prior_root, axis=1) + np.finfo(float).tiny  # (u,)
    changes = _body_quantities(links, possible + np.diag(steps)) - values  # (u, u) one row a step
    J = changes.T / steps  # (u, u)
    # (u,) deviations by data and prior, by the prior, by what no motion shows, and by errors of the file
    from_file = np.hstack([unknowns.shown @ spread @ spread.T, unknowns.hidden])
    roots = (possible_spread, unknowns.prior_root, unknowns.hidden, from_file)
    deviations, by_prior, left, by_file = (np.linalg.norm(J @ root, axis=1) for root in roots)
    shown = is_narrowed(deviations, by_prior)
    flags = np.column_stack([shown & rests_on_data(deviations, by_file), is_narrowed(left, by_prior), shown])
    return tuple(
        IdentifiedQuantity(*table[k], values[k], deviations[k], in_file[k], *flags[k].tolist())
        for k in np.flatnonzero(by_prior)
    )


def _body_quantities(links: LinkParameters, parameters: Array) -> Array:
    """Return mass, centre and inertia about the centre of each link, then motor parameters, (..., u)."""
    bodies = parameters[..., : links.motor_slice.start].reshape(*parameters.shape[:-1], len(links.links), 10)
    centre, moments = central_moments(bodies)  # (..., links, 3), (..., links, 3, 3)
    inertia = np.trace(moments, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - moments
    quantities = [bodies[..., :1], centre, inertia[..., *np.tril_indices(3)]]
    of_bodies = np.concatenate(quantities, axis=-1).reshape(*parameters.shape[:-1], -1)
    return np.concatenate([of_bodies, parameters[..., links.motor_slice]], axis=-1)


# ------------------------------------------------------------------ mistaken columns


def _refuse_mistaken_columns(
    robot: ParallelRobot,
    base: BaseParameters,
    data: Recording,
    poses: str | None,
    start: Mapping[str, float] | None,
) -> None:
    """Raise InvalidInput if one change of a column brings the torques near what the file's bodies need."""
    max_instants = 48  # of three equations or more, for one unknown and three of each motor
    max_factor = 4.0  # by which all masses in the file may be off, in either direction
    min_moving = 0.2  # share of the equations at instants whose motors move
    from scipy.optimize import lsq_linear  # slow to import

    # the file's bodies times a factor, and rotors, damping and friction, within what this robot can have
    bodies = base.described.values.copy()
    bodies[-3 * robot.n_a :] = 0.0
    of_motors = np.eye(len(bodies))[:, -3 * robot.n_a :]
    columns = base.combinations.coefficients @ np.column_stack([bodies, of_motors])  # (rank, 1 + 3 n_a)
    known: dict[object, TorqueRows] = {}  # by the motion, which changes of the torques leave
    is_motion = np.array([not name.startswith("torque_") for name in data.names])
    lowest = np.append(1.0 / max_factor, np.zeros(3 * robot.n_a))
    highest = np.append(max_factor, base.described.sizes[-3 * robot.n_a :])

    # as many coefficients of splines as these columns need, whatever the change
    kinds = {"motor_angle": robot.actuator_names}
    if poses != "motors" and data.has("platform", robot.axis_names):
        kinds["platform"] = robot.axis_names
    signals = {kind: data.complete(f"{kind}_") for kind in kinds}  # a tracker may be slower than the motors
    cutoffs = [
        smooth(part.column("time"), part.columns(kind, kinds[kind])).cutoff for kind, part in signals.items()
    ]
    times = data.column("time")
    periods = (1.0 - SAME_PLACE) * min(cutoffs) * np.ptp(times)
    seen = np.flatnonzero(np.isin(times, [*signals.values()][-1].column("time")))  # by all sensors
    instants = seen[:: max(1, len(seen) // max_instants)]
    begun = robot
    with suppress(NoAnswer):
        begun = begin_at_first_row(robot, data, start or {})

    def misfit(recording: Recording) -> float:
        """Compute the squared misfit of the torques to this model, over the squared torques."""
        names = np.array(recording.names)[is_motion]
        moving = (*names, recording.values[:, is_motion].tobytes())
        rows = known.get(moving)
        if rows is None or robot.n_a > robot.n:
            cutoff = periods / np.ptp(recording.column("time"))
            measured = measured_motion(
                begun, recording, cutoff=cutoff, poses=poses, instants=instants, trial=True
            )
            rows = torque_rows(robot, measured, base, exact_motion=True)
            known[moving] = rows
        rows = rows._replace(torque=recording.columns("torque", robot.actuator_names)[instants])
        if rows.valid.mean() < min_moving:
            raise InvalidInput("the motors hardly move")
        sizes = np.sqrt(np.mean(rows.torque**2, axis=0))  # (n_a,)
        matrix = (rows.matrix @ columns / sizes[:, None])[rows.valid]
        right = ((rows.torque - rows.constant) / sizes)[rows.valid]
        return float(2.0 * lsq_linear(matrix, right, bounds=(lowest, highest)).cost / (right @ right))

    # positions, and torques too, of the joints behind the gears
    gears = dict(zip(robot.actuator_names, robot.gear_ratio.tolist(), strict=True))
    angles = {f"motor_angle_{joint}": f"{gear:.9g}" for joint, gear in gears.items()}
    torques = {f"torque_{joint}": f"{1.0 / gear:.9g}" for joint, gear in gears.items()}
    has_gears = bool((robot.gear_ratio != 1.0).any())
    further = [Conversions(units=units) for units in (angles, angles | torques)] * has_gears
    refuse_mistaken_columns(data, ("time", *kinds, "torque"), misfit, further)
