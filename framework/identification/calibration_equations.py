"""Measured poses as equations for the geometric parameters, with the pose of each instant eliminated.

At each instant the joints q close the loops, F(q, p) = 0, and measurements differ from h(q, p) by noise. The
linearised loops F_q dq + F_p dp = -F have the solutions dq = step + follow dp + free z. Least squares on the
measurements determine z, and the remaining equations contain only the parameters p. They are regular at Type
2 singularities, and noise of motors counts like noise of the platform.
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
    others: IntArray  # of 0..2: positions of the frame's origin that are no coordinates of the platform

    def rows(self, which: BoolArray) -> Measurements:
        """Return the measurements at the instants marked in `which` (T,)."""
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
    """Model values less measured ones, and their derivatives along all joints."""

    offset: Array  # (T, m)
    slope: Array  # (T, m, nv)


def offsets(model: ParallelRobot, measured: Measurements, frames: FrameStack) -> MeasuredOffsets:
    """Compute the offsets of joints, platform coordinates and positions from the measured values."""
    joints, axes, others = measured.columns, measured.axes, measured.others
    joint_values, x_values, position_values = np.split(
        measured.values, [len(joints), len(joints) + len(axes)], axis=1
    )
    x = model.platform.coordinates(frames)
    x[:, axes] = x_values
    offset = [
        model.coordinates.positions(frames.q)[:, joints] - joint_values,
        model.platform.residual(frames, x)[:, axes],
        frames.position[:, 0, others] - position_values,
    ]
    slope = [
        np.tile(np.eye(model.model.nv)[joints], (len(x), 1, 1)),
        model.platform.jacobian(frames)[:, axes],
        frames.frame_jacobian(0)[:, others],
    ]
    return MeasuredOffsets(np.concatenate(offset, axis=1), np.concatenate(slope, axis=1))


class ParameterEquations(NamedTuple):
    """Linear equations right + matrix dp = noise at T instants, and the joints' steps for parameters dp."""

    right: Array  # (T, m) offsets over their noise, without the part that a change of the pose removes
    matrix: Array  # (T, m, p) derivatives of `right` along the parameters
    open_loops: Array  # (T, rows) loop equations that no joint can close, over LOOP_GAP
    loop_slopes: Array  # (T, rows, p) derivatives of `open_loops` along the parameters
    step: Array  # (T, k) of the joints at constant parameters
    follow: Array  # (T, k, p) steps of the joints for unit steps of the parameters


def eliminate_poses(model: ParallelRobot, measured: Measurements, q: Array) -> ParameterEquations:
    """Compute the equations of the parameters at q (T, nq), with the poses eliminated.

    Offsets over their noise are r + A dp + B z, with z the free motions of the loops. Least squares give
    z = -B^+ (r + A dp), so the equations (1 - B B^+) (r + A dp) remain.
    """
    frames, lengths = frames_at(model, q), model.column_scale[model.joints]
    loops = _close_linearly(model, frames)
    offset, slope = offsets(model, measured, frames)
    by_joints = slope[:, :, model.joints] * lengths / measured.noise[:, None]
    A = slope[:, :, model.elastic] / measured.noise[:, None] + by_joints @ loops.follow
    r = offset / measured.noise + np.einsum("tmk,tk->tm", by_joints, loops.step)
    B = by_joints @ loops.free
    B_inverse = np.linalg.pinv(B, rcond=RANK_ROUNDING)
    step = loops.step - np.einsum("tkf,tfm,tm->tk", loops.free, B_inverse, r)
    follow = loops.follow - loops.free @ B_inverse @ A
    return ParameterEquations(
        right=r - np.einsum("tmf,tfn,tn->tm", B, B_inverse, r),
        matrix=A - B @ (B_inverse @ A),
        open_loops=loops.open_loops,
        loop_slopes=loops.slopes,
        step=lengths * step,
        follow=lengths[:, None] * follow,
    )


class _LinearLoops(NamedTuple):
    """Solutions dq = step + follow dp + free z of the linearised loops at T instants, k joints.

    Steps are in radians and lengths of the robot.
    """

    step: Array  # (T, k) of least norm that closes the loops
    follow: Array  # (T, k, p) for unit steps of the parameters
    free: Array  # (T, k, f) motions that the loops allow
    open_loops: Array  # (T, rows) loop equations that no joint can close, over LOOP_GAP
    slopes: Array  # (T, rows, p) derivatives of `open_loops` along the parameters


def _close_linearly(model: ParallelRobot, frames: FrameStack) -> _LinearLoops:
    """Solve the linearised loop equations for the joints by a singular value decomposition.

    F_q = U S V'. The first columns of U and V, as many as the rank, give the step; the other columns of V are
    the free motions, the other columns of U the equations that no joint can close.
    """
    loops, weights = loop_equations(model.rows, frames), 1.0 / model.row_lengths
    jacobian = weights[:, None] * loops.jacobian
    gap, F_p = weights * loops.residual, jacobian[:, :, model.elastic]
    U, S, V_rows = np.linalg.svd(jacobian[:, :, model.joints] * model.column_scale[model.joints])
    rank = len(model.structure.independent)
    inverse = V_rows[:, :rank].swapaxes(1, 2) / S[:, None, :rank] @ U[:, :, :rank].swapaxes(1, 2)
    unreachable = U[:, :, rank:].swapaxes(1, 2) / LOOP_GAP
    return _LinearLoops(
        step=-np.einsum("tkr,tr->tk", inverse, gap),
        follow=-inverse @ F_p,
        free=V_rows[:, rank:].swapaxes(1, 2),
        open_loops=np.einsum("tir,tr->ti", unreachable, gap),
        slopes=unreachable @ F_p,
    )
