"""The same robot elsewhere, or of another size: descriptions for tests of invariance."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import replace

from framework.model.description import RobotDescription, Scene


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
    offsets = [by_axis.get(axis, 0.0) for axis in description.platform.axes]
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
    turning = [axis.startswith("r") for axis in description.platform.axes]
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


def with_points(scene: Scene, change) -> Scene:
    """The scene with every coordinate k of its points changed."""
    points = tuple(tuple(change(k, value) for k, value in enumerate(point)) for point in scene.points)
    return replace(scene, points=points)
