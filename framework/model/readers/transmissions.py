"""Motors that pull at joints, and the joints that they drive once couplings and locks are known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from framework.model.description import Actuator, Coupling
from framework.model.readers.urdf_tree import UrdfTree


class Motor(NamedTuple):
    """A motor, and what it pulls at: joints, each with its share in the angle at the output of the gear."""

    name: str
    shares: Mapping[str, float]
    gear: float = 1.0
    torque_limit: float | None = None  # motor side [N m]

    @classmethod
    def on(cls, joint: str) -> Motor:
        """Return a motor straight on a joint."""
        return cls(joint, {joint: 1.0})


def actuators_of(
    motors: Sequence[Motor], tree: UrdfTree, couplings: Sequence[Coupling]
) -> tuple[list[Actuator], list[str]]:
    """Return the motors that drive one joint that moves, and the names of those that drive several.

    A tendon over joints that couplings make one is a transmission to that one. Of two motors on a joint,
    such as a servo's position and speed, the first is taken.
    """
    actuators: dict[str, Actuator] = {}
    several = []
    for motor in motors:
        shares = shares_of_leaders(motor.shares, tree, couplings)
        if len(shares) > 1:
            several.append(f"motor {motor.name!r}: pulls at {' and '.join(shares)}, which move independently")
        for joint, share in shares.items() if len(shares) == 1 else ():
            gear = abs(motor.gear * share)
            if gear and joint not in actuators:
                actuators[joint] = Actuator(joint, gear, torque_limit=motor.torque_limit)
    return list(actuators.values()), several


def shares_of_leaders(
    shares: Mapping[str, float], tree: UrdfTree, couplings: Sequence[Coupling]
) -> dict[str, float]:
    """Return shares of joints as shares of those that follow no other by a coupling, held ones left out."""
    followed = {coupling.joint: coupling for coupling in couplings}
    leaders: dict[str, float] = {}
    for name, value in shares.items():
        joint, share = name, value
        visited = {joint}
        while joint in followed and followed[joint].of not in visited:
            share *= followed[joint].ratio
            joint = followed[joint].of
            visited.add(joint)
        if tree.joints[joint].moves:
            leaders[joint] = leaders.get(joint, 0.0) + share
    return leaders
