"""Fixed steps for control loops and for many runs at once.

A step is a pure function of the state. The motor torque is constant over the step, as under a digital
controller.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from framework.errors import InvalidInput, check_choice
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, ArrayLike
from framework.numerics.ordered_sums import matvec
from framework.simulation.consistent import consistent_state, free_motions
from framework.simulation.schemes import SCHEMES, State, stack_states
from framework.simulation.terms import RobotStack
from framework.simulation.world_forces import NO_FORCES, WorldForces


@dataclass(frozen=True, eq=False)
class Stepper:
    """A fixed-step integrator of one robot in any number of runs, or of R robots in R runs."""

    stack: RobotStack
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
            scheme: midpoint or extrapolated, see `schemes`; by default extrapolated if parts have no mass,
                else midpoint.
            like: a robot of the same structure that decides which loop equations are independent, which
                joints idle and whether parts have no mass; by default the first of the robots.

        Raises:
            InvalidInput: a scheme that is unknown or does not suit the robot; robots of different structure.
        """
        return Stepper.from_stack(RobotStack.of(robots, damping, like), scheme)

    @staticmethod
    def from_stack(stack: RobotStack, scheme: str | None = None) -> Stepper:
        """Make a stepper of stacked robots, whose damping is complete.

        Raises:
            InvalidInput: a scheme that is unknown or does not suit the robot.
        """
        first = stack.first
        light = free_motions(first, first.tangent_at_rest(first.robot.reference.q))[1]
        has_light_motion = light.shape[1] > 0
        if scheme is None:
            scheme = "extrapolated" if has_light_motion else "midpoint"
        check_choice("scheme", scheme, SCHEMES)
        if has_light_motion and scheme == "midpoint":
            raise InvalidInput(f"{stack.robots[0].name}: parts without mass need the scheme extrapolated")
        return Stepper(stack, scheme)

    def start(
        self,
        q: ArrayLike,
        v: ArrayLike | None = None,
        torque: ArrayLike | None = None,
        *,
        world: WorldForces = NO_FORCES,
    ) -> State:
        """Find the consistent state next to q (nq,) or (R, nq): loops closed, massless parts in balance.

        v (nv,) or (R, nv) and motor torques (n_a,) or (R, n_a) [N m], motor side, are zero by default. The
        forces of the world are those at t = 0.

        Raises:
            NotAssembled, NotConverged, InvalidInput: see `consistent_state`.
        """
        robot, q = self.stack.robots[0], np.asarray(q, dtype=float)
        runs = np.atleast_2d(q)  # (R, nq)
        rates = np.zeros((len(runs), robot.nv)) if v is None else np.atleast_2d(np.asarray(v, dtype=float))
        torques = np.zeros((len(runs), robot.n_a)) if torque is None else np.atleast_2d(torque)
        states = [
            consistent_state(self.stack.equations(k), *run, world)
            for k, run in enumerate(zip(runs, rates, torques, strict=True))
        ]
        new = stack_states(states)
        return State(new.q.reshape(q.shape), new.v.reshape(*q.shape[:-1], robot.nv))

    def step(self, q: Array, v: Array, torque: Array, h: float, *, world: Array | None = None) -> State:
        """Compute the state h [s] later under constant torques (n_a,) or (R, n_a) [N m], motor side.

        The result is NaN or infinite for a run that diverges or has singular equations. A run has the same
        result, to the last bit, in any stack. The forces of the `world` (nv,) or (R, nv) are constant, too.
        """
        runs, rates = np.atleast_2d(q), np.atleast_2d(v)  # (R, nq), (R, nv)
        driven = np.zeros(rates.shape)  # generalised forces of motors and world
        driven[:, self.stack.robots[0].actuated] = self.stack.gear_ratio * torque
        if world is not None:
            driven += world
        with np.errstate(over="ignore", invalid="ignore"):
            new = SCHEMES[self.scheme](self.stack, State(runs, rates), driven, h)
        return State(new.q.reshape(q.shape), new.v.reshape(v.shape))

    def platform(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Compute coordinates x and twist of the platform on its axes, (n,) or (R, n) each."""
        platform, rates = self.stack.robots[0].platform, np.atleast_2d(v)
        frames = self.stack.terms(np.atleast_2d(q), rates).frames
        x = platform.coordinates(frames)
        twist = matvec(platform.jacobian(frames), rates)
        shape = (*q.shape[:-1], platform.n)
        return x.reshape(shape), twist.reshape(shape)
