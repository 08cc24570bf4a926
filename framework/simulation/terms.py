"""Mass matrix, bias forces and closures for a stack of runs, one call of pinocchio each.

Each run may have a robot of its own (another payload, other lengths, other springs) as long as joints and
loops are the same. For the fixed-step integrators; `equations` has the derivatives that Newton's method asks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.errors import InvalidInput
from framework.kinematics.closures import closure_drift, loop_equations
from framework.kinematics.frames import FrameMotions, FrameStack, collect_frames
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.pinocchio_memory import scratch_of
from framework.numerics.arrays import Array, ArrayLike
from framework.numerics.ordered_sums import matmul
from framework.simulation.equations import EquationsOfMotion, check_damping


class Terms(NamedTuple):
    """The terms of R equations of motion: M, c + g and the loop equations with their drift."""

    mass: Array  # (R, nv, nv) with rotors
    bias: Array  # (R, nv) c + g
    frames: FrameStack
    residual: Array  # (R, m)
    jacobian: Array  # (R, m, nv)
    tree_rate: Array  # (R, 6, nv) time derivative of the tree's Jacobian on world axes


@dataclass(frozen=True, eq=False)
class RobotStack:
    """R robots of one structure, with their numbers stacked; one robot may serve any number of runs."""

    robots: tuple[ParallelRobot, ...]
    first: EquationsOfMotion  # of the robot on which the structure is found
    gear_ratio: Array  # (R, n_a)
    rotors: Array  # (R, nv)
    stiffness: Array  # (R, nv)
    rest: Array  # (R, nv) where the springs are at rest, as an offset from the neutral configuration
    damping: Array  # (R, nv)

    @staticmethod
    def of(
        robots: ParallelRobot | Sequence[ParallelRobot],
        damping: ArrayLike | None = None,
        like: ParallelRobot | None = None,
    ) -> RobotStack:
        """Stack one robot or several of the same structure.

        `like` decides which loop equations count and which joints idle.

        Raises:
            InvalidInput: no robot, or joints, motors, springs or loops differ; see `EquationsOfMotion.of`.
        """
        robots = (robots,) if isinstance(robots, ParallelRobot) else tuple(robots)
        if not robots:
            raise InvalidInput("robots: needs at least one robot")
        like = robots[0] if like is None else like
        first = EquationsOfMotion.of(like)
        for robot in robots:
            _check_same_structure(like, robot)
        idle_inertia = first.rotors - like.rotors  # that keeps massless idle joints still
        added = check_damping(damping, (len(robots), like.model.nv))
        return RobotStack(
            robots=robots,
            first=first,
            gear_ratio=np.array([robot.gear_ratio for robot in robots]),
            rotors=np.array([robot.rotors for robot in robots]) + idle_inertia,
            stiffness=np.array([robot.all_stiffness for robot in robots]),
            rest=np.array([robot.joint_rest for robot in robots]),
            damping=added + np.array([robot.joint_damping for robot in robots]),
        )

    def equations(self, run: int) -> EquationsOfMotion:
        """Return the equations of one run, with all that the robots share."""
        k = run if len(self.robots) > 1 else 0
        return replace(
            self.first,
            robot=self.robots[k],
            damping=self.damping[k],
            rotors=self.rotors[k],
            stiffness=self.stiffness[k],
        )

    def _models(self, runs: int) -> list[pin.Model]:
        """Return the model of each run."""
        models = [robot.model for robot in self.robots]
        return models if len(models) > 1 else models * runs

    def terms(self, q: Array, v: Array) -> Terms:
        """Compute all terms at q (R, nq) and v (R, nv).

        Pinocchio fills the upper half of a mass matrix, to which the rotors are added.
        """
        (runs, nv), scratch = v.shape, scratch_of(self.robots[0])
        data, models = scratch.data, self._models(runs)
        mass, bias, dJ = np.empty((runs, nv, nv)), np.empty((runs, nv)), np.empty((runs, 6, nv))

        def compute(k: int) -> pin.Model:
            bias[k] = pin.nonLinearEffects(models[k], data, q[k], v[k])
            mass[k] = pin.crba(models[k], data, q[k])
            pin.computeJointJacobiansTimeVariation(models[k], data, q[k], v[k])
            dJ[k] = data.dJ
            return models[k]

        frames = collect_frames(scratch, q, compute)
        mass = np.triu(mass) + np.triu(mass, 1).swapaxes(1, 2)
        mass[:, range(nv), range(nv)] += self.rotors
        loops = loop_equations(self.first.rows, frames)
        return Terms(mass, bias, frames, loops.residual, loops.jacobian, dJ)

    def with_velocities(self, terms: Terms, q: Array, v: Array) -> Terms:
        """Return the terms at configurations q (R, nq) for other velocities v (R, nv).

        Only bias forces and the rate of the tree's Jacobian depend on velocities.
        """
        bias, dJ = np.empty_like(terms.bias), np.empty_like(terms.tree_rate)
        data = scratch_of(self.robots[0]).data
        for k, model in enumerate(self._models(len(q))):
            pin.computeJointJacobiansTimeVariation(model, data, q[k], v[k])
            dJ[k] = data.dJ
            bias[k] = pin.nonLinearEffects(model, data, q[k], v[k])
        return terms._replace(bias=bias, tree_rate=dJ)

    def drift(self, terms: Terms, v: Array) -> Array:
        """Compute the second derivative (R, m) of the loop equations when joint accelerations are zero."""
        frames = terms.frames
        rates = frames.carried * v[:, None]  # (R, F, nv)
        screws_and_rates = np.stack([frames.screws, terms.tree_rate.swapaxes(1, 2)])
        motions = FrameMotions.of(frames.placements, *matmul(rates, screws_and_rates))
        return closure_drift(self.first.rows, motions)


def _check_same_structure(first: ParallelRobot, second: ParallelRobot) -> None:
    """Refuse robots that cannot be stacked."""
    same = (
        list(first.model.names) == list(second.model.names)
        and first.model.nv == second.model.nv
        and all(
            np.array_equal(getattr(first, name), getattr(second, name))
            for name in ("actuated", "elastic", "frames")
        )
        and all(np.array_equal(getattr(first.loops, n), getattr(second.loops, n)) for n in vars(first.loops))
    )
    if not same:
        raise InvalidInput(
            f"robots: {second!r} differs from {first!r} in more than numbers; a stack needs one structure"
        )
