"""Remarks on values that seem to be in another unit: points in mm, angles in degrees, sizes, masses."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from framework.errors import point
from framework.kinematics.mechanism import Mechanism, velocity_columns
from framework.numerics.arrays import Array

# Beyond these values the unit of a part is doubted.
LIGHT_PART_RATIO = 1e-6  # mass of a part divided by that of the heaviest part
HEAVY_PART = 1e5  # [kg]
SMALL_LINK, LARGE_LINK = 1e-3, 20.0  # [m] length of the longest link
GYRATION_RATIO = 5.0  # radius of gyration divided by the size of a part; at most 2.4 in the catalogue
SMALL_PART_RATIO = 0.2  # least size assumed for a part, as share of the longest link: it may lack frames


def remark_on_turns(mechanism: Mechanism, positions: Mapping[str, float]) -> str:
    """Return a remark on hinges whose `positions` by name exceed a full turn; empty without any."""
    turns = []
    columns = velocity_columns(mechanism.model, positions)
    for sliding, (joint, angle) in zip(mechanism.sliding[columns], positions.items(), strict=True):
        count = abs(angle) / (2.0 * np.pi)
        if count > 1.0 and not sliding:
            turns.append(f"{joint} at {angle:g} rad is {count:.3g} turns")
    return f"; angles are in rad: {', '.join(turns)}" if turns else ""


def longest_reach(robot: Mechanism) -> float:
    """Compute the summed length [m] of the links from base to platform.

    Slides are at the far end of their range, springs at rest. A slide without limits, such as those of a
    floating joint, makes the length practically infinite.
    """
    model = robot.model
    frame = model.frames[model.getFrameId(robot.description.platform.frame)]
    reach = float(np.linalg.norm(frame.placement.translation))
    for k in list(model.supports[frame.parentJoint])[1:]:  # the joints from the base, without the world
        joint = model.joints[k]
        reach += float(np.linalg.norm(model.jointPlacements[k].translation))
        if robot.sliding[joint.idx_v] and joint.idx_v not in robot.elastic:
            ends = model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q]
            reach += float(np.abs(ends).max())
    return reach


def remark_on_reach(robot: Mechanism, position: Array) -> str:
    """Return a remark on a platform out of reach of the links; empty if within reach.

    `position` has the prescribed translations of the platform's origin [m].
    """
    distance, reach = float(np.linalg.norm(position)), longest_reach(robot)
    if distance <= reach:
        return ""
    return (
        f"; points are in m: {point(position)} is {distance:.4g} m from the base, "
        f"{distance / robot.length:.3g} times the size of the robot, and its links in one line reach "
        f"{reach:.3g} m"
    )


def remarks_on_bodies(robot: Mechanism) -> Iterator[str]:
    """Yield remarks on bodies whose sizes, masses or inertias suggest another unit."""
    bodies = moving_bodies(robot)
    longest = max((body.size for body in bodies.values()), default=1.0)  # 0 if only slides move
    if longest and not SMALL_LINK < longest < LARGE_LINK:
        yield (f"the longest link measures {longest:.3g} m: lengths are in m; check the URDF's unit")
    for name, body in bodies.items():
        assumed_size = max(body.size, SMALL_PART_RATIO * longest)
        if longest and body.gyration > GYRATION_RATIO * assumed_size:
            yield (
                f"what {name} carries has a radius of gyration of {body.gyration:.3g} m, and measures some "
                f"{body.size:.2g} m: inertias are in kg m^2; check the URDF's <inertia>"
            )

    heaviest = max((body.mass for body in bodies.values()), default=0.0)
    if heaviest == 0.0:
        yield ("no link has a mass: all torques will be those of the rotors; add <inertial>")
    for name, body in bodies.items():
        if 0 < body.mass < LIGHT_PART_RATIO * heaviest:
            yield (
                f"what {name} carries weighs {body.mass:g} kg, a millionth of the heaviest part: is it in "
                f"the wrong unit? Leave <inertial> out for a massless part"
            )
    if heaviest > HEAVY_PART:
        yield (f"a part weighs {heaviest:g} kg: masses are in kg; check the URDF's unit")


class _Body(NamedTuple):
    """The body that a joint moves."""

    mass: float  # [kg]
    gyration: float  # [m] largest radius of gyration about the centre of mass
    size: float  # [m] largest distance of its frames and its centre of mass from the joint


def moving_bodies(robot: Mechanism) -> dict[str, _Body]:
    """Compute mass, radius of gyration and size of the bodies that joints move, by joint name."""
    if robot.n_e:  # springs would separate joints from the masses that they move
        robot = Mechanism.from_description(robot.description)
    model = robot.model
    bodies = {}
    for j in range(1, model.njoints):
        inertia = model.inertias[j]
        largest_moment = max(np.linalg.eigvalsh(inertia.inertia)[-1], 0.0)
        gyration = np.sqrt(largest_moment / inertia.mass) if inertia.mass > 0.0 else 0.0
        placements = [frame.placement for frame in model.frames if frame.parentJoint == j]
        placements += [model.jointPlacements[child] for child in model.children[j]]
        points = [inertia.lever, *(placement.translation for placement in placements)]
        size = max(float(np.linalg.norm(point)) for point in points)
        bodies[model.names[j]] = _Body(inertia.mass, gyration, size)
    return bodies
