"""The geometric parameters of a robot, errors of joint origins and of lengths, and equations for them.

Each joint between the base and a frame of the platform or of a closure, fixed joints included, has six
parameters: translations along the axes of its origin, then rotations about them. Each is a virtual joint,
like that of a spring. So the equations of the robot with these joints also give derivatives with respect to
the parameters. The length of a `distance` closure is a parameter as well: it is in the constant of the row.
These are the dimensions of the robot. Parameters are the dimensions themselves or, by name, numbers of the
robot file's `parameters`, on which dimensions depend; three numbers of each fixture (`fixtures`) come behind.

At each instant of a recording the joints q close the loops, F(q, p) = 0, and the measurements are h(q, p)
plus noise. The linearised loops leave free motions z. Least squares on the measurements determines z, and the
remaining equations contain only the parameters p (`eliminate_poses`). These equations are regular at Type 2
singularities, and treat the noise of motors like that of the platform.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple
from xml.etree.ElementTree import Element, fromstring, tostring

import numpy as np

from framework.errors import InvalidInput, check_choice
from framework.identification.fixtures import Fixture, find_fixtures
from framework.identification.recording import DISTANCE, LINEAR_AXES, TOUCH, Recording
from framework.kinematics.closures import loop_equations
from framework.kinematics.frames import FrameStack, frames_at
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import single_columns
from framework.model.description import AXES, RobotDescription, Spring
from framework.model.documents import read_origin, remove_children
from framework.model.loop_rows import LoopRows
from framework.model.placement import placement, rotation_about
from framework.model.robot_file import read_robot_file
from framework.model.urdf_edits import origin_element, urdf_text
from framework.model.urdf_elements import Joint, read_tree
from framework.numerics.arrays import Array, BoolArray, IntArray, Names, ReadOnlyArrays
from framework.tolerances import LOOP_GAP, RANK_ROUNDING

ERRORS = "errors"  # suffix of the names of virtual joints
PLACED = "placed"  # suffix of the fixed joint that takes over the origin of a moving joint


@dataclass(frozen=True, eq=False)
class Geometry(ReadOnlyArrays):
    """A robot with p parameters, by which its g dimensions are off: joint origins, then lengths of closures.

    The parameters are the dimensions, or the `numbers` of the robot file, then three for each fixture.
    """

    robot: ParallelRobot
    model: ParallelRobot  # the robot with an elastic virtual joint for each parameter of an origin
    joints: Names  # joints whose origins have errors
    lengths: Names  # closures whose lengths have errors
    names: Names  # (p,) names of the parameters, JOINT.x .. JOINT.rz, CLOSURE.length
    turning: np.ndarray  # (g,) true for an angle [rad], false for a length [m]
    numbers: Names = ()  # parameters of the robot file that are calibrated in place of dimensions
    fixtures: tuple[Fixture, ...] = ()

    def dimensions(self, values: Array) -> Array:
        """Compute errors of the dimensions (g,) for changes of the parameters (p,)."""
        if not self.numbers:
            return values[: len(self.turning)]
        changes = dict(zip(self.numbers, values[: len(self.numbers)].tolist(), strict=True))
        description = self.robot.description
        changed = _with_parameters(description, changes)
        return _dimension_changes(description, changed, self.joints, self.lengths)

    def slopes(self, values: Array) -> Array:
        """Compute the derivatives (g, p) of the dimensions with respect to the parameters (p,)."""
        if not self.numbers:
            return np.eye(len(self.turning), len(self.names))
        slopes = np.zeros((len(self.turning), len(self.names)))
        for k, step in enumerate(_steps(self.robot.description, self.numbers)):
            change = step * np.eye(len(values))[k]
            difference = self.dimensions(values + change) - self.dimensions(values - change)
            slopes[:, k] = difference / (2.0 * step)
        return slopes

    def prior(self, length_error: float, angle_error: float) -> Array:
        """Return standard deviations (p,) of the file's parameters.

        The number of a file is off by as much as brings a dimension to its deviation. Of a fixture nothing is
        known but that it is no farther than the robot is long.
        """
        deviations = np.where(self.turning, angle_error, length_error)  # (g,)
        own = deviations
        if self.numbers:
            slopes = self.slopes(np.zeros(len(self.names)))[:, : len(self.numbers)]
            own = 1.0 / np.abs(slopes / deviations[:, None]).max(axis=0)
        return np.concatenate([own, *(np.full(3, fixture.length) for fixture in self.fixtures)])

    def description(self, values: Array) -> RobotDescription:
        """Return the robot's description with origins and lengths changed by parameters (p,)."""
        description = self.robot.description
        urdf = fromstring(description.urdf_text)
        elements = elements_by_name(urdf, "joint")
        moves, lengths = np.split(self.dimensions(values), [6 * len(self.joints)])
        for joint, move in zip(self.joints, moves.reshape(-1, 6), strict=True):
            if move.any():  # translations, then rotations about x, y, z, as the virtual joints of the model
                element = elements[joint]
                pose = read_origin(element, f"joint {joint!r}") @ placement(None, move[:3])
                for axis, angle in zip(np.eye(3), move[3:], strict=True):
                    pose = pose @ placement(rotation_about(axis, angle))
                remove_children(element, "origin")
                element.append(origin_element(pose))
        changes = dict(zip(self.lengths, lengths.tolist(), strict=True))
        closures = [
            replace(loop, length=(loop.length or 0.0) + changes[loop.name]) if loop.name in changes else loop
            for loop in description.closures
        ]
        return replace(description, urdf_text=tostring(urdf, encoding="unicode"), closures=tuple(closures))

    def with_lengths(self, values: Array) -> ParallelRobot:
        """Return the model with the lengths of closures changed by parameters (p,).

        With the weight 1 / 2 L of the file's length L, the constant of the row (d.d - length^2) / 2 L is
        length^2 / 2 L.
        """
        changes = dict(zip(self.lengths, self.dimensions(values)[6 * len(self.joints) :], strict=True))
        if not changes:
            return self.model

        def change(rows: LoopRows) -> LoopRows:
            """Change the constants of the rows."""
            constant = rows.constant.copy()
            for k, name in enumerate(rows.names):
                closure = name.rpartition(".")[0]
                if rows.square[k] and closure in changes:
                    constant[k] = rows.weight[k] * (rows.reach[k] + changes[closure]) ** 2
            return replace(rows, constant=constant)

        equations = replace(self.model.equations, loops=change(self.model.loops))
        return replace(self.model, rows=change(self.model.rows), equations=equations)


def parametrise_geometry(robot: ParallelRobot, joints: Sequence[str] | None = None) -> Geometry:
    """Add six geometric parameters to the origin of each joint, and one to each length of a closure.

    Each joint gets a spring of six virtual joints directly behind its origin. Behind the origin of a fixed
    joint this is behind the joint itself. For a moving joint a new fixed joint takes over the origin, and the
    virtual joints come between it and the moving joint.

    Args:
        joints: names of joints, or of closures with a length; by default all these closures, and all joints
            between the base and the frames of the platform and of closures. Or names of parameters of the
            robot file, which then are the only ones.

    Raises:
        InvalidInput: a name is not one of these, or parameters of the file are mixed with joints.
    """
    description = robot.description
    tree = read_tree(fromstring(description.urdf_text))
    # choose of the joints between the base and the frames of platform and closures
    frames = [description.platform.frame, *(frame for each in description.closures for frame in each.frames)]
    between = {joint.name for frame in frames for joint in tree.path_to_base(tree.link_of(frame))}
    candidates = [name for name in tree.joints if name in between]  # in the order of the URDF
    with_length = [closure.name for closure in description.closures if closure.length is not None]
    numbers = tuple(name for name in description.parameters if name in (joints or ()))
    for name in joints or ():
        check_choice("joint", name, [*candidates, *with_length, *description.parameters])
    if numbers and (beside := [name for name in joints or () if name not in numbers]):
        raise InvalidInput(
            f"joints: {', '.join(numbers)} and {', '.join(beside)}: give parameters of the robot file, or "
            f"joints and closures, not both"
        )
    if numbers:
        joints = _dependent_dimensions(description, numbers, candidates, with_length)
    lengths = tuple(name for name in with_length if joints is None or name in joints)
    chosen = tuple(name for name in candidates if joints is None or name in joints)

    # place a spring of six virtual joints behind the origin of each joint: the origin of a moving one goes to
    # a fixed joint before it, with a link without mass between them
    springs = []
    for name in chosen:
        joint, origin_joint = tree.joints[name], name
        if joint.moves:
            origin_joint, link = f"{name}_{PLACED}", f"{name}_{PLACED}_link"
            tree.put(Joint(origin_joint, "fixed", joint.origin, parent=joint.parent, child=link))
            tree.put(replace(joint, origin=np.eye(4), parent=link, element=None))
        stiffness = (1.0,) * len(AXES)  # required, but without effect on the geometry
        springs.append(Spring(f"{name}_{ERRORS}", "joint", origin_joint, AXES, stiffness))

    with_errors = replace(description, urdf_text=urdf_text(tree), springs=tuple(springs))
    return Geometry(
        robot=robot,
        model=ParallelRobot.from_description(with_errors, flexibility="flexible_joints"),
        joints=chosen,
        lengths=lengths,
        names=numbers
        or (*(f"{name}.{axis}" for name in chosen for axis in AXES), *(f"{name}.length" for name in lengths)),
        numbers=numbers,
        turning=np.array([axis.startswith("r") for axis in AXES] * len(chosen) + [False] * len(lengths)),
    )


def _steps(description: RobotDescription, numbers: Names) -> list[float]:
    """Return steps of differences by parameters of the robot file."""
    return [1e-6 * max(abs(description.parameters[name]), 1e-2) for name in numbers]


def _with_parameters(description: RobotDescription, changes: Mapping[str, float]) -> RobotDescription:
    """Read the robot file again with changes of its parameters."""
    values = {name: value + changes.get(name, 0.0) for name, value in description.parameters.items()}
    return read_robot_file(description.file, values)


def _dimension_changes(
    description: RobotDescription, changed: RobotDescription, joints: Sequence[str], lengths: Sequence[str]
) -> Array:
    """Compute the changes (g,) of joint origins and lengths [m, rad] from a description to a changed one."""
    origins, new_origins = (read_tree(fromstring(one.urdf_text)).joints for one in (description, changed))
    changes = []
    for name in joints:
        move = np.linalg.solve(origins[name].origin, new_origins[name].origin)  # (4, 4)
        R = move[:3, :3]  # of rotations about x, y, z in turn
        y = np.arcsin(np.clip(R[0, 2], -1.0, 1.0))
        changes += [*move[:3, 3], np.arctan2(-R[1, 2], R[2, 2]), y, np.arctan2(-R[0, 1], R[0, 0])]
    old, new = ({loop.name: loop.length or 0.0 for loop in one.closures} for one in (description, changed))
    return np.array(changes + [new[name] - old[name] for name in lengths])


def _dependent_dimensions(
    description: RobotDescription, numbers: Names, joints: Sequence[str], lengths: Sequence[str]
) -> list[str]:
    """Return the joints and closures whose dimensions depend on parameters of the robot file."""
    depend: set[str] = set()
    for name, step in zip(numbers, _steps(description, numbers), strict=True):
        changed = _with_parameters(description, {name: step})
        change = _dimension_changes(description, changed, joints, lengths)  # (g,)
        moves, lengthenings = np.split(change, [6 * len(joints)])
        dependent = [joint for joint, move in zip(joints, moves.reshape(-1, 6), strict=True) if move.any()]
        dependent += [closure for closure, longer in zip(lengths, lengthenings, strict=True) if longer]
        if not dependent or _uncalibrated_geometry(changed) != _uncalibrated_geometry(description):
            what = "gear ratios, axes or couplings too" if dependent else "no joint origin and no length"
            raise InvalidInput(
                f"{description.name}: the parameter {name} changes {what}; calibrate joints in its place"
            )
        depend.update(dependent)
    return [name for name in (*joints, *lengths) if name in depend]


def _uncalibrated_geometry(description: RobotDescription) -> tuple[object, ...]:
    """Return all that decides poses besides joint origins and lengths of closures, for comparison."""
    tree = read_tree(fromstring(description.urdf_text))
    axes = [(joint.name, *joint.axis.tolist()) for joint in tree.joints.values()]
    gears = [(motor.joint, motor.gear_ratio) for motor in description.actuators]
    # a length is left out, but not whether a closure has one
    closures = [replace(each, length=None if each.length is None else 1.0) for each in description.closures]
    return axes, gears, closures, description.couplings, description.platform


def elements_by_name(urdf: Element, tag: str) -> dict[str, Element]:
    """Return the elements of a URDF with the tag "joint" or "link", by name."""
    return {element.get("name", ""): element for element in urdf.findall(tag)}


# ------------------------------------------------------------------ measured poses as equations


@dataclass(frozen=True, eq=False)
class Measurements(ReadOnlyArrays):
    """m measurements at each of T instants, on the joint side of gears.

    In this order: the n_a joints of motors, other joints with encoders, coordinates of the platform,
    positions of the platform's frame that are no coordinates, and offsets from fixtures.
    """

    names: Names  # (m,) columns of the recording
    values: Array  # (T, m) [rad, m]
    noise: Array  # (m,) standard deviations [rad, m]
    columns: IntArray  # indices of the measured joints in the velocity vector
    axes: IntArray  # indices of the measured platform coordinates
    positions: IntArray  # base axes (0, 1, 2) of the measured positions

    def columns_of(self, source: str) -> slice:
        """Return the columns of the `motors`, or of the coordinates of the `platform`."""
        joints = len(self.columns)
        motors = sum(name.startswith("motor_angle_") for name in self.names)
        return slice(motors) if source == "motors" else slice(joints, joints + len(self.axes))

    def select_instants(self, instants: BoolArray) -> Measurements:
        """Return the measurements at the instants in a mask (T,)."""
        return replace(self, values=self.values[instants])


def select_measurements(geometry: Geometry, data: Recording, noise: dict[str, float]) -> Measurements:
    """Select the measurements of a recording that calibration uses.

    Args:
        geometry: the robot, and its model with the parameters.
        data: the recording.
        noise: standard deviations by kind: motor_angle [rad or m, motor side], joint [rad or m] and platform
            [m]. For turns of the platform its deviation is divided by the robot's length.

    Raises:
        InvalidInput: motor angles are missing, or the recording contains nothing else.
    """
    robot = geometry.robot
    model = geometry.model
    fixed = [name for name in data.names if name.startswith((DISTANCE, TOUCH))]
    motors = data.columns("motor_angle", robot.actuator_names) / robot.gear_ratio
    encoders = {column: name for column, name in encoder_names(model).items() if name in data.names}
    # measured coordinates of the platform, and positions of its frame that are no coordinates
    axes = [axis for axis in robot.axis_names if data.has("platform", [axis])]
    positions = [axis for axis in LINEAR_AXES if data.has("platform", [axis]) and axis not in axes]
    names = [*encoders.values(), *(f"platform_{axis}" for axis in axes + positions), *fixed]  # without motors
    if not names:
        raise InvalidInput(
            f"{data.source}: motor angles alone do not determine the geometry; platform_"
            f"{robot.axis_names[0]}, {DISTANCE}NAME, {TOUCH}z or angles of other joints are needed"
        )
    axis_indices = np.array([robot.axis_names.index(axis) for axis in axes], dtype=np.intp)
    deviations = [  # of motors, encoders, coordinates and positions, like all columns
        *(noise["motor_angle"] / np.abs(robot.gear_ratio)),
        *[noise["joint"]] * len(encoders),
        *(noise["platform"] * robot.platform_scale[axis_indices] / robot.length),
        *[noise["platform"]] * (len(positions) + len(fixed)),
    ]
    return Measurements(
        names=(*(f"motor_angle_{joint}" for joint in robot.actuator_names), *names),
        values=np.column_stack([motors, *map(data.column, names)]),
        noise=np.array(deviations),
        columns=np.array([*model.actuated, *encoders], dtype=np.intp),
        axes=axis_indices,
        positions=np.array([LINEAR_AXES.index(axis) for axis in positions], dtype=np.intp),
    )


def encoder_names(model: ParallelRobot) -> dict[int, str]:
    """Return the names of recording columns of passive joints, by index in the velocity vector.

    Only joints with one freedom are included: an encoder can measure them.
    """
    single = single_columns(model.model)
    return {k: f"joint_{model.coordinates.name_of(k)}" for k in model.passive.tolist() if k in single}


def sensor_slopes(model: ParallelRobot, q: Array) -> dict[str, Array]:
    """Compute derivatives of all measurable quantities at q (T, nq), by name.

    The quantities are the position and the rotation of the platform's frame, with derivatives (T, nv), and
    the joints that an encoder can measure, with constant derivatives (nv,).
    """
    jacobian = frames_at(model, q).frame_jacobian()  # (T, 6, nv)
    axes = [*(f"platform_{axis}" for axis in "xyz"), *(f"the platform's turn about {axis}" for axis in "xyz")]
    slopes = dict(zip(axes, jacobian.swapaxes(0, 1), strict=True))
    for column, name in encoder_names(model).items():
        slopes[name] = np.eye(model.model.nv)[column]
    return slopes


def place_fixtures(geometry: Geometry, measured: Measurements, q: Array) -> Geometry:
    """Return the geometry with the fixtures of the measurements at poses q (T, nq)."""
    columns = tuple(name for name in measured.names if name.startswith((DISTANCE, TOUCH)))
    points = frames_at(geometry.model, q).platform_origin
    values = measured.values[:, len(measured.names) - len(columns) :]
    fixtures = find_fixtures(columns, points, values, geometry.robot.length)
    names = (*geometry.names, *(name for fixture in fixtures for name in fixture.names))
    return replace(geometry, names=names, fixtures=fixtures)


def measurement_offsets(
    geometry: Geometry, model: ParallelRobot, measured: Measurements, frames: FrameStack, values: Array
) -> tuple[Array, Array, Array]:
    """Compute offsets of the model from measurements at T instants, and slopes along joints and parameters.

    The m offsets of an instant are in the order of `Measurements`.

    Args:
        model: of the geometry, with the lengths of its closures.
        frames: those of T poses.
        values: (p,) parameters.

    Returns:
        Values of the model minus measured values (T, m) [rad, m]; their derivatives (T, m, nv) along all
        joints, those of the parameters included; those (T, m, 3 fixtures) along parameters of the fixtures.
    """
    joints = measured.columns
    axes = measured.axes
    positions = measured.positions
    ends = np.cumsum([len(joints), len(axes), len(positions)])  # the first columns of each kind but the first
    joint_values, x_values, position_values, fixed_values = np.split(measured.values, ends, axis=1)
    # measured platform coordinates (T, n), with the model's values for those that are not measured
    # (`residual` needs all coordinates)
    x = model.platform.coordinates(frames)
    x[:, axes] = x_values
    offset = [
        model.coordinates.positions(frames.q)[:, joints] - joint_values,
        model.platform.residual(frames, x)[:, axes],
        frames.platform_origin[:, positions] - position_values,
    ]
    slope = [
        np.tile(np.eye(model.model.nv)[joints], (len(x), 1, 1)),
        model.platform.jacobian(frames)[:, axes],
        frames.frame_jacobian()[:, positions],
    ]
    T, m = measured.values.shape
    by_fixtures = np.zeros((T, m, 3 * len(geometry.fixtures)))
    moves = values[len(geometry.names) - by_fixtures.shape[2] :].reshape(-1, 3)
    for k, (fixture, move) in enumerate(zip(geometry.fixtures, moves, strict=True)):
        off, by_point, by_move = fixture.offsets(frames.platform_origin, fixed_values[:, k], move)
        by_fixtures[:, ends[-1] + k, 3 * k : 3 * k + 3] = by_move
        offset.append(off[:, None])
        slope.append(by_point[:, None] @ frames.frame_jacobian()[:, :3])
    return np.concatenate(offset, axis=1), np.concatenate(slope, axis=1), by_fixtures


class ParameterEquations(NamedTuple):
    """Linear equations residual + matrix dp = noise for steps dp of p parameters, at T instants."""

    residual: Array  # (T, m) offsets over their noise, minus the part that a step of the pose can remove
    matrix: Array  # (T, m, p) derivatives of `residual` along the parameters
    loop_residual: Array  # (T, rows) of loop equations that no joint can close, over LOOP_GAP
    loop_slopes: Array  # (T, rows, p) derivatives of `loop_residual` along the parameters
    joint_step: Array  # (T, k) [rad, m] steps of the joints at constant parameters
    joint_slopes: Array  # (T, k, p) further steps of the joints for unit steps of the parameters
    per_instant: int  # equations of an instant that are left: eliminating a pose uses up one for each motor


def eliminate_poses(
    geometry: Geometry, measured: Measurements, q: Array, values: Array
) -> ParameterEquations:
    """Compute the equations of the parameters at poses q (T, nq), with the poses eliminated.

    F_q and F_p are the derivatives of the r loop equations F along the k joints [rad, robot lengths] and the
    p parameters. With F_q = U S V', the first columns of U and V, as many as the rank, give the steps of the
    joints that keep the loops closed, dq = -F_q^+ (F + F_p dp) + free z. The other columns of V are the f
    free motions, and those of U the combinations of loop equations that no joint can close.

    The offsets over their noise are then r + A dp + B z. Least squares gives z = -B^+ (r + A dp), and
    (1 - B B^+) (r + A dp) remains (variable projection, Golub and Pereyra 1973).

    Args:
        measured: m measurements at the T instants, with their standard deviations `noise` (m,).
        values: (p,) parameters at q.
    """
    model = geometry.with_lengths(values)
    frames = frames_at(model, q)
    scale = model.column_scale[model.joints]  # (k,) units of the k joints of the robot itself
    by_parameters = geometry.slopes(values)  # (g, p) of the dimensions: elastic joints of the model, lengths

    # the linearised loops, dimensionless
    loops = loop_equations(model.rows, frames)
    weights = 1.0 / model.row_lengths  # (r,)
    gap = weights * loops.residual  # (T, r) F
    jacobian = weights[:, None] * loops.jacobian
    F_q = jacobian[:, :, model.joints] * scale  # (T, r, k)
    by_lengths = np.zeros((len(q), len(weights), len(geometry.lengths)))
    for row, name in enumerate(model.rows.names):
        if model.rows.square[row] and (closure := name.rpartition(".")[0]) in geometry.lengths:
            slope = -2.0 * model.rows.weight[row] * model.rows.reach[row]
            by_lengths[:, row, geometry.lengths.index(closure)] = weights[row] * slope
    F_p = np.concatenate([jacobian[:, :, model.elastic], by_lengths], axis=2) @ by_parameters  # (T, r, p)
    U, S, V_rows = np.linalg.svd(F_q)
    rank = len(model.structure.independent)
    U_rows, V = U.swapaxes(1, 2), V_rows.swapaxes(1, 2)
    inverse = V[:, :, :rank] / S[:, None, :rank] @ U_rows[:, :rank]  # (T, k, r) pseudo-inverse of F_q
    unreachable = U_rows[:, rank:] / LOOP_GAP  # (T, rows, r)
    closing_step = -np.matvec(inverse, gap)  # (T, k)
    joint_slopes = -inverse @ F_p  # (T, k, p)
    free_motions = V[:, :, rank:]  # (T, k, f)

    # the offsets over their noise, and their slopes along joints and parameters
    offsets, slopes, by_fixtures = measurement_offsets(geometry, model, measured, frames, values)
    slopes = slopes / measured.noise[:, None]  # (T, m, nv)
    by_joints = slopes[:, :, model.joints] * scale  # (T, m, k)
    r = offsets / measured.noise + np.matvec(by_joints, closing_step)  # (T, m)
    # a parameter acts directly, and through the joints that move to keep the loops closed
    A = by_joints @ joint_slopes + slopes[:, :, model.elastic] @ by_parameters[: model.n_e]  # (T, m, p)
    A[:, :, len(geometry.names) - by_fixtures.shape[2] :] += by_fixtures / measured.noise[:, None]
    B = by_joints @ free_motions  # (T, m, f)

    # eliminate z
    B_inverse = np.linalg.pinv(B, rcond=RANK_ROUNDING)
    minus_z = np.matvec(B_inverse, r)  # (T, f) -z at constant parameters, dp = 0
    minus_z_slope = B_inverse @ A  # (T, f, p) -dz/dp
    return ParameterEquations(
        residual=r - np.matvec(B, minus_z),
        matrix=A - B @ minus_z_slope,
        loop_residual=np.matvec(unreachable, gap),
        loop_slopes=unreachable @ F_p,
        joint_step=scale * (closing_step - np.matvec(free_motions, minus_z)),
        joint_slopes=scale[:, None] * (joint_slopes - free_motions @ minus_z_slope),
        per_instant=len(measured.names) - model.n_a,
    )
