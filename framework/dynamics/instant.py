"""One instant of a robot: what its motors, loops and joints carry, and the inertia that is felt.

No law and no path: a pose, rates and accelerations of the platform, wrenches of the world. With r the forces
of the open tree (RNEA, less the wrenches), S the motors' columns, J the Jacobian of all loop equations,
redundant ones too,

    r = S tau_joint + J' lambda.

Motor torques follow from the independent equations, as everywhere (`forces`). lambda is unique only where J'
has no null space: what the null space can reach, in a loop or in a joint, is indeterminate in a rigid robot,
and is not a number here instead of one choice of many.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.arrays import Array, ArrayLike, ReadOnlyArrays, read_only
from framework.dynamics.forces import balanced_forces, motor_torque, tree_forces
from framework.dynamics.platform_wrench import motor_speeds
from framework.errors import InvalidInput, SingularPose, choose_from, finite_numbers, point, short
from framework.kinematics.closures import loop_equations, loop_wrenches
from framework.kinematics.frames import scratch_of
from framework.kinematics.inverse_kinematics import Motion, assembled_at, motion_at, require_square
from framework.kinematics.loop_matrices import passive_matrix
from framework.kinematics.mechanism import frame_of
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot

HELD = 1e-7  # least singular value of P (radians, robot lengths) at which motors count as holding the robot
REACHED = 1e-9  # [N, lengths] by which a unit of what may be added to lambda moves what is not rounding


@dataclass(frozen=True, eq=False)
class Instant(ReadOnlyArrays):
    """What a robot is and carries at one instant; wrenches are (force, moment) (6,) in base axes [N, N m].

    `loop_forces` of a closure with frames [a, b]: BY b's body ON a's body, at a's origin. `reactions` of a
    joint: BY the body before it ON the one behind it, at the joint's origin; the part along the joint's axis
    is what a motor (rotor not included) or a spring gives. Components that the loops leave indeterminate are
    NaN. Springs keep the deflections of q; `spring_force` is what they would have to give for that.
    """

    robot: ParallelRobot
    q: Array  # (nq,)
    v: Array  # (nv,)
    a: Array  # (nv,)
    torque: Array  # (n_a,) motor side [N m]: rotor inertia and joint torque through the gear
    joint_torque: Array  # (n_a,) joint side, rotors not included [N m, N]
    spring_force: Array  # (n_e,) [N, N m]
    loop_forces: Mapping[str, Array]
    reactions: Mapping[str, Array]
    platform_inertia: Array  # (n, n) of all bodies and rotors, along the platform's twist on its axes
    motor_inertia: Array  # (n_a, n_a) of the same, joint side; NaN with redundant motors
    clearance: float  # least singular value of P (radians, robot lengths): 0 at Type 2

    @property
    def indeterminate(self) -> tuple[str, ...]:
        """Names of what cannot be told: `tip: force z`, `elbow: moment x`."""
        parts = [f"{kind} {axis}" for kind in ("force", "moment") for axis in "xyz"]
        return tuple(
            f"{name}: {part}"
            for wrenches in (self.loop_forces, self.reactions)
            for name, wrench in wrenches.items()
            for part, value in zip(parts, wrench, strict=True)
            if np.isnan(value)
        )


def dynamics_at(
    robot: ParallelRobot,
    q: ArrayLike,
    *,
    dx: ArrayLike | None = None,
    ddx: ArrayLike | None = None,
    wrenches: Mapping[str, ArrayLike] | None = None,
) -> Instant:
    """Motor torques, loop forces, joint reactions and inertia at an assembled configuration q (nq,).

    Args:
        q: as `assemble` or `forward_kinematics` give it.
        dx, ddx: rates (n,) and accelerations (n,) of the platform coordinates, 0 by default.
        wrenches: of the world, by URDF link or joint: ON its body, at its origin, (force, moment) (6,) in
            base axes [N, N m].

    Raises:
        InvalidInput: q leaves the loops open; an argument of the wrong length, or a frame that is not there;
            a platform that does not determine the joints.
        NotAssembled: it does not at this pose (Type 1).
        SingularPose: the motors do not hold the robot there (Type 2). The torque is then a limit that needs
            the motion on both sides and condition (8): see `inverse_dynamics`.
    """
    expect_robot(robot)
    require_square(robot)
    closed = assembled_at(robot, q)
    dx, ddx = (
        np.zeros(robot.n) if given is None else finite_numbers(name, given, robot.n)
        for name, given in (("dx", dx), ("ddx", ddx))
    )
    clearance = float(
        np.linalg.svd(passive_matrix(robot, closed.system)[0], compute_uv=False).min(initial=np.inf)
    )
    if clearance < HELD:
        raise SingularPose(
            f"{robot.name}: at {', '.join(robot.axis_names)} = {point(closed.x[0])} the motors do not hold "
            f"the robot (Type 2): torque is a limit there that needs the motion on both sides; plan one",
            platform=closed.x[0],
        )
    motion = motion_at(robot, closed, dx[None], ddx[None])
    if not isinstance(wrenches, Mapping | None):
        raise InvalidInput(f"wrenches: needs a wrench by frame, {{name: (6,)}}, got {short(wrenches)}")
    loads = [_load(robot, motion.q[0], frame, wrench) for frame, wrench in (wrenches or {}).items()]
    r = tree_forces(robot, motion)
    for load in loads:
        r = r - load.generalised
    forces = balanced_forces(robot, motion.system, r)
    loops = _balanced_loops(robot, motion, r[0], forces.joint_torque[0])
    platform_inertia, motor_inertia = _inertia(robot, motion)
    return Instant(
        robot=robot,
        q=closed.q[0],
        v=motion.v[0],
        a=motion.a[0],
        torque=motor_torque(robot, motion, forces.joint_torque)[0],
        joint_torque=forces.joint_torque[0],
        spring_force=forces.spring_force[0],
        loop_forces=_loop_forces(robot, loops),
        reactions=_reactions(robot, motion, loads, loops),
        platform_inertia=platform_inertia,
        motor_inertia=motor_inertia,
        clearance=clearance,
    )


class _Load(NamedTuple):
    """A wrench of the world on the body that a joint carries."""

    joint: int
    about_base: pin.Force
    generalised: Array  # (nv,)


class _Loops(NamedTuple):
    """All loop equations as wrenches, and how much of each acts."""

    wrench: Array  # (rows, 6) on the second body, at the origin of the second frame
    position: Array  # (rows, 3) of that origin
    multipliers: Array  # (rows,) the smallest that balance the robot
    free: Array  # (k, rows) what may be added to them, and no joint feels it


def _load(robot: ParallelRobot, q: Array, frame: str, wrench: ArrayLike) -> _Load:
    model, data = robot.model, scratch_of(robot).data
    names = [one.name for one in model.frames[1:]]  # not the universe
    if frame not in names:
        raise InvalidInput(f"wrenches: {choose_from('frame', frame, names)}")
    index = frame_of(model, frame)
    given = finite_numbers(f"wrenches: {frame}", wrench, 6)
    jacobian = pin.computeFrameJacobian(model, data, q, index, pin.LOCAL_WORLD_ALIGNED)
    pin.framesForwardKinematics(model, data, q)
    at = pin.SE3(np.eye(3), data.oMf[index].translation)
    return _Load(int(model.frames[index].parentJoint), at.act(pin.Force(given)), jacobian.T @ given)


def _balanced_loops(robot: ParallelRobot, motion: Motion, r: Array, joint_torque: Array) -> _Loops:
    """Solve r = S tau + J' lambda for all rows of J, along the joints that follow."""
    at = motion.system.frames
    loops = loop_wrenches(robot.rows, at)
    lengths = np.where(robot.rows.rotation, 1.0, robot.length)  # rows in radians and robot lengths
    columns = robot.column_scale[robot.moving]
    jacobian = loop_equations(robot.rows, at).jacobian[0][:, robot.moving]
    balanced = (jacobian * columns / lengths[:, None]).T
    left = r[robot.moving]
    left[: robot.n_a] -= joint_torque
    multipliers = np.linalg.lstsq(balanced, left * columns, rcond=None)[0] / lengths
    sizes, ways = np.linalg.svd(balanced)[1:]
    free = ways[int(np.sum(sizes > REACHED * sizes.max(initial=0.0))) :] / lengths
    return _Loops(loops.wrench[0], at.position[0, robot.rows.second], multipliers, free)


def _loop_forces(robot: ParallelRobot, loops: _Loops) -> dict[str, Array]:
    """BY b's body ON a's body: the opposite of what acts on b, closure by closure."""
    found, first = {}, 0
    for closure in robot.description.closures:
        rows = slice(first, first + len(closure.axes))
        first = rows.stop
        wrench = -loops.multipliers[rows] @ loops.wrench[rows]
        found[closure.name] = _told(robot, wrench, loops.free[:, rows] @ loops.wrench[rows])
    return found


def _reactions(robot: ParallelRobot, motion: Motion, loads: list[_Load], loops: _Loops) -> dict[str, Array]:
    """By RNEA with the wrenches of the world and of the loops on the bodies."""
    model, data = robot.model, scratch_of(robot).data
    joints = range(1, model.njoints)
    carriers = [int(model.frames[frame].parentJoint) for frame in robot.frames]

    def reactions(multipliers: Array) -> Array:
        """(joints, 6) at the joints' origins."""
        pin.forwardKinematics(model, data, motion.q[0])
        forces = [pin.Force.Zero() for _ in range(model.njoints)]
        for load in loads:
            forces[load.joint] += data.oMi[load.joint].actInv(load.about_base)
        for k, (wrench, at) in enumerate(zip(loops.wrench, loops.position, strict=True)):
            about_base = pin.SE3(np.eye(3), at).act(pin.Force(multipliers[k] * wrench))
            second, first = carriers[robot.rows.second[k]], carriers[robot.rows.first[k]]
            forces[second] += data.oMi[second].actInv(about_base)
            forces[first] -= data.oMi[first].actInv(about_base)
        pin.rnea(model, data, motion.q[0], motion.v[0], motion.a[0], pin.StdVec_Force(forces))
        turned = [pin.SE3(data.oMi[j].rotation, np.zeros(3)).act(data.f[j]).vector for j in joints]
        return np.array(turned)

    told = reactions(loops.multipliers)
    moved = np.array([reactions(loops.multipliers + one) - told for one in loops.free])
    moved = moved.reshape(len(loops.free), *told.shape)
    names = [str(model.names[j]) for j in joints]
    return {name: _told(robot, told[j], moved[:, j]) for j, name in enumerate(names)}


def _told(robot: ParallelRobot, wrench: Array, moved: Array) -> Array:
    """A wrench (6,), NaN where what may be added to lambda, a unit force or so, moves it, moved (k, 6)."""
    lever = np.repeat([1.0, robot.length], 3)
    reached = np.abs(moved / lever).max(axis=0, initial=0.0) * robot.length
    return read_only(np.where(reached > REACHED, np.nan, wrench))


def _inertia(robot: ParallelRobot, motion: Motion) -> tuple[Array, Array]:
    """Inertia matrices along the platform's twist (n, n), and along the motors' joints (n_a, n_a)."""
    data = scratch_of(robot).data
    upper = np.triu(pin.crba(robot.model, data, motion.q[0]))
    mass = upper + np.triu(upper, 1).T
    mass[robot.actuated, robot.actuated] += robot.rotor_inertia * robot.gear_ratio**2
    rates = motor_speeds(robot, motion.system)[1][0]  # (nv, n)
    along_platform = rates.T @ mass @ rates
    if robot.n_a != robot.n:
        return along_platform, np.full((robot.n_a, robot.n_a), np.nan)
    to_platform = np.linalg.inv(rates[robot.actuated])
    return along_platform, to_platform.T @ along_platform @ to_platform
