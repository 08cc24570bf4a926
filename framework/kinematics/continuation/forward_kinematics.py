"""Forward kinematics: all joints and the platform for prescribed motor joints, followed from a start pose.

The motors turn from the start to the target, all at once and in proportion, and the loops move the passive
joints: P dq_p = -J_a dq_a, with P and J_a the passive and the actuated columns of the loop equations. Away
from Type 2 singularities P is regular, and the branch leads to the pose of the same assembly mode. Where P
loses rank assembly modes meet and the motors no longer determine the motion: the branch ends. (That is Type 2
in the wide sense; `singularity.classification` tells whether the platform or only joints inside a leg
escape.)
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from framework.arrays import Array, ArrayLike, BoolArray, freeze
from framework.errors import InvalidInput, NotAssembled, Type2Singularity, finite_numbers, point
from framework.kinematics.assembly import Configuration
from framework.kinematics.continuation.predictor_corrector import FIRST_STEP_RATIO, Places, Way, follow
from framework.kinematics.continuation.turning_point import (
    CurveEquations,
    Curves,
    TurningPoints,
    turning_points,
)
from framework.kinematics.frames import difference, integrate
from framework.kinematics.inverse_kinematics import MAX_ITERATIONS, NewtonResult, close_each
from framework.kinematics.linearised_loops import (
    LinearisedLoops,
    assembled_at,
    linearised_at,
    linearised_at_reference,
)
from framework.kinematics.loop_matrices import clearance, equation_sizes, independent_loops_matrix
from framework.kinematics.modes import keeps_assembly_mode
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.tolerances import BRANCHES_CROSS, BRANCHES_MEET, RANK_LOST

TYPE_2_END_RATIO = 0.05  # of the usual least singular value of P: a way that ends below does so at Type 2
MAX_SINGLE_STEP = 0.05  # [rad, lengths] that the joints may move by in a single step


@dataclass(frozen=True, eq=False)
class ForwardPose(Configuration):
    """The pose at prescribed motor joints, with its certificate.

    `q` (nq,) and platform `x` (n,), its turns counted on from those at the start; `residual`, the largest of
    all loop equations [m or rad], redundant ones included; `iterations`, the steps of the way; `clearance`,
    the least singular value of P met on the way (radians, robot lengths), which is 0 at a Type 2 singularity
    and infinite for a robot without passive joints. `robot` and `place` let the next pose of a stream of
    motor angles start from this one without proving again that it is assembled.
    """

    clearance: float
    robot: ParallelRobot = field(repr=False)
    place: Places = field(repr=False)


def forward_kinematics(
    robot: ParallelRobot, q_a: ArrayLike, *, near: ArrayLike | Configuration | None = None
) -> ForwardPose:
    """Compute all joints and the platform for prescribed motor joints, in the assembly mode of a start pose.

    Args:
        q_a: actuated joints (n_a,), joint side of the gears [rad, m], in the order of the robot file. Full
            turns of hinges count: a target one turn away is reached by a full turn.
        near: an assembled configuration (nq,) to start from, the reference by default; for a stream of angles
            the last result of this function. Springs keep its deflections.

    Raises:
        InvalidInput: q_a or near has the wrong length or is not finite, the loops are open at near, or the
            motors depend on one another.
        Type2Singularity: one lies between, or near is one; carries its configuration.
        NotAssembled: the way cannot be followed for another reason.
    """
    expect_robot(robot)
    target = motor_joints_of(robot, q_a)
    check_motors_are_free(robot)
    start = start_pose(robot, near)
    way, x = _follow_motors(robot, start.place, target), start.x[None]
    for place in way.stretches[1:]:
        x = robot.platform.unwrap(robot.platform.coordinates(place.linearised.frames), x[0])
    if not way.complete:
        raise _end_error(robot, way, x[0], target)
    return _pose_at(robot, way.last, x[0], float(way.clearance.min()), steps=len(way.at) - 1)


def motor_joints_of(robot: ParallelRobot, q_a: ArrayLike, *, stacks: bool = False) -> Array:
    """Return motor joints q_a, (n_a,) or (T, n_a), as an array of finite numbers."""
    return finite_numbers(f"q_a ({', '.join(robot.actuator_names)})", q_a, robot.n_a, stacks=stacks)


def _pose_at(robot: ParallelRobot, place: Places, x: Array, least: float, *, steps: int) -> ForwardPose:
    """Return the pose of a place with its platform at x (n,), `least` clearance and steps of the way."""
    freeze(place)
    return ForwardPose(
        q=place.q[0],
        x=x,
        residual=float(place.linearised.gap[0]),
        iterations=steps,
        clearance=least,
        robot=robot,
        place=place,
    )


def start_pose(robot: ParallelRobot, near: ArrayLike | Configuration | None) -> ForwardPose:
    """Return the pose of an assembled configuration (nq,), the reference by default, as start of a way.

    Raises:
        InvalidInput: it is not assembled.
    """
    if isinstance(near, ForwardPose) and near.robot is robot:
        return near
    closed = assembled_at(robot, robot.reference.q if near is None else near)
    still = np.zeros((1, robot.model.nv))
    place = Places(closed.q, closed.linearised, still, clearance(robot, closed.linearised))
    return _pose_at(robot, place, closed.x[0], float(place.clearance[0]), steps=0)


def check_motors_are_free(robot: ParallelRobot) -> None:
    """Raise InvalidInput unless one motor can move while the others rest."""
    if not motors_are_free(robot):
        raise InvalidInput(
            f"{robot.name}: its {robot.n_a} motors drive {robot.n} degrees of freedom, so none of them can "
            f"move while all others rest; move the platform"
        )


def motors_are_free(robot: ParallelRobot) -> bool:
    """Whether one motor can move while the others rest: P is square, and as many motors as platform axes."""
    return robot.n_a == robot.n and len(robot.following) == len(robot.loops.names)


def close_at_motors(
    robot: ParallelRobot, start: Array, turn: Array, guess: Array, *, iterations: int = MAX_ITERATIONS
) -> NewtonResult:
    """Close the loops near guesses (T, nq), with the motors turned by `turn` (T, nv) from start (nq,)."""
    rounding = np.zeros_like(turn)  # of the motors' angles, after many steps
    rounding[:, robot.actuated] = (turn - difference(robot, start, guess))[:, robot.actuated]
    guess = integrate(robot, guess, rounding)
    if not len(robot.following):
        return NewtonResult(guess, linearised_at(robot, guess, None), np.ones(len(guess), dtype=bool))
    return close_each(robot, None, guess, iterations=iterations)


def motor_driven_rates(robot: ParallelRobot, linearised: LinearisedLoops, turn: Array) -> Array | None:
    """Compute rates (T, nv) of all joints for rates `turn` (T, nv) of the motors; None if P is singular."""
    rate, columns = turn.copy(), robot.following
    if len(columns):
        driven = np.einsum("tmv,tv->tm", linearised.closures, turn)
        try:
            rate[:, columns] = -linearised.passive_factors.solve(driven)
        except np.linalg.LinAlgError:
            return None
    return rate


def _follow_motors(robot: ParallelRobot, start: Places, q_a: Array) -> Way:
    """Turn the motors from a place towards q_a (n_a,), up to the end of the branch."""
    turn = np.zeros((1, robot.model.nv))
    turn[0, robot.actuated] = q_a - robot.actuated_coordinates(start.q)[0]

    def place(q: Array, linearised: LinearisedLoops, distance: Array) -> Places | None:
        rate = motor_driven_rates(robot, linearised, turn)
        return None if rate is None else Places(q, linearised, rate, distance)

    def arrive(share: Array, predicted: Array) -> Places | None:
        """Return the place at a share (1,) of the way."""
        q, linearised, closed = close_at_motors(robot, start.q[0], share[:, None] * turn, predicted)
        return place(q, linearised, clearance(robot, linearised)) if closed.all() else None

    def belong(before: Places, after: Places, straight: BoolArray) -> BoolArray:
        apart = straight | (after.clearance > BRANCHES_CROSS)
        return apart & keeps_assembly_mode(before.linearised, after.linearised)

    def end(share: float, last: Places) -> tuple[float, Places] | None:
        """Find the Type 2 singularity ahead of a place, as its share of the way and place; None if none.

        Joint rates by the motors are infinite there: the place has rates of zero instead.
        """
        singular = motors_turning_points(robot, last.q, np.array([share]), turn)
        if not singular.found[0]:
            return None
        joint_rates = np.zeros_like(turn)
        distance = clearance(robot, singular.linearised)
        return float(singular.share[0]), Places(singular.q, singular.linearised, joint_rates, distance)

    first_place = place(start.q, start.linearised, start.clearance)
    if first_place is None or start.clearance[0] < RANK_LOST:  # on the meeting of two modes
        return Way(np.zeros(1), (start,))
    short = np.abs(first_place.rate / robot.column_scale).max() < MAX_SINGLE_STEP
    step = 1.0 if short else FIRST_STEP_RATIO
    return _up_to_the_meeting(follow(robot, first_place, arrive, belong, end=end, step=step))


def _up_to_the_meeting(way: Way) -> Way:
    """Cut a way at its first meeting with another assembly mode, where the clearance is least."""
    clearance = way.clearance
    approaching = clearance[1:] < clearance[:-1]  # not leading away from a meeting
    meeting = np.flatnonzero((clearance[1:] < BRANCHES_MEET) & approaching)
    if not len(meeting):
        return way
    first = int(meeting[0]) + 1
    beyond = np.flatnonzero(clearance[first:] >= BRANCHES_MEET)
    last = first + int(clearance[first : first + beyond[0] if len(beyond) else None].argmin())
    return Way(way.at[: last + 1], way.stretches[: last + 1])


def motors_turning_points(robot: ParallelRobot, q: Array, share: Array, turn: Array) -> TurningPoints:
    """Find Type 2 singularities ahead of q (T, nq), after a `share` (T,) of the motors' turns (T, nv)."""
    columns, sizes = robot.following, equation_sizes(robot)[robot.n :]

    def evaluate(q: Array, share: Array) -> CurveEquations:
        """Compute the loop equations (T, m), their matrix along following joints, and the motors' drive."""
        linearised = linearised_at(robot, q, None)
        loops = independent_loops_matrix(robot, linearised)
        drive = np.einsum("tmv,tv->tm", loops, turn / robot.column_scale)
        return CurveEquations(
            loops[:, :, columns], drive, linearised.residual[:, robot.n :] / sizes, linearised
        )

    return turning_points(Curves(robot, columns, turn, evaluate), q, share)


def _end_error(robot: ParallelRobot, way: Way, x: Array, q_a: Array) -> NotAssembled:
    """Return the error for the end of the way of the motors to q_a, at platform x."""
    residual = float(np.abs(way.last.linearised.residual[:, robot.n :]).max(initial=0.0))
    usual = max(float(way.clearance.max()), float(clearance(robot, linearised_at_reference(robot))[0]))
    if way.last.clearance[0] > TYPE_2_END_RATIO * usual:
        place = _place_in_words(robot, way.at[-1], x, q_a)
        return NotAssembled(
            f"{robot.name}: the loops cannot be followed {place}", q=way.q[-1], residual=residual
        )
    return type2_singularity(robot, way.at[-1], way.q[-1], x, q_a, residual)


def type2_singularity(
    robot: ParallelRobot, share: float, q: Array, x: Array, q_a: Array, residual: float
) -> Type2Singularity:
    """Return the error for a way to q_a (n_a,) that ends after a share, at q with platform x."""
    place = _place_in_words(robot, share, x, q_a)
    return Type2Singularity(
        f"{robot.name}: a Type 2 singularity {place}: with its motors locked the robot can still move there, "
        f"and this assembly mode ends",
        q=q,
        residual=residual,
        share=float(share),
        platform=x,
    )


def _place_in_words(robot: ParallelRobot, share: float, x: Array, q_a: Array) -> str:
    motors = f"{', '.join(robot.actuator_names)} = {point(q_a)}"
    return f"on the way to {motors}, after {share:.6g} of it, at {robot.place(x)}"
