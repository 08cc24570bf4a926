"""`crossing calibrate` and `crossing identify`: fit geometry and parameters to recorded data."""

from __future__ import annotations

from argparse import Namespace

import numpy as np

from framework.cli import arguments
from framework.cli.commands import OneLineParser
from framework.cli.parser import MAX_LISTED, Report, add_number, add_out, add_overwrite, add_robot
from framework.identification.calibrate import ANGLE_ERROR, LENGTH_ERROR, NOISE, Calibration, calibrate
from framework.identification.identify import Identification, identify
from framework.tolerances import MIN_RANK_GAP

CALIBRATED = """\
{0.robot.name}: {0.combinations.rank} combinations of {1} parameters are determined (gap of singular values \
{0.combinations.gap:.1e}), {0.instants} poses, {0.steps} steps
  residual          {2}{3}
  held out, by motor angles\tbefore\tafter"""


def add_calibrate_options(parser: OneLineParser) -> None:
    """Add the arguments of `crossing calibrate`."""
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
    add_overwrite(parser)


def run_calibrate(options: Namespace) -> Report:
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
        options.written = document["robot_file"] = str(
            calibration.write(options.out, overwrite=options.overwrite)
        )
    return document, calibration_lines(calibration)


def _noise_text(calibration: Calibration) -> str:
    """State the estimated noise over the assumed noise."""
    if calibration.degrees_of_freedom < 1.0:
        return "too few poses to estimate the noise: deviations are those of the noise assumed"
    return (
        f"{calibration.noise:.2g} of the noise assumed, of {calibration.degrees_of_freedom:.3g} equations "
        f"more than the parameters need"
    )


def calibration_lines(
    calibration: Calibration,
    *,
    min_change: float = 1e-3,  # least change of a parameter that is reported, over its standard deviation
) -> list[str]:
    """Return the report on a calibration, in words."""
    names = calibration.geometry.names
    measured = calibration.measured
    unseen = calibration.unseen
    outliers = f"; outliers: rows {', '.join(map(str, calibration.outliers))}" if calibration.outliers else ""
    lines = [CALIBRATED.format(calibration, len(names), _noise_text(calibration), outliers)]
    errors = [*zip(measured.names, calibration.error_before, calibration.error_after, strict=True)]
    for error in errors[calibration.robot.n_a :]:  # behind the motors, which predict the other measurements
        lines.append("  {}\t{:.2e}\t{:.2e}".format(*error))
    lines += ["  parameters [m, rad]", "  name\toff by\tdeviation"]
    for name, value, deviation in zip(names, calibration.values, calibration.deviations, strict=True):
        if abs(value) > min_change * deviation:
            lines.append(f"  {name}\t{value:.2e}\t{deviation:.1e}")
    if unseen:
        lines.append(f"  not seen by these data: {len(unseen)} directions, which stay as in the file")
        lines += [f"    {sentence}" for sentence in unseen[:MAX_LISTED]]
    if len(unseen) > MAX_LISTED:
        lines.append(f"    and {len(unseen) - MAX_LISTED} more, see --json")
    return lines


# ------------------------------------------------------------------ crossing identify

IDENTIFIED = """\
{0.robot.name}: {0.base.rank} base parameters of {parameters} (gap of singular values {0.base.gap:.1e})
  data              {0.instants} instants, low-pass at {0.cutoff:.3g} Hz, poses by the {0.poses}
  torques held out  error with the file's parameters {before}, with the identified {after}
  no effect         {unseen} parameters{massless}
  base parameter\tvalue\tdeviation\tfile"""

BASE_PARAMETER = "  {}\t{:.6g}\t{:.2g}\t{:.6g}"


def add_identify_options(parser: OneLineParser) -> None:
    """Add the arguments of `crossing identify`."""
    add_robot(parser)
    parser.add_argument(
        "data", metavar="DATA", help="CSV with time, motor_angle_JOINT, torque_JOINT as in motion.csv"
    )
    group = parser.topic("data and file")
    add_number(
        group, "--cutoff", "F", "of the low-pass filter [Hz] (default: where the angles' noise begins)"
    )
    group.add_argument(
        "--poses",
        choices=("motors", "platform"),
        help="what poses come from; platform passes Type 2 singularities and needs all its coordinates "
        "(default: motors, or platform where these lead to one)",
    )
    group.add_argument(
        "--prior",
        metavar="P",
        default="1",
        help="how far the file's values may be off, as a share such as 20%% (default: %(default)s)",
    )
    group.add_argument(
        "--massless", action="store_true", help="identify bodies without mass in the file as well"
    )
    add_out(parser, "write the robot file and its URDF there")
    add_overwrite(parser)


def run_identify(options: Namespace) -> Report:
    """Identify parameters; report the errors of torques that were held out of the fit."""
    robot = arguments.load(options)
    identification = identify(
        robot,
        options.data,
        cutoff=options.cutoff,
        poses=options.poses,
        prior=arguments.share("--prior", options.prior),
        massless=options.massless,
        progress=options.progress.start("identifying", unit="poses"),
    )
    document = identification.to_dict()
    if not identification.base.certain:
        options.warnings.append(
            f"the rank {identification.base.rank} of the base parameters is uncertain: the gap of singular "
            f"values is {identification.base.gap:.1e}, below {MIN_RANK_GAP:g}"
        )
    if options.out is not None:
        options.written = document["robot_file"] = str(
            identification.write(options.out, overwrite=options.overwrite)
        )
    return document, identification_lines(identification)


def identification_lines(identification: Identification) -> list[str]:
    """Return the report on identified parameters, in words."""
    base = identification.base
    joints = identification.robot.actuator_names
    words = {
        "parameters": len(base.parameters),
        "before": _format_errors(joints, identification.error_before),
        "after": _format_errors(joints, identification.error_after),
        "unseen": len(base.without_effect),
        "massless": f"; massless, left out: {', '.join(base.left_out)}" if base.left_out else "",
    }
    rows = zip(base.names, identification.values, identification.deviations, base.values, strict=True)
    lines = [IDENTIFIED.format(identification, **words), *(BASE_PARAMETER.format(*row) for row in rows)]
    if identification.changed:
        lines.append(f"  off the file      {'; '.join(identification.changed)}")
    if identification.undetermined:
        lines.append(f"  not seen          and left as in the file: {'; '.join(identification.undetermined)}")
    if identification.keeps_file:
        lines.append("  the file's stay   all of them: they predict the torques held out at least as well")
    return lines


def _format_errors(joints: tuple[str, ...], errors: np.ndarray) -> str:
    """State the errors (n,) of the joints in per cent."""
    if not np.isfinite(errors).all():
        return "not known (all at Type 2)"
    return ", ".join(f"{joint} {100 * error:.2g} %" for joint, error in zip(joints, errors, strict=True))
