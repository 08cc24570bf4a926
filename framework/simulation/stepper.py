"""Fixed steps for control loops and for many runs at once: a step is a pure function of the state.

The motor torque is held over the step, as a digital controller holds it.
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
from framework.simulation.schemes import SCHEMES, State
from framework.simulation.terms import RobotStack
from framework.simulation.world_forces import NO_FORCES, WorldForces


@dataclass(frozen=True, eq=False)
class Stepper:
    """Advances one robot, one robot in many runs, or as many robots as runs; made by `Stepper.of`."""

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

        One robot serves any number of runs.

        Args:
            damping: viscous damping of every joint rate, one number, (nv,) or (R, nv) [N m s/rad, N s/m].
            scheme: midpoint or extrapolated, see `schemes`; by default midpoint, extrapolated where parts
                have no mass.
            like: a robot of the same structure that tells which loop equations are independent, which
                joints idle and whether parts have no mass; the first of the robots by default.

        Raises:
            InvalidInput: unknown scheme, one that does not suit the robot, robots of different structure.
        """
        stack = RobotStack.of(robots, damping, like)
        first = stack.first
        light = free_motions(first, first.tangent_at_rest(first.robot.reference.q))[1]  # (nv, k)
        massless = light.shape[1] > 0  # whether the loops allow a motion without mass
        if scheme is None:
            scheme = "extrapolated" if massless else "midpoint"
        check_choice("scheme", scheme, SCHEMES)
        if massless and scheme == "midpoint":
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
        """Find the nearest consistent state.

        Its loops close and massless parts are in balance. q (nq,) or (R, nq); v of zeros and torque (n_a,) of
        zeros by default; the world as it is at t = 0.

        Raises:
            NotAssembled, NotConverged, InvalidInput: see `consistent_state`.
        """
        robot, q = self.stack.robots[0], np.asarray(q, dtype=float)
        runs = np.atleast_2d(q)  # (R, nq)
        v = np.zeros((len(runs), robot.nv)) if v is None else np.atleast_2d(np.asarray(v, dtype=float))
        tau = np.zeros((len(runs), robot.n_a)) if torque is None else np.atleast_2d(torque)
        states = [
            consistent_state(self.stack.equations(k), runs[k], v[k], tau[k], world) for k in range(len(runs))
        ]
        starts, velocities = map(np.array, zip(*states, strict=True))
        return State(starts.reshape(q.shape), velocities.reshape(*q.shape[:-1], robot.nv))

    def step(self, q: Array, v: Array, torque: Array, h: float, *, world: Array | None = None) -> State:
        """Return the state h [s] later under constant torques (n_a,) or (R, n_a) [N m], motor side.

        And under constant generalised forces of the `world` (nv,) or (R, nv), none by default. A run that
        diverges, or whose equations are singular, comes out as NaN or infinite. A run comes out the same to
        the last bit whatever stack it is in.
        """
        runs, rates = np.atleast_2d(q), np.atleast_2d(v)  # (R, nq), (R, nv)
        driven = np.zeros(rates.shape)  # generalised forces of motors and world
        driven[:, self.stack.robots[0].actuated] = self.stack.gear_ratio * torque
        if world is not None:
            driven += world
        with np.errstate(over="ignore", invalid="ignore"):
            new = SCHEMES[self.scheme](self.stack, runs, rates, driven, h)
        return State(new.q.reshape(q.shape), new.v.reshape(v.shape))

    def platform(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Compute coordinates x and twist of the platform on its axes, (n,) or (R, n)."""
        platform, rates = self.stack.robots[0].platform, np.atleast_2d(v)
        frames = self.stack.terms(np.atleast_2d(q), rates).frames
        x, twist = platform.coordinates(frames), matvec(platform.jacobian(frames), rates)
        shape = (*q.shape[:-1], platform.n)
        return x.reshape(shape), twist.reshape(shape)
