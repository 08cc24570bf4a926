"""`crossing calibrate`: the origins of joints from motor angles and measured poses."""

from __future__ import annotations

from argparse import Namespace
from typing import Any

from framework.cli import arguments
from framework.cli.parser import Report, add_number, add_out, add_robot, command
from framework.identification.calibrate import ANGLE_ERROR, LENGTH_ERROR, NOISE, Calibration, calibrate

LISTED_UNSEEN = 12  # directions listed in the report; the document has all
MIN_CHANGE = 1e-3  # least change of a parameter that is reported, over its standard deviation

HEAD = """\
{0.robot.name}: {0.combinations.rank} combinations of {1} parameters are determined (gap of singular values \
{0.combinations.gap:.1e}), {0.instants} poses, {0.steps} steps
  residual          {2}{3}
  held out, by motor angles\tbefore\tafter"""


def add(commands: Any) -> None:
    """Add the command to the parser."""
    parser = command(
        commands,
        "calibrate",
        run,
        "What the data cannot see is named, with a measurement that would show it, and stays as in the file.",
    )
    add_robot(parser)
    parser.add_argument(
        "data",
        metavar="DATA",
        help="CSV with motor_angle_JOINT and some of platform_AXIS, joint_NAME; a row a pose",
    )
    group = parser.topic("data and file")
    group.add_argument(
        "--joints", nargs="+", metavar="JOINT", help="whose origins are calibrated (default: all that matter)"
    )
    group.add_argument(
        "--noise",
        nargs="+",
        default=[],
        metavar="KIND=VALUE",
        help="standard deviations of motor_angle (motor side), joint, platform [rad, m] (default: "
        + ", ".join(f"{name}={value:g}" for name, value in NOISE.items())
        + ")",
    )
    for flag, default, unit in (("--length-error", LENGTH_ERROR, "m"), ("--angle-error", ANGLE_ERROR, "rad")):
        text = f"standard deviation of the file's own [{unit}] (default: {default:.3g})"
        add_number(group, flag, "E", text, default=default)
    add_out(parser, "write the robot file and its URDF there")


def run(options: Namespace) -> Report:
    """Calibrate, and report the errors of poses that were held out of the fit."""
    robot = arguments.load(options)
    calibration = calibrate(
        robot,
        options.data,
        joints=options.joints,
        noise=arguments.named_numbers("--noise", options.noise, "KIND=VALUE"),
        length_error=options.length_error,
        angle_error=options.angle_error,
        progress=options.progress.start("calibrating", unit="steps"),
    )
    document = calibration.to_dict()
    if options.out is not None:
        options.written = document["robot_file"] = str(calibration.write(options.out))
    return document, calibration_lines(calibration)


def _noise_text(calibration: Calibration) -> str:
    """State the estimated noise over the assumed noise."""
    if calibration.degrees_of_freedom < 1.0:
        return "too few poses to estimate the noise: deviations are those of the noise assumed"
    return (
        f"{calibration.noise:.2g} of the noise assumed, of {calibration.degrees_of_freedom:.3g} equations "
        f"more than the parameters need"
    )


def calibration_lines(calibration: Calibration) -> list[str]:
    """Return the report on a calibration, in words."""
    names, measured, unseen = calibration.geometry.names, calibration.measured, calibration.unseen
    outliers = f"; outliers: rows {', '.join(map(str, calibration.outliers))}" if calibration.outliers else ""
    lines = [HEAD.format(calibration, len(names), _noise_text(calibration), outliers)]
    errors = [*zip(measured.names, calibration.error_before, calibration.error_after, strict=True)]
    for error in errors[measured.driven :]:  # behind the motors, which predict the other measurements
        lines.append("  {}\t{:.2e}\t{:.2e}".format(*error))
    lines += ["  parameters [m, rad]", "  name\toff by\tdeviation"]
    for name, value, deviation in zip(names, calibration.values, calibration.deviations, strict=True):
        if abs(value) > MIN_CHANGE * deviation:
            lines.append(f"  {name}\t{value:.2e}\t{deviation:.1e}")
    if unseen:
        lines.append(f"  not seen by these data: {len(unseen)} directions, which stay as in the file")
        lines += [f"    {sentence}" for sentence in unseen[:LISTED_UNSEEN]]
    if len(unseen) > LISTED_UNSEEN:
        lines.append(f"    and {len(unseen) - LISTED_UNSEEN} more, see --json")
    return lines
