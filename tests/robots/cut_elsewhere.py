"""The same mechanism with a loop opened at another joint: descriptions for a test of invariance.

A closure becomes a chain of real joints with the freedoms that it leaves, and a joint of its loop becomes
a closure. The part of the tree beyond that joint then hangs from the other side: its joints are walked
the other way round. A joint with origin T and axis a, child = parent T exp(a q), is walked back by

    parent = child exp(-a q) T^-1

a joint of axis -a in the child's own frame, so that its coordinate keeps its sign, and behind it the
constant T^-1. All links keep their frames, hence their inertias and all that hangs on them.
"""

import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import numpy as np
import pinocchio as pin

from framework import ParallelRobot
from framework.model.description import Closure, RobotDescription, Spring, locked_axes
from tests.oracles.joint_chain import Edge, along_z, chain, fixed, urdf
from tests.oracles.placements import placements


def openings(description: RobotDescription, closure: Closure) -> list[str]:
    """Joints of a closure's loop at which it can be opened instead, those farthest from the closure first.

    Passive joints that no spring drives and that are not the platform; if there is none, rigid connections
    between two links: there a body is cut in two.
    """
    edges = _edges(description)
    above = {edge.child: edge for edge in edges}
    branches = [_up(above, _link(edges, frame)) for frame in closure.frames]
    ring = [
        (depth, edge)
        for one, other in (branches, branches[::-1])
        for depth, edge in enumerate(one)
        if edge not in other
    ]
    kept = {actuator.joint for actuator in description.actuators} | {*description.platform.joints}
    kept |= {spring.after for spring in description.springs}
    kept |= {*description.joints}
    free = sorted((edge.kind == "fixed", -depth, edge.name) for depth, edge in ring if edge.name not in kept)
    return [name for is_fixed, _, name in free if is_fixed == free[0][0]]


def cut_elsewhere(description: RobotDescription, closure: Closure, opening: str) -> RobotDescription:
    """The robot with `closure` a chain of joints and the joint `opening` of its loop a closure.

    Raises:
        ValueError: the joint is not on the loop; or springs behind a joint that is walked the other way
            round stand in an order that cannot be turned.
    """
    edges = _edges(description)
    (opened,) = (edge for edge in edges if edge.name == opening)
    ends = [_link(edges, frame) for frame in closure.frames]
    joints, start = chain(closure, *ends, _between(description, *ends))
    seat, journal = f"{opening}_seat", f"{opening}_journal"
    straight = along_z(opened.axis)
    graph = [edge for edge in edges if edge is not opened]
    graph += [
        *joints,
        fixed(f"{seat}_mount", opened.parent, seat, opened.origin * straight),
        fixed(f"{journal}_mount", opened.child, journal, straight),
    ]
    (root,) = {edge.parent for edge in edges} - {edge.child for edge in edges}
    tree, turned = _walk(graph, root)
    springs = list(description.springs)
    for edge in turned:
        behind = [spring for spring in description.springs if spring.after == edge.name]
        back, behind_back = _turned(edge, behind)
        tree += back
        springs = [*(spring for spring in springs if spring not in behind), *behind_back]
    used = {description.platform.frame, *(frame for c in description.closures for frame in c.frames)}
    if lost := used & {edge.name for edge in turned} - {edge.child for edge in edges}:
        raise ValueError(f"{description.name}: frames named by joints that are walked back: {lost}")
    kind = opened.kind if opened.kind in ("prismatic", "fixed") else "revolute"
    closures = [c for c in description.closures if c != closure]
    return replace(
        description,
        urdf_text=urdf(description.urdf_text, tree),
        closures=(*closures, Closure(f"{opening}_opened", (seat, journal), locked_axes(kind))),
        springs=tuple(springs),
        reference={k: value for k, value in (_reference(description) | start).items() if k != opening},
    )


def _edges(description: RobotDescription) -> list[Edge]:
    root = ElementTree.fromstring(description.urdf_text)
    edges = []
    for element in root.findall("joint"):
        ends = [element.find(end).get("link") for end in ("parent", "child")]
        origin, axis = element.find("origin"), element.find("axis")
        place = {"xyz": "0 0 0", "rpy": "0 0 0", **(origin.attrib if origin is not None else {})}
        xyz, rpy = (np.array(place[key].split(), float) for key in ("xyz", "rpy"))
        along = np.array((axis.get("xyz") if axis is not None else "1 0 0").split(), float)
        where = pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)
        edges.append(Edge(element.get("name"), element.get("type"), *ends, where, along, element))
    return edges


def _link(edges: list[Edge], frame: str) -> str:
    """The link of a frame; that of a joint is its child."""
    links = {link for edge in edges for link in (edge.parent, edge.child)}
    return frame if frame in links else next(edge.child for edge in edges if edge.name == frame)


def _up(above: dict[str, Edge], link: str) -> list[Edge]:
    """Joints from a link to the root."""
    path = []
    while link in above:
        path.append(above[link])
        link = above[link].parent
    return path


def _reference(description: RobotDescription) -> dict[str, float]:
    """The assembled reference, all joints."""
    robot = ParallelRobot.from_description(description)
    q = robot.reference.q
    return {robot.coordinates.name_of(column): float(q[column]) for column in range(robot.model.nv)}


def _between(description: RobotDescription, first: str, second: str) -> pin.SE3:
    """Pose of the second link in the first at the assembled reference."""
    robot = ParallelRobot.from_description(description)
    one, two = placements(robot.model, (first, second), robot.reference.q)
    return one.actInv(two)


def _walk(graph: list[Edge], root: str) -> tuple[list[Edge], list[Edge]]:
    """Joints walked from parent to child, and those walked back, on the way out from the root."""
    reached, forward, turned, left = {root}, [], [], list(graph)
    while left:
        ready = [edge for edge in left if (edge.parent in reached) != (edge.child in reached)]
        if not ready:
            raise ValueError("the joint to open is not on the loop of the closure")
        edge = ready[0]
        (forward if edge.parent in reached else turned).append(edge)
        reached |= {edge.parent, edge.child}
        left.remove(edge)
    return forward, turned


def _turned(edge: Edge, springs: list[Spring]) -> tuple[list[Edge], list[Spring]]:
    """A joint walked from child to parent, and the springs behind it.

    Springs with a motion of their own stand beyond the joint and its drive: walked back they come first,
    behind a rigid connection made for them, their axes in opposite order; what was a stretch of +1 mm
    between the two bodies is now -1 mm, with the same force.
    """
    own = [spring for spring in springs if not spring.motion]
    bending = [spring for spring in springs if spring.motion]
    if springs != [*own, *bending]:
        raise ValueError(f"{edge.name}: a drive's spring stands beyond another spring")
    here, joints, after = edge.child, [], edge.name
    if bending and edge.kind != "fixed":
        after = f"{edge.name}_before"
        here = f"{after}_link"
        joints = [fixed(after, edge.child, here, pin.SE3.Identity())]
    back = [
        replace(spring, after=after, motion=spring.motion[::-1], stiffness=spring.stiffness[::-1])
        for spring in bending[::-1]
    ]
    turned = f"{edge.parent}_turned"
    joints.append(replace(edge, parent=here, child=turned, origin=pin.SE3.Identity(), axis=-edge.axis))
    joints.append(fixed(f"{turned}_back", turned, edge.parent, edge.origin.inverse()))
    return joints, [*own, *back]
