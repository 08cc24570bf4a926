"""From the platform to the joints: positions, velocities and accelerations for a stack of instants.

With x and the deflections q_e given, F(q) = [platform(q) - x ; closures(q)] = 0 fixes all other
coordinates. Its Jacobian along them is square and regular everywhere but in Type 1 singularities; in
particular Type 2 singularities do not trouble it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from framework.arrays import Array, ArrayLike, IntArray, freeze
from framework.errors import InvalidInput, NotAssembled, point
from framework.kinematics.assembly import Configuration
from framework.kinematics.closures import LoopWrenches, closure_drift, loop_wrenches, scaled
from framework.kinematics.equations import Equations
from framework.kinematics.frames import FrameStack, cross, frame_motions, frames_at
from framework.kinematics.newton import ITERATIONS, LAST_STEP, Linear, NewtonResult, Which, newton
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.kinematics.placements import configuration
from framework.linalg.banded_lu import Factors

VANISHED = 1e-6  # what a step leaves of a determinant if it ends on its zero: half the digits are lost there
OPEN = 1e-6  # loops [robot lengths, rad] that are open by more are no rounding of an assembled robot
LOST = 1e-7  # least singular value, without dimension, of loop equations that have lost rank


@dataclass(frozen=True, eq=False)
class System:
    """F and its derivatives at T configurations; m independent loop equations."""

    equations: Equations
    frames: FrameStack
    loops: LoopWrenches  # all loop equations of the robot, those dropped as redundant too
    residual: Array  # (T, n + m)
    entries: Array  # (T, E) of dF/dq, as `equations.pattern` has them

    def at(self, k: int | slice | IntArray) -> System:
        """The system of one instant, T = 1, or of some."""
        here = slice(k, k + 1) if isinstance(k, int) else k
        loops = LoopWrenches(*(part[here] for part in self.loops))
        return System(self.equations, self.frames.at(here), loops, self.residual[here], self.entries[here])

    @property
    def gap(self) -> Array:
        """By how much the loops are open (T,) [m or rad], the largest of all their equations."""
        return np.asarray(np.abs(self.loops.residual).max(axis=1, initial=0.0))

    @cached_property
    def jacobian(self) -> Array:
        """dF/dq (T, n + m, nv)."""
        jacobian = self.equations.pattern.dense(self.entries)
        freeze(jacobian)
        return jacobian

    @property
    def platform(self) -> Array:
        """The platform's rows of dF/dq, (T, n, nv)."""
        return self.jacobian[:, : self.equations.n]

    @property
    def closures(self) -> Array:
        """The loop equations' rows of dF/dq, (T, m, nv)."""
        return self.jacobian[:, self.equations.n :]

    @cached_property
    def factors(self) -> Factors:
        """dF/dq along the columns that follow, factored.

        Raises:
            numpy.linalg.LinAlgError: there are not as many equations as columns.
        """
        band = self.equations.moving_band
        if band is None:
            raise np.linalg.LinAlgError("the platform and the loops do not make a square system")
        return band.factor(self.entries.take(self.equations.moving.entry, axis=1))

    @cached_property
    def passive_factors(self) -> Factors:
        """The loop equations' derivatives along the passive columns that follow (P), factored.

        Raises:
            numpy.linalg.LinAlgError: there are not as many loop equations as columns.
        """
        band = self.equations.passive_band
        if band is None:
            raise np.linalg.LinAlgError("the loops do not make a square system for the passive joints")
        return band.factor(self.entries.take(self.equations.passive.entry, axis=1))


@dataclass(frozen=True, eq=False)
class ClosedStack:
    """T configurations `q` (T, nq) on the prescribed `x` (T, n), with the equations `system` there."""

    q: Array
    x: Array
    system: System


@dataclass(frozen=True, eq=False)
class Motion:
    """Positions, velocities and accelerations of all coordinates at T instants."""

    q: Array  # (T, nq)
    v: Array  # (T, nv)
    a: Array  # (T, nv)
    system: System


def require_square(robot: ParallelRobot) -> None:
    """Raise InvalidInput unless x and the loops determine all joints, and there are motors enough."""
    held_by_springs = robot.springs_alone
    if held_by_springs:
        raise InvalidInput(
            f"{robot.name}, {robot.flexibility}: {', '.join(held_by_springs)} can only be closed by springs: "
            f"the joints cannot move along them; lock fewer axes there (axes: [...]) or leave those axes "
            f"out of the springs' motion"
        )
    loops = len(robot.loops.names)
    joints = len(robot.moving)
    mobility = joints - loops
    if not robot.n == mobility <= robot.n_a:
        raise InvalidInput(
            f"{robot.name}: {robot.n} platform axes, {robot.n_a} actuators, {mobility} degrees of "
            f"freedom ({joints} joints less {loops} independent loop equations); planning needs as many "
            f"platform axes as degrees of freedom, and no fewer actuators"
        )


def system_at(robot: ParallelRobot, q: Array, x: Array | None) -> System:
    """F, its rows and their derivatives at q (T, nq) for the platform at x (T, n); None: where it is."""
    equations, at, count, n = robot.equations, frames_at(robot, q), len(q), robot.n
    loops = loop_wrenches(robot.rows, at)
    residual, wrench = np.zeros((count, len(equations.bodies))), np.empty((count, len(equations.bodies), 6))
    if x is not None:
        residual[:, :n] = robot.platform.residual(at, x)
    wrench[:, :n] = robot.platform.wrenches(at)
    residual[:, n:], wrench[:, n:] = loops.take(robot.independent)
    arm = at.position.take(equations.bodies, axis=1)
    wrench[..., 3:] += cross(arm, wrench[..., :3])  # about the base's origin
    return System(equations, at, loops, residual, equations.pattern.entries(wrench, at.screws))


def assembled_at(robot: ParallelRobot, q: ArrayLike | Configuration, *, stacks: bool = False) -> ClosedStack:
    """A configuration q (nq,), or a `Configuration`, whose loops are closed, with its equations (T = 1).

    Args:
        stacks: whether T configurations (T, nq) will do as well.

    Raises:
        InvalidInput: q has the wrong shape, is not finite, or leaves a loop open.
    """
    expect_robot(robot)
    q = np.array(configuration(robot, q, stacks=stacks), ndmin=2)  # a copy: what was given may change
    system = system_at(robot, q, None)
    gaps = np.abs(system.loops.residual) / robot.row_lengths
    if gaps.max(initial=0.0) > OPEN:
        worst = gaps.max(axis=1).argmax()
        raise InvalidInput(
            f"q{f', row {worst}' if len(q) > 1 else ''}: the loops of {robot.name} are open by "
            f"{system.gap[worst]:.3g} m or rad there; see `assemble`"
        )
    return ClosedStack(q, robot.platform.coordinates(system.frames), system)


def close_loops(robot: ParallelRobot, x: Array, guess: Array, *, last_step: float = LAST_STEP) -> ClosedStack:
    """Close all loops at platform coordinates x (T, n), from guess (T, nq) near the solution.

    The elastic coordinates keep the values of the guess. `last_step` as in `newton`.

    Raises:
        NotAssembled: some instant does not close; carries its last iterate and residual.
    """
    q, system, closed = close_each(robot, x, guess, last_step=last_step)
    if closed.all():
        return ClosedStack(q, x, system)
    left = np.where(closed, 0.0, np.nan_to_num(np.abs(system.residual), nan=np.inf).max(axis=1))
    worst = int(np.argmax(left))
    residual = float(np.abs(system.residual[worst]).max())
    raise NotAssembled(
        f"{robot.name}: the loops do not close at {', '.join(robot.axis_names)} = {point(x[worst])}: "
        f"{residual:.3g} m or rad left after {ITERATIONS} iterations",
        q=q[worst],
        residual=residual,
    )


def close_each(
    robot: ParallelRobot,
    x: Array,
    guess: Array,
    *,
    iterations: int = ITERATIONS,
    farthest: float = np.inf,
    last_step: float = LAST_STEP,
) -> NewtonResult[System]:
    """Close the loops wherever they close, as `close_loops` does, and tell where; options of `newton`."""

    def evaluate(q: Array, which: Which) -> System:
        return system_at(robot, q, x[which])

    def linear(system: System) -> Linear:
        return Linear(system.residual, system.factors)

    return newton(
        robot,
        guess,
        robot.moving,
        evaluate,
        linear,
        iterations=iterations,
        farthest=farthest,
        last_step=last_step,
    )


def joint_rates(robot: ParallelRobot, system: System, platform: Array, elastic: Array) -> Array:
    """All joint rates (..., T, nv) for platform twists (..., T, n) and deflection rates (T, n_e)."""
    right = np.zeros((*platform.shape[:-1], system.residual.shape[1]))
    right[..., : platform.shape[-1]] = platform
    return _solve_rates(robot, system, right, elastic)


def _solve_rates(robot: ParallelRobot, system: System, right: Array, elastic: Array) -> Array:
    rates = np.zeros((*right.shape[:-1], robot.model.nv))
    if robot.n_e:
        rates[..., robot.elastic] = elastic
        right = right - system.equations.elastic.times(system.entries, elastic)
    try:
        rates[..., robot.moving] = system.factors.solve(right)
    except np.linalg.LinAlgError:
        raise NotAssembled(
            f"{robot.name}: the platform's {', '.join(robot.axis_names)} do not determine the joints: a leg "
            f"is stretched or folded, or the platform frame does not move along these axes",
            q=robot.q_near,
            residual=float(np.abs(system.residual).max()),
        ) from None
    return rates


def motion_at(
    robot: ParallelRobot,
    closed: ClosedStack,
    dx: Array,
    ddx: Array,
    dq_e: Array | None = None,
    ddq_e: Array | None = None,
) -> Motion:
    """Velocities and accelerations for platform rates dx, ddx (T, n) and deflection rates (T, n_e)."""
    nothing = np.zeros((len(dx), robot.n_e))
    dq_e = nothing if dq_e is None else dq_e
    ddq_e = nothing if ddq_e is None else ddq_e
    twist, dtwist = robot.platform.twist(closed.x, dx, ddx)
    return _motion_of_twist(robot, closed.q, closed.system, (twist, dtwist), (dq_e, ddq_e))


def without_elastic_rates(robot: ParallelRobot, q: Array, v: Array, a: Array) -> Motion:
    """The motion of the same platform at the same deflections, as if these did not change."""
    at = frames_at(robot, q)
    system = system_at(robot, q, robot.platform.coordinates(at))
    drift = robot.platform.drift(at, frame_motions(robot, at, q, v))
    twist, dtwist = (np.einsum("tnv,tv->tn", system.platform, rates) for rates in (v, a))
    still = np.zeros((len(q), robot.n_e))
    return _motion_of_twist(robot, q, system, (twist, dtwist + drift), (still, still))


def _motion_of_twist(
    robot: ParallelRobot, q: Array, system: System, twist: tuple[Array, Array], elastic: tuple[Array, Array]
) -> Motion:
    """Rates and accelerations of all joints for those of the platform's twist and of the deflections."""
    v = joint_rates(robot, system, twist[0], elastic[0])
    motions = frame_motions(robot, system.frames, q, v)
    drift = closure_drift(system.equations.loops, system.frames, motions)
    platform_drift = robot.platform.drift(system.frames, motions)
    right = np.concatenate([twist[1] - platform_drift, -drift], axis=1)
    return Motion(q, v, _solve_rates(robot, system, right, elastic[1]), system)


def mode_signs(robot: ParallelRobot, system: System) -> tuple[Array, Array]:
    """Signs (T,) of the working mode and of the assembly mode.

    The sign of det [dF/dq] changes at Type 1 singularities, the sign of the determinant of the
    passive columns of the loops at Type 2 (of a robot without redundant motors; else it is 1).
    """
    working = system.factors.slogdet[0]
    if system.equations.passive_band is None:
        return working, np.ones(len(working))
    return working, system.passive_factors.slogdet[0]


def keeps_assembly_mode(one: System, two: System) -> bool:
    """Whether no Type 2 singularity lies between two near configurations (systems of T = 1) or at the second.

    Of robots without redundant motors. A determinant of which no more than rounding is left has no sign.
    """
    if one.equations.passive_band is None:
        return True
    (sign_one, size_one), (sign_two, size_two) = one.passive_factors.slogdet, two.passive_factors.slogdet
    return bool(sign_one == sign_two and size_two - size_one > np.log(VANISHED))


def keeps_working_mode(robot: ParallelRobot, one: System, two: System) -> bool:
    """Whether no Type 1 singularity lies between two near configurations (systems of T = 1) or at the second.

    det [dF/dq] also changes sign where the loop equations lose rank, and there a smooth branch goes on.
    The map from the motions that the loops allow to the platform does not: with N a basis of those
    motions, carried on from one configuration to the other, det (platform N) keeps its sign. A determinant
    of which no more than rounding is left has no sign, and loops that have lost rank allow more than one
    motion: no such configuration belongs to a mode.
    """
    columns = robot.moving

    def loops(system: System) -> Array:
        return scaled(robot, system.closures, robot.loops.rotation)[0][:, columns]

    if np.linalg.svd(loops(two), compute_uv=False).min(initial=np.inf) < LOST:
        return False
    (sign_one, size_one), (sign_two, size_two) = one.factors.slogdet, two.factors.slogdet
    if sign_one == sign_two and size_two - size_one > np.log(VANISHED):
        return True
    bases, maps = [], []
    for system in (one, two):
        basis = np.linalg.svd(loops(system))[2][system.closures.shape[1] :].T
        bases.append(basis)
        maps.append(
            float(np.linalg.det(scaled(robot, system.platform, ~robot.translations)[0][:, columns] @ basis))
        )
    carried_on = maps[1] * np.sign(maps[0] * np.linalg.det(bases[0].T @ bases[1]))
    return bool(carried_on > VANISHED * abs(maps[0]))


def reference_system(robot: ParallelRobot) -> System:
    """The equations at the assembled reference."""
    reference = robot.reference
    return system_at(robot, reference.q[None], reference.x[None])
