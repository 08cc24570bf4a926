"""Motors that pull at joints, and the joints that they drive once couplings and locks are known."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

from framework.model.description import Actuator, Coupling, JointDynamics
from framework.model.readers.left_out import LeftOut
from framework.model.readers.urdf_tree import UrdfTree


class Motor(NamedTuple):
    """A motor with its joints, each with a share in the angle at the output of the gear."""

    name: str
    shares: Mapping[str, float]
    gear: float = 1.0
    torque_limit: float | None = None  # motor side [N m]
    acting: JointDynamics = JointDynamics()  # motor side, whether or not it is chosen

    @classmethod
    def on(cls, joint: str) -> Motor:
        """Return a motor straight on a joint."""
        return cls(joint, {joint: 1.0})


class Pull(NamedTuple):
    """Dynamics along a length of joints, each with a share in the length, times a gear."""

    name: str
    shares: Mapping[str, float]
    gear: float
    acting: JointDynamics


def add_pulls(
    pulls: Iterable[Pull],
    joints: Mapping[str, JointDynamics],
    tree: UrdfTree,
    couplings: Sequence[Coupling],
) -> tuple[dict[str, JointDynamics], list[LeftOut]]:
    """Add dynamics along lengths to the joints of each; return joints and the ambiguous rest."""
    sums, left_out = dict(joints), list[LeftOut]()
    for pull in pulls:
        if not any((pull.acting.armature, pull.acting.damping, pull.acting.friction, pull.acting.stiffness)):
            continue
        shares, constant = shares_of_leaders(pull.shares, tree, couplings)
        if len(shares) > 1:
            text = (
                f"{pull.name}: what acts along it pulls at {' and '.join(shares)}, which move independently"
            )
            left_out.append(LeftOut(text, tuple(shares)))
            continue
        for joint, share in shares.items():
            acting = replace(pull.acting, rest=pull.acting.rest - pull.gear * constant)
            sums[joint] = sums.get(joint, JointDynamics()) + acting.seen_through(pull.gear * share)
    return sums, left_out


def actuators_of(
    motors: Sequence[Motor], tree: UrdfTree, couplings: Sequence[Coupling]
) -> tuple[list[Actuator], list[str]]:
    """Return the motors of single moving joints, and the names of motors of several.

    A tendon over joints that couplings make one is a transmission to that one. Of two motors on a joint,
    such as a servo's position and speed, the first is taken.
    """
    actuators: dict[str, Actuator] = {}
    several = []
    for motor in motors:
        shares, _ = shares_of_leaders(motor.shares, tree, couplings)
        if len(shares) > 1:
            several.append(f"motor {motor.name!r}: pulls at {' and '.join(shares)}, which move independently")
        for joint, share in shares.items() if len(shares) == 1 else ():
            gear = abs(motor.gear * share)
            if gear and joint not in actuators:
                actuators[joint] = Actuator(joint, gear, torque_limit=motor.torque_limit)
    return list(actuators.values()), several


def shares_of_leaders(
    shares: Mapping[str, float], tree: UrdfTree, couplings: Sequence[Coupling]
) -> tuple[dict[str, float], float]:
    """Express shares of joints by moving joints that follow no other, and a constant."""
    followed = {coupling.joint: coupling for coupling in couplings}
    leaders: dict[str, float] = {}
    constant = 0.0
    for name, value in shares.items():
        joint, share = name, value
        visited = {joint}
        while joint in followed and followed[joint].of not in visited:
            constant += share * followed[joint].offset
            share *= followed[joint].ratio
            joint = followed[joint].of
            visited.add(joint)
        if tree.joints[joint].moves:
            leaders[joint] = leaders.get(joint, 0.0) + share
        else:
            constant += share * tree.held.get(joint, (0.0,))[0]
    return {joint: share for joint, share in leaders.items() if share}, constant
