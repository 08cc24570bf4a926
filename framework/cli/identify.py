"""`crossing identify`: identify inertial and motor parameters from recorded angles and torques."""

from __future__ import annotations

from argparse import Namespace
from typing import Any

import numpy as np

from framework.cli import arguments
from framework.cli.parser import Report, add_number, add_out, add_robot, command
from framework.identification.identify import DEFAULT_PRIOR, Identification, identify
from framework.tolerances import MIN_RANK_GAP

HEAD = """\
{0.robot.name}: {0.base.rank} base parameters of {parameters} (gap of singular values {0.base.gap:.1e})
  data              {0.instants} instants, low-pass at {0.cutoff:.3g} Hz, poses by the {0.poses}
  torques held out  error with the file's parameters {before}, with the identified {after}
  no effect         {unseen} parameters{massless}
  base parameter\tvalue\tdeviation\tfile"""

ROW = "  {}\t{:.6g}\t{:.2g}\t{:.6g}"


def add(commands: Any) -> None:
    """Add the command to the parser."""
    parser = command(
        commands,
        "identify",
        run,
        "Named are the combinations that torques depend on, see base parameters in the literature; what they "
        "do not show stays as near to the robot file as bodies that can exist allow.",
    )
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
        default=f"{DEFAULT_PRIOR:g}",
        help="how far the file's values may be off, as a share such as 20%% (default: %(default)s)",
    )
    group.add_argument(
        "--massless", action="store_true", help="identify bodies without mass in the file as well"
    )
    add_out(parser, "write the robot file and its URDF there")


def run(options: Namespace) -> Report:
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
        options.written = document["robot_file"] = str(identification.write(options.out))
    return document, identification_lines(identification)


def identification_lines(identification: Identification) -> list[str]:
    """Return the report on identified parameters, in words."""
    base, joints = identification.base, identification.robot.actuator_names
    words = {
        "parameters": len(base.parameters),
        "before": _format_errors(joints, identification.error_before),
        "after": _format_errors(joints, identification.error_after),
        "unseen": len(base.without_effect),
        "massless": f"; massless, left out: {', '.join(base.left_out)}" if base.left_out else "",
    }
    rows = zip(base.names, identification.values, identification.deviations, base.values, strict=True)
    lines = [HEAD.format(identification, **words), *(ROW.format(*row) for row in rows)]
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
