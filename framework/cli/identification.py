"""`crossing calibrate`, `identify`, `excite`: fit a file to recorded data; motions to record."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from framework.cli import arguments
from framework.cli.commands import OneLineParser
from framework.cli.parser import MAX_LISTED, Report, add_number, add_out, add_overwrite, add_robot, not_empty
from framework.errors import list_names
from framework.identification.calibrate import ANGLE_ERROR, LENGTH_ERROR, NOISE, Calibration, calibrate
from framework.identification.conversions import Conversions
from framework.identification.excite import GRAVITY, TRIALS, Excitation, digits, excite
from framework.identification.identify import Identification, identify
from framework.identification.recording import make_sensors
from framework.kinematics.parallel_robot import ParallelRobot
from framework.model.robot_file_writer import check_overwritten_robot
from framework.numerics.arrays import Array, Names
from framework.numerics.output import check_files, write_files
from framework.tolerances import MIN_RANK_GAP

CALIBRATED = """\
{0.robot.name}: {0.combinations.rank} combinations of {1} parameters are determined (gap of singular values \
{0.combinations.gap:.1e}), {0.instants} poses{4}, {0.steps} steps
  residual          {2}{3}
  held out, by {5}\tbefore\tafter"""


def add_calibrate_options(parser: OneLineParser) -> None:
    """Add the arguments of `crossing calibrate`."""
    add_robot(parser)
    parser.add_argument(
        "data",
        metavar="DATA",
        help="CSV with motor_angle_JOINT and some of platform_AXIS, joint_NAME, distance_NAME, touch_AXIS",
    )
    group = parser.topic("data and file")
    _add_conversions(group)
    group.add_argument(
        "--joints",
        nargs="+",
        metavar="JOINT",
        help="whose origins are calibrated, and closures whose lengths are (default: all that matter); or "
        "parameters of the robot file alone",
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
    if options.out is not None:
        check_overwritten_robot(robot.description, options.out, overwrite=options.overwrite)
    calibration = calibrate(
        robot,
        options.data,
        joints=options.joints,
        noise=arguments.named_numbers("--noise", options.noise, "KIND=VALUE"),
        length_error=options.length_error,
        angle_error=options.angle_error,
        conversions=_conversions(options),
        progress=options.progress.start("calibrating", unit="steps"),
    )
    document = calibration.to_dict()
    if options.out is not None:
        options.written = document["robot_file"] = str(
            calibration.write(options.out, overwrite=options.overwrite)
        )
    return document, calibration_lines(calibration)


def calibration_lines(calibration: Calibration) -> list[str]:
    """Return the report on a calibration, in words."""
    names = calibration.geometry.names
    unseen = calibration.unseen
    outliers = f"; outliers: {', '.join(calibration.outlier_rows)}" if calibration.outliers else ""
    source = "motor angles" if calibration.poses == "motors" else "the platform: motors lead elsewhere"
    left_out = _tell_left_out(calibration.left_out)
    noise = "too few poses to estimate the noise: deviations are those of the noise assumed"
    if calibration.degrees_of_freedom >= 1.0:
        noise = (
            f"{calibration.noise:.2g} of the noise assumed, of {calibration.degrees_of_freedom:.0f} "
            f"equations more than the parameters need"
        )
    lines = [CALIBRATED.format(calibration, len(names), noise, outliers, left_out, source)]
    lines += ["  {}\t{:.2e}\t{:.2e}".format(*error) for error in calibration.errors_held_out()]
    rows = zip(names, calibration.values, calibration.deviations, strict=True)
    off = [row for row in rows if abs(row[1]) > row[2]]
    lines += ["  parameter [m, rad]\toff by\tdeviation"] if off else []
    lines += ["  {}\t{:.2e}\t{:.1e}".format(*row) for row in off]
    lines.append(f"  {len(names) - len(off)} parameters are off by less than their deviations, see --json")
    if unseen:
        lines.append(f"  not seen by these data: {len(unseen)} directions, which stay as in the file")
        lines += [f"    {sentence}" for sentence in unseen[:MAX_LISTED]]
    if len(unseen) > MAX_LISTED:
        lines.append(f"    and {len(unseen) - MAX_LISTED} more, see --json")
    # the poses to measure next, and the deviations that they would at least halve
    further = calibration.further
    gain = further.deviations / calibration.deviations
    shown = np.argsort(gain)[: np.count_nonzero(gain < 0.5)]
    if len(shown):
        changes = [*zip(names, calibration.deviations, further.deviations, strict=True)]
        listed = list_names(["{} {:.1e} -> {:.1e}".format(*changes[k]) for k in shown], most=MAX_LISTED)
        more = ", see --json" if len(shown) > MAX_LISTED else ""
        lines.append(f"  deviations that {len(further.platform)} further poses would leave: {listed}{more}")
        lines += [f"    {calibration.robot.place(x)}" for x in further.platform]
    return lines


# ------------------------------------------------------------------ crossing identify

IDENTIFIED = """\
{0.robot.name}: {0.base.rank} base parameters of {parameters} (gap of singular values {0.base.gap:.1e})
  data              {0.instants} samples{left_out} every {0.period:.4g} s{jitter}, {0.equations} equations; \
angles up \
to {0.cutoff:.3g} Hz, poses by the {0.poses}
  noise of torques  {noise}{massless}
  torques held out: error over torque, and by how many deviations of chance it is worse than the twin"""

QUANTITY = "  {0.name}\t{0.value:.5g}\t{0.deviation:.2g}\t{0.file:.5g}\t{1}"


def add_identify_options(parser: OneLineParser) -> None:
    """Add the arguments of `crossing identify`."""
    add_robot(parser)
    parser.add_argument(
        "data", metavar="DATA", help="CSV with time, motor_angle_JOINT, torque_JOINT as in motion.csv"
    )
    group = parser.topic("what to identify")
    _add_only(group)
    group.add_argument(
        "--prior",
        metavar="P",
        default="1",
        help="how far the file's values may be off, as a share such as 20%% (default: %(default)s)",
    )
    group.add_argument(
        "--massless", action="store_true", help="identify bodies without mass in the file as well"
    )
    group.add_argument("--all", action="store_true", help="list the base parameters, and what is not shown")
    group = parser.topic("data and file")
    group.add_argument(
        "--held-out", metavar="FILE", help="another recording that judges the twin (default: parts of DATA)"
    )
    _add_conversions(group)
    group.add_argument(
        "--sensor-error",
        nargs="+",
        default=[],
        metavar="KIND=VALUE",
        help="deviation of errors of the torques that last: scale (share of a torque, default 0.005), offset "
        "(share of its root mean square), delay [s]",
    )
    group.add_argument(
        "--start",
        nargs="+",
        default=[],
        metavar="JOINT=VALUE",
        help="joints near the first row, if the motion begins in another mode than the reference (default: "
        "as columns joint_NAME or platform_AXIS tell)",
    )
    add_number(group, "--cutoff", "F", "highest frequency of the angles [Hz] (default: by cross-validation)")
    group.add_argument(
        "--poses",
        choices=("motors", "platform"),
        help="what poses come from; platform passes Type 2 singularities and needs all its coordinates "
        "(default: motors, or platform where these lead to one)",
    )
    add_out(parser, "write the robot file and its URDF there, if the twin predicts best")
    add_overwrite(parser)


def _add_only(group: Any) -> None:
    """Add --only."""
    group.add_argument(
        "--only",
        nargs="+",
        default=[],
        metavar="NAME",
        help="payload, friction, rotor, or names of links, joints or parameters; others stay as in the file",
    )


def _add_conversions(group: Any) -> None:
    """Add the options that declare units, signs and exchanged columns."""
    for flag, form, text in (
        (
            "--unit",
            "COLUMN=UNIT",
            "of a column, or of all motor_angle, torque, platform, joint: deg, mm, ms .. or SI units",
        ),
        ("--sign", "COLUMN=-1", "columns, or all of a kind, that count the other way"),
        ("--zero", "COLUMN=VALUE", "readings where columns are zero, in SI units, after unit and sign"),
        ("--swap", "COLUMN=COLUMN", "columns that are exchanged for one another"),
        ("--column", "COLUMN=HEADER", "words of the first line of DATA in place of a column's name"),
        ("--unwrap", "COLUMN", "columns of angles that begin anew after a turn"),
    ):
        group.add_argument(flag, nargs="+", default=[], metavar=form, help=text)


def _conversions(options: Namespace) -> Conversions:
    """Return the conversions that the options declare."""
    return Conversions(
        units=arguments.named_words("--unit", options.unit, "NAME=VALUE"),
        signs=arguments.named_numbers("--sign", options.sign, "COLUMN=-1"),
        zeros=arguments.named_numbers("--zero", options.zero, "COLUMN=VALUE"),
        swaps=arguments.named_words("--swap", options.swap, "NAME=VALUE"),
        headers=arguments.named_words("--column", options.column, "NAME=VALUE"),
        unwrapped=options.unwrap,
    )


def run_identify(options: Namespace) -> Report:
    """Identify parameters; report the errors of torques that were held out of the fit."""
    robot = arguments.load(options)
    if options.out is not None:
        check_overwritten_robot(robot.description, options.out, overwrite=options.overwrite)
    identification = identify(
        robot,
        options.data,
        held_out=options.held_out,
        only=options.only,
        cutoff=options.cutoff,
        poses=options.poses,
        start=arguments.named_numbers("--start", options.start, "JOINT=VALUE"),
        prior=arguments.share("--prior", options.prior),
        massless=options.massless,
        sensor_errors=arguments.named_numbers("--sensor-error", options.sensor_error, "KIND=VALUE"),
        conversions=_conversions(options),
        progress=options.progress.start("identifying", unit="poses"),
    )
    document = identification.to_dict()
    if not identification.base.certain:
        options.warnings.append(
            f"the rank {identification.base.rank} of the base parameters is uncertain: the gap of singular "
            f"values is {identification.base.gap:.1e}, below {MIN_RANK_GAP:g}"
        )
    options.refusal = identification.refusal
    if options.out is not None and options.refusal is None:
        options.written = document["robot_file"] = str(
            identification.write(options.out, overwrite=options.overwrite)
        )
    return document, identification_lines(
        identification, everything=options.all, conditional=bool(options.only)
    )


def _list_by_motor(robot: ParallelRobot, values: Array, units: Names, *, digits: int) -> str:
    """List values (n_a,) with the names of their motors and with units."""
    rows = zip(robot.actuator_names, values, units, strict=True)
    return ", ".join(f"{joint} {value:.{digits}g} {unit}" for joint, value, unit in rows)


def _tell_left_out(count: int) -> str:
    """Return the clause about rows of a file that are not used."""
    return f" ({count} rows without all numbers, or that repeat one, left out)" if count else ""


def identification_lines(
    identification: Identification, *, everything: bool = False, conditional: bool = False
) -> list[str]:
    """Format the report on identified parameters as lines of text.

    Args:
        everything: whether base parameters are listed, too.
        conditional: whether some unknowns keep the file's values, so that all deviations rest on these.
    """
    base = identification.base
    robot = identification.robot
    least = 1e-3 * identification.period  # of a jitter that is told
    words = {
        "parameters": len(base.parameters),
        "noise": _list_by_motor(robot, identification.noise, robot.torque_units, digits=2),
        "jitter": f" (+- {0.5 * identification.jitter:.1g})" if identification.jitter > least else "",
        "left_out": _tell_left_out(identification.left_out),
        "massless": f"\n  massless          left out: {', '.join(base.left_out)}" if base.left_out else "",
    }
    lines = [IDENTIFIED.format(identification, **words)]
    lines.append("  " + "\t".join(["model", *robot.actuator_names, "worse by"]))
    for prediction in identification.predictions:
        errors = (f"{100 * error:.3g} %" for error in prediction.errors)
        lead = "" if np.isinf(prediction.lead) else f"{prediction.lead:.1f}"
        lines.append("  " + "\t".join([prediction.model, *errors, lead]))

    shown = [quantity for quantity in identification.quantities if everything or quantity.shown]
    if shown:
        lines.append("  quantity\tvalue\tdeviation\tfile\tunit")
    for quantity in shown:
        remark = ", if other values of the file are right" if quantity.shown else ", not shown by these data"
        lines.append(
            QUANTITY.format(quantity, quantity.unit + remark * (conditional or not quantity.determined))
        )
    hidden = len(identification.quantities) - len(shown)
    if hidden:
        lines.append(f"  not shown         by these data: {hidden} more quantities, see --all")
    others = [quantity for quantity in identification.quantities if not quantity.shown]
    showable = [quantity.name for quantity in others if quantity.alone]
    if showable:
        listed = list_names(showable, most=MAX_LISTED)
        lines.append(f"  other motions     would show {listed}: see crossing excite")
    elif others:
        lines.append("  other motions     show none of these alone, only sums of parameters, see --all")
    if everything:
        lines.append("  base parameter\tvalue\tdeviation\tfile")
        unseen = ["" if seen else "not determined by these data" for seen in identification.determined]
        columns = (identification.values, identification.deviations, base.values, unseen)
        rows = zip(base.names, *columns, strict=True)
        lines += ["  {}\t{:.6g}\t{:.2g}\t{:.6g}\t{}".format(*row) for row in rows]
    if identification.changed:
        lines.append(f"  off the file      {'; '.join(identification.changed)}")
    return lines


# ------------------------------------------------------------------ crossing excite

EXCITED = """\
{0.robot.name}: {1:g} s in periods of {2:.3g} s; deviations are {0.improvement:.2g} times smaller than \
those of the first motion tried
  start             {3}, at rest
  largest torques   {4}
  largest speeds    {5}
  checked           by forward simulation, within {0.tracking_error:.1e} of the motion (robot lengths, rad)
  shown             {7} of {8} quantities, by a simulated recording of {6} samples with noise
  quantity\tfile\tfound\tdeviation\tdigits\tunit"""


def add_excite_options(parser: OneLineParser) -> None:
    """Add the arguments of `crossing excite`."""
    add_robot(parser)
    group = parser.topic("the motion")
    add_number(group, "--duration", "T", "of the motion [s] (default: 10)", default=10.0)
    _add_only(group)
    for name in ("torque_limit", "speed_limit"):
        text = (
            f"{name.partition('_')[0]} limits of the motors: one, one each, or JOINT=N (default: the file's)"
        )
        group.add_argument(f"--{name.replace('_', '-')}", nargs="+", metavar="N", help=text)
    add_number(
        group,
        "--acceleration",
        "A",
        "largest of the platform [m/s^2], for turns times the robot's length (default: %(default)s)",
        default=GRAVITY,
    )
    group.add_argument(
        "--clearance",
        default="30%",
        metavar="SHARE",
        help="of the reference's distance from singularities that the motion keeps (default: 30%%)",
    )
    parser.add_argument(
        "--out", type=not_empty, metavar="FILE", help="write the motion there, such as motion.csv"
    )
    add_overwrite(parser)
    parser.add_argument(
        "--sensors",
        nargs="+",
        default=["rate=500"],
        metavar="NAME=VALUE",
        help="of the simulated recording, and the rate of FILE, as for simulate (default: rate=500)",
    )


def run_excite(options: Namespace) -> Report:
    """Design a motion; report the quantities that a simulated recording shows."""
    robot = arguments.load(options)
    if options.out is not None:
        beginning = {FilePath(options.out): "time,motor_angle_"}
        check_files(beginning, option="--out", overwrite=options.overwrite)
    stated: dict[str, Any] = {}
    for name in ("torque_limit", "speed_limit"):
        if (words := getattr(options, name)) is not None:
            stated[name] = arguments.limits(f"--{name.replace('_', '-')}", words)
    excitation = excite(
        robot,
        duration=options.duration,
        only=options.only,
        acceleration=options.acceleration,
        clearance_share=arguments.share("--clearance", options.clearance),
        sensors=make_sensors(arguments.named_numbers("--sensors", options.sensors, "NAME=VALUE")),
        progress=options.progress.start("searching", TRIALS, "motions"),
        **stated,
    )
    document = excitation.to_dict()
    options.refusal = excitation.refusal
    if options.out is not None:
        write_files({FilePath(options.out): excitation.to_csv()}, option="--out", overwrite=options.overwrite)
        options.written = document["file"] = options.out
    return document, excitation_lines(excitation)


def excitation_lines(excitation: Excitation) -> list[str]:
    """Return the report on a motion, in words."""
    robot = excitation.robot
    motion = excitation.motion
    duration = float(motion.times[-1])
    values = [
        _list_by_motor(robot, np.abs(series).max(axis=0), units, digits=3)
        for series, units in ((motion.torque, robot.torque_units), (motion.speed, robot.speed_units))
    ]
    shown = excitation.shown
    quantities = excitation.identification.quantities
    place = robot.place(motion.x[0])
    counts = (excitation.identification.instants, len(shown), len(quantities))
    lines = [EXCITED.format(excitation, duration, excitation.period, place, *values, *counts)]
    lines += [
        f"  {quantity.name}\t{quantity.file:.5g}\t{quantity.value:.5g}\t{quantity.deviation:.2g}"
        f"\t{f'{digits(quantity):.1f}' if quantity.file else '-'}\t{quantity.unit}"
        for quantity in shown
    ]
    hidden = [quantity.name for quantity in quantities if not quantity.shown]
    if hidden:
        lines.append(f"  not shown         {list_names(hidden, most=MAX_LISTED)}")
    return lines
