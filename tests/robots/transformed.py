"""The same robot elsewhere, of another size, or written on other frames: for tests of invariance."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import numpy as np
import pinocchio as pin

from framework.model.description import AXES, Closure, RobotDescription, Scene

SHIFT = 0.3  # [m]
TURN = np.array([0.5, -0.7, 0.9])  # [rad]


def moved(description: RobotDescription, shift: tuple[float, float, float]) -> RobotDescription:
    """The robot with its root link mounted `shift` [m] away, its scenes moved along."""
    root = ElementTree.fromstring(description.urdf_text)
    children = {child.get("link") for child in root.iter("child")}
    (base,) = (link.get("name") for link in root.findall("link") if link.get("name") not in children)
    ElementTree.SubElement(root, "link", name="elsewhere")
    joint = ElementTree.SubElement(root, "joint", name="mount_elsewhere", type="fixed")
    ElementTree.SubElement(joint, "parent", link="elsewhere")
    ElementTree.SubElement(joint, "child", link=base)
    ElementTree.SubElement(joint, "origin", xyz=" ".join(map(repr, shift)))
    by_axis = dict(zip(("x", "y", "z"), shift, strict=True))
    offsets = [by_axis.get(axis, 0.0) for axis in description.platform.axes or description.platform.joints]
    scenes = {
        name: with_points(scene, lambda k, value: value + offsets[k])
        for name, scene in description.scenes.items()
    }
    text = ElementTree.tostring(root, encoding="unicode")
    return replace(description, urdf_text=text, scenes=scenes)


def scaled(description: RobotDescription, size: float) -> RobotDescription:
    """The robot `size` times as large, with the same masses, times and angles.

    Lengths and gravity grow as size, moments of inertia and torsional stiffnesses as size^2, linear
    stiffnesses not at all; a sliding motor turns as far as before. Then all motor torques grow as size^2.
    """
    root = ElementTree.fromstring(description.urdf_text)
    for origin in [*root.iterfind("joint/origin"), *root.iterfind("link/inertial/origin")]:
        if origin.get("xyz"):
            origin.set("xyz", " ".join(repr(size * float(part)) for part in origin.get("xyz").split()))
    for inertia in root.iterfind("link/inertial/inertia"):
        for key in list(inertia.attrib):
            inertia.set(key, repr(size**2 * float(inertia.get(key))))
    kinds = {joint.get("name"): joint.get("type") for joint in root.findall("joint")}

    def slides(joint: str) -> bool:
        return kinds[joint] == "prismatic"

    springs = tuple(
        replace(
            spring,
            stiffness=tuple(
                stiffness
                if (slides(spring.after) if axis is None else axis in "xyz")
                else size**2 * stiffness
                for axis, stiffness in zip(spring.motion or (None,), spring.stiffness, strict=True)
            ),
        )
        for spring in description.springs
    )
    actuators = tuple(
        replace(
            actuator,
            gear_ratio=actuator.gear_ratio / size if slides(actuator.joint) else actuator.gear_ratio,
            rotor_inertia=size**2 * actuator.rotor_inertia,
        )
        for actuator in description.actuators
    )
    platform = description.platform
    turning = [axis.startswith("r") for axis in platform.axes] or [not slides(j) for j in platform.joints]
    return replace(
        description,
        urdf_text=ElementTree.tostring(root, encoding="unicode"),
        springs=springs,
        joint_springs=tuple(
            spring if slides(spring.joint) else replace(spring, stiffness=size**2 * spring.stiffness)
            for spring in description.joint_springs
        ),
        actuators=actuators,
        gravity=tuple(size * component for component in description.gravity),
        closures=tuple(
            closure if closure.length is None else replace(closure, length=size * closure.length)
            for closure in description.closures
        ),
        reference={
            joint: size * value if slides(joint) else value for joint, value in description.reference.items()
        },
        scenes={
            name: with_points(scene, lambda k, value: value if turning[k] else size * value)
            for name, scene in description.scenes.items()
        },
    )


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
            ElementTree.SubElement(root, "link", name=name)
            joint = ElementTree.SubElement(root, "joint", name=f"{name}_mount", type="fixed")
            ElementTree.SubElement(joint, "parent", link=frame)
            ElementTree.SubElement(joint, "child", link=name)
            xyz, rpy = place.translation, pin.rpy.matrixToRpy(place.rotation)
            written = {"xyz": xyz, "rpy": rpy}
            ElementTree.SubElement(
                joint,
                "origin",
                {key: " ".join(repr(float(v)) for v in part) for key, part in written.items()},
            )
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


def with_points(scene: Scene, change) -> Scene:
    """The scene with every coordinate k of its points changed."""
    points = tuple(tuple(change(k, value) for k, value in enumerate(point)) for point in scene.points)
    return replace(scene, points=points)
