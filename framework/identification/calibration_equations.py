"""Measured poses as equations for the geometric parameters, with the pose of each instant eliminated.

At an instant the joints q close the loops, F(q, p) = 0, and measurements differ from h(q, p) by noise.
Solving F_q dq + F_p dp = -F by a particular motion and free motions z of the loops, and z by least squares on
the measurements, leaves rows that depend on parameters alone. They are regular at Type 2 singularities, and
noise of motors counts like that of the platform.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray, IntArray, ReadOnlyArrays
from framework.errors import InvalidInput
from framework.identification.geometry import Geometry
from framework.identification.recording import LINEAR_AXES, Recording
from framework.kinematics.closures import loop_equations
from framework.kinematics.frames import FrameStack, frames_at
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import single_columns
from framework.tolerances import LOOP_GAP, RANK_ROUNDING


@dataclass(frozen=True, eq=False)
class Measurements(ReadOnlyArrays):
    """Measurements at T instants, m numbers each: motors' joints first, on the joint side."""

    names: tuple[str, ...]  # (m,) columns of the recording
    values: Array  # (T, m)
    noise: Array  # (m,) standard deviations
    driven: int  # number of motors
    columns: IntArray  # (measured joints,) entries of the velocity vector
    axes: IntArray  # of the platform's coordinates
    others: IntArray  # 0..2: positions of the frame's origin that are no coordinates of the platform

    def rows(self, which: BoolArray) -> Measurements:
        """Return the measurements at some instants."""
        return replace(self, values=self.values[which])


def measurements_of(geometry: Geometry, data: Recording, noise: dict[str, float]) -> Measurements:
    """Return the measurements of motors, other joints and the platform in a recording.

    Args:
        noise: standard deviations by kind: motor_angle [rad or m, motor side], joint [rad or m] and platform
            [m]; those of platform turns are over the robot's length.

    Raises:
        InvalidInput: motor angles are missing, or the recording has nothing else.
    """
    robot, model = geometry.robot, geometry.model
    motors = data.columns("motor_angle", robot.actuator_names) / robot.gear_ratio
    encoders = {column: name for column, name in joint_names(model).items() if name in data.names}
    other_axes = [axis for axis in LINEAR_AXES if axis not in robot.axis_names]
    axes = [axis for axis in robot.axis_names if f"platform_{axis}" in data.names]
    others = [axis for axis in other_axes if f"platform_{axis}" in data.names]
    names = [*encoders.values(), *(f"platform_{axis}" for axis in axes + others)]
    if not names:
        raise InvalidInput(
            f"{data.source}: motor angles alone show nothing of the geometry; platform_"
            f"{robot.axis_names[0]} or angles of other joints are needed"
        )
    places = np.array([robot.axis_names.index(axis) for axis in axes], dtype=np.intp)
    scale = np.append(robot.platform_scale[places], np.full(len(others), robot.length)) / robot.length
    return Measurements(
        names=(*(f"motor_angle_{joint}" for joint in robot.actuator_names), *names),
        values=np.column_stack([motors, *map(data.column, names)]),
        noise=np.concatenate(
            [
                noise["motor_angle"] / np.abs(robot.gear_ratio),
                np.full(len(encoders), noise["joint"]),
                noise["platform"] * scale,
            ]
        ),
        driven=robot.n_a,
        columns=np.array([*model.actuated, *encoders], dtype=np.intp),
        axes=places,
        others=np.array(list(map(LINEAR_AXES.index, others)), dtype=np.intp),
    )


def joint_names(model: ParallelRobot) -> dict[int, str]:
    """Return the names of passive hinges and slides, which an encoder may measure, by column."""
    single = single_columns(model.model)
    return {k: f"joint_{model.coordinates.name_of(k)}" for k in model.passive.tolist() if k in single}


class MeasuredOffsets(NamedTuple):
    """Offsets of the model from the measurements, and their derivatives along all joints."""

    offset: Array  # (T, m)
    slope: Array  # (T, m, nv)


def offsets(model: ParallelRobot, measured: Measurements, frames: FrameStack) -> MeasuredOffsets:
    """Compute offsets of joints, platform coordinates and positions from the measured ones."""
    joints, axes, others = measured.columns, measured.axes, measured.others
    count, first = len(joints), len(joints) + len(axes)
    x = model.platform.coordinates(frames)
    x[:, axes] = measured.values[:, count:first]
    offset = [
        model.coordinates.positions(frames.q)[:, joints] - measured.values[:, :count],
        model.platform.residual(frames, x)[:, axes],
        frames.position[:, 0, others] - measured.values[:, first:],
    ]
    slope = [
        np.tile(np.eye(model.model.nv)[joints], (len(x), 1, 1)),
        model.platform.jacobian(frames)[:, axes],
        frames.jacobian[:, 0, others],
    ]
    return MeasuredOffsets(np.concatenate(offset, axis=1), np.concatenate(slope, axis=1))


class ParameterEquations(NamedTuple):
    """Equations of the parameters at T instants, and the motion of the joints along the parameters."""

    right: Array  # (T, m) offsets over their noise, less the share that the pose compensates
    matrix: Array  # (T, m, p) derivatives along the parameters
    open_loops: Array  # (T, rows) loop equations that no joint can close, over LOOP_GAP
    loop_slopes: Array  # (T, rows, p) of these
    step: Array  # (T, k) of the joints, parameters at rest
    follow: Array  # (T, k, p) motions of the joints along the parameters


def eliminate_poses(model: ParallelRobot, measured: Measurements, q: Array) -> ParameterEquations:
    """Compute the equations of all instants at q (T, nq), with their poses eliminated."""
    frames, lengths = frames_at(model, q), model.column_scale[model.joints]
    loops = _close_linearly(model, frames)
    offset, slope = offsets(model, measured, frames)
    by_joints = slope[:, :, model.joints] * lengths / measured.noise[:, None]
    by_parameters = slope[:, :, model.elastic] / measured.noise[:, None] + by_joints @ loops.follow
    offset = offset / measured.noise + np.einsum("tmk,tk->tm", by_joints, loops.step)
    fitted = by_joints @ loops.free
    fit = np.linalg.pinv(fitted, rcond=RANK_ROUNDING)
    step = loops.step - np.einsum("tkf,tfm,tm->tk", loops.free, fit, offset)
    follow = loops.follow - loops.free @ fit @ by_parameters
    return ParameterEquations(
        right=offset - np.einsum("tmf,tfn,tn->tm", fitted, fit, offset),
        matrix=by_parameters - fitted @ (fit @ by_parameters),
        open_loops=loops.open_loops,
        loop_slopes=loops.slopes,
        step=lengths * step,
        follow=lengths[:, None] * follow,
    )


class _LinearLoops(NamedTuple):
    """Loops closed to first order by k joints at T instants, in radians and lengths of the robot."""

    step: Array  # (T, k) of least norm that closes the loops
    follow: Array  # (T, k, p) along the parameters
    free: Array  # (T, k, f) motions that the loops allow
    open_loops: Array  # (T, rows) equations that no joint can close, over LOOP_GAP
    slopes: Array  # (T, rows, p) of these along the parameters


def _close_linearly(model: ParallelRobot, frames: FrameStack) -> _LinearLoops:
    """Close the loops to first order by a singular value decomposition along the joints."""
    loops, sizes = loop_equations(model.rows, frames), 1.0 / model.row_lengths
    jacobian = sizes[:, None] * loops.jacobian
    left, values, right = np.linalg.svd(jacobian[:, :, model.joints] * model.column_scale[model.joints])
    rank = len(model.structure.independent)
    closing = right[:, :rank].swapaxes(1, 2) / values[:, None, :rank] @ left[:, :, :rank].swapaxes(1, 2)
    gap, slopes = sizes * loops.residual, jacobian[:, :, model.elastic]
    outside = left[:, :, rank:].swapaxes(1, 2) / LOOP_GAP
    return _LinearLoops(
        step=-np.einsum("tkr,tr->tk", closing, gap),
        follow=-closing @ slopes,
        free=right[:, rank:].swapaxes(1, 2),
        open_loops=np.einsum("tir,tr->ti", outside, gap),
        slopes=outside @ slopes,
    )
