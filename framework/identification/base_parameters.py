"""Base parameters: the combinations of inertial and motor parameters that motor torques determine.

The forces of a motion are linear in the parameters theta. The virtual work along the platform's twists gives

    N' Y theta = N' S tau,

where N = dq/dv are the joint rates of the closed loops for unit twists, Y is the joint torque regressor of
the open tree, and S selects the motors' joints. This is W = G' tau of `platform_wrench`. It is regular at
Type 2 singularities too, and holds with redundant motors.

Each moving body has ten parameters (m, m c, I about the origin of its joint), on the axes of its link. Each
motor has three: the rotor inertia on the motor side of the gear, and viscous and dry friction on the joint
side. The robot file has these parameters too, those of the bodies split among their links.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple
from xml.etree.ElementTree import Element, fromstring, tostring

import numpy as np
import pinocchio as pin

from framework.dynamics.body_parameters import (
    INERTIAL,
    from_pseudo_inertia,
    link_parameters,
    parameter_transform,
    pseudo_inertia,
    tree_regressor,
)
from framework.dynamics.forces import tree_forces
from framework.errors import InvalidInput, NotAssembled, NotConverged
from framework.identification.combinations import (
    Combinations,
    find_combinations,
    format_combination,
)
from framework.identification.geometry import elements_by_name
from framework.kinematics.assembly import MAX_NEWTON_STEP
from framework.kinematics.inverse_kinematics import close_each, close_loops, require_square
from framework.kinematics.linearised_loops import clearance, linearised_at
from framework.kinematics.motion_rates import Motion, motion_at, motor_speeds
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import link_axes, link_of
from framework.model.description import JointDynamics, RobotDescription
from framework.model.documents import remove_children
from framework.model.urdf_edits import inertial_element
from framework.model.urdf_elements import read_inertial
from framework.numerics.arrays import Array, IntArray, Names, ReadOnlyArrays
from framework.tolerances import BRANCHES_MEET, MASS_SHIFT, MIN_RANK_GAP, RANK_ROUNDING

LENGTH_POWERS = np.array([0, 1, 1, 1, 2, 2, 2, 2, 2, 2])  # of a length in the units of a body's parameters
OF_MOTORS = ("rotor_inertia", "damping", "friction")  # parameters of each motor, in this order


class TorqueParameters(NamedTuple):
    """The p parameters of a robot: ten for each body, then three for each motor."""

    bodies: IntArray  # (b,) indices of the bodies' joints in pinocchio
    links: Names  # (b,) names of the bodies
    names: Names  # (p,) LINK.mass and so on, JOINT.rotor_inertia and so on
    values: Array  # (p,) in the robot file, SI units
    sizes: Array  # (p,) typical sizes for a body or a motor of this robot, SI units


def torque_parameters(robot: ParallelRobot, *, massless: bool = False) -> TorqueParameters:
    """Collect the parameters that torques may depend on, with the values of the robot file.

    Args:
        massless: whether to include bodies that have no mass in the file.

    Raises:
        InvalidInput: the robot has springs that are virtual joints.
    """
    if robot.n_e:
        raise InvalidInput(
            f"{robot.name}, {robot.flexibility}: parameters are of the rigid robot; load it with "
            f"flexibility='rigid'"
        )
    model = robot.model
    motors = robot.actuated
    bodies = [j for j in range(1, model.njoints) if massless or model.inertias[j].mass > 0]
    links = tuple(link_of(model, j) for j in bodies)

    names = [f"{link}.{name}" for link in links for name in INERTIAL]
    names += [f"{joint}.{name}" for joint in robot.actuator_names for name in OF_MOTORS]

    body_values = [link_parameters(model, j) for j in bodies]  # (10,) each
    # (n_a,) each, in the order of `OF_MOTORS`
    motor_values = [robot.rotor_inertia, robot.joint_damping[motors], robot.joint_friction[motors]]
    # without a mass in the file the size is arbitrary
    mass = robot.mass or 1.0
    body_sizes = np.tile(mass * robot.length**LENGTH_POWERS, len(bodies))
    # on the joint side the inertia I is mass length^2 for a hinge and the mass for a slide; at the typical
    # rate w = sqrt(g / length) viscous friction has the size I w, and dry friction the size I w^2
    inertia = mass * (robot.length / robot.column_scale[motors]) ** 2  # the scale of a slide is the length
    rate = np.sqrt(gravity_scale(robot) / robot.length)
    motor_sizes = [inertia / robot.gear_ratio**2, inertia * rate, inertia * rate**2]  # (n_a,) each
    return TorqueParameters(
        bodies=np.array(bodies, dtype=np.intp),
        links=links,
        names=tuple(names),
        values=np.concatenate([*body_values, np.stack(motor_values, axis=1).ravel()]),
        sizes=np.concatenate([body_sizes, np.stack(motor_sizes, axis=1).ravel()]),
    )


def gravity_scale(robot: ParallelRobot) -> float:
    """Return the size of gravity [m/s^2], which sets the scale of time; 1 without gravity."""
    return float(np.linalg.norm(robot.model.gravity.linear)) or 1.0


class ParameterRegressor(NamedTuple):
    """The terms of N' Y theta + constant = N' S tau on platform axes, at T instants."""

    matrix: Array  # (T, n, p) N' Y
    constant: Array  # (T, n) wrench of springs, and of armature and damping of joints without a motor
    motors: Array  # (T, n, n_a) N' S for torques on the motor side: G' of `platform_wrench`


def parameter_regressor(
    robot: ParallelRobot, motion: Motion, parameters: TorqueParameters
) -> ParameterRegressor:
    """Compute the regressor of the closed robot at T instants of a motion.

    A motor with the gear ratio n loads its joint with the torque n^2 I a + damping v + friction sign(v). The
    constant is N' r, with r of `tree_forces`, minus the part of N' r that is linear in theta. The forces r
    contain those of bodies and damping, but neither rotors nor dry friction.

    Args:
        parameters: theta, with the values of the robot file.
    """
    # speeds of motors G (T, n_a, n) and rates of joints N (T, nv, n) for unit twists of the platform
    G, N = motor_speeds(robot, motion.linearised)
    N_transposed = N.swapaxes(1, 2)
    motors = robot.actuated
    body_part = N_transposed @ tree_regressor(robot, motion, parameters.bodies)  # (T, n, 10 b)
    v = motion.v[:, motors]
    # the motors' columns: torques for unit parameters, which act on the platform by the motors' rows of N
    unit_torques = [robot.gear_ratio**2 * motion.a[:, motors], v, np.sign(v)]  # (T, n_a) each, as `OF_MOTORS`
    motor_part = N_transposed[:, :, motors, None] * np.stack(unit_torques, axis=2)[:, None]  # (T, n, n_a, 3)
    matrix = np.concatenate([body_part, motor_part.reshape(*motor_part.shape[:2], -1)], axis=2)

    # theta without rotor inertias and dry friction, which r does not contain
    values_in_tree = parameters.values.copy()
    of_motors = values_in_tree[body_part.shape[2] :].reshape(-1, len(OF_MOTORS))  # (n_a, 3), a view
    of_motors[:, np.array(OF_MOTORS) != "damping"] = 0.0
    constant = np.matvec(N_transposed, tree_forces(robot, motion)) - matrix @ values_in_tree
    return ParameterRegressor(matrix, constant, G.swapaxes(1, 2))


RANDOM_SETS = 3  # sets of random instants; their ranks must agree
ROWS_PER_PARAMETER = 1.5  # in each set


@dataclass(frozen=True, eq=False)
class BaseParameters(ReadOnlyArrays):
    """The base parameters of a robot on its closed loops, by name.

    Attributes:
        rank: number of base parameters.
        gap: ratio of the last singular value within the rank to the first beyond it; the least over all
            random sets of instants.
        names: the base parameters, each as a combination of `parameters`.
        without_effect: parameters on which no torque depends.
        left_out: links without mass in the file, whose parameters are not identified.
    """

    robot: ParallelRobot
    rank: int
    gap: float
    names: Names
    parameters: Names
    without_effect: Names
    left_out: Names
    values: Array  # (rank,) by the robot file, SI units
    described: TorqueParameters  # the parameters with values and sizes
    combinations: Combinations  # coefficients of the base parameters, in `parameters`

    @property
    def certain(self) -> bool:
        """Whether the gap is large enough for the rank to be certain."""
        return self.gap >= MIN_RANK_GAP


def base_parameters(robot: ParallelRobot, *, massless: bool = False) -> BaseParameters:
    """Compute the parameter combinations that motor torques determine.

    All motions near the reference together determine these combinations; a motion along a single line
    determines fewer. Their number is the rank of the closed robot's regressor at random instants
    (`parameter_regressor`). Several sets of random instants must have the same rank.

    Args:
        massless: whether to include bodies that have no mass in the file.

    Raises:
        InvalidInput: the robot has springs, or its platform does not determine its joints.
        NotConverged: the sets of instants have different ranks.
    """
    return _base_parameters(robot, massless)


@lru_cache(maxsize=8)
def _base_parameters(robot: ParallelRobot, massless: bool) -> BaseParameters:
    """Compute the base parameters of a robot once."""
    described = torque_parameters(robot, massless=massless)
    random = np.random.default_rng(0)
    count = int(np.ceil(ROWS_PER_PARAMETER * len(described.names) / robot.n))  # instants of n rows each
    sets = []
    for _ in range(RANDOM_SETS):
        matrix = parameter_regressor(robot, random_motion(robot, count, random), described).matrix
        # give all instants the same weight: forces are large near singularities of the inverse kinematics
        matrix /= np.linalg.norm(matrix * described.sizes, axis=(1, 2), keepdims=True)
        sets.append(find_combinations(np.concatenate(matrix), described.sizes))

    # the set with the least clear rank decides
    ranks = [combinations.rank for combinations in sets]
    least_clear = min(sets, key=lambda combinations: combinations.gap)
    if len(set(ranks)) > 1:
        raise NotConverged(
            f"random instants give base parameters of rank {', '.join(map(str, ranks))}; the "
            f"singular values leave no clear gap",
            name=robot.name,
            residual=1.0 / least_clear.gap,
        )

    all_links = torque_parameters(robot, massless=True).links
    return BaseParameters(
        robot=robot,
        rank=least_clear.rank,
        gap=least_clear.gap,
        names=tuple(format_combination(described.names, row) for row in least_clear.coefficients),
        parameters=described.names,
        without_effect=tuple(described.names[k] for k in least_clear.without_effect),
        left_out=tuple(link for link in all_links if link not in described.links),
        values=least_clear.coefficients @ described.values,
        described=described,
        combinations=least_clear,
    )


def random_motion(robot: ParallelRobot, count: int, random: np.random.Generator) -> Motion:
    """Draw poses near the reference, rates and accelerations at `count` instants, by `random`.

    Rates have the size sqrt(g / length), accelerations the size g, so inertial forces are as large as the
    weight.

    Raises:
        InvalidInput: the platform does not determine the joints.
        NotAssembled: the loops close nowhere near the reference.
    """
    require_square(robot)
    q, x = random_poses(robot, count, random)  # (count, nq), (count, n)
    rate = np.sqrt(gravity_scale(robot) / robot.length)  # [1/s]
    dx = rate * robot.platform_scale * random.standard_normal((count, robot.n))
    ddx = rate**2 * robot.platform_scale * random.standard_normal((count, robot.n))
    return motion_at(robot, close_loops(robot, x, q), dx, ddx)


def random_poses(robot: ParallelRobot, count: int, random: np.random.Generator) -> tuple[Array, Array]:
    """Draw assembled configurations q (count, nq) and platform coordinates x (count, n).

    Each pose is the end of a random walk from the reference. A step is rejected if the loops do not close at
    its end, or if the end is near a singularity. After `steps` steps only walks without an accepted step
    continue, with ever shorter steps.
    """
    steps = 16  # of every random walk
    max_steps = 36  # of a walk that has not moved by then, each half as long as the previous one
    largest_step = 0.5  # [rad, robot lengths] of the platform
    q = np.repeat(robot.reference.q[None], count, axis=0)
    x = np.repeat(robot.reference.x[None], count, axis=0)
    has_moved = np.zeros(count, dtype=bool)
    for k in range(max_steps):
        only_unmoved = k >= steps
        if only_unmoved and has_moved.all():
            break
        step = largest_step * robot.platform_scale * random.uniform(-1.0, 1.0, (count, robot.n))
        target = x + step * 0.5 ** max(k - steps, 0)  # ever shorter after these steps
        end = close_each(robot, target, q, farthest=MAX_NEWTON_STEP)
        accepted = end.closed & ~(only_unmoved & has_moved)  # (count,) of the walks
        end_clearance = clearance(robot, linearised_at(robot, end.q[accepted]))
        accepted[accepted] = end_clearance > BRANCHES_MEET  # away from singularities
        q[accepted] = end.q[accepted]
        x[accepted] = target[accepted]
        has_moved |= accepted
    if has_moved.all():
        return q, x
    raise NotAssembled(
        "the loops close at no pose beside the reference",
        name=robot.name,
        q=robot.reference.q,
        residual=robot.reference.residual,
    )


# ------------------------------------------------------------------ links and motors in the robot file


class LinkParameters(NamedTuple):
    """The u parameters of links and motors: ten of each link on its axes, then three of each motor."""

    links: Names  # those with mass in the file
    values: Array  # (u,) in the robot file
    prior_root: Array  # (u, u) L, where L L' is their covariance by the file
    to_parameters: Array  # (p, u) matrix: adds up links to the parameters of bodies, `TorqueParameters`

    @property
    def link_slices(self) -> list[slice]:
        """The entries of each link among the u parameters."""
        return [slice(10 * i, 10 * i + 10) for i in range(len(self.links))]

    @property
    def motor_slice(self) -> slice:
        """The entries of all motors among the u parameters."""
        return slice(10 * len(self.links), None)


def collect_link_parameters(robot: ParallelRobot, parameters: TorqueParameters) -> LinkParameters:
    """Collect the u parameters of all links with mass and of the motors.

    A body consists of links fixed to one another, and its ten parameters are the sum of those of its links,
    each transformed to the axes of the body. The matrix `to_parameters` (p, u) of the result computes these
    sums and keeps the parameters of motors. The links are in the order of their bodies.

    Args:
        parameters: the p parameters of bodies and motors, `bodies` as indices of joints in pinocchio.
    """
    from scipy.linalg import block_diag  # slow to import

    urdf = fromstring(robot.description.urdf_text)
    links = elements_by_name(urdf, "link").items()
    in_file = {name: read_inertial_parameters(link) for name, link in links}  # (10,) each, mass first
    with_mass = {name: values for name, values in in_file.items() if values[0] > 0.0}  # the mass

    # a link is a frame of the kind BODY; find those of each body
    frames: list[pin.Frame] = []
    columns: list[Array] = []  # (p, 10) of `to_parameters`, for each link
    for body, joint in enumerate(parameters.bodies.tolist()):  # pinocchio's joint that carries the body
        for frame in robot.model.frames:
            if frame.parentJoint == joint and frame.type == pin.FrameType.BODY and frame.name in with_mass:
                on_body = link_axes(robot.model, joint).inverse() * frame.placement
                matrix = np.zeros((len(parameters.names), 10))
                matrix[10 * body : 10 * body + 10] = parameter_transform(on_body)  # from the link's axes
                frames.append(frame)
                columns.append(matrix)

    motors = slice(10 * len(parameters.bodies), None)
    columns.append(np.eye(len(parameters.names))[:, motors])
    link_values = [with_mass[frame.name] for frame in frames]
    # damping and friction have typical sizes of this robot, a rotor that of its inertia in the file: a rotor
    # that is zero there stays almost zero
    sizes = parameters.sizes[motors].copy()
    rotors = slice(OF_MOTORS.index("rotor_inertia"), None, len(OF_MOTORS))
    sizes[rotors] = np.maximum(parameters.values[motors][rotors], RANK_ROUNDING * sizes[rotors])
    return LinkParameters(
        links=tuple(frame.name for frame in frames),
        values=np.concatenate([*link_values, parameters.values[motors]]),
        prior_root=block_diag(*map(_link_prior, link_values), np.diag(sizes)),
        to_parameters=np.concatenate(columns, axis=1),
    )


def _link_prior(link: Array) -> Array:
    """Compute L (10, 10), where L L' is the covariance of a link's parameters (10,) by the file.

    A pseudo-inertia P = C C' is off by C X C' with a symmetric X, whose length |X|^2 = tr (P^-1 dP)^2 no
    choice of axes changes (Lee, Wensing and Park, IEEE Transactions on Robotics 36(2), 2020). With X of unit
    normals the mass is off by its own size, and lies a radius of gyration off its place along each axis. So
    a slender rod stays slender, but for a small share of the link's radius about its origin.
    """
    P = pseudo_inertia(link)
    mass = link[0]
    square = np.trace(P[:3, :3]) / mass  # of the radius; 0 for a point mass at the origin, which stays one
    P[:3, :3] += mass * square * MASS_SHIFT**2 * np.eye(3)
    scale = np.array([*[np.sqrt(square) or 1.0] * 3, 1.0])
    w, V = np.linalg.eigh(P / np.outer(scale, scale))
    C = scale[:, None] * V * np.sqrt(np.maximum(w, 0.0))
    i, j = np.tril_indices(4)
    products = C.T[i, :, None] * C.T[j, None]  # (10, 4, 4)
    weights = np.where(i == j, 0.5, np.sqrt(0.5))  # of X + X', so that entries of X count once in |X|^2
    return from_pseudo_inertia(weights[:, None, None] * (products + products.swapaxes(1, 2))).T


def read_inertial_parameters(link: Element) -> Array:
    """Read the ten parameters (10,) of a link about its origin; zeros without <inertial>.

    They are mass, first and second moments [kg, kg m, kg m^2], on the axes of the link.
    """
    mass, pose, inertia = read_inertial(link)
    moments = inertia[np.tril_indices(3)]  # (6,) in the order of INERTIAL
    # they are about the centre of mass, where the first moments are zero
    return parameter_transform(pin.SE3(pose)) @ np.array([mass, 0.0, 0.0, 0.0, *moments])


def with_masses_and_motors(robot: ParallelRobot, links: LinkParameters, values: Array) -> RobotDescription:
    """Return the robot's description with other parameters of links and motors.

    Args:
        links: the parameters in the file. Links whose parameters do not change keep their text.
        values: (u,) new values in the same order: inertial parameters of the links; rotor inertia, damping
            and friction of each motor, as in `OF_MOTORS`.
    """
    description = robot.description
    urdf = fromstring(description.urdf_text)
    elements = elements_by_name(urdf, "link")
    for name, part in zip(links.links, links.link_slices, strict=True):
        if (values[part] != links.values[part]).any():
            write_inertial(elements[name], values[part])

    # (n_a, 3) rotor inertia, damping and friction of each motor
    motors = values[links.motor_slice].reshape(-1, len(OF_MOTORS))
    actuators = []
    joints = dict(description.joints)  # only those with properties in the file; the others have defaults
    for actuator, (rotor, damping, friction) in zip(description.actuators, motors.tolist(), strict=True):
        actuators.append(replace(actuator, rotor_inertia=rotor))
        properties = joints.get(actuator.joint, JointDynamics())
        joints[actuator.joint] = replace(properties, damping=damping, friction=friction)
    return replace(
        description, urdf_text=tostring(urdf, encoding="unicode"), actuators=tuple(actuators), joints=joints
    )


def write_inertial(link: Element, parameters: Array) -> None:
    """Write ten parameters (10,) about a link's origin as its <inertial>, about the centre of mass.

    The inertia is the trace of the second moments times the identity, minus the second moments.
    """
    centre, about_centre = central_moments(parameters)
    moments, axes = np.linalg.eigh(about_centre)
    second_moments = (axes * np.maximum(moments, 0.0)) @ axes.T  # moments are negative only by rounding
    inertia = np.trace(second_moments) * np.eye(3) - second_moments
    remove_children(link, "inertial")
    link.insert(0, inertial_element(float(parameters[0]), centre, inertia))


def central_moments(parameters: Array) -> tuple[Array, Array]:
    """Compute centres of mass (..., 3) and central second moments (..., 3, 3).

    With the second moments S about the origin, those about c are S - m c c'.
    """
    mass = parameters[..., :1]
    centre = parameters[..., 1:4] / mass
    outer = mass[..., None] * centre[..., :, None] * centre[..., None, :]
    return centre, pseudo_inertia(parameters)[..., :3, :3] - outer
