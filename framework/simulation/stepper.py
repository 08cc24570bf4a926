"""Fixed steps for control loops and for many runs at once.

A step is a pure function of the state. The motor torque is constant over the step, as under a digital
controller. Springs and damping enter implicitly, so stiff springs need no small steps. The loop equations are
imposed on the velocities, and each step also closes a share of the remaining gaps. There are two schemes of
order 2. Both solve, with d = h/2 in the first scheme and d = h in the second,

    [ M + d^2 K + d D   J' ] [    a    ]   [ forces ]
    [       J           0  ] [ -lambda ] = [ rates  ]

K and D contain springs and dampers between points, without the geometric stiffness of their tension.

midpoint: the linear implicit midpoint rule. It needs one mass matrix per step and has no numerical damping.
extrapolated: the linear implicit Euler method with extrapolation: twice the result of two half steps minus
    that of one whole step. A coordinate without mass reaches its balance in one step. Vibrations too fast for
    the step decay, whereas they persist under the midpoint rule.
Sources: Hairer, Lubich and Roche, The Numerical Solution of Differential-Algebraic Systems by Runge-Kutta
Methods, Springer 1989; Deuflhard, Hairer and Zugck 1987, DOI 10.1007/BF01400352, for the extrapolation.

Arrays have a row for each of R runs. Each run may have its own robot (another payload, other lengths, other
springs) if joints and loops are the same. All schemes take the generalised forces `driven`
(R, nv) of motors and world, which are constant over the step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from framework.errors import InvalidInput, check_choice, finite_numbers
from framework.kinematics.closures import closure_drift, loop_equations
from framework.kinematics.frames import (
    FrameStack,
    difference,
    frames_at,
    integrate,
    move_with_bodies,
    scratch_of,
)
from framework.kinematics.line_springs import Lines
from framework.kinematics.mechanism import LineSprings
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, ArrayLike, mirror_upper
from framework.numerics.ordered_sums import matmul, matvec, solve
from framework.simulation.consistent_states import allowed_motions, consistent_state
from framework.simulation.drive import NO_FORCES, WorldForces
from framework.simulation.equations import (
    EquationsOfMotion,
    State,
    check_damping,
    singular_vectors,
    spring_forces,
    stack_states,
)


class Terms(NamedTuple):
    """The terms of the equations of motion of R runs, with r loop equations; no derivatives."""

    mass: Array  # (R, nv, nv) M with rotors
    bias: Array  # (R, nv) c + g, Coriolis, centrifugal and gravity forces
    frames: FrameStack
    residual: Array  # (R, r) of the loop equations [m, rad]
    jacobian: Array  # (R, r, nv) of the loop equations
    lines: Lines | None  # of springs between points
    drift: Array  # (R, r) second time derivatives of the loop equations without joint accelerations


SCHEMES = ("midpoint", "extrapolated")
# Share of the gap of a loop that one step closes: 6 - sqrt(32), the largest without overshoot.
CLOSING_SHARE = 0.343


@dataclass(frozen=True, eq=False)
class Stepper:
    """A fixed-step integrator of one robot in any number of runs, or of R robots in R runs."""

    equations: tuple[EquationsOfMotion, ...]  # of R robots of one structure, or of one robot for all runs
    scheme: str  # of SCHEMES

    @staticmethod
    def of(
        robots: ParallelRobot | Sequence[ParallelRobot],
        *,
        damping: ArrayLike | None = None,
        scheme: str | None = None,
        like: ParallelRobot | None = None,
    ) -> Stepper:
        """Make a stepper of one robot or of R robots of one structure.

        Args:
            damping: viscous damping added to that of the joints, one number, (nv,) or (R, nv)
                [N m s/rad, N s/m].
            scheme: "midpoint", without numerical damping, or "extrapolated", which lets vibrations too fast
                for the step decay; by default extrapolated if parts have no mass, else midpoint.
            like: a robot of the same structure that decides for all which loop equations are independent,
                which joints idle and whether parts have no mass; by default the first of the robots.

        Raises:
            InvalidInput: no robot is given, or the robots differ in joints, motors, springs or loops; a
                scheme that is unknown or does not suit the robot; or as in `EquationsOfMotion.of`.
        """
        robots = (robots,) if isinstance(robots, ParallelRobot) else tuple(robots)
        if not robots:
            raise InvalidInput("robots: needs at least one robot")
        like = robots[0] if like is None else like
        template = EquationsOfMotion.of(like)
        for robot in robots:
            _check_same_structure(like, robot)
        # (nv,) the template adds 1 to the rotors of idle joints, which have no mass; all robots get the same
        idle_inertia = template.rotors - like.rotors
        shape = (len(robots), like.nv)
        added_damping = np.broadcast_to(check_damping(damping, shape), shape)
        equations = [
            replace(
                template,
                robot=robot,
                damping=robot.joint_damping + added,
                rotors=robot.rotors + idle_inertia,
                stiffness=robot.all_stiffness,
            )
            for robot, added in zip(robots, added_damping, strict=True)
        ]
        return Stepper(tuple(equations), choose_scheme(template, scheme))

    @property
    def robot(self) -> ParallelRobot:
        """The first robot, whose structure is that of all."""
        return self.equations[0].robot

    @cached_property
    def gear_ratio(self) -> Array:
        """Gear ratios (R, n_a)."""
        return np.array([equations.robot.gear_ratio for equations in self.equations])

    @cached_property
    def rotors(self) -> Array:
        """Inertia (R, nv) of the rotors [kg m^2, kg], joint side."""
        return np.array([equations.rotors for equations in self.equations])

    @cached_property
    def stiffness(self) -> Array:
        """Stiffness (R, nv) of the springs [N m/rad, N/m]."""
        return np.array([equations.stiffness for equations in self.equations])

    @cached_property
    def rest(self) -> Array:
        """Rest positions (R, nv) of the springs, as offsets from the neutral configuration."""
        return np.array([equations.robot.joint_rest for equations in self.equations])

    @cached_property
    def damping(self) -> Array:
        """Damping (R, nv) of the joints, with the damping added by the caller [N m s/rad, N s/m]."""
        return np.array([equations.damping for equations in self.equations])

    def start(
        self,
        q: ArrayLike,
        v: ArrayLike | None = None,
        torque: ArrayLike | None = None,
        *,
        world: WorldForces = NO_FORCES,
    ) -> State:
        """Find the consistent state next to q (nq,) or (R, nq): loops closed, massless parts in balance.

        Args:
            v: rates (nv,) or (R, nv); zero by default.
            torque: motor torques (n_a,) or (R, n_a) [N m], motor side; zero by default.
            world: external forces, of which those at t = 0 act.

        Raises:
            NotAssembled, NotConverged, InvalidInput: see `consistent_state`.
        """
        robot = self.robot
        q = finite_numbers("q", q, robot.model.nq, stacks=True)
        v = finite_numbers("v", np.zeros(robot.nv) if v is None else v, robot.nv, stacks=True)
        given = np.zeros(robot.n_a) if torque is None else torque
        torque = finite_numbers("torque", given, robot.n_a, stacks=True)
        leading = q.shape[:-1]  # (R,), or () for a single run
        rates = np.broadcast_to(v, (*leading, robot.nv))
        torques = np.broadcast_to(torque, (*leading, robot.n_a))
        runs = zip(np.atleast_2d(q), np.atleast_2d(rates), np.atleast_2d(torques), strict=True)
        # run k is that of robot k, or of the only robot
        states = [
            consistent_state(self.equations[k % len(self.equations)], *run, world)
            for k, run in enumerate(runs)
        ]
        new = stack_states(states)
        return State(new.q.reshape(q.shape), new.v.reshape(rates.shape))

    def step(self, q: Array, v: Array, torque: Array, h: float, *, world: Array | None = None) -> State:
        """Compute the state h [s] later under constant torques.

        The result is NaN or infinite for a run that diverges or has singular equations. A run has the same
        result, to the last bit, in any stack.

        Args:
            q, v: configurations (nq,) or (R, nq), and velocities (nv,) or (R, nv).
            torque: motor torques (n_a,) or (R, n_a) [N m], motor side.
            world: generalised external forces (nv,) or (R, nv) [N m, N], constant, too.
        """
        runs, rates = np.atleast_2d(q), np.atleast_2d(v)  # (R, nq), (R, nv)
        driven = np.zeros(rates.shape)  # generalised forces of motors and world
        driven[:, self.robot.actuated] = self.gear_ratio * torque
        if world is not None:
            driven += world
        with np.errstate(over="ignore", invalid="ignore"):
            scheme = self._midpoint if self.scheme == "midpoint" else self._extrapolate
            new = scheme(State(runs, rates), driven, h)
        return State(new.q.reshape(q.shape), new.v.reshape(v.shape))

    def platform(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Compute the platform's coordinates x and twist on its axes, (n,) or (R, n) each.

        Args:
            q, v: configurations (nq,) or (R, nq), and velocities (nv,) or (R, nv).
        """
        platform = self.robot.platform
        runs = np.atleast_2d(q)
        frames = frames_at(self.robot, runs, self.models(len(runs)))
        x = platform.coordinates(frames)
        twist = matvec(platform.jacobian(frames), np.atleast_2d(v))
        shape = (*q.shape[:-1], platform.n)
        return x.reshape(shape), twist.reshape(shape)

    @cached_property
    def line_springs(self) -> LineSprings:
        """The springs between points, with numbers (R, K)."""
        springs = [equations.robot.line_springs for equations in self.equations]
        return replace(
            springs[0],
            stiffness=np.array([one.stiffness for one in springs]),
            rest=np.array([one.rest for one in springs]),
            damping=np.array([one.damping for one in springs]),
        )

    # ------------------------------------------------------------------ schemes

    def _midpoint(self, start: State, driven: Array, h: float) -> State:
        """Step by the linear implicit midpoint rule, h [s].

        All terms are evaluated in the predicted middle of the step. The equations are solved twice. The first
        acceleration is a guess. It predicts the velocity in the middle, on which the bias forces and the
        drift of the loops depend.

        Args:
            driven: generalised forces (R, nv) of motors and world [N m, N].
        """
        robot, (q, v) = self.robot, start
        middle = integrate(robot, q, 0.5 * h * v)
        terms = self.terms(middle, v)
        implicit_mass = self._implicit_mass(terms, 0.5 * h)

        loop_rate = matvec(terms.jacobian, v)  # (R, m)
        # residuals (R, m) at q, by a Taylor series over -h/2 from the middle back to the start
        gap = terms.residual - 0.5 * h * loop_rate + 0.125 * h**2 * terms.drift

        # the two solutions differ in the bias forces, and in the drift of the loops
        forces = driven - self._spring_and_damping_forces(terms, v)
        closing = -loop_rate / h - CLOSING_SHARE * gap / h**2
        guess = self._solve_accelerations(
            implicit_mass, terms.jacobian, forces - terms.bias, closing - 0.5 * terms.drift
        )

        v_middle = v + 0.5 * h * guess
        _, bias, drift = self._terms_of_motion(middle, v_middle, terms.frames)
        terms = terms._replace(bias=bias, drift=drift)
        v_end = v + h * self._solve_accelerations(
            implicit_mass, terms.jacobian, forces - terms.bias, closing - 0.5 * terms.drift
        )
        return State(integrate(robot, q, 0.5 * h * (v + v_end)), v_end)

    def _step_by_euler(
        self, start: State, driven: Array, h: float, closing_rate: Array | None = None
    ) -> tuple[State, Array]:
        """Step by the linear implicit Euler method, h [s].

        The velocity v + h a after the step satisfies J (v + h a) = `closing_rate`. All terms are evaluated at
        q + h v, so that a part without mass is in balance after the step.

        Args:
            driven: generalised forces (R, nv) of motors and world [N m, N].
            closing_rate: rates (R, r) of the loop equations after the step. By default the step closes
                CLOSING_SHARE of every gap.

        Returns:
            The state after the step; the closing rate.
        """
        robot, (q, v) = self.robot, start
        predicted = integrate(robot, q, h * v)
        terms = self.terms(predicted, v)
        if closing_rate is None:
            closing_rate = -CLOSING_SHARE * terms.residual / h
        implicit_mass = self._implicit_mass(terms, h)
        forces = driven - terms.bias - self._spring_and_damping_forces(terms, v)
        loop_acceleration = (closing_rate - matvec(terms.jacobian, v)) / h
        v_end = v + h * self._solve_accelerations(implicit_mass, terms.jacobian, forces, loop_acceleration)
        return State(integrate(robot, q, h * v_end), v_end), closing_rate

    def _extrapolate(self, start: State, driven: Array, h: float) -> State:
        """Step by the extrapolated linear implicit Euler method, h [s].

        The result is twice that of two half steps minus that of one whole step. Extrapolation requires that
        whole and half steps approach the same solution. So all of them close the loops at the same rate.

        Args:
            driven: generalised forces (R, nv) of motors and world [N m, N].
        """
        whole, closing_rate = self._step_by_euler(start, driven, h)  # rate (R, r) of the loop equations
        half, _ = self._step_by_euler(start, driven, 0.5 * h, closing_rate)
        halves, _ = self._step_by_euler(half, driven, 0.5 * h, closing_rate)
        robot = self.robot
        # configurations have no multiples, so 2 halves - whole is computed as halves + (halves - whole)
        correction = difference(robot, whole.q, halves.q)  # (R, nv)
        return State(integrate(robot, halves.q, correction), 2 * halves.v - whole.v)

    def _solve_accelerations(self, mass: Array, jacobian: Array, forces: Array, rates: Array) -> Array:
        """Solve M a - J' lambda = forces, J a = rates for accelerations a (R, nv).

        The accelerations of a run with singular equations are infinite.

        Args:
            mass: M (R, nv, nv).
            jacobian: J (R, r, nv) of the loop equations, of rank m.
            forces: (R, nv) [N m, N].
            rates: (R, r) second time derivatives of the loop equations by the accelerations alone.
        """
        m = self.equations[0].rank
        runs, r, nv = jacobian.shape
        if r > m:
            is_finite = np.isfinite(jacobian).all(axis=(1, 2), keepdims=True)  # (R, 1, 1)
            U, _, _ = singular_vectors(np.where(is_finite, jacobian, 0.0), m)  # (R, r, m)
            jacobian = matmul(U.transpose(0, 2, 1), jacobian)
            rates = matvec(U.transpose(0, 2, 1), rates)
        matrix = np.zeros((runs, nv + m, nv + m))
        matrix[:, :nv, :nv] = mass
        matrix[:, :nv, nv:] = jacobian.transpose(0, 2, 1)
        matrix[:, nv:, :nv] = jacobian
        return solve(matrix, np.concatenate([forces, rates], axis=1))[:, :nv]

    def _spring_and_damping_forces(self, terms: Terms, v: Array) -> Array:
        """Compute the forces (R, nv) that hold springs and dampers at joint rates v (R, nv)."""
        springs = spring_forces(self.robot, self.stiffness, self.rest, terms.frames.q)
        forces: Array = springs + self.damping * v
        return forces if terms.lines is None else forces + terms.lines.forces(v)

    def _implicit_mass(self, terms: Terms, d: float) -> Array:
        """Compute the matrix M + d^2 K + d D (R, nv, nv) of an implicit step, see the header.

        The time d [s] is half of the step, or the step.
        """
        matrix = terms.mass.copy()
        diagonal = range(matrix.shape[1])
        matrix[:, diagonal, diagonal] += d**2 * self.stiffness + d * self.damping
        if terms.lines is not None:
            matrix += d**2 * terms.lines.stiffness + d * terms.lines.damping
        return matrix

    # ------------------------------------------------------------------ terms

    @cached_property
    def own_models(self) -> list[pin.Model]:
        """The pinocchio models of the robots."""
        return [equations.robot.model for equations in self.equations]

    def models(self, runs: int) -> list[pin.Model]:
        """Return the pinocchio model of each of R runs.

        A stepper of several robots has one run for each; a stepper of one robot has any number of runs.
        """
        return self.own_models if len(self.own_models) > 1 else self.own_models * runs

    def terms(self, q: Array, v: Array) -> Terms:
        """Compute all terms of R runs at q (R, nq) and v (R, nv)."""
        runs, nv = len(q), self.robot.nv
        data = scratch_of(self.robot).data
        mass = np.empty((runs, nv, nv))
        for k, model in enumerate(self.models(runs)):
            mass[k] = pin.crba(model, data, q[k])
        mirror_upper(mass)[:, range(nv), range(nv)] += self.rotors
        frames, bias, drift = self._terms_of_motion(q, v)
        loops = loop_equations(self.equations[0].rows, frames)
        springs = self.line_springs
        lines = Lines.of(self.robot, frames, springs) if springs.names else None
        return Terms(mass, bias, frames, *loops, lines, drift)

    def _terms_of_motion(
        self, q: Array, v: Array, frames: FrameStack | None = None
    ) -> tuple[FrameStack, Array, Array]:
        """Compute frames, bias forces c + g (R, nv) and drifts (R, r) of R runs.

        Bias forces are Coriolis, centrifugal and gravity forces. A drift is the second time derivative of a
        loop equation without joint accelerations. Frames that are known at q are not computed again.
        """
        scratch = scratch_of(self.robot)
        runs, nv = v.shape
        placements = np.empty((runs, *scratch.placements.shape))  # (R, frames of the model, 12)
        screws = np.empty((runs, *scratch.screws.shape))  # (R, nv, 6)
        twists = np.empty((2, runs, *scratch.velocities.shape))  # (2, R, bodies, 6) and their rates
        bias, rest = np.empty_like(v), np.zeros(nv)
        data, velocities, accelerations = scratch.data, scratch.velocities, scratch.accelerations
        for k, (model, q_k, v_k) in enumerate(zip(self.models(runs), q, v, strict=True)):
            bias[k] = pin.nonLinearEffects(model, data, q_k, v_k)
            # screws, twists and their rates; then placements
            pin.computeForwardKinematicsDerivatives(model, data, q_k, v_k, rest)
            twists[0, k], twists[1, k] = velocities, accelerations
            if frames is None:
                pin.updateFramePlacements(model, data)
                placements[k], screws[k] = scratch.placements, scratch.screws
        frames = FrameStack.of(scratch, placements, screws, q) if frames is None else frames
        motions = move_with_bodies(self.robot, frames, twists)
        return frames, bias, closure_drift(self.equations[0].rows, motions, q, v)


def choose_scheme(equations: EquationsOfMotion, scheme: str | None = None) -> str:
    """Return the scheme, by default extrapolated if a motion moves no mass, else midpoint.

    Raises:
        InvalidInput: a scheme that is unknown or does not suit the robot.
    """
    tangent = equations.tangent_at_rest(equations.robot.reference.q)
    has_light_motion = bool(allowed_motions(equations, tangent).light.any())  # of parts without mass
    if scheme is None:
        return "extrapolated" if has_light_motion else "midpoint"
    check_choice("scheme", scheme, SCHEMES)
    if has_light_motion and scheme == "midpoint":
        raise InvalidInput(f"{equations.robot.name}: parts without mass need the scheme extrapolated")
    return scheme


def _check_same_structure(first: ParallelRobot, second: ParallelRobot) -> None:
    """Raise InvalidInput unless two robots have the same structure: joints, index sets and loop rows.

    Pinocchio computes all robots of a stack in the memory of one, and does not check its sizes.
    """

    def structure(robot: ParallelRobot) -> list[Any]:
        """Return the properties in which the robots of a stack agree."""
        joints = [list(robot.model.names), robot.model.nv, robot.model.nframes]
        index_sets = [robot.actuated, robot.elastic, robot.frames, robot.line_springs.first]
        loop_rows = [getattr(robot.spanning_loops, field.name) for field in fields(robot.spanning_loops)]
        return joints + index_sets + loop_rows

    if not all(map(np.array_equal, structure(first), structure(second))):
        raise InvalidInput(
            f"robots: {second!r} differs from {first!r} in more than numbers; a stack needs one structure"
        )
