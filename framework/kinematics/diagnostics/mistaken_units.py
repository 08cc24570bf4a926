"""Remarks on bodies whose sizes, masses or inertias seem to be in another unit."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from framework.kinematics.mechanism import Mechanism


class _Body(NamedTuple):
    """The body that a joint moves."""

    mass: float  # [kg]
    gyration: float  # [m] largest radius of gyration about the centre of mass
    size: float  # [m] largest distance of its frames and its centre of mass from the joint


def remarks_on_bodies(robot: Mechanism) -> Iterator[str]:
    """Yield remarks on bodies whose sizes, masses or inertias suggest another unit."""
    small_link = 1e-3  # [m] length of the longest link, below which its unit is doubted
    large_link = 20.0  # [m] the same, above which it is doubted
    gyration_ratio = 5.0  # radius of gyration over the size of a part; at most 2.4 in the catalogue
    small_part = 0.2  # least size assumed for a part, over the longest link: it may lack frames
    light_part = 1e-6  # mass of a part over that of the heaviest part
    heavy_part = 1e5  # [kg]
    bodies = moving_bodies(robot)
    longest = max((body.size for body in bodies.values()), default=1.0)  # 0 if only slides move
    if longest and not small_link < longest < large_link:
        yield f"the longest link measures {longest:.3g} m: lengths are in m; check the URDF's unit"
    for name, body in bodies.items():
        assumed_size = max(body.size, small_part * longest)
        if longest and body.gyration > gyration_ratio * assumed_size:
            yield (
                f"what {name} carries has a radius of gyration of {body.gyration:.3g} m, and measures some "
                f"{body.size:.2g} m: inertias are in kg m^2; check the URDF's <inertia>"
            )
    heaviest = max((body.mass for body in bodies.values()), default=0.0)
    if heaviest == 0.0:
        yield "no link has a mass: all torques will be those of the rotors; add <inertial>"
    for name, body in bodies.items():
        if 0 < body.mass < light_part * heaviest:
            yield (
                f"what {name} carries weighs {body.mass:g} kg, a millionth of the heaviest part: is it in "
                f"the wrong unit? Leave <inertial> out for a massless part"
            )
    if heaviest > heavy_part:
        yield f"a part weighs {heaviest:g} kg: masses are in kg; check the URDF's unit"


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
