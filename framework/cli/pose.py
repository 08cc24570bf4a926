"""`crossing pose`: all joints of a pose, from its motors or from its platform."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import Any

from framework.cli import arguments
from framework.cli.parser import Report, add_flexibility, add_robot, command
from framework.errors import InvalidInput
from framework.kinematics.forward_kinematics import forward_kinematics
from framework.kinematics.pose import describe_pose
from framework.kinematics.tracking import assemble


def add(commands: Any) -> None:
    """Add the command to the parser."""
    text = "all joints of a pose, from its motors or from its platform, in the modes of the reference"
    parser = command(commands, "pose", run, text)
    add_robot(parser)
    add_flexibility(parser)
    parser.add_argument(
        "--motors",
        dest="motor_joints",
        type=float,
        nargs="+",
        metavar="Q",
        help="joints with motors, joint side of the gears [rad, m], in the order of the robot file",
    )
    parser.add_argument(
        "--platform", dest="point", type=float, nargs="+", metavar="X", help="its coordinates [m, rad]"
    )


def run(options: argparse.Namespace) -> Report:
    """Forward or inverse kinematics from the reference, springs at rest."""
    if (options.motor_joints is None) == (options.point is None):
        raise InvalidInput("give either --motors or --platform")
    robot = arguments.load(options)
    given = options.motor_joints
    closed = assemble(robot, options.point) if given is None else forward_kinematics(robot, given)
    pose = describe_pose(robot, closed.q)
    lines = [
        f"{pose.robot}, {pose.flexibility}",
        f"  platform          {_listed(pose.platform)}",
        f"  motors            {_listed(pose.motor_joints)}",
        f"  motor angles      {_listed(pose.motor_angles)} (motor side)",
        f"  joints            {_listed(pose.joints)}",
        f"  mode              working {pose.working_mode:+d}, assembly {pose.assembly_mode:+d}",
        f"  closures          closed to {pose.closure_error:.1e} m or rad",
        *(f"  warning           {joint} exceeds its limits: {what}" for joint, what in pose.exceeded.items()),
    ]
    return asdict(pose), "\n".join(lines)


def _listed(values: dict[str, float]) -> str:
    return ", ".join(f"{name} {round(value, 12) + 0.0:.9g}" for name, value in values.items())
