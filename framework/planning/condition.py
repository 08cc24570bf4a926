"""Condition (8) on a path: alpha s" + beta s'^2 + gamma + delta s' = 0 at the singular point.

At a Type 2 singularity the motors cannot exert a wrench along the platform's twist t_s. Their torques stay
finite only if the motion requires no such wrench: t_s . W_p = 0, where W_p is the wrench on the platform that
the inertia and weight of all bodies require (Briot and Arakelian 2010, condition (8)).

The power t_s . W_p is computed as eta . r. Here eta (`motion` in the code) are the joint rates of t_s with
locked motors, and r are the generalised forces of the open tree (`dynamics.forces`) less the external
wrenches. On a path, r is affine in s" and quadratic in s', so a few evaluations of the inverse dynamics give
the coefficients, as in toppra. Only viscous damping and changing deflections contribute to delta.
"""

from __future__ import annotations

import numpy as np

from framework.dynamics.forces import damping_forces, inertial_forces, static_forces
from framework.errors import NoLaw, NotConverged, point
from framework.kinematics.continuation.tracking import Branch
from framework.kinematics.motion_rates import Motion, motion_at
from framework.numerics.arrays import Array, freeze
from framework.singularity.points_on_path import Condition8, SingularPoint
from framework.singularity.type2 import uncontrolled_motion
from framework.tolerances import CONDITION_ROUNDING, NO_HOLD


def imposed_point(branch: Branch, s: float) -> SingularPoint:
    """Return the point at s where the user imposes condition (8), t_s . W_p = 0.

    The pose there need not be singular: with rounded data it lies beside the singular one. t_s is then the
    motion that the motors control least.
    """
    pose = branch.close(s)
    freeze(pose)
    least = uncontrolled_motion(branch.robot, pose)._replace(corank=1)
    return SingularPoint.of(branch, s, pose, least, contact="imposed", slope=np.nan)


def require_effect(branch: Branch, crossing: SingularPoint, *, deflected: bool) -> SingularPoint:
    """Return a crossing point unchanged; refuse one whose condition (8) no s" meets.

    Args:
        deflected: whether the condition was computed with deflections.

    Raises:
        NoLaw: s" has no effect on t_s . W_p (alpha = 0), so that no law can meet the condition.
        NotConverged: s" has no effect with these deflections; with others it may have one.
    """
    robot, condition = branch.robot, crossing.condition
    if condition is None or condition.holds_anyway or condition.alpha != 0.0:
        return crossing
    axes, x = ", ".join(robot.axis_names), point(branch.path(crossing.s))
    where = f"at s = {crossing.s:.6g}, {axes} = {x}"
    if deflected and robot.n_e:
        raise NotConverged(
            f'{where} s" has no effect on t_s . W_p once the robot deflects: with these deflections the path '
            f"runs orthogonal to t_s",
            name=robot.name,
            residual=0.0,  # no iteration failed: the pose is exact, and alpha is 0
        )
    raise NoLaw(
        f'{where} the path runs orthogonal to t_s: s" has no effect on t_s . W_p there',
        name=robot.name,
        clauses=("cross in another direction",),
    )


def coefficients_at(branch: Branch, crossing: SingularPoint, deflection: Array | None) -> Condition8:
    """Compute the coefficients of condition (8) at a crossing point.

    It is t_s . W_p = alpha s" + beta s'^2 + gamma + delta s' = 0. Each coefficient is the power of these
    generalised forces in the uncontrolled motion, whose twist t_s has unit size:

        alpha: inertia at s" = 1
        beta:  inertia at s' = 1
        gamma: weight and external wrenches at rest, and inertia and damping while only deflections change
        delta: damping at s' = 1, and the inertial forces that are bilinear in s' and the deflection rates

    Args:
        deflection: (3, n_e) deflections at the crossing and two time derivatives; None for springs at rest.
    """
    robot, path = branch.robot, branch.path
    deflection = deflection if robot.n_e else None
    s = np.array([crossing.s])
    # T motions of the one pose: s' = 1 with springs at rest, then moving springs at s' = 0 and at s' = 1
    speeds = np.ones((1, 1))  # s' (T, 1)
    spring_rates = np.empty((0, 1, robot.n_e))
    if deflection is not None:
        speeds = np.array([[1.0], [0.0], [1.0]])
        spring_rates = np.array([[0.0], [1.0], [1.0]]) * deflection[1:, None]  # (2, T, n_e)
    pose = crossing.pose.select(np.zeros(len(speeds), dtype=np.intp))
    motion = motion_at(robot, pose, speeds * path(s, 1), speeds**2 * path(s, 2), *spring_rates)
    rates = motion.v[:1]  # dq/ds (1, nv)
    inertia = inertial_forces(robot, motion)  # (T, nv)
    damping = damping_forces(robot, motion.q, motion.v)  # (T, nv)
    # s" = 1 at rest gives joints the accelerations dq/ds
    (along_path,) = inertial_forces(robot, Motion(motion.q[:1], np.zeros(rates.shape), rates, crossing.pose))
    wrenches = branch.wrenches.evaluate(robot, crossing.pose.frames, s)
    (static,) = static_forces(robot, motion.q[:1], wrenches)

    # powers (4, nv) of each joint for alpha, beta, gamma and delta
    eta = crossing.motion
    powers = eta * np.array([along_path, inertia[0], static, damping[0]])
    values = powers.sum(axis=1)  # (4,)

    # a coefficient that is small against the sum (4,) of the sizes of its terms is rounding
    largest_rate = np.abs(rates / robot.column_scale).max()  # [rad, robot lengths]
    term_sizes = np.maximum(bounds_of_terms(branch, crossing, largest_rate), np.abs(powers).sum(axis=1))
    has_effect = abs(values[0]) > NO_HOLD * term_sizes[0]
    if deflection is not None:
        # moving springs add to gamma, and to delta the forces of both motions at once less those of each
        bilinear = inertia[2] - inertia[0] - inertia[1]
        of_springs = eta * np.array([inertia[1] + damping[1], bilinear])  # (2, nv)
        values[2:] += of_springs.sum(axis=1)
        term_sizes[2:] += np.abs(of_springs).sum(axis=1)
        # stiff springs add small terms, which are not rounding as long as s" has an effect
        if has_effect:
            return Condition8(*values.tolist())
    # where s" has no effect, no motion compensates the others: they count as rounding up to a larger share
    rounding = CONDITION_ROUNDING if has_effect else NO_HOLD
    return Condition8(*np.where(np.abs(values) > rounding * term_sizes, values, 0.0).tolist())


def bounds_of_terms(branch: Branch, crossing: SingularPoint, rate: float) -> Array:
    """Bound the sizes (4,) of the terms of alpha, beta, gamma and delta of condition (8).

    Terms that cancel within one joint force do not show in the powers of the joints. An example is a payload
    on massless legs whose forces are all orthogonal to t_s. So these bounds let the mass of all bodies move
    like the platform and, for beta, at the end of a joint of the robot's length. The bound for delta is 0,
    because the damping of a joint is one term, which cannot cancel.

    Args:
        crossing: the point of the path at which the condition holds.
        rate: the largest dq/ds of a joint [rad, robot lengths].
    """
    robot = branch.robot
    units = robot.length / robot.platform_scale  # [m] per unit of each platform coordinate
    tangent = np.abs(robot.platform.path_twist(branch.path, crossing.s) * units).max()  # [m] of dx/ds
    twist_size = np.abs(crossing.twist * units).max()  # [m] of t_s

    along_path = robot.mass * tangent  # [kg m] force of inertia at s" = 1
    centrifugal = robot.mass * robot.length * rate**2  # [kg m] the same at s' = 1
    load = robot.mass * np.linalg.norm(robot.model.gravity.linear)  # [N] weight and external wrenches
    for wrench in branch.wrenches.entries:
        force_and_moment = wrench(np.array([crossing.s])).reshape(2, 3)
        force, moment = np.linalg.norm(force_and_moment, axis=1)
        load += force + moment / robot.length
    return twist_size * np.array([along_path, centrifugal, load, 0.0])
