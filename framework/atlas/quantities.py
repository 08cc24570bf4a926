"""What a map shows, pose by pose: one line a quantity, with its name in words and its unit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from framework.arrays import Array, ReadOnlyArrays
from framework.dynamics.stiffness import (
    CompliantMotions,
    compliant_motions,
    least_stiffness,
    locked_motor_frequency,
)
from framework.errors import InvalidInput, choose_from
from framework.kinematics.inverse_kinematics import System
from framework.kinematics.parallel_robot import ParallelRobot
from framework.singularity.distances import Distances, singularity_distances


@dataclass(frozen=True, eq=False)
class Poses(ReadOnlyArrays):
    """T assembled configurations and what several quantities share."""

    robot: ParallelRobot
    q: Array  # (T, nq)
    system: System

    @cached_property
    def distances(self) -> Distances:
        return singularity_distances(self.robot, self.system)

    @cached_property
    def free(self) -> CompliantMotions:
        return compliant_motions(self.robot, self.system, self.q)


@dataclass(frozen=True)
class Quantity:
    """`name` in words, `unit` as printed, and its values (T,)."""

    key: str
    name: str
    unit: str
    of: Callable[[Poses], Array]
    large_is_good: bool = True
    decades: bool = False  # told in decades: a colour for each factor of ten
    signed: bool = False
    springs: bool = False  # of robots that have some

    def __reduce__(self) -> tuple[Callable[[str], Quantity], tuple[str]]:
        return known, (self.key,)  # another process has its own functions


def known(key: str) -> Quantity:
    """The quantity of a key; KeyError for any other."""
    return QUANTITIES[key]


QUANTITIES = {
    quantity.key: quantity
    for quantity in (
        Quantity(
            *("g", "signed distance from Type 2, g", "1"),
            lambda poses: poses.distances.g,
            signed=True,
        ),
        Quantity(
            *("conditioning", "conditioning, least singular value of A", "1, lengths in robot lengths"),
            lambda poses: poses.distances.sigma_A,
        ),
        Quantity(
            *("torque", "worst motor torques against a unit force, 2-norm", "N m/N"),
            lambda poses: poses.distances.motor_torque_norm,
            large_is_good=False,
            decades=True,
        ),
        Quantity(
            *("single_torque", "worst torque of a single motor against a unit force", "N m/N"),
            lambda poses: poses.distances.motor_torque_largest,
            large_is_good=False,
            decades=True,
        ),
        Quantity(
            *("joint_torque", "worst torques behind the gears against a unit force, 2-norm", "N m/N"),
            lambda poses: poses.distances.torque_norm,
            large_is_good=False,
            decades=True,
        ),
        Quantity(
            *("stiffness", "stiffness in the softest direction, motors locked", "N/m"),
            lambda poses: least_stiffness(poses.robot, poses.free),
            decades=True,
            springs=True,
        ),
        Quantity(
            *("frequency", "first natural frequency, motors locked", "Hz"),
            lambda poses: locked_motor_frequency(poses.free),
            springs=True,
        ),
    )
}


def chosen(robot: ParallelRobot, names: Sequence[str] | None) -> tuple[Quantity, ...]:
    """The quantities of these names, and g, from which the locus is drawn; without names all that apply.

    "Apply" leaves out torques that differ by gears or by a norm alone.

    Raises:
        InvalidInput: an unknown name, or one that asks for springs which the robot has not.
    """
    has_springs = bool(robot.n_e or robot.joint_stiffness.any())
    if names is None:
        names = ["conditioning", *(["torque"] if robot.translations.any() else [])]
        names += ["stiffness", "frequency"] if has_springs else []
    names = ["g", *names]
    for name in names:
        if name not in QUANTITIES:
            raise InvalidInput(choose_from("quantity", name, QUANTITIES))
        if QUANTITIES[name].springs and not has_springs:
            raise InvalidInput(
                f"quantity {name}: {robot.name}, {robot.flexibility}, has no springs; take "
                f"flexible_joints or flexible_links"
            )
        if "torque" in name and not robot.translations.any():
            raise InvalidInput(
                f"quantity {name}: it is told against a unit force, and the platform of {robot.name} "
                f"only turns"
            )
    return tuple(QUANTITIES[name] for name in dict.fromkeys(names))


def unit_of(robot: ParallelRobot, quantity: Quantity) -> str:
    """The unit for this robot: its motors may slide, its platform may only turn."""
    if quantity.key.endswith("torque"):
        units = (
            set(robot.torque_units)
            if quantity.key != "joint_torque"
            else {"N" if slide else "N m" for slide in robot.sliding[robot.actuated]}
        )
        return "N/N" if units == {"N"} else "N m/N" if units == {"N m"} else "N m/N, N/N"
    if quantity.key == "stiffness" and not robot.translations.any():
        return "N m/rad"
    return quantity.unit


def evaluate(
    robot: ParallelRobot, quantities: Sequence[Quantity], q: Array, system: System
) -> dict[str, Array]:
    """Values (T,) by the quantity's key at assembled configurations q (T, nq)."""
    poses = Poses(robot, q, system)
    with np.errstate(all="ignore"):  # infinite at Type 2
        return {quantity.key: np.asarray(quantity.of(poses), dtype=float) for quantity in quantities}
