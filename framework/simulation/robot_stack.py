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
from framework.kinematics.frames import (
    FrameStack,
    Scratch,
    collect_frames,
    move_with_bodies,
    scratch_of,
)
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, ArrayLike
from framework.simulation.equations import EquationsOfMotion, check_damping


class Terms(NamedTuple):
    """The terms of the equations of motion of R runs, with m loop equations."""

    mass: Array  # (R, nv, nv) M with rotors
    bias: Array  # (R, nv) c + g, Coriolis, centrifugal and gravity forces
    frames: FrameStack
    residual: Array  # (R, m) of the loop equations [m, rad]
    jacobian: Array  # (R, m, nv) of the loop equations
    twists: Array  # (2, R, bodies, 6) of all bodies, and their time derivatives without joint accelerations


@dataclass(frozen=True, eq=False)
class RobotStack:
    """R robots of one structure with their parameters stacked; one robot serves any number of runs."""

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

        Args:
            damping: viscous damping added to that of the joints, one number, (nv,) or (R, nv)
                [N m s/rad, N s/m].
            like: robot that decides which loop equations are independent and which joints idle; by default
                the first of the robots.

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
        idle_inertia = first.rotors - like.rotors  # (nv,) 1 on idle joints without mass
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
        k = run if len(self.robots) > 1 else 0  # one robot serves all runs
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
        """Compute all terms of R runs at q (R, nq) and v (R, nv)."""
        runs, nv = v.shape
        models = self._models(runs)
        scratch = scratch_of(self.robots[0])
        mass = np.empty((runs, nv, nv))
        bias = np.empty((runs, nv))
        twists = np.empty((2, runs, *scratch.velocities.shape))

        def compute(k: int) -> pin.Model:
            """Compute the terms of the tree in run k; return the model for its frames."""
            mass[k] = pin.crba(models[k], scratch.data, q[k])
            bias[k], twists[:, k] = _velocity_terms(models[k], scratch, q[k], v[k])
            return models[k]

        frames = collect_frames(scratch, q, compute)
        mass = np.triu(mass) + np.triu(mass, 1).swapaxes(1, 2)  # pinocchio fills only the upper half
        mass[:, range(nv), range(nv)] += self.rotors
        loops = loop_equations(self.first.rows, frames)
        return Terms(mass, bias, frames, loops.residual, loops.jacobian, twists)

    def with_velocities(self, terms: Terms, q: Array, v: Array) -> Terms:
        """Return `terms`, computed at q (R, nq), for other velocities v (R, nv).

        Only bias forces and twists depend on velocities.
        """
        bias = np.empty_like(terms.bias)
        twists = np.empty_like(terms.twists)
        scratch = scratch_of(self.robots[0])
        for k, model in enumerate(self._models(len(q))):
            bias[k], twists[:, k] = _velocity_terms(model, scratch, q[k], v[k])
        return terms._replace(bias=bias, twists=twists)

    def drift(self, terms: Terms) -> Array:
        """Compute second time derivatives (R, m) of the loop equations without joint accelerations."""
        motions = move_with_bodies(self.robots[0], terms.frames, terms.twists)
        return closure_drift(self.first.rows, motions)


def _velocity_terms(model: pin.Model, scratch: Scratch, q: Array, v: Array) -> tuple[Array, Array]:
    """Compute the terms of one run that depend on velocities, at q (nq,) and v (nv,).

    The screws of the joints, from which frames are collected, are computed in the memory `scratch`, too.

    Returns:
        The bias forces (nv,); the twists of all bodies and their time derivatives (2, bodies, 6).
    """
    bias = pin.nonLinearEffects(model, scratch.data, q, v)
    pin.computeForwardKinematicsDerivatives(model, scratch.data, q, v, np.zeros_like(v))
    return bias, np.stack([scratch.velocities, scratch.accelerations])


def _check_same_structure(first: ParallelRobot, second: ParallelRobot) -> None:
    """Raise InvalidInput unless two robots have the same structure."""
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
