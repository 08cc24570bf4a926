"""The same robot elsewhere, in other units, mirrored, or written otherwise: for tests of invariance.

Each function takes a description and returns another of a robot that moves alike. Torques on the motors'
side stay what they are, but for `in_other_units`, which multiplies them by mass length^2 / time^2, and
`reversed_joints`, which turns their sign.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pinocchio as pin

from framework.model.description import AXES, Closure, JointDynamics, RobotDescription, Scene

SHIFT = 0.3  # [m]
TURN = np.array([0.5, -0.7, 0.9])  # [rad]
MOVING = ("revolute", "continuous", "prismatic")

# ------------------------------------------------------------------ elsewhere


def moved(description: RobotDescription, shift: tuple[float, float, float]) -> RobotDescription:
    """The robot with its root link mounted `shift` [m] away, its scenes moved along."""
    root = ElementTree.fromstring(description.urdf_text)
    _mount(root, "elsewhere", _base_link(root), pin.SE3(np.eye(3), np.array(shift)), above=True)
    by_axis = dict(zip(("x", "y", "z"), shift, strict=True))
    offsets = [by_axis.get(axis, 0.0) for axis in description.platform.names]
    return replace(
        description,
        urdf_text=ElementTree.tostring(root, encoding="unicode"),
        scenes=_with_points(description, lambda x: x + offsets),
    )


def can_turn(description: RobotDescription, axis: str) -> bool:
    """Whether the platform's axes span the same motions after a turn about the base's `axis`, or any axis."""
    axes = set(description.platform.axes)
    allowed = [set(), {axis}, set("xyz") - {axis}, set("xyz")] if axis != "any" else [set(), set("xyz")]
    slides, turns = ({name[-1] for name in axes if (len(name) == 2) == turning} for turning in (False, True))
    return slides in allowed and turns in allowed and (len(turns) != 2 or not slides)


def turned(description: RobotDescription, rotation: np.ndarray) -> RobotDescription:
    """The robot and gravity turned by R = `rotation` in the base frame, with the axes of its platform.

    With the platform's frame turned back by R', its attitude is R A R', the rotation vector of A turned. So
    points of a path become R p, the vectors of turns likewise.
    """
    root = ElementTree.fromstring(description.urdf_text)
    _mount(root, "elsewhere", _base_link(root), pin.SE3(rotation, np.zeros(3)), above=True)
    platform, names = description.platform, description.platform.names
    if platform.axes:
        _mount(root, "platform_turned_back", platform.frame, pin.SE3(rotation.T, np.zeros(3)))
        platform = replace(platform, frame="platform_turned_back")
    # each coordinate takes its share of the turned vectors; joints as coordinates stay
    change = np.eye(len(names))
    for i, one in enumerate(names if platform.axes else ()):
        for k, other in enumerate(names):
            same_kind = len(one) == len(other)
            change[i, k] = rotation["xyz".index(one[-1]), "xyz".index(other[-1])] if same_kind else 0.0
    return replace(
        description,
        urdf_text=ElementTree.tostring(root, encoding="unicode"),
        platform=platform,
        gravity=tuple(map(float, rotation @ description.gravity)),
        scenes=_with_points(description, lambda x: change @ x),
    )


def mirrored(description: RobotDescription, axis: str) -> RobotDescription:
    """The robot and gravity mirrored in the plane across the base's `axis`; joint coordinates stay."""
    mirror = np.eye(3)
    mirror["xyz".index(axis), "xyz".index(axis)] = -1.0
    root = ElementTree.fromstring(description.urdf_text)
    for origin in [*root.iterfind("joint/origin"), *root.iterfind("link/inertial/origin")]:
        place = _placement(origin)
        _write(origin, pin.SE3(mirror @ place.rotation @ mirror, mirror @ place.translation))
    for element in root.iterfind("link/inertial/inertia"):
        for i, one in enumerate("xyz"):
            for k, other in enumerate("xyz"):
                if f"i{one}{other}" in element.attrib:
                    value = mirror[i, i] * mirror[k, k] * float(element.get(f"i{one}{other}"))
                    element.set(f"i{one}{other}", repr(float(value)))
    for joint in root.iterfind("joint"):
        if joint.get("type") in MOVING:
            sign = 1.0 if joint.get("type") == "prismatic" else -1.0  # a turn is an axial vector
            _write_axis(joint, sign * mirror @ _axis(joint))
    names = description.platform.names
    axial = np.array([len(name) == 2 for name in names])  # turns: their share along the normal stays
    along = np.array([name[-1] == axis for name in names])
    signs = np.where((axial == along) | (not description.platform.axes), 1.0, -1.0)
    return replace(
        description,
        urdf_text=ElementTree.tostring(root, encoding="unicode"),
        gravity=tuple(map(float, mirror @ description.gravity)),
        scenes=_with_points(description, lambda x: signs * x),
    )


# ------------------------------------------------------------------ in other units


def scaled(description: RobotDescription, size: float) -> RobotDescription:
    """The robot `size` times as large, with the same masses, times and angles: torques grow as size^2."""
    return in_other_units(description, length=size)


def in_other_units(
    description: RobotDescription, *, length: float = 1.0, mass: float = 1.0, time: float = 1.0
) -> RobotDescription:
    """The robot whose lengths, masses and times are these multiples: another robot, or other units.

    Every quantity is multiplied by its dimension. Angles stay, and those of the motors of slides, whose gear
    ratio is an angle over a length.
    """
    force = mass * length / time**2
    couple = force * length
    root = ElementTree.fromstring(description.urdf_text)
    for origin in [*root.iterfind("joint/origin"), *root.iterfind("link/inertial/origin")]:
        if origin.get("xyz"):
            _multiply(origin, "xyz", length)
    for element in root.iterfind("link/inertial/mass"):
        _multiply(element, "value", mass)
    for element in root.iterfind("link/inertial/inertia"):
        for key in list(element.attrib):
            _multiply(element, key, mass * length**2)
    slides = {joint.get("name") for joint in root.findall("joint") if joint.get("type") == "prismatic"}
    for joint in root.findall("joint"):
        moved_by, moved_with = (length, force) if joint.get("name") in slides else (1.0, couple)
        sizes = {
            "limit": {
                "lower": moved_by,
                "upper": moved_by,
                "velocity": moved_by / time,
                "effort": moved_with,
            },
            "dynamics": {"damping": moved_with * time / moved_by, "friction": moved_with},
        }
        for tag, factors in sizes.items():
            for element in joint.findall(tag):
                for key in set(factors) & set(element.attrib):
                    _multiply(element, key, factors[key])

    def stiffer(after: str, motion: str | None, stiffness: float) -> float:
        straight = after in slides if motion is None else motion in ("x", "y", "z")
        return stiffness * (force / length if straight else couple)

    springs = tuple(
        replace(
            spring,
            stiffness=tuple(
                stiffer(spring.after, motion, value)
                for motion, value in zip(spring.motion or (None,), spring.stiffness, strict=True)
            ),
        )
        for spring in description.springs
    )
    joints = {
        name: JointDynamics(
            armature=joint.armature * (mass if name in slides else mass * length**2),
            damping=joint.damping * time * stiffer(name, None, 1.0),
            friction=joint.friction * (force if name in slides else couple),
            stiffness=stiffer(name, None, joint.stiffness),
            rest=joint.rest * (length if name in slides else 1.0),
        )
        for name, joint in description.joints.items()
    }
    unit = {str(joint.get("name")): 1.0 for joint in root.findall("joint")} | dict.fromkeys(slides, length)
    couplings = tuple(
        replace(
            one,
            ratio=one.ratio * unit[one.joint] / unit[one.of],
            offset=one.offset * unit[one.joint],
            terms=tuple(
                (product, value * unit[one.joint] / np.prod([unit[joint] for joint in product]))
                for product, value in one.terms
            ),
        )
        for one in description.couplings
    )
    actuators = tuple(
        replace(
            motor,
            gear_ratio=motor.gear_ratio / (length if motor.joint in slides else 1.0),
            rotor_inertia=motor.rotor_inertia * mass * length**2,
            torque_limit=None if motor.torque_limit is None else motor.torque_limit * couple,
            speed_limit=None if motor.speed_limit is None else motor.speed_limit / time,
        )
        for motor in description.actuators
    )
    platform = description.platform
    straight = [name in ("x", "y", "z") for name in platform.axes] or [j in slides for j in platform.joints]
    scenes = {
        name: replace(
            scene,
            duration=scene.duration * time,
            times=None if scene.times is None else tuple(t * time for t in scene.times),
            speeds=None if scene.speeds is None else tuple(speed / time for speed in scene.speeds),
        )
        for name, scene in _with_points(description, lambda x: np.where(straight, length, 1.0) * x).items()
    }
    return replace(
        description,
        urdf_text=ElementTree.tostring(root, encoding="unicode"),
        springs=springs,
        joints=joints,
        couplings=couplings,
        actuators=actuators,
        gravity=tuple(component * length / time**2 for component in description.gravity),
        closures=tuple(
            closure if closure.length is None else replace(closure, length=length * closure.length)
            for closure in description.closures
        ),
        reference={
            joint: value * (length if joint in slides else 1.0)
            for joint, value in description.reference.items()
        },
        scenes=scenes,
    )


# ------------------------------------------------------------------ written otherwise


def reversed_joints(description: RobotDescription) -> RobotDescription:
    """The robot with the axis of every joint turned round: its coordinates and torques change their sign."""
    root = ElementTree.fromstring(description.urdf_text)
    for joint in root.findall("joint"):
        if joint.get("type") in MOVING:
            _write_axis(joint, -_axis(joint))
            for limit in joint.findall("limit"):
                ends = [limit.get(key) for key in ("lower", "upper")]
                for key, value in zip(("upper", "lower"), ends, strict=True):
                    if value is not None:
                        limit.set(key, repr(-float(value)))
    coordinates = bool(description.platform.joints)
    return replace(
        description,
        urdf_text=ElementTree.tostring(root, encoding="unicode"),
        reference={joint: -value for joint, value in description.reference.items()},
        joints={name: replace(joint, rest=-joint.rest) for name, joint in description.joints.items()},
        couplings=tuple(
            replace(
                one,
                offset=-one.offset,
                terms=tuple((product, -value * (-1.0) ** len(product)) for product, value in one.terms),
            )
            for one in description.couplings
        ),
        scenes=_with_points(description, lambda x: -x if coordinates else x),
    )


def permuted_joints(description: RobotDescription, rng: np.random.Generator) -> RobotDescription:
    """The robot with other names for its joints: the parser takes the children of a link by name."""
    root = ElementTree.fromstring(description.urdf_text)
    joints = root.findall("joint")
    names = {
        str(joint.get("name")): f"j{k}_{joint.get('name')}"
        for joint, k in zip(joints, rng.permutation(len(joints)) + 100, strict=True)
    }
    for joint in joints:
        joint.set("name", names[str(joint.get("name"))])
        for mimic in joint.findall("mimic"):
            mimic.set("joint", names[str(mimic.get("joint"))])
    links = {link.get("name") for link in root.findall("link")}

    def frame(name: str) -> str:
        return name if name in links else names.get(name, name)

    platform = description.platform
    return replace(
        description,
        urdf_text=ElementTree.tostring(root, encoding="unicode"),
        platform=replace(
            platform, frame=frame(platform.frame), joints=tuple(names[joint] for joint in platform.joints)
        ),
        actuators=tuple(replace(motor, joint=names[motor.joint]) for motor in description.actuators),
        closures=tuple(
            replace(closure, frames=tuple(map(frame, closure.frames))) for closure in description.closures
        ),
        springs=tuple(replace(spring, after=names[spring.after]) for spring in description.springs),
        joints={names[name]: joint for name, joint in description.joints.items()},
        couplings=tuple(
            replace(
                one,
                joint=names[one.joint],
                of=names[one.of],
                terms=tuple(
                    (tuple(names[joint] for joint in product), value) for product, value in one.terms
                ),
            )
            for one in description.couplings
        ),
        reference={names[joint]: value for joint, value in description.reference.items()},
    )


def is_universal(closure: Closure) -> bool:
    """Whether a closure has one axis on either body: turned round it is another joint."""
    return sum(axis.startswith("r") for axis in closure.axes) == 1


def swapped_frames(description: RobotDescription) -> RobotDescription:
    """The robot with the two bodies of each closure named in the other order."""
    closures = tuple(
        c if is_universal(c) else replace(c, frames=c.frames[::-1]) for c in description.closures
    )
    return replace(description, closures=closures)


def with_other_frames(description: RobotDescription) -> RobotDescription:
    """The robot with every closure written on frames turned, and shifted where its kind allows.

    A ball takes any axes, a weld any frame; a hinge may be turned about and shifted along its axis. The
    rows come out mixed: combinations of the old ones, those of a weld and a hinge with a length between
    metres and radians. Bodies and joints stay.
    """
    root = ElementTree.fromstring(description.urdf_text)
    closures = []
    for closure in description.closures:
        place = _other_place(closure)
        names = tuple(f"{closure.name}_{k}" for k in "ab")
        for frame, name in zip(closure.frames, names, strict=True):
            _mount(root, name, frame, place)
        closures.append(replace(closure, frames=names))
    text = ElementTree.tostring(root, encoding="unicode")
    return replace(description, urdf_text=text, closures=tuple(closures))


def _other_place(closure: Closure) -> pin.SE3:
    """The new frame in the old one, the same on both bodies: where the loop is closed they coincide."""
    locked = set(closure.axes)
    anyhow = pin.exp3(TURN)
    if locked == set(AXES):
        return pin.SE3(anyhow, SHIFT * np.ones(3))
    if locked == {"x", "y", "z"} or closure.length is not None:
        return pin.SE3(anyhow, np.zeros(3))
    free = set(AXES) - locked
    if len(free) == 1 and min(free).startswith("r"):
        axis = np.eye(3)["xyz".index(min(free)[1])]
        return pin.SE3(pin.exp3(0.7 * axis), SHIFT * axis)
    return pin.SE3.Identity()  # a kind whose axes are part of its meaning


# ------------------------------------------------------------------ elements of a URDF


def _base_link(root: ElementTree.Element) -> str:
    """The link that is the child of no joint."""
    children = {child.get("link") for child in root.iter("child")}
    (base,) = (link.get("name") for link in root.findall("link") if link.get("name") not in children)
    return str(base)


def _mount(root: ElementTree.Element, name: str, link: str, place: pin.SE3, *, above: bool = False) -> None:
    """Add a link `name` fixed to a link at this place, or, `above`, that carries the link there."""
    carried_by = {joint.get("name"): joint.find("child").get("link") for joint in root.findall("joint")}
    link = link if any(link == one.get("name") for one in root.findall("link")) else carried_by[link]
    ElementTree.SubElement(root, "link", name=name)
    joint = ElementTree.SubElement(root, "joint", name=f"mount_{name}", type="fixed")
    ElementTree.SubElement(joint, "parent", link=name if above else link)
    ElementTree.SubElement(joint, "child", link=link if above else name)
    _write(ElementTree.SubElement(joint, "origin"), place)


def _placement(origin: ElementTree.Element) -> pin.SE3:
    xyz, rpy = (np.array((origin.get(key) or "0 0 0").split(), dtype=float) for key in ("xyz", "rpy"))
    return pin.SE3(pin.rpy.rpyToMatrix(*rpy), xyz)


def _write(origin: ElementTree.Element, place: pin.SE3) -> None:
    origin.set("xyz", _text(place.translation))
    origin.set("rpy", _text(pin.rpy.matrixToRpy(place.rotation)))


def _axis(joint: ElementTree.Element) -> np.ndarray:
    element = joint.find("axis")
    return np.array(("1 0 0" if element is None else element.get("xyz")).split(), dtype=float)


def _write_axis(joint: ElementTree.Element, axis: np.ndarray) -> None:
    element = joint.find("axis")
    if element is None:
        element = ElementTree.SubElement(joint, "axis")
    element.set("xyz", _text(axis))


def _multiply(element: ElementTree.Element, key: str, factor: float) -> None:
    element.set(key, _text(factor * np.array(element.get(key).split(), dtype=float)))


def _text(values: np.ndarray) -> str:
    return " ".join(repr(float(value)) for value in values)


def _with_points(
    description: RobotDescription, change: Callable[[np.ndarray], np.ndarray]
) -> Mapping[str, Scene]:
    """The scenes with every point of their paths changed."""
    return {
        name: replace(
            scene, points=tuple(tuple(map(float, change(np.array(point)))) for point in scene.points)
        )
        for name, scene in description.scenes.items()
    }
