"""The content of a robot file, as frozen records. No file is read and no pinocchio called here."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element

from framework.errors import RobotFileError, check_choice, check_name
from framework.numerics.arrays import Names

# Each has the springs of its predecessors; a spring exists from some level on, see `Spring.exists_in`.
FLEXIBILITIES = ("rigid", "flexible_joints", "flexible_links")
GOALS = ("time", "peak_torque", "energy")  # of an optimal law
SMALLEST_LENGTH = 1e-30  # [m] powers of others vanish
AXES = ("x", "y", "z", "rx", "ry", "rz")

# Locked axes of each closure kind whose axis is z, in the frame of the first body; or rows that need the
# closure's `length`, by their names in `loop_rows.ROW_KINDS`.
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
    """Return the locked axes of a closure kind, in the first body's frame.

    Rows that need a length, such as distance, come last. `axis` in {x, y, z} is the axis of the joint; the
    kinds are tabled for z and turned cyclically.

    Raises:
        RobotFileError: unknown kind or axis.
    """
    check_name("kind", "closure kind", kind, _LOCKED)
    check_name("axis", "closure axis", axis, tuple("xyz"))
    turn = {"x": "yzx", "y": "zxy", "z": "xyz"}[axis]  # where x, y, z go when z goes to `axis`
    axes = {name[:-1] + turn["xyz".index(name[-1])] for name in _LOCKED[kind] if name in AXES}
    with_length = (name for name in _LOCKED[kind] if name not in AXES)
    return (*(name for name in AXES if name in axes), *with_length)


def kinds_with_length() -> Names:
    """Return the closure kinds that need a length."""
    return tuple(kind for kind, axes in _LOCKED.items() if not set(axes) <= set(AXES))


@dataclass(frozen=True)
class Platform:
    """The prescribed motion: of a frame on base axes, or of joints.

    Of two turns the order counts, see `framework.kinematics.attitude`.
    """

    frame: str
    axes: Names = ()
    joints: Names = ()  # instead of axes; the frame is then only drawn

    @property
    def names(self) -> Names:
        """Names of the coordinates."""
        return self.joints or self.axes


@dataclass(frozen=True)
class Actuator:
    """A motor on a URDF joint.

    `rotor_inertia` [kg m^2] and the limits [N m], [rad/s] are on the motor side of the gear, whose
    ratio is motor angle over joint angle.
    """

    joint: str
    gear_ratio: float = 1.0
    rotor_inertia: float = 0.0
    torque_limit: float | None = None
    speed_limit: float | None = None


@dataclass(frozen=True)
class Closure:
    """Two frames and the axes of their relative pose, in the first frame, that are locked.

    Among the axes a name of `loop_rows.ROW_KINDS`, such as "distance", is a row that needs `length` [m].
    """

    name: str
    frames: tuple[str, str]
    axes: Names
    length: float | None = None

    def __post_init__(self) -> None:
        """Refuse unknown rows, and a length missing or without a use."""
        valid = {row for rows in _LOCKED.values() for row in rows}
        for row in self.axes:
            check_name(f"closure {self.name}", "axis", row, valid)
        if (set(self.axes) <= set(AXES)) != (self.length is None):
            raise RobotFileError(
                f"closure {self.name}: a length goes with rows such as distance, and with no others, "
                f"got axes {list(self.axes)} and length {self.length}"
            )


@dataclass(frozen=True)
class Spring:
    """A virtual joint in series behind the URDF joint `after`.

    `part` is "joint" (exists from flexible_joints on) or "link" (flexible_links only). `motion` holds
    the axes of the child frame that give way, or is empty for the motion of `after` itself.
    `stiffness` [N/m or N m/rad] has one entry an axis.
    """

    name: str
    part: str
    after: str
    motion: Names
    stiffness: tuple[float, ...]

    def exists_in(self, flexibility: str) -> bool:
        """Return whether a robot of this flexibility has the spring."""
        first = "flexible_joints" if self.part == "joint" else "flexible_links"
        return FLEXIBILITIES.index(flexibility) >= FLEXIBILITIES.index(first)

    @property
    def coordinates(self) -> Names:
        """Names of its virtual joints, one for each axis."""
        if len(self.motion) <= 1:
            return (self.name,)
        return tuple(f"{self.name}_{axis}" for axis in self.motion)


@dataclass(frozen=True)
class JointDynamics:
    """Armature, spring, damping and friction along one joint coordinate.

        torque of the joint = armature a + damping v + stiffness (q - rest) + friction sign(v)

    beside the inertia of the bodies, for a hinge [kg m^2, N m s/rad, N m/rad, rad, N m] and for a slide
    [kg, N s/m, N/m, m, N]. It is there for every flexibility and whichever motors are chosen.
    """

    armature: float = 0.0
    damping: float = 0.0
    friction: float = 0.0  # dry
    stiffness: float = 0.0
    rest: float = 0.0

    def reflect_through(self, ratio: float) -> JointDynamics:
        """Reflect the dynamics through a gear, onto x with q = ratio x."""
        square, rest = ratio * ratio, self.rest / ratio if self.stiffness else 0.0
        friction = abs(ratio) * self.friction
        return JointDynamics(
            square * self.armature, square * self.damping, friction, square * self.stiffness, rest
        )

    def __add__(self, other: JointDynamics) -> JointDynamics:
        """Return the dynamics of two in parallel, their springs as one."""
        stiffness = self.stiffness + other.stiffness
        moment = self.stiffness * self.rest + other.stiffness * other.rest
        return JointDynamics(
            self.armature + other.armature,
            self.damping + other.damping,
            self.friction + other.friction,
            stiffness,
            moment / stiffness if stiffness else 0.0,
        )


@dataclass(frozen=True)
class Coupling:
    """A loop equation q_joint = ratio q_of + offset of two joints.

    Each joint has one degree of freedom; `ratio` and `offset` are in the units of the joints [rad, m]. Gears,
    mirrored fingers, <mimic>.
    """

    joint: str
    of: str
    ratio: float = 1.0
    offset: float = 0.0

    @property
    def name(self) -> str:
        """Name of its loop equation."""
        return f"{self.joint}_of_{self.of}"


def locked_through_couplings(couplings: Iterable[Coupling], locked: Mapping[str, float]) -> dict[str, float]:
    """Return the joints that locked ones lock through couplings, with values [rad, m]."""
    further = {}
    for coupling in couplings:
        if coupling.of in locked and coupling.joint not in locked:
            further[coupling.joint] = coupling.ratio * locked[coupling.of] + coupling.offset
        elif coupling.joint in locked and coupling.of not in locked and coupling.ratio:
            further[coupling.of] = (locked[coupling.joint] - coupling.offset) / coupling.ratio
    return further


@dataclass(frozen=True)
class KeptLevel:
    """The stored result of a fidelity study: a scene's least sufficient level.

    `tolerance` is relative to the largest torque.
    """

    level: str
    tolerance: float


@dataclass(frozen=True)
class Scene:
    """A path, a duration [s] and requirements at the crossings.

    `kind` is line, arc, spline or polyline (with the `blend` of its corners), through `points`. The duration
    is None where `optimize` is time. `times` [s] and `speeds` [1/s] are None when left
    open; empty `times` mean a law without crossing conditions. `at` imposes path coordinates
    instead of locating the singular points. `wrenches` of the world are by frame, see `FrameWrench`.
    `fidelity` is the result of a study of the scene.
    """

    name: str
    kind: str
    points: tuple[tuple[float, ...], ...]
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
    """The content of a robot file. `urdf_text` is the untouched URDF, i.e. the rigid robot."""

    name: str
    file: Path
    urdf_text: str = field(repr=False)
    platform: Platform
    actuators: tuple[Actuator, ...]
    closures: tuple[Closure, ...]
    springs: tuple[Spring, ...] = ()
    joints: Mapping[str, JointDynamics] = field(default_factory=dict)  # by coordinate
    couplings: tuple[Coupling, ...] = ()
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    reference: Mapping[str, float] = field(default_factory=dict)
    scenes: Mapping[str, Scene] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)  # values of its file's placeholders
    left_out: tuple[str, ...] = ()  # effects in the file that it was converted from, and not in this one

    @property
    def motor_joints(self) -> Names:
        """Names of the joints with a motor."""
        return tuple(actuator.joint for actuator in self.actuators)

    def least_flexibility(self, flexibility: str) -> str:
        """Return the least flexibility with the springs of this one.

        Raises:
            InvalidInput: unknown flexibility.
        """
        springs = self.active_springs(flexibility)
        return next(least for least in FLEXIBILITIES if self.active_springs(least) == springs)

    def active_springs(self, flexibility: str) -> tuple[Spring, ...]:
        """Return the springs of one flexibility, in file order.

        Raises:
            InvalidInput: unknown flexibility.
        """
        check_choice("flexibility", flexibility, FLEXIBILITIES)
        return tuple(spring for spring in self.springs if spring.exists_in(flexibility))


class ParsedRobot(NamedTuple):
    """The content of a file of any dialect.

    `urdf` is the root of `description.urdf_text`, parsed once and not to be changed; `dialect` is one of
    `readers.recognise.DIALECTS`; `remarks` report proposals for a foreign file.
    """

    description: RobotDescription
    urdf: Element
    dialect: str = "robot file"
    remarks: tuple[str, ...] = ()
