"""The content of a robot file as frozen records.

This module opens no file and does not call pinocchio. Joints, links and frames have their URDF names.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from framework.errors import (
    LARGEST_NUMBER,
    InvalidInput,
    RobotFileError,
    check_choice,
    check_name,
    finite_numbers,
    short,
)
from framework.numerics.arrays import Array, Names, ReadOnlyArrays
from framework.numerics.fields import Table, anything, one_of, optional, read_table

# Each level has all springs of the level before it, see `Spring.exists_in`.
FLEXIBILITIES = ("rigid", "flexible_joints", "flexible_links")
GOALS = ("time", "peak_torque", "energy")  # of an optimal law
SMALLEST_LENGTH = 1.0 / LARGEST_NUMBER  # [m] powers of smaller lengths underflow to zero
AXES = ("x", "y", "z", "rx", "ry", "rz")
Points = tuple[tuple[float, ...], ...]  # of a path, each in the platform's coordinates
MAX_TERMS = 20  # of a coupling, besides offset and ratio
MAX_DEGREE = 4  # of a coupling, as in MJCF
Product = tuple[str, ...]  # of the coordinates of joints, by name; () is 1
Polynomial = Mapping[Product, float]  # coefficient of each product

_WRENCH_TABLE: Table = {
    "wrench": optional(anything),
    "axes": optional(one_of("axes", ("base", "tool")), "base"),
}

# The axes that each kind of closure locks, in the frame of the first body, for a joint with axis z. A kind
# that needs the closure's `length` has rows of `loop_rows.ROW_KINDS` instead.
_LOCKED = {
    "fixed": ("x", "y", "z", "rx", "ry", "rz"),
    "revolute": ("x", "y", "z", "rx", "ry"),  # turns about its axis
    "prismatic": ("x", "y", "rx", "ry", "rz"),  # slides along its axis
    "universal": ("x", "y", "z", "rz"),  # does not turn about its axis
    "cylindrical": ("x", "y", "rx", "ry"),  # turns about and slides along its axis
    "spherical": ("x", "y", "z"),
    "planar": ("z", "rx", "ry"),  # its axis is the normal of the plane
    "distance": ("distance",),
}
CLOSURE_KINDS = _LOCKED.keys()


def locked_axes(kind: str, axis: str = "z") -> Names:
    """Return the axes that a closure kind locks, in the first body's frame.

    Rows that need a length, such as distance, come last. `axis` in {x, y, z} is the axis of the joint: the
    table is for z, and a cyclic permutation of the axes takes z to `axis`.

    Raises:
        RobotFileError: unknown kind or axis.
    """
    check_name("kind", "closure kind", kind, _LOCKED)
    check_name("axis", "closure axis", axis, tuple("xyz"))
    permuted = {"x": "yzx", "y": "zxy", "z": "xyz"}[axis]  # the axes that x, y, z become
    permutation = str.maketrans("xyz", permuted)
    rows = [row.translate(permutation) if row in AXES else row for row in _LOCKED[kind]]
    return tuple(sorted(rows, key=[*AXES, *rows].index))  # in the order of AXES, others last


def kinds_with_length() -> Names:
    """Return the closure kinds that need a length."""
    return tuple(kind for kind, axes in _LOCKED.items() if not set(axes) <= set(AXES))


@dataclass(frozen=True)
class Platform:
    """The coordinates of the prescribed motion: of a frame along base axes, or of joints.

    The order of two rotations matters, see `framework.kinematics.attitude`.
    """

    frame: str
    axes: Names = ()
    joints: Names = ()  # instead of axes; the frame is then only drawn

    @property
    def names(self) -> Names:
        """Names of the platform's coordinates."""
        return self.joints or self.axes


@dataclass(frozen=True)
class Actuator:
    """A motor on a URDF joint.

    `rotor_inertia` [kg m^2] and the limits [N m], [rad/s] are on the motor side of the gear. `gear_ratio` is
    motor angle over joint angle. `backlash` is the whole play of the joint [rad, m] with the motor at rest.
    A torque-speed curve (`dynamics.drive_limits`) has the `torque_limit` up to the `corner_speed`, and no
    torque at the `no_load_speed`. `rms_torque_limit` bounds the root mean square over a motion or cycle.
    """

    joint: str
    gear_ratio: float = 1.0
    rotor_inertia: float = 0.0
    torque_limit: float | None = None  # None: no limit
    speed_limit: float | None = None
    backlash: float = 0.0
    corner_speed: float | None = None  # None: no torque-speed curve
    no_load_speed: float | None = None
    rms_torque_limit: float | None = None


@dataclass(frozen=True)
class Closure:
    """Two frames, and the axes of the first frame along which their relative pose is locked.

    `axes` may also name a row of `loop_rows.ROW_KINDS`, such as "distance", which needs `length` [m].
    """

    name: str
    frames: tuple[str, str]
    axes: Names
    length: float | None = None
    # whether the file leaves out the axis of its kind, which is z then
    omits_axis: bool = field(default=False, compare=False)

    def __post_init__(self) -> None:
        """Refuse unknown rows, a missing length, and a length that no row needs."""
        valid = set().union(*_LOCKED.values())
        for row in self.axes:
            check_name(f"closure {self.name}", "axis", row, valid)
        needs_length = not set(self.axes) <= set(AXES)
        if needs_length == (self.length is None):
            raise RobotFileError(
                f"closure {self.name}: a length goes with rows such as distance, and with no others, "
                f"got axes {list(self.axes)} and length {self.length}"
            )


@dataclass(frozen=True)
class Spring:
    """A virtual joint in series behind the URDF joint `after`.

    `part` is "joint" (exists from flexible_joints on) or "link" (flexible_links only). `motion` names the
    elastic axes of the child frame; if empty, the spring has the motion of `after` itself. `stiffness` [N/m
    or N m/rad] has one entry per axis.
    """

    name: str
    part: str
    after: str
    motion: Names
    stiffness: tuple[float, ...]

    def exists_in(self, flexibility: str) -> bool:
        """Return whether a robot of this flexibility has the spring."""
        least = "flexible_joints" if self.part == "joint" else "flexible_links"
        return FLEXIBILITIES.index(flexibility) >= FLEXIBILITIES.index(least)

    @property
    def coordinates(self) -> Names:
        """Names of the virtual joints, one for each axis."""
        if len(self.motion) <= 1:
            return (self.name,)
        return tuple(f"{self.name}_{axis}" for axis in self.motion)


@dataclass(frozen=True)
class LineSpring:
    """A spring and damper between the origins of two frames, along their line, in every flexibility."""

    between: tuple[str, str]  # two frames
    stiffness: float = 0.0  # [N/m]
    rest: float = 0.0  # [m] length at which the spring exerts no force
    damping: float = 0.0  # [N s/m]
    name: str = ""

    @property
    def label(self) -> str:
        """The name, by default that of both frames."""
        return self.name or "-".join(self.between)


# ------------------------------------------------------------------ levels of fidelity


@dataclass(frozen=True)
class Level:
    """One model of a robot: its bodies with mass, its springs and its geometry."""

    name: str  # in robot files, tables and JSON
    summary: str
    bodies: str = "all"  # that have mass: none, payload or all; rotors always have their inertia
    flexibility: str = "rigid"  # says which springs exist, see FLEXIBILITIES
    geometry: str = "rigid"  # of the robot on which forces are computed: rigid or deformed
    elastic_inertia: bool = True  # whether the rates of deflections cause inertia forces


LEVELS = (
    Level("kinematics", "no body has mass; the motors turn their rotors", bodies="none"),
    Level("payload", "the platform's body has mass, the legs have none", bodies="payload"),
    Level("rigid", "all bodies have mass, nothing gives way"),
    Level("flexible_joints", "the drives give way", flexibility="flexible_joints"),
    Level("flexible_links", "links too; forces of the undeformed robot", flexibility="flexible_links"),
    Level(
        "deformed",
        "forces of the deformed robot, singular where that is",
        flexibility="flexible_links",
        geometry="deformed",
        elastic_inertia=False,
    ),
    Level(
        "elastic_inertia",
        "the bodies feel how the springs move",
        flexibility="flexible_links",
        geometry="deformed",
    ),
)
LEVELS_BY_NAME = {level.name: level for level in LEVELS}


# ------------------------------------------------------------------ joints and loads


@dataclass(frozen=True)
class JointDynamics:
    """Armature, spring, damping and friction along one joint coordinate.

    In addition to the inertia forces of the bodies, moving the joint requires the torque

        armature a + damping v + stiffness (q - rest) + friction sign(v)

    for every flexibility and every choice of motors. Below, the first unit is that of a hinge, the second
    that of a slide.
    """

    armature: float = 0.0  # [kg m^2] or [kg]
    damping: float = 0.0  # [N m s/rad] or [N s/m]
    friction: float = 0.0  # dry [N m] or [N]
    stiffness: float = 0.0  # [N m/rad] or [N/m]
    rest: float = 0.0  # [rad] or [m]

    def reflect_through(self, ratio: float) -> JointDynamics:
        """Return the dynamics along a coordinate x, where q = ratio x by a gear."""
        square = ratio * ratio
        return JointDynamics(
            armature=square * self.armature,
            damping=square * self.damping,
            friction=abs(ratio) * self.friction,
            stiffness=square * self.stiffness,
            rest=self.rest / ratio if self.stiffness else 0.0,
        )

    def __add__(self, other: JointDynamics) -> JointDynamics:
        """Return the sum of two dynamics in parallel.

        One spring stands for both: its torque is the sum of their torques at every position.
        """
        stiffness = self.stiffness + other.stiffness
        torque_at_zero = self.stiffness * self.rest + other.stiffness * other.rest
        return JointDynamics(
            armature=self.armature + other.armature,
            damping=self.damping + other.damping,
            friction=self.friction + other.friction,
            stiffness=stiffness,
            rest=torque_at_zero / stiffness if stiffness else 0.0,
        )


@dataclass(frozen=True)
class Coupling:
    """A loop equation of joints, q_joint = offset + ratio q_of + sum of coefficient times product.

    Each joint has one degree of freedom; all numbers are in the units of the joints [rad, m]. Couplings
    describe gears, mirrored fingers, <mimic>, differentials, and joints that roll on one another.
    """

    joint: str
    of: str
    ratio: float = 1.0
    offset: float = 0.0
    terms: tuple[tuple[Product, float], ...] = ()  # further products of joints, without `joint` itself

    def __post_init__(self) -> None:
        """Refuse coefficients of which powers overflow."""
        largest = max(map(abs, self.equation.values()))
        if not largest <= LARGEST_NUMBER:
            raise RobotFileError(
                f"coupling {self.name}: coefficients must be at most {LARGEST_NUMBER:g} in size, "
                f"got {largest:g}"
            )

    @property
    def name(self) -> str:
        """Name of the loop equation."""
        return f"{self.joint}_of_{self.of}"

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of all joints, without repetitions; the first is `joint`."""
        return tuple(dict.fromkeys([self.joint, self.of, *(name for key, _ in self.terms for name in key)]))

    @property
    def equation(self) -> Polynomial:
        """The polynomial q_joint - ... that vanishes."""
        return {
            (self.joint,): 1.0,
            (self.of,): -self.ratio,
            (): -self.offset,
            **{product: -coefficient for product, coefficient in self.terms},
        }

    @property
    def is_linear(self) -> bool:
        """Whether no term is a product of joints."""
        return all(len(product) == 1 for product, _ in self.terms)

    @staticmethod
    def solve_equation(equation: Polynomial, followers: Iterable[str] = ()) -> Coupling | None:
        """Return the coupling of a polynomial that vanishes, solved for a joint that no product has.

        If there are several, the joint is the first that is none of `followers`, which other couplings solve.
        Without such a joint the result is None.
        """
        terms = {product: coefficient for product, coefficient in equation.items() if coefficient}
        in_products = {name for product in terms if len(product) > 1 for name in product}
        alone = [product[0] for product in terms if len(product) == 1 and product[0] not in in_products]
        if not alone:
            return None
        joint = next((name for name in alone if name not in set(followers)), alone[0])
        scale = -terms.pop((joint,))
        offset = terms.pop((), 0.0) / scale + 0.0  # not -0.0
        of = next((product for product in terms if len(product) == 1), None)
        ratio = terms.pop(of) / scale if of else 0.0
        leader = of or next(iter(terms))
        rest = tuple((product, coefficient / scale) for product, coefficient in terms.items())
        return Coupling(joint, leader[0], ratio, offset, rest)


def lock_couplings(
    couplings: Iterable[Coupling], locked: Mapping[str, float]
) -> tuple[list[Coupling], dict[str, float]]:
    """Return the couplings that remain with joints locked, and positions [rad, m] that others impose.

    Args:
        couplings: those of a mechanism.
        locked: positions [rad, m] of the locked joints, by name.

    Raises:
        RobotFileError: the locked joints leave an equation that is not solved for a joint.
    """
    remaining: list[Coupling] = []
    positions: dict[str, float] = {}
    for coupling in couplings:
        if not locked.keys() & coupling.joints:
            remaining.append(coupling)
            continue
        equation: dict[Product, float] = {(): 0.0}
        for product, coefficient in coupling.equation.items():
            moving = tuple(name for name in product if name not in locked)
            factor = math.prod(locked[name] for name in product if name in locked)
            equation[moving] = equation.get(moving, 0.0) + coefficient * factor
        products = [product for product, coefficient in equation.items() if product and coefficient]
        if len(products) == 1 and len(products[0]) == 1:
            positions[products[0][0]] = -equation[()] / equation[products[0]]
        elif products:
            if (reduced := Coupling.solve_equation(equation)) is None:
                moving = tuple(name for name in coupling.joints if name not in locked)
                raise RobotFileError(
                    f"coupling {coupling.name!r} has no unique solution where {coupling.joint} is locked: "
                    f"lock {' and '.join(moving)}, too"
                )
            remaining.append(reduced)
    return remaining, positions


@dataclass(frozen=True, eq=False)
class FrameWrench(ReadOnlyArrays):
    """An external wrench on the body of one frame, at the origin of the frame.

    `rows` is a constant (force, moment) (6,) [N, N m], or a table (K, 7) of rows (s, force, moment) at
    ascending path coordinates s from 0 to 1. A cubic spline interpolates the table, since elastic robots need
    a continuous second derivative. Through fewer than four rows it is of lower degree.
    """

    frame: str
    rows: Array
    axes: str  # of force and moment: "base", or "tool" for the axes of the frame

    def __call__(self, s: Array) -> Array:
        """Compute the wrench (T, 6) [N, N m] at path coordinates s (T,), along `axes`."""
        if self.rows.ndim == 1:
            return np.broadcast_to(self.rows, (len(s), 6))
        return self._spline(s)

    def times(self, factor: float) -> FrameWrench:
        """Return the wrench multiplied by a `factor`."""
        rows = self.rows.copy()
        rows[..., -6:] *= factor  # force and moment; a row of a table has s before them
        return replace(self, rows=rows)

    @property
    def knots(self) -> Array:
        """Path coordinates in (0, 1) where the third derivative of the wrench jumps."""
        # a spline with not-a-knot ends has no knots at the first two and the last two rows
        return np.empty(0) if self.rows.ndim == 1 else self.rows[2:-2, 0]

    @property
    def turns(self) -> bool:
        """Whether the wrench turns with the frame, on axes of the tool."""
        return self.axes == "tool"

    @property
    def document(self) -> Any:
        """Wrench as written in a robot file or plan.json."""
        numbers = self.rows.tolist()
        return {"wrench": numbers, "axes": self.axes} if self.turns else numbers

    @cached_property
    def _spline(self) -> Any:
        """Cubic spline (s -> (6,)) through the rows of the table, with not-a-knot ends."""
        from scipy.interpolate import CubicSpline

        return CubicSpline(self.rows[:, 0], self.rows[:, 1:])

    @staticmethod
    def of(frame: str, given: Any, where: str = "wrenches") -> FrameWrench:
        """Read a wrench: 6 numbers, a table, or {wrench: ..., axes: base or tool}.

        Args:
            frame: frame of the URDF.
            given: the wrench as in a robot file or a request.
            where: the mapping of wrenches by frame, as messages name it.

        Raises:
            InvalidInput: `given` is none of these, or s does not ascend from 0 to 1.
        """
        name = f"{where}: {frame}"
        axes = "base"
        if isinstance(given, Mapping):
            values = read_table(name, dict(given), _WRENCH_TABLE)
            given, axes = values["wrench"], values["axes"]
        # a wrench is a list of numbers, a table is a list of lists; an array without dimensions is neither
        is_list = isinstance(given, list | tuple | np.ndarray) and np.iterable(given)
        if not (is_list and any(map(np.iterable, given))):
            return FrameWrench(frame, finite_numbers(name, given, 6), axes)
        rows = finite_numbers(f"{name}: each row of the table (s, force, moment)", given, 7, stacks=True)
        s = rows[:, 0]
        if len(s) < 2 or np.any(np.diff(s) <= 0) or s[0] != 0.0 or s[-1] != 1.0:
            raise InvalidInput(f"{name}: s of the rows must ascend from 0 to 1, got {short(s.tolist())}")
        return FrameWrench(frame, rows, axes)


@dataclass(frozen=True)
class KeptLevel:
    """The stored result of a fidelity study: the least level that is enough for a scene.

    `tolerance` is the error that was allowed, as a share of the path's length and of the peak torque.
    """

    level: str
    tolerance: float


@dataclass(frozen=True)
class Scene:
    """A path, a duration [s] and requirements at the crossings.

    `kind` is line, arc, spline or polyline, through `points`; `blend` [m] rounds the corners of a polyline.
    The duration is None where `optimize` is time. `times` [s] and `speeds` [1/s] of the crossings are None
    when left open; empty `times` mean a law without crossing conditions. `at` imposes path coordinates of the
    crossings; without it the singular points are located. `wrenches` are external wrenches by frame, see
    `FrameWrench`. `fidelity` is the result of a fidelity study of the scene.
    """

    name: str
    kind: str
    points: Points
    duration: float | None
    times: tuple[float, ...] | None = None
    speeds: tuple[float, ...] | None = None
    at: tuple[float, ...] | None = None
    wrenches: Mapping[str, Any] | None = None
    fidelity: KeptLevel | None = None
    blend: float | None = None
    optimize: str | None = None


@dataclass(frozen=True)
class RobotDescription:
    """The content of a robot file. `urdf_text` is the URDF of the rigid robot, without springs."""

    name: str
    file: Path
    urdf_text: str = field(repr=False)
    platform: Platform
    actuators: tuple[Actuator, ...]
    closures: tuple[Closure, ...]
    springs: tuple[Spring, ...] = ()
    line_springs: tuple[LineSpring, ...] = ()  # entries of `springs` in the file
    joints: Mapping[str, JointDynamics] = field(default_factory=dict)  # by name of the coordinate
    couplings: tuple[Coupling, ...] = ()
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    reference: Mapping[str, float] = field(default_factory=dict)
    scenes: Mapping[str, Scene] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)  # that fill the placeholders of the file
    left_out: tuple[str, ...] = ()  # effects in a foreign file that the description cannot express

    @property
    def motor_joints(self) -> Names:
        """Names of the joints with a motor."""
        return tuple(actuator.joint for actuator in self.actuators)

    def least_flexibility(self, flexibility: str) -> str:
        """Return the least flexibility that has the same springs as this one.

        Raises:
            InvalidInput: unknown flexibility.
        """
        springs = self.active_springs(flexibility)
        return next(least for least in FLEXIBILITIES if self.active_springs(least) == springs)

    def active_springs(self, flexibility: str) -> tuple[Spring, ...]:
        """Return the springs that exist in a flexibility, in file order.

        Raises:
            InvalidInput: unknown flexibility.
        """
        check_choice("flexibility", flexibility, FLEXIBILITIES)
        return tuple(spring for spring in self.springs if spring.exists_in(flexibility))
