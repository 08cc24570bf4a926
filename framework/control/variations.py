"""Random robots that differ from the model: `Spread` says how far, `draw` draws one, a `Variation`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from framework.errors import InvalidInput
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array
from framework.numerics.fields import CheckedNumbers, NotNegative


@dataclass(frozen=True)
class Spread(CheckedNumbers):
    """The spread of each quantity about the model, zero by default.

    The spread of a uniform distribution is its largest deviation, that of a normal distribution its standard
    deviation.
    """

    payload: NotNegative = 0.0  # share of the platform body's inertia, uniform to both sides
    stiffness: NotNegative = 0.0  # share of each spring's stiffness, uniform to both sides
    places: NotNegative = 0.0  # [m] standard deviation of each coordinate of each joint's position
    friction: NotNegative = (
        0.0  # Coulomb friction of each motor, share of the plan's peak torque, uniform from 0
    )
    delay: NotNegative = 0.0  # [s] from measurement to torque, uniform from 0, rounded to sampling periods
    noise: NotNegative = 0.0  # [rad, robot lengths] standard deviation of each encoder
    speed_noise: NotNegative = 0.0  # [rad/s, robot lengths/s] standard deviation of measured speeds

    def __post_init__(self) -> None:
        """Check that no deviation is negative, and that shares are below 1."""
        super().__post_init__()
        for name in ("payload", "stiffness"):
            if getattr(self, name) >= 1:
                raise InvalidInput(f"{name}: must be a share below 1, got {getattr(self, name)!r}")


@dataclass(frozen=True, eq=False)
class Variation:
    """The differences of one robot from the model, reproducible by a seed."""

    seed: tuple[int, int]  # seed of the study, number of the run
    payload: float  # factor on the platform body's inertia
    stiffness: Array  # (n_e,) factors
    shifts: Array  # (joints, 3) [m] of the joints' positions
    friction: Array  # (n_a,) Coulomb friction, share of the plan's peak torque
    delay: float  # [s]


def draw(robot: ParallelRobot, spread: Spread, seed: tuple[int, int]) -> Variation:
    """Draw the variation of one robot, independent of all others.

    Args:
        spread: of each quantity about the model `robot`.
        seed: seed of the study, number of the run.
    """
    random = np.random.default_rng(seed)
    # drawing in another order would give other results for the same seed
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
    """Draw encoder noise (samples, R, 2, nv) of positions and speeds; None without noise.

    Positions are in rad or m, speeds in rad/s or m/s.

    Args:
        spread: standard deviations of the noise.
        seeds: those of the R variations.
        samples: number of sampling instants.
    """
    if not (spread.noise or spread.speed_noise):
        return None
    deviations = np.array([spread.noise, spread.speed_noise])[:, None]  # (2, 1)
    shape = (samples, 2, robot.nv)
    # the additional 1 in the seed makes the sequences independent of those of `draw`
    runs = [np.random.default_rng((*seed, 1)).standard_normal(shape) for seed in seeds]
    return np.stack(runs, axis=1) * deviations * robot.column_scale


def apply_variation(robot: ParallelRobot, variation: Variation) -> ParallelRobot:
    """Return the robot with the inertia, joint positions and spring stiffness of a variation.

    With shifted joints the loops close at another configuration. Loop equations that are redundant in all
    poses are left out: they hold only for exact positions, and a real machine has clearance in its joints.

    The payload factor applies to the inertia of the platform's link or, if that link has no inertia, to the
    moving body that carries the platform's frame. The closed-loop simulation applies friction and delay.
    """
    model = scale_payload(robot, variation.payload)
    for k, shift in enumerate(variation.shifts, start=1):  # joint 0 is the world
        model.jointPlacements[k].translation += shift
    return replace(
        robot,
        model=model,
        stiffness=robot.stiffness * variation.stiffness,
        rows=robot.spanning_loops,  # now all that there are
        structure=replace(
            robot.structure,
            independent=np.arange(len(robot.loops.names)),
            spanning=np.arange(len(robot.spanning_loops.names)),
        ),
    )


def scale_payload(robot: ParallelRobot, factor: float) -> pin.Model:
    """Return a copy of the robot's model with the inertia of the payload multiplied by `factor`."""
    model = robot.model.copy()
    frame = model.frames[robot.frames[0]]  # the platform's frame
    joint = frame.parentJoint
    payload = frame.placement.act(frame.inertia) if frame.inertia.mass > 0 else model.inertias[joint]
    parameters = model.inertias[joint].toDynamicParameters()  # (10,): mass, first moments, inertia
    # parameters of bodies that move as one add up, so their sum changes by the change of the payload
    parameters += (factor - 1) * payload.toDynamicParameters()
    if parameters[0] > 0:  # only a body with mass has an inertia to change
        model.inertias[joint] = pin.Inertia.FromDynamicParameters(parameters)
    return model
