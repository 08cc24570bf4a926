"""Measured poses as equations for the geometric parameters, the pose of each instant eliminated.

At an instant the joints q meet the loops, F(q, p) = 0, and what is measured differs from h(q, p) by noise.
With F_q dq + F_p dp = -F solved by a particular motion and free motions z of the loops, and z by least
squares on what is measured, rows are left that hold parameters alone. They are regular at Type 2
singularities, and noise of motors counts as that of the platform does.
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
    """What was measured at T instants, m numbers each: motors' joints first, on the joint side."""

    names: tuple[str, ...]  # (m,) columns of the recording
    values: Array  # (T, m)
    noise: Array  # (m,) standard deviations
    driven: int  # how many are of motors
    columns: IntArray  # (joints that are measured,) entries of the velocity vector
    axes: IntArray  # of the platform's coordinates
    beside: IntArray  # 0..2: places of the frame's origin that are no coordinates of the platform

    def rows(self, which: BoolArray) -> Measurements:
        """Return those of some instants."""
        return replace(self, values=self.values[which])


def measurements_of(geometry: Geometry, data: Recording, noise: dict[str, float]) -> Measurements:
    """Return what a recording has of motors, other joints and the platform.

    Args:
        noise: standard deviations by kind: motor_angle [rad or m, motor side], joint [rad or m] and platform
            [m]; those of platform turns are over the robot's length.

    Raises:
        InvalidInput: motor angles are missing, or nothing else is there.
    """
    robot, model = geometry.robot, geometry.model
    motors = data.columns("motor_angle", robot.actuator_names) / robot.gear_ratio
    names = [f"motor_angle_{joint}" for joint in robot.actuator_names]
    encoders = {column: name for column, name in joint_names(model).items() if name in data.names}
    joints = list(encoders.values())
    axes = [k for k, axis in enumerate(robot.axis_names) if f"platform_{axis}" in data.names]
    beside = [
        k
        for k, axis in enumerate(LINEAR_AXES)
        if axis not in robot.axis_names and f"platform_{axis}" in data.names
    ]
    platform = [f"platform_{robot.axis_names[k]}" for k in axes]
    platform += [f"platform_{LINEAR_AXES[k]}" for k in beside]
    if not joints + platform:
        raise InvalidInput(
            f"{data.source}: motor angles alone show nothing of the geometry; platform_"
            f"{robot.axis_names[0]} or angles of other joints are needed"
        )
    scale = np.append(robot.platform_scale[axes], np.full(len(beside), robot.length)) / robot.length
    measured = [data.column(name) for name in joints + platform]
    return Measurements(
        names=(*names, *joints, *platform),
        values=np.column_stack([motors, *measured]),
        noise=np.concatenate(
            [
                noise["motor_angle"] / np.abs(robot.gear_ratio),
                np.full(len(joints), noise["joint"]),
                noise["platform"] * scale,
            ]
        ),
        driven=robot.n_a,
        columns=np.array([*model.actuated, *encoders], dtype=np.intp),
        axes=np.array(axes, dtype=np.intp),
        beside=np.array(beside, dtype=np.intp),
    )


def joint_names(model: ParallelRobot) -> dict[int, str]:
    """Return the names of the passive joints that an encoder measures, by column; balls have none."""
    single = single_columns(model.model)
    return {k: f"joint_{model.coordinates.name_of(k)}" for k in model.passive.tolist() if k in single}


class MeasuredOffsets(NamedTuple):
    """Offsets of what the model says from what was measured, and their derivatives along all joints."""

    offset: Array  # (T, m)
    slope: Array  # (T, m, nv)


def offsets(model: ParallelRobot, measured: Measurements, frames: FrameStack) -> MeasuredOffsets:
    """Compute offsets of joints, platform coordinates and places from the measured ones."""
    joints, axes, beside = measured.columns, measured.axes, measured.beside
    count, first = len(joints), len(joints) + len(axes)
    x = model.platform.coordinates(frames)
    x[:, axes] = measured.values[:, count:first]
    unit = np.tile(np.eye(model.model.nv)[joints], (len(x), 1, 1))
    place = frames.position[:, 0, beside] - measured.values[:, first:]
    return MeasuredOffsets(
        np.concatenate(
            [
                model.coordinates.positions(frames.q)[:, joints] - measured.values[:, :count],
                model.platform.residual(frames, x)[:, axes],
                place,
            ],
            axis=1,
        ),
        np.concatenate(
            [unit, model.platform.jacobian(frames)[:, axes], frames.jacobian[:, 0, beside]], axis=1
        ),
    )


class Eliminated(NamedTuple):
    """Rows on the parameters at T instants, and the joints that follow them."""

    right: Array  # (T, m) offsets over their noise, less what the pose can make up for
    matrix: Array  # (T, m, p) derivatives along the parameters
    held: Array  # (T, rows) loop equations that no joint can close, over LOOP_GAP
    holding: Array  # (T, rows, p)
    step: Array  # (T, k) of the joints, parameters at rest
    follow: Array  # (T, k, p) how the joints follow the parameters


def eliminated(model: ParallelRobot, measured: Measurements, q: Array) -> Eliminated:
    """Compute the equations of all instants at q (T, nq), the pose of each eliminated."""
    frames = frames_at(model, q)
    loops = loop_equations(model.rows, frames)
    sizes = 1.0 / model.row_lengths
    joints, elastic = model.joints, model.elastic
    lengths = model.column_scale[joints]
    along = sizes[:, None] * loops.jacobian[:, :, joints] * lengths
    left, values, right = np.linalg.svd(along)
    rank = len(model.structure.independent)
    closing = right[:, :rank].swapaxes(1, 2) / values[:, None, :rank] @ left[:, :, :rank].swapaxes(1, 2)
    gap, opened = sizes * loops.residual, sizes[:, None] * loops.jacobian[:, :, elastic]
    step, follow = -np.einsum("tkr,tr->tk", closing, gap), -closing @ opened
    free = right[:, rank:].swapaxes(1, 2)  # (T, k, f)
    outside = left[:, :, rank:].swapaxes(1, 2) / LOOP_GAP
    offset, slope = offsets(model, measured, frames)
    by_joints = slope[:, :, joints] * lengths / measured.noise[:, None]
    by_parameters = slope[:, :, elastic] / measured.noise[:, None] + by_joints @ follow
    offset = offset / measured.noise + np.einsum("tmk,tk->tm", by_joints, step)
    fitted = by_joints @ free
    back = np.linalg.pinv(fitted, rcond=RANK_ROUNDING)
    step = step - np.einsum("tkf,tfm,tm->tk", free, back, offset)
    follow = follow - free @ back @ by_parameters
    return Eliminated(
        right=offset - np.einsum("tmf,tfn,tn->tm", fitted, back, offset),
        matrix=by_parameters - fitted @ (back @ by_parameters),
        held=np.einsum("tir,tr->ti", outside, gap),
        holding=outside @ opened,
        step=lengths * step,
        follow=lengths[:, None] * follow,
    )
