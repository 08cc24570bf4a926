"""Mass matrix, bias forces and loop equations for a stack of runs.

Each run may have its own robot (another payload, other lengths, other springs) if joints and loops are the
same. The fixed-step integrators use these terms; `equations` adds the derivatives for Newton's method.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from framework.errors import InvalidInput
from framework.kinematics.closures import closure_drift, loop_equations
from framework.kinematics.frames import FrameMotions, FrameStack, collect_frames, scratch_of
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, ArrayLike
from framework.numerics.ordered_sums import matmul
from framework.simulation.equations import EquationsOfMotion, check_damping


class Terms(NamedTuple):
    """The terms of the equations of motion of R runs."""

    mass: Array  # (R, nv, nv) M with rotors
    bias: Array  # (R, nv) c + g
    frames: FrameStack
    residual: Array  # (R, m) of the loop equations
    jacobian: Array  # (R, m, nv) of the loop equations
    tree_rate: Array  # (R, 6, nv) time derivative of the tree's Jacobian on world axes


@dataclass(frozen=True, eq=False)
class RobotStack:
    """R robots of one structure with their parameters stacked; a single robot serves any number of runs."""

    robots: tuple[ParallelRobot, ...]
    first: EquationsOfMotion  # of the robot that decides the structure, see `of`
    gear_ratio: Array  # (R, n_a)
    rotors: Array  # (R, nv) inertia, joint side
    stiffness: Array  # (R, nv)
    rest: Array  # (R, nv) rest position of the springs, as an offset from the neutral configuration
    damping: Array  # (R, nv) of the joints, and what the caller adds

    @staticmethod
    def of(
        robots: ParallelRobot | Sequence[ParallelRobot],
        damping: ArrayLike | None = None,
        like: ParallelRobot | None = None,
    ) -> RobotStack:
        """Stack one robot or several of the same structure.

        `damping` is added to that of the joints. `like`, by default the first, decides which loop equations
        are independent and which joints idle.

        Raises:
            InvalidInput: no robot is given, or the robots differ in joints, motors, springs or loops; or as
                in `EquationsOfMotion.of`.
        """
        robots = (robots,) if isinstance(robots, ParallelRobot) else tuple(robots)
        if not robots:
            raise InvalidInput("robots: needs at least one robot")
        like = robots[0] if like is None else like
        first = EquationsOfMotion.of(like)
        for robot in robots:
            _check_same_structure(like, robot)
        idle_inertia = first.rotors - like.rotors  # of idle joints without mass
        added_damping = check_damping(damping, (len(robots), like.nv))

        def stack(parameter: str) -> Array:
            """Return a parameter of all robots, (R, ...)."""
            return np.array([getattr(robot, parameter) for robot in robots])

        return RobotStack(
            robots=robots,
            first=first,
            gear_ratio=stack("gear_ratio"),
            rotors=stack("rotors") + idle_inertia,
            stiffness=stack("all_stiffness"),
            rest=stack("joint_rest"),
            damping=stack("joint_damping") + added_damping,
        )

    @staticmethod
    def from_equations(equations: EquationsOfMotion) -> RobotStack:
        """Stack one robot, with the damping of its equations of motion."""
        robot = equations.robot
        return RobotStack(
            robots=(robot,),
            first=equations,
            gear_ratio=robot.gear_ratio[None],
            rotors=equations.rotors[None],
            stiffness=equations.stiffness[None],
            rest=robot.joint_rest[None],
            damping=equations.damping[None],
        )

    def equations(self, run: int) -> EquationsOfMotion:
        """Return the equations of motion of one run."""
        k = run if len(self.robots) > 1 else 0
        return replace(
            self.first,
            robot=self.robots[k],
            damping=self.damping[k],
            rotors=self.rotors[k],
            stiffness=self.stiffness[k],
        )

    def _models(self, runs: int) -> list[pin.Model]:
        """Return the pinocchio model of each of R runs."""
        models = [robot.model for robot in self.robots]
        return models if len(models) > 1 else models * runs

    def terms(self, q: Array, v: Array) -> Terms:
        """Compute all terms at q (R, nq) and v (R, nv)."""
        runs, nv = v.shape
        models = self._models(runs)
        scratch = scratch_of(self.robots[0])
        data = scratch.data
        mass = np.empty((runs, nv, nv))
        bias = np.empty((runs, nv))
        dJ = np.empty((runs, 6, nv))

        def compute(k: int) -> pin.Model:
            """Compute the terms of the tree in run k; return the model for its frames."""
            bias[k] = pin.nonLinearEffects(models[k], data, q[k], v[k])
            mass[k] = pin.crba(models[k], data, q[k])
            pin.computeJointJacobiansTimeVariation(models[k], data, q[k], v[k])
            dJ[k] = data.dJ
            return models[k]

        frames = collect_frames(scratch, q, compute)
        mass = np.triu(mass) + np.triu(mass, 1).swapaxes(1, 2)  # pinocchio fills the upper half
        mass[:, range(nv), range(nv)] += self.rotors
        loops = loop_equations(self.first.rows, frames)
        return Terms(mass, bias, frames, loops.residual, loops.jacobian, dJ)

    def with_velocities(self, terms: Terms, q: Array, v: Array) -> Terms:
        """Return `terms`, computed at q (R, nq), for other velocities v (R, nv).

        Only bias forces and the rate of the tree's Jacobian depend on velocities.
        """
        bias = np.empty_like(terms.bias)
        dJ = np.empty_like(terms.tree_rate)
        data = scratch_of(self.robots[0]).data
        for k, model in enumerate(self._models(len(q))):
            pin.computeJointJacobiansTimeVariation(model, data, q[k], v[k])
            dJ[k] = data.dJ
            bias[k] = pin.nonLinearEffects(model, data, q[k], v[k])
        return terms._replace(bias=bias, tree_rate=dJ)

    def drift(self, terms: Terms, v: Array) -> Array:
        """Compute the second time derivative (R, m) of the loop equations at zero joint accelerations."""
        frames = terms.frames
        rates = frames.carried * v[:, None]  # (R, F, nv) rates of the joints that carry each frame
        screws_and_rates = np.stack([frames.screws, terms.tree_rate.swapaxes(1, 2)])
        twists_and_rates = matmul(rates, screws_and_rates)  # (2, R, F, 6)
        motions = FrameMotions.of(frames.placements, *twists_and_rates)
        return closure_drift(self.first.rows, motions)


def _check_same_structure(first: ParallelRobot, second: ParallelRobot) -> None:
    """Raise InvalidInput for two robots that cannot be stacked."""
    if not all(map(np.array_equal, _structure(first), _structure(second))):
        raise InvalidInput(
            f"robots: {second!r} differs from {first!r} in more than numbers; a stack needs one structure"
        )


def _structure(robot: ParallelRobot) -> list[Any]:
    """Return the properties in which the robots of a stack agree: joints, index sets and loop rows."""
    joints = [list(robot.model.names), robot.model.nv]
    index_sets = [robot.actuated, robot.elastic, robot.frames]
    loop_rows = [getattr(robot.loops, field.name) for field in fields(robot.loops)]
    return joints + index_sets + loop_rows
