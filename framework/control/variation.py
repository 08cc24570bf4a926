"""Differences of a real robot from its model: payload, springs, geometry, friction, timing, noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from framework.errors import InvalidInput
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array
from framework.numerics.fields import not_negative


@dataclass(frozen=True)
class Spread:
    """The largest deviation of each quantity from the model; zero for none."""

    payload: float = 0.0  # share of the platform body's inertia, uniform in +-
    stiffness: float = 0.0  # share of each spring's stiffness, uniform in +-
    places: float = 0.0  # [m] standard deviation of each coordinate of each joint's place
    friction: float = 0.0  # Coulomb friction of each motor, share of the plan's peak torque, uniform from 0
    delay: float = 0.0  # [s] from measurement to torque, uniform from 0, in whole sampling periods
    noise: float = 0.0  # [rad] or [lengths of the robot], standard deviation of each encoder
    speed_noise: float = 0.0  # [rad/s] or [lengths/s], the same of measured speeds

    def __post_init__(self) -> None:
        """Check deviations: 0 or more, shares below 1."""
        for name, value in vars(self).items():
            not_negative(name, value)
        for name in ("payload", "stiffness"):
            if getattr(self, name) >= 1:
                raise InvalidInput(f"{name}: must be a share below 1, got {getattr(self, name)!r}")


@dataclass(frozen=True, eq=False)
class Variation:
    """The differences of one robot from the model, reproduced by a seed."""

    seed: tuple[int, int]  # of the study, number of the run
    payload: float  # factor on the platform body's inertia
    stiffness: Array  # (n_e,) factors
    shifts: Array  # (joints, 3) [m] added to the joints' places
    friction: Array  # (n_a,) [share of the peak torque]
    delay: float  # [s]


def draw(robot: ParallelRobot, spread: Spread, seed: tuple[int, int]) -> Variation:
    """Draw the variation of one seed, independent of all other runs."""
    random = np.random.default_rng(np.random.SeedSequence(seed))
    return Variation(
        seed=seed,
        payload=1 + spread.payload * random.uniform(-1, 1),
        stiffness=1 + spread.stiffness * random.uniform(-1, 1, robot.n_e),
        shifts=spread.places * random.standard_normal((robot.model.njoints - 1, 3)),
        friction=spread.friction * random.uniform(0, 1, robot.n_a),
        delay=spread.delay * random.uniform(0, 1),
    )


def draw_noise(
    robot: ParallelRobot, spread: Spread, seeds: Sequence[tuple[int, int]], samples: int
) -> Array | None:
    """Draw encoder noise (samples, R, 2, nv) of positions and speeds; None without.

    In radians and robot lengths times the joints' scale.
    """
    if not (spread.noise or spread.speed_noise):
        return None
    deviation = np.array([spread.noise, spread.speed_noise])[:, None]
    shape = (samples, 2, robot.model.nv)
    sequences = [np.random.SeedSequence((*seed, 1)) for seed in seeds]  # independent of those of `draw`
    runs = [np.random.default_rng(sequence).standard_normal(shape) for sequence in sequences]
    return np.stack(runs, axis=1) * deviation * robot.column_scale


def apply_variation(robot: ParallelRobot, variation: Variation) -> ParallelRobot:
    """Return the robot with the differences of a variation.

    With other places of joints the loops close at another configuration. Only the independent loop equations
    are kept: redundant ones hold only for exact places, and a real machine has clearance.

    The payload is the inertia of the platform's link or, if that link has no inertia, of the moving body that
    carries the platform's frame.
    """
    model = robot.model.copy()
    frame = model.frames[robot.frames[0]]
    joint = frame.parentJoint
    inertia = frame.inertia
    payload = frame.placement.act(inertia) if inertia.mass > 0 else model.inertias[joint]
    parameters = model.inertias[joint].toDynamicParameters()
    parameters += (variation.payload - 1) * payload.toDynamicParameters()
    if parameters[0] > 0:  # the mass
        model.inertias[joint] = pin.Inertia.FromDynamicParameters(parameters)
    for k, shift in enumerate(variation.shifts):
        placement = model.jointPlacements[k + 1]
        model.jointPlacements[k + 1] = pin.SE3(placement.rotation, placement.translation + shift)
    return replace(
        robot,
        model=model,
        stiffness=robot.stiffness * variation.stiffness,
        rows=robot.loops,
        structure=replace(robot.structure, independent=np.arange(len(robot.loops.names))),
    )
