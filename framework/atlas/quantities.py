"""The quantities of a map: their names, their units, and the functions that compute them at many poses."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from framework.dynamics.forces import balanced_forces, static_forces
from framework.dynamics.loading import LoadedStack, LoadReason, loaded_stack
from framework.dynamics.motor_limits import motor_limits
from framework.dynamics.stiffness import (
    CompliantMotions,
    compliant_motions,
    least_stiffness,
    locked_motor_frequency,
    moving_axes,
    softest_motion,
)
from framework.dynamics.tangent_stiffness import check_wrench
from framework.errors import InvalidInput, choose_from, finite_numbers
from framework.kinematics.linearised_loops import LinearisedLoops, linearised_at
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays
from framework.singularity.distances import Distances
from framework.singularity.type2 import signed_measure


@dataclass(frozen=True, eq=False)
class Poses(ReadOnlyArrays):
    """T assembled configurations, with the results that several quantities share."""

    robot: ParallelRobot
    q: Array  # (T, nq)
    linearised: LinearisedLoops  # at q
    wrench: Array | None  # (n,) external wrench ON the platform [N, N m], in addition to the weight

    @cached_property
    def distances(self) -> Distances:
        """Distances of the poses from singularities."""
        return Distances(self.robot, self.linearised)

    @cached_property
    def compliance(self) -> CompliantMotions:
        """Motions that the springs allow while motors are locked."""
        return compliant_motions(self.robot, self.linearised, self.q)

    @cached_property
    def loaded(self) -> LoadedStack:
        """The poses after deflection by weight and wrench."""
        return loaded_stack(self.robot, self.q, wrench=self.wrench)

    def mask_loaded(self, values: Array) -> Array:
        """Return values (T,), NaN at poses that do not carry the load."""
        return np.where(self.loaded.reason == LoadReason.CARRIED, values, np.nan)


@dataclass(frozen=True)
class Quantity:
    """A quantity of a map."""

    key: str  # by which options and files name the quantity
    name: str  # in words
    unit: str  # as printed, for most robots; `quantity_unit` has the exceptions
    large_is_good: bool = True  # whether large values are good, for the colours
    decades: bool = False  # whether it is drawn on a logarithmic scale
    signed: bool = False  # whether its sign has a meaning
    springs: bool = False  # whether it needs a robot with springs
    softest: bool = False  # whether it is the stiffness in the softest direction, which is drawn
    loaded: bool = False  # whether it is computed at poses deflected by weight and `wrench`
    wrench: tuple[float, ...] | None = None  # (n,) external wrench ON the platform [N, N m]

    @property
    def takes_wrench(self) -> bool:
        """Whether the quantity depends on the wrench."""
        return self.loaded or self.key == "holding"


def holding_torque_ratio(poses: Poses) -> Array:
    """Compute the largest motor torque at rest over its limit (T,), at T poses.

    Motors without a limit do not count: their limit is infinite. The torques balance weight, springs and
    wrench at the deflections of q, without dry friction. They grow without bound towards Type 2.
    """
    robot = poses.robot
    forces = static_forces(robot, poses.q)  # (T, nv) generalised, of weight and springs
    if poses.wrench is not None:
        # the wrench acts on the joints by the platform's Jacobian (T, n, nv)
        forces = forces - np.einsum("tnv,n->tv", poses.linearised.platform, poses.wrench)
    torques = balanced_forces(robot, poses.linearised, forces).joint_torque / robot.gear_ratio
    return (np.abs(torques) / motor_limits(robot, "torque_limit", stated=None)).max(axis=1)


QUANTITIES = {
    quantity.key: quantity
    for quantity in (
        Quantity("g", "signed measure of Type 2 singularity, g", "1", signed=True),
        Quantity("conditioning", "conditioning, least singular value of A", "1"),
        Quantity(
            "torque",
            "worst motor torques against a unit force, 2-norm",
            "N m/N",
            large_is_good=False,
            decades=True,
        ),
        Quantity(
            "single_torque",
            "worst torque of a single motor against a unit force",
            "N m/N",
            large_is_good=False,
            decades=True,
        ),
        Quantity(
            "joint_torque",
            "worst torques behind the gears against a unit force, 2-norm",
            "N m/N",
            large_is_good=False,
            decades=True,
        ),
        Quantity("holding", "largest motor torque at rest over its limit", "1", large_is_good=False),
        Quantity(
            "stiffness",
            "stiffness in the softest direction, motors locked",
            "N/m",
            decades=True,
            springs=True,
            softest=True,
        ),
        Quantity("frequency", "first natural frequency, motors locked", "Hz", springs=True),
        Quantity(
            "loaded_stiffness",
            "stiffness under load in the softest direction, motors locked",
            "N/m",
            decades=True,
            springs=True,
            softest=True,
            loaded=True,
        ),
        Quantity(
            "loaded_frequency",
            "first natural frequency under load, motors locked",
            "Hz",
            springs=True,
            loaded=True,
        ),
    )
}
_VALUES: Mapping[str, Callable[[Poses], Array]] = {  # (T,) by the quantity's key
    "g": lambda poses: signed_measure(poses.robot, poses.linearised),
    "conditioning": lambda poses: poses.distances.sigma_A,
    "torque": lambda poses: poses.distances.worst_torques(poses.robot.gear_ratio)[0],
    "single_torque": lambda poses: poses.distances.worst_torques(poses.robot.gear_ratio)[1],
    "joint_torque": lambda poses: poses.distances.worst_torques(np.ones(poses.robot.n_a))[0],
    "holding": holding_torque_ratio,
    "stiffness": lambda poses: least_stiffness(poses.robot, poses.compliance),
    "frequency": lambda poses: locked_motor_frequency(poses.compliance),
    "loaded_stiffness": lambda poses: poses.mask_loaded(least_stiffness(poses.robot, poses.loaded.free)),
    "loaded_frequency": lambda poses: poses.mask_loaded(locked_motor_frequency(poses.loaded.free)),
}


def choose_quantities(
    robot: ParallelRobot, names: Sequence[str] | None, wrench: ArrayLike | None = None
) -> tuple[Quantity, ...]:
    """Return the quantities of the keys `names`, led by g, from which the locus is drawn.

    The default is conditioning, torque if the platform translates, and stiffness and frequency if the robot
    has springs.

    Args:
        wrench: external wrench (n,) ON the platform in addition to the weight [N, N m], for quantities that
            depend on it.

    Raises:
        InvalidInput: a name is unknown; a quantity needs springs, torque limits or translations that the
            robot does not have; the wrench has no potential, or no quantity depends on it.
    """
    has_springs = robot.has_springs
    if names is None:
        names = ["conditioning"]
        names += ["torque"] if robot.translations.any() else []
        names += ["stiffness", "frequency"] if has_springs else []
    names = ["g", *names]

    # refuse quantities that this robot does not have
    for name in names:
        if name not in QUANTITIES:
            raise InvalidInput(choose_from("quantity", name, QUANTITIES))
        quantity = QUANTITIES[name]
        if quantity.springs and not has_springs:
            raise InvalidInput(
                f"quantity {name}: {robot.name}, {robot.flexibility}, has no springs; take "
                f"flexible_joints or flexible_links"
            )
        if name == "holding" and not has_torque_limits(robot):
            raise InvalidInput(f"quantity {name}: no motor of {robot.name} has a torque_limit")
        if "torque" in name and not robot.translations.any():
            raise InvalidInput(
                f"quantity {name}: is the torque against a unit force, and the platform of {robot.name} "
                f"only turns"
            )
    quantities = tuple(QUANTITIES[name] for name in dict.fromkeys(names))  # each once

    # store the wrench in the quantities that depend on it
    if wrench is None:
        return quantities
    if not any(quantity.takes_wrench for quantity in quantities):
        with_wrench = [quantity.key for quantity in QUANTITIES.values() if quantity.takes_wrench]
        raise InvalidInput(f"wrench: affects only {', '.join(with_wrench)}; ask for one of them")
    load = tuple(finite_numbers("wrench", wrench, robot.n).tolist())
    if has_loaded(quantities):
        check_wrench(robot, load)  # deflections minimise an energy, so the wrench needs a potential
    return tuple(
        replace(quantity, wrench=load) if quantity.takes_wrench else quantity for quantity in quantities
    )


def has_loaded(quantities: Sequence[Quantity]) -> bool:
    """Return whether any quantity is computed at loaded poses."""
    return any(quantity.loaded for quantity in quantities)


def has_torque_limits(robot: ParallelRobot) -> bool:
    """Return whether any motor has a torque limit."""
    return bool(np.isfinite(motor_limits(robot, "torque_limit", stated=None)).any())


def quantity_unit(robot: ParallelRobot, quantity: Quantity) -> str:
    """Return the unit of a quantity, which depends on the robot's motors and platform."""
    if quantity.key.endswith("torque"):
        units = set(robot.torque_units)  # of motors; behind its gear a slide has a force
        if quantity.key == "joint_torque":
            units = {"N" if slides else "N m" for slides in robot.sliding[robot.actuated]}
        return f"{units.pop()}/N" if len(units) == 1 else "N m/N, N/N"
    if quantity.key in ("stiffness", "loaded_stiffness") and not robot.translations.any():
        return "N m/rad"
    return quantity.unit


def quantity_values(
    robot: ParallelRobot, quantities: Sequence[Quantity], q: Array, linearised: LinearisedLoops
) -> dict[str, Array]:
    """Compute the values (T,) of quantities at configurations q (T, nq), by key.

    `linearised` are the loops at q. If any quantity is loaded, the key "load" has the `LoadReason` of each
    configuration.
    """
    wrench = find_wrench(quantities)
    poses = Poses(robot, q, linearised, None if wrench is None else np.array(wrench))
    with np.errstate(all="ignore"):  # some are infinite at Type 2
        values: dict[str, Any] = {quantity.key: _VALUES[quantity.key](poses) for quantity in quantities}
    if has_loaded(quantities):
        values["load"] = poses.loaded.reason
    return values


def softest_directions(robot: ParallelRobot, quantity: Quantity, q: Array) -> Array:
    """Compute unit twists (T, n) in which the platform is softest at q (T, nq).

    The least stiffness with locked motors is along them. For a platform that moves, axes of rotation do not
    count and have zeros.

    Args:
        quantity: the stiffness whose directions they are: of the robot at q, or deflected by its load.
    """
    wrench = None if quantity.wrench is None else np.array(quantity.wrench)
    poses = Poses(robot, q, linearised_at(robot, q), wrench)
    twists = np.zeros((len(q), robot.n))
    with np.errstate(all="ignore"):
        compliant = poses.loaded.free if quantity.loaded else poses.compliance  # motions with locked motors
        _stiffness, directions = softest_motion(robot, compliant)
    twists[:, moving_axes(robot)] = directions
    return twists


def find_wrench(quantities: Sequence[Quantity]) -> tuple[float, ...] | None:
    """Return the wrench (n,) of the quantities that depend on one; None without such a wrench."""
    return next((quantity.wrench for quantity in quantities if quantity.takes_wrench), None)
