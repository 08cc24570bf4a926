"""`crossing pose`: all joints of a pose, from its motors or from its platform, and its loads in motion."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import Any

import numpy as np

from framework.arrays import Array
from framework.cli import arguments
from framework.cli.instant import loads_document, loads_in_words, loads_of_instant
from framework.cli.parser import Report, add_flexibility, add_options, add_robot, add_wrenches, command
from framework.dynamics.platform_limits import PlatformLimits, platform_limits
from framework.errors import InvalidInput, NoAnswer, NotAssembled
from framework.kinematics.continuation.forward_kinematics import forward_kinematics
from framework.kinematics.continuation.tracking import assemble
from framework.kinematics.mistaken_units import beyond_reach, more_than_a_turn
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.pose import describe_pose
from framework.proofs.assembly_modes import assembly_modes
from framework.proofs.working_modes import working_modes
from framework.singularity.pose_classes import Classification, classify


def add(commands: Any) -> None:
    """Add the command to the parser."""
    parser = command(commands, "pose", run)
    add_robot(parser)
    group = parser.topic("which pose")
    group.add_argument(
        "--motors",
        dest="motor_joints",
        type=float,
        nargs="+",
        metavar="Q",
        help="joints with motors, joint side of the gears [rad, m], in the order of the robot file",
    )
    group.add_argument(
        "--platform", dest="point", type=float, nargs="+", metavar="X", help="its coordinates [m, rad]"
    )
    group.add_argument(
        "--all",
        dest="every",
        action="store_true",
        help="every pose for these motors (assembly modes), or every way to this platform (working modes)",
    )
    group = parser.topic("its motion")
    group.add_argument(
        "--velocity",
        type=float,
        nargs="+",
        metavar="V",
        help="rates of the platform's coordinates [m/s, rad/s]: with them, --acceleration or a wrench, the "
        "motor torques and the forces in loops and joints at that instant, springs rigid (default: 0)",
    )
    group.add_argument(
        "--acceleration", type=float, nargs="+", metavar="A", help="their rates [m/s2, rad/s2] (default: 0)"
    )
    add_flexibility(parser)
    add_wrenches(parser)
    add_options(parser, "torque_limit", "speed_limit")


def run(options: argparse.Namespace) -> Report:
    """Report the pose of given motor angles or of a platform point, springs at rest."""
    robot = arguments.load(options)
    if (options.motor_joints is None) == (options.point is None):
        here = robot.actuated_coordinates(robot.reference.q[None])[0].tolist()
        raise InvalidInput("give either --motors or --platform").advising({"platform": None, "motors": here})
    motor_joints = options.motor_joints
    single = ("torque_limit", "speed_limit", "velocity", "acceleration", "wrench", "wrench_on")
    stated = [name for name in single if getattr(options, name) is not None]
    if options.every and stated:
        flag = "--" + stated[0].replace("_", "-")
        raise InvalidInput(f"--all: lists poses alone; {flag} is for a single pose").advising(
            dict.fromkeys(stated)
        )
    if options.every:
        if motor_joints is None:
            return _working(robot, options)
        return _assembly(robot, options)
    try:
        closed = (
            assemble(robot, options.point)
            if motor_joints is None
            else forward_kinematics(robot, motor_joints)
        )
    except NotAssembled as failure:  # from the reference; another mode may have such a pose
        degrees = "" if motor_joints is None else _degrees(robot, motor_joints)
        far = "" if options.point is None else _far(robot, options.point)
        failure.args = (f"{failure}{degrees}",)
        raise failure.advising(None if stated or degrees or far else {"all": True}) from None
    pose, classification = describe_pose(robot, closed.q), classify(robot, closed.q)
    limits = _limits(robot, closed.q, options)
    instant = loads_of_instant(robot, closed.q, options)
    lines = [
        f"{pose.robot}, {pose.flexibility}",
        f"  platform          {_listed(pose.platform)}",
        f"  motors            {_listed(pose.motor_joints)}",
        f"  motor angles      {_listed(pose.motor_angles)} (motor side)",
        f"  joints            {_listed(pose.joints)}",
        f"  mode              working {pose.working_mode:+d}, assembly {pose.assembly_mode:+d}",
        f"  singularity       {classification.sentence}",
        *(
            f"  t_s               {_listed(dict(zip(robot.axis_names, twist, strict=True)), 6)}"
            for twist in classification.twists
        ),
        f"  distances         g {classification.g:.3g}, sigma_A {classification.sigma_A:.3g} "
        f"(length {classification.length:.3g} m)" + _angles(robot, classification),
        *_worst_torques(robot, classification),
        *_limits_in_words(robot, limits),
        *loads_in_words(robot, instant),
        f"  closures          closed to {pose.closure_error:.1e} m or rad",
        *(
            f"  warning           {joint} exceeds its limits: {excess}"
            for joint, excess in pose.exceeded.items()
        ),
    ]
    document = asdict(pose) | {"singularity": _document(classification), "limits": _limits_document(limits)}
    if instant is not None:
        document["dynamics"] = loads_document(robot, instant)
    return document, "\n".join(lines)


def _limits(robot: ParallelRobot, q: Array, options: argparse.Namespace) -> PlatformLimits | None:
    """Compute the platform's limits; None where the platform does not determine the motors."""
    try:
        return platform_limits(robot, q, **arguments.typed_options(options))
    except NotAssembled:
        return None


def _limits_in_words(robot: ParallelRobot, limits: PlatformLimits | None) -> list[str]:
    """Return lines on the platform's limits; none where no motor has one."""
    lines = []
    units = [("N", "m/s") if moves else ("N m", "rad/s") for moves in robot.translations]
    for k, (name, polytope) in enumerate(limits.polytopes.items() if limits else ()):
        ranges = (
            f"{axis} {low:.4g} .. {high:.4g} {unit[k]}"
            for axis, (low, high), unit in zip(robot.axis_names, polytope.axis_ranges(), units, strict=True)
        )
        alone = ", each alone" if robot.n > 1 else ""
        lines.append(f"  {name + ' limits':<17} {', '.join(ranges)}{alone}")
    if lines:
        lines.append(f"  {'':<17} of the motors in this pose; rigid, without contact, the weight held")
    return lines


def _limits_document(limits: PlatformLimits | None) -> dict[str, Any]:
    """Return ranges and polytopes on the platform's coordinates, for JSON."""
    return {
        name: {
            "alone": _finite(polytope.axis_ranges()),
            "bounds": _finite(polytope.bounds()),
            "vertices": polytope.vertices.tolist(),
            "normals": polytope.normals.tolist(),
            "offsets": polytope.offsets.tolist(),
        }
        for name, polytope in (limits.polytopes.items() if limits else ())
    }


def _degrees(robot: ParallelRobot, motor_joints: list[float]) -> str:
    """Return the end of a sentence on motors that are asked to turn more than once; empty for none."""
    return more_than_a_turn(robot, dict(zip(robot.actuator_names, motor_joints, strict=True)))


def _far(robot: ParallelRobot, point: list[float]) -> str:
    """Return the end of a sentence on a platform that no link leads to; empty where one may."""
    return beyond_reach(robot, np.array(point)[robot.platform.sliding])


def _assembly(robot: ParallelRobot, options: argparse.Namespace) -> Report:
    """Report all poses for the motor angles asked for."""
    assembly = assembly_modes(robot, options.motor_joints)
    degrees = "" if assembly.modes else _degrees(robot, options.motor_joints)
    if degrees:
        options.warnings.append(degrees.removeprefix("; "))
    lines, modes = [f"{robot.name}, {robot.flexibility}", f"  assembly modes    {assembly.sentence}"], []
    for mode in assembly.modes:
        pose, kind = describe_pose(robot, mode.q), classify(robot, mode.q)
        lines.append(f"  platform          {_listed(pose.platform)}; g {kind.g:.3g}, {kind.sentence}")
        modes.append(asdict(pose) | {"proved": mode.proved, "singularity": _document(kind)})
    about = {
        "complete": assembly.complete,
        "status": assembly.status,
        "bound": assembly.bound,
        "paths": None if assembly.count is None else asdict(assembly.count),
        "method": assembly.method,
        "modes": modes,
    }
    return {"robot": robot.name, "flexibility": robot.flexibility, "assembly_modes": about}, "\n".join(lines)


def _working(robot: ParallelRobot, options: argparse.Namespace) -> Report:
    """Report all ways to the platform that is asked for; refuse where there is none."""
    working = working_modes(robot, options.point)
    if not working.modes:
        far = _far(robot, options.point)
        options.refusal = NoAnswer(f"{robot.name}: out of reach: no pose was found with this platform{far}")
    lines, modes = [f"{robot.name}, {robot.flexibility}", f"  working modes     {working.sentence}"], []
    for mode in working.modes:
        pose = describe_pose(robot, mode.q)
        signs = "".join("+" if sign > 0 else "-" for sign in mode.signs)
        beyond = "" if mode.within_limits else "; beyond the joints' limits"
        lines.append(f"  {signs:17s} {_listed(pose.motor_joints)}{beyond}")
        modes.append(asdict(pose) | {"signs": mode.signs.tolist(), "proved": mode.proved})
    about = {
        "complete": working.status == "proved",
        "status": working.status,
        "solutions": list(working.solutions),
        "legs": [list(leg) for leg in working.legs],
        "proved_legs": list(working.proved_legs),
    }
    document = {
        "robot": robot.name,
        "flexibility": robot.flexibility,
        "working_modes": about | {"modes": modes},
    }
    return document, "\n".join(lines)


def _document(classification: Classification) -> dict[str, Any]:
    """Return a classification for JSON: null for what is undefined, or unbounded at a Type 2 singularity."""
    document = {
        name: value.tolist() if isinstance(value, np.ndarray) else value
        for name, value in vars(classification).items()
    }
    return {"regular": classification.regular} | {name: _finite(value) for name, value in document.items()}


def _finite(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return _finite(value.tolist())
    if isinstance(value, list):
        return [_finite(part) for part in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _angles(robot: ParallelRobot, classification: Classification) -> str:
    """Return the transmission angles, where they are defined."""
    if not np.isfinite(classification.transmission_angle).all():
        return ""
    degrees = np.rad2deg(classification.transmission_angle)
    return ", transmission " + _listed(dict(zip(robot.actuator_names, degrees, strict=True)), 4) + " degrees"


def _worst_torques(robot: ParallelRobot, classification: Classification) -> list[str]:
    """Return the line about the worst torques per newton; none for a platform that only turns."""
    if np.isnan(classification.torque_norm):
        return []
    units = " or ".join(sorted({f"{unit}/N" for unit in robot.torque_units}))
    return [
        f"  worst torque      {classification.motor_torque_largest:.3g} {units} of one motor, norm "
        f"{classification.motor_torque_norm:.3g} (motor side), to hold a unit force in any direction"
    ]


def _listed(values: dict[str, float], digits: int = 9) -> str:
    return ", ".join(f"{name} {round(value, 12) + 0.0:.{digits}g}" for name, value in values.items())
