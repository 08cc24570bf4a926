"""Files written anew in the dialects and with the quirks of published ones, and how each is converted.

tests/data/dialects/EXPECTED.md says beforehand what comes of the originals.
"""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from framework import CrossingPlan, Line, ParallelRobot, plan_crossing
from framework.kinematics.diagnostics.proposal import propose
from framework.model.description import RobotDescription
from framework.model.readers import parse_any

DATA = Path(__file__).parents[2] / "data" / "dialects"


class ForeignFile(NamedTuple):
    """A file, the options that `convert` is given, and what an expert counts at a closed pose of it."""

    name: str
    options: dict[str, Any]
    freedoms: int  # that move a mass, each with a motor
    idle_turns: int  # of rods between two balls about their own line

    def description(self) -> RobotDescription:
        """What `convert` writes."""
        return _converted(self.name)


@cache
def _converted(name: str) -> RobotDescription:
    (options,) = (file.options for file in PLANNED if file.name == name)
    return parse_any(DATA / name, propose=propose, **options).description


PLANNED = (
    ForeignFile("five_bar_defaults.xml", {}, 2, 0),
    ForeignFile("three_rings.xml", {}, 3, 0),
    ForeignFile("ankle_on_balls.xml", {}, 2, 2),
    ForeignFile("sprung_leg.xml", {"base": "hip", "locked": {"shin": None, "heel": None}}, 1, 1),
    ForeignFile(
        "gripper_on_a_tendon.xml", {"locked": {"right_spring_link": None, "left_spring_link": None}}, 1, 0
    ),
    ForeignFile("mirrored_gripper.xml", {"base": "palm"}, 1, 0),
    ForeignFile("sliding_fingers.xml", {}, 1, 0),
    ForeignFile("two_cranks.xml", {"motors": ["j1"]}, 1, 0),
    ForeignFile("head_on_six_rods.xml", {}, 6, 6),
    ForeignFile("stretched_leg.xml", {"base": "hip"}, 2, 0),
)


def undamped(description: RobotDescription) -> RobotDescription:
    """The same robot without viscous damping."""
    joints = {name: replace(joint, damping=0.0) for name, joint in description.joints.items()}
    return replace(description, joints=joints)


def without_dry_friction(description: RobotDescription) -> RobotDescription:
    """The same robot without dry friction, which no inverse dynamics of MuJoCo has."""
    joints = {name: replace(joint, friction=0.0) for name, joint in description.joints.items()}
    return replace(description, joints=joints)


def short_move(robot: ParallelRobot) -> CrossingPlan:
    """A plan of a move through the reference, of a hundredth of the robot's length or 0.03 rad either way."""
    x = robot.reference.x
    size = np.where(robot.translations, 0.01 * robot.length, 0.03)
    return plan_crossing(
        robot,
        Line(x - size * np.linspace(1.0, 0.5, robot.n), x + size * np.linspace(1.0, 0.6, robot.n)),
        duration=1.0,
    )
