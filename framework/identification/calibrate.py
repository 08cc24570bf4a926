"""Calibration of the geometry from motor angles and measured poses, or parts of poses.

Damped Gauss-Newton steps on all poses and parameters at once, with a prior about the robot file and Huber's
weights against outliers. What the data cannot see stays at the file's values, and is named.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from framework.arrays import Array, ReadOnlyArrays
from framework.errors import InvalidInput, NotConverged, choose_from
from framework.identification.calibration_equations import (
    Eliminated,
    Measurements,
    eliminated,
    joint_names,
    measurements_of,
    offsets,
)
from framework.identification.calibration_steps import GaussNewton, rows_of
from framework.identification.combinations import Combinations, combination_text, determined_combinations
from framework.identification.geometry import Geometry, geometry_of
from framework.identification.recording import Recording, recording_of
from framework.kinematics.closures import loop_equations
from framework.kinematics.continuation.pose_stack import forward_kinematics_stack
from framework.kinematics.frames import frames_at, integrate_columns
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.model.robot_file_writer import write_robot_file
from framework.tolerances import LOOP_GAP, MAX_NOISE_RATIO, MAX_PRIOR_DEVIATIONS, RANK_ROUNDING

LENGTH_ERROR = 1e-3  # [m] of the file, as a machine shop makes it
ANGLE_ERROR = float(np.radians(1.0))  # [rad] likewise
NOISE = {"motor_angle": 3e-5, "joint": 1e-4, "platform": 2e-5}  # standard deviations [rad, m], by kind
HELD_OUT_EVERY = 4  # instants
MAX_CLOSING_STEPS = 20
MIN_RESPONSE = 1e-6  # of a measurement to a direction, over its largest motion [robot lengths, rad]


@dataclass(frozen=True, eq=False)
class Calibration(ReadOnlyArrays):
    """A calibrated geometry with what proves it: poses that were held out.

    Attributes:
        values, deviations: (p,) of `geometry.names` [m, rad], about the file's, with standard deviations.
        combinations: what the data determine of them; unseen directions keep the prior.
        error_before, error_after: (m,) by column of `measured`, root mean square at instants held out, of
            what the motors' angles predict; zero for the motors themselves.
        noise: residual over the noise that was assumed; deviations are scaled by it. It is 1, the noise
            assumed, where the data are too few to show it. Else deviations are widened, as Student's t is for
            an estimated noise: three of them hold what three of a known noise do.
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

    def to_dict(self) -> dict[str, Any]:
        """Return all numbers, for JSON."""
        parameters = zip(self.geometry.names, self.values.tolist(), self.deviations.tolist(), strict=True)
        errors = zip(self.measured.names, self.error_before.tolist(), self.error_after.tolist(), strict=True)
        return {
            "robot": self.robot.name,
            "rank": self.combinations.rank,
            "gap": self.combinations.gap if np.isfinite(self.combinations.gap) else None,
            "parameters": {
                name: {"value": value, "standard_deviation": deviation}
                for name, value, deviation in parameters
            },
            "unseen": list(self.unseen),
            "errors_held_out": {
                name: {"before": before, "after": after}
                for name, before, after in islice(errors, self.measured.driven, None)
            },
            "noise": self.noise,
            "degrees_of_freedom": self.degrees_of_freedom,
            "outliers": list(self.outliers),
            "instants": self.instants,
            "steps": self.steps,
            "seconds": self.seconds,
        }


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
        joints: whose origins are calibrated, by default all that matter, see `geometry_of`.
        noise: standard deviations of what is measured, by kind: `motor_angle`, `joint`, `platform`.
        length_error, angle_error: standard deviations of the file's dimensions [m, rad].
        progress: called with the number of steps that are tried.

    Raises:
        InvalidInput: data that are not right or too few; redundant motors; unknown joints or kinds of noise.
        NotAssembled: the loops do not close at some motor angles.
        NotConverged: the steps do not settle, or settle far outside the errors that the file may have.
    """
    expect_robot(robot)
    started = clock.perf_counter()
    noise = noise or {}
    for name in noise:
        if name not in NOISE:
            raise InvalidInput(choose_from("kind of noise", name, NOISE))
    for what, value in {**noise, "length_error": length_error, "angle_error": angle_error}.items():
        if not (np.isfinite(value) and value > 0):
            raise InvalidInput(f"{what}: needs a positive number, got {value!r}")
    geometry = geometry_of(robot, joints)
    data = recording_of(robot, data)
    measured = measurements_of(geometry, data, {**NOISE, **noise})
    held = np.arange(len(data)) % HELD_OUT_EVERY == HELD_OUT_EVERY - 1
    if not held.any():
        raise InvalidInput(f"{data.source}: {len(data)} rows; at least {HELD_OUT_EVERY} are needed")
    start = _start(geometry.model, measured)
    used = measured.rows(~held)
    prior = np.where(geometry.turning, angle_error, length_error)
    solver = GaussNewton(geometry.model, used, start[~held], prior)
    solver.run(robot.name, progress)
    _check_plausible(robot, geometry, solver.values / prior, solver.noise)
    combinations, at_file = _determined(geometry, used, start[~held], prior)
    before, after = (
        _prediction_error(geometry.model, measured.rows(held), start[held], values)
        for values in (np.zeros_like(prior), solver.values)
    )
    return Calibration(
        robot=robot,
        geometry=geometry,
        measured=measured,
        values=solver.values,
        deviations=solver.deviations,
        combinations=combinations,
        unseen=_unseen(geometry, used, start[~held], at_file, combinations),
        error_before=before,
        error_after=after,
        noise=solver.noise,
        degrees_of_freedom=solver.freedom,
        outliers=tuple(np.flatnonzero(~held)[solver.weights**2 < 0.5].tolist()),
        instants=len(data),
        steps=solver.count,
        seconds=clock.perf_counter() - started,
    )


def _start(model: ParallelRobot, measured: Measurements) -> Array:
    """Return the configurations (T, nq) of the robot file at the measured motor angles."""
    stack = forward_kinematics_stack(model, measured.values[:, : measured.driven])
    for refusal in stack.refused.values():
        raise refusal
    return stack.q


def _determined(
    geometry: Geometry, measured: Measurements, q: Array, prior: Array
) -> tuple[Combinations, Eliminated]:
    """Compute what data show at these poses of the file's geometry, or loops hold."""
    equations = eliminated(geometry.model, measured, q)
    holding = equations.holding * LOOP_GAP / measured.noise.min()  # as large as what is measured
    rows = np.concatenate([rows_of(equations.matrix), rows_of(holding)])
    return determined_combinations(rows, prior), equations


def _check_plausible(robot: ParallelRobot, geometry: Geometry, share: Array, noise: float) -> None:
    """Refuse residuals, and changes over their prior (p,), that these errors of the file do not explain."""
    if noise > MAX_NOISE_RATIO:
        raise NotConverged(
            f"{robot.name}: what is left of the data is {noise:.3g} times the noise that is assumed; raise "
            f"length_error or angle_error, give the noise, or look at the data",
            residual=noise,
        )
    worst = int(np.abs(share).argmax())
    if abs(share[worst]) > MAX_PRIOR_DEVIATIONS:
        raise NotConverged(
            f"{robot.name}: {geometry.names[worst]} would be off by {abs(share[worst]):.3g} standard "
            f"deviations of what the file may be wrong by; raise length_error or angle_error, or "
            f"look at the data",
            residual=float(abs(share[worst])),
        )


def _prediction_error(model: ParallelRobot, measured: Measurements, q: Array, values: Array) -> Array:
    """Compute errors (m,), root mean square, of what motors' angles and parameters (p,) predict."""
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
        back = np.linalg.pinv(matrix[:, :, model.joints] * lengths, rcond=RANK_ROUNDING)
        q = integrate_columns(model, q, model.joints, -lengths * np.einsum("tkr,tr->tk", back, right))
        if np.abs(right).max() < RANK_ROUNDING:
            break
    else:
        worst = int(np.abs(right).max(axis=1).argmax())
        raise NotConverged(
            f"{model.name}: at pose {worst + 1} of those held out the loops do not close at the measured "
            f"motor angles; these data are of another robot, or the file is too far off",
            residual=float(np.abs(right[worst]).max()),
        )
    return np.sqrt(np.mean(offsets(model, measured, frames_at(model, q)).offset ** 2, axis=0))


def _unseen(
    geometry: Geometry, measured: Measurements, q: Array, equations: Eliminated, combinations: Combinations
) -> tuple[str, ...]:
    """Name the directions of the parameters that the data do not see, with what would show each."""
    model, names = geometry.model, geometry.names
    frames = frames_at(model, q)
    axes = [*(f"platform_{axis}" for axis in "xyz"), *(f"the platform's turn about {axis}" for axis in "xyz")]
    shown = {axis: frames.jacobian[:, 0, k] for k, axis in enumerate(axes)}
    for column, name in joint_names(model).items():
        shown[name] = np.tile(np.eye(model.model.nv)[column], (len(q), 1))
    sentences = []
    for direction in combinations.unseen:
        moved = np.zeros((len(q), model.model.nv))
        moved[:, model.joints] = equations.follow @ direction
        moved[:, model.elastic] = direction
        size = np.abs(moved / model.column_scale).max()
        by = [
            name
            for name, slope in shown.items()
            if name not in measured.names
            and np.abs(np.einsum("tv,tv->t", slope, moved)).max() > MIN_RESPONSE * size
        ]
        advice = f"{by[0]} would show it" if by else "no pose or joint angle depends on it"
        sentences.append(f"{unseen_text(names, direction)}; {advice}")
    return tuple(sentences)


def unseen_text(names: Sequence[str], direction: Array) -> str:
    """Return a direction that data do not see, in words."""
    used = np.flatnonzero(direction)
    if len(used) == 1:
        return f"{names[used[0]]} not at all"
    if len(used) == 2:
        first, second = direction[used]
        if abs(abs(first) - abs(second)) < MIN_RESPONSE * abs(first):
            kind = "difference" if first * second > 0 else "sum"
            return f"{names[used[0]]} and {names[used[1]]} only as their {kind}"
    return f"no change by {combination_text(names, direction)}"
