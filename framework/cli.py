"""The command line: `crossing robots | check | convert | locate | plan`.

Exit codes: 0 done, 1 the answer is no, 2 misuse or bad input (one line on stderr). With --json there
is one JSON object on stdout and nothing else.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from framework.catalogue import catalogue, robot_file
from framework.crossing.plan import plan_crossing
from framework.crossing.result import CrossingPlan
from framework.crossing.scenes import scene, scene_path
from framework.errors import FrameworkError, InvalidInput, MissingPackage, NoAnswer, point
from framework.kinematics.checkup import check_robot
from framework.kinematics.locus import locate_singularities
from framework.model import ParallelRobot
from framework.model.description import FLEXIBILITIES, RobotDescription
from framework.model.readers.recognise import DIALECTS, dialect_of, read_any
from framework.model.readers.writer import write_robot_file
from framework.motion.path import Line
from framework.motion.path import Path as MotionPath
from framework.output import written_together

Report = tuple[dict[str, Any], str]  # for machines, for people


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        options = _parser().parse_args(given)
        with np.errstate(all="ignore"):  # what is not finite is told as an error, not as a warning
            document, text = options.run(options)
    except (FrameworkError, _Misuse) as error:
        print(f"crossing: {error}", file=sys.stderr)
        if "--json" in given:
            _print(json.dumps({"error": _error_document(error)}, allow_nan=False))
        return 1 if isinstance(error, NoAnswer) else 2
    _print(json.dumps(document, allow_nan=False) if options.json else text)
    return 0


def _print(text: str) -> None:
    try:
        print(text, flush=True)
    except BrokenPipeError:  # whoever reads has seen enough, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _error_document(error: Exception) -> dict[str, Any]:
    """An error for machines: its kind, the sentence, and the numbers that it carries."""
    document: dict[str, Any] = {"kind": type(error).__name__.lstrip("_"), "message": str(error)}
    for key in ("time", "s", "wrench", "joint", "residual", "platform"):
        value = getattr(error, key, None)
        if (isinstance(value, float) and np.isfinite(value)) or isinstance(value, str):
            document[key] = value
        elif isinstance(value, np.ndarray):
            document[key] = value.tolist()
    return document


# ------------------------------------------------------------------ commands


def _robots(options: argparse.Namespace) -> Report:
    rows: list[dict[str, Any]] = []
    figures: dict[str, Any]
    for name, entry in catalogue().items():
        try:
            robot = entry.load()
        except MissingPackage as missing:  # its URDF is somebody else's, and not here
            figures = {"needs": missing.package}
        else:
            description = robot.description
            figures = {
                "degrees_of_freedom": check_robot(robot).mobility,
                "loops": len(description.closures),
                "springs": len(description.springs),
                "scenes": list(description.scenes),
            }
        rows.append(
            {
                "name": name,
                **figures,
                "summary": entry.summary,
                "singularities": list(entry.singularities),
                "source": entry.source,
                "file": str(entry.file),
            }
        )
    lines = [f"{'name':16s}  dof  loops  springs  scenes"]
    for row in rows:
        if "needs" in row:
            lines.append(f"{row['name']:16s}  not installed: pip install {row['needs']}")
        else:
            lines.append(
                f"{row['name']:16s}  {row['degrees_of_freedom']:3d}  {row['loops']:5d}  {row['springs']:7d}  "
                f"{', '.join(row['scenes'])}"
            )
        kinds = ", ".join(row["singularities"]) or "none on its scenes"
        lines.append(f"{'':16s}  {row['summary']}; singularities: {kinds}")
        lines.append(f"{'':16s}  {row['source']}")
    return {"robots": rows}, "\n".join(lines)


def _check(options: argparse.Namespace) -> Report:
    found = check_robot(_load(options))
    rank = f"{found.rank} of {found.loop_equations} loop equations independent"
    if found.redundant_rows:
        rank += f"; redundant: {', '.join(found.redundant_rows)}"
    lines = [
        f"{found.robot}, {found.flexibility}",
        f"  platform          {', '.join(found.platform_axes)} at {point(found.platform)}",
        f"  actuated joints   {', '.join(found.actuators)}",
        f"  passive joints    {', '.join(found.passive_joints)}",
        f"  idle joints       {', '.join(found.idle_joints) or 'none'}",
        f"  springs           {', '.join(found.springs) or 'none'}",
        f"  mobility          {found.mobility}; A is {'square' if found.square else 'NOT square'}",
        f"  closures          {rank}; closed to {found.closure_error:.1e}",
        f"  mass              {found.mass:g} kg; without mass of their own: "
        f"{', '.join(found.massless_joints) or 'none'}",
        "  reference         "
        + ", ".join(f"{joint} {value:.6g}" for joint, value in found.reference.items()),
        f"  mode              working {found.working_mode:+d} (changes at Type 1), assembly "
        f"{found.assembly_mode:+d} (changes at Type 2); smallest singular value "
        f"{'unknown' if found.smallest_singular_value is None else f'{found.smallest_singular_value:.3g}'}",
        *(f"  note              {advice}" for advice in found.advice),
    ]
    return asdict(found), "\n".join(lines)


def _convert(options: argparse.Namespace) -> Report:
    dialect, description = dialect_of(robot_file(options.robot)), _describe(options)
    written = write_robot_file(description, options.out)
    document = {
        "robot": description.name,
        "dialect": dialect,
        "file": str(written),
        "urdf": str(written.with_suffix(".urdf")),
    }
    closures = ", ".join(closure.name for closure in description.closures)
    text = (
        f"{description.name}, read as {DIALECTS[dialect]}: loops closed by {closures}\n"
        f"  written to        {written}"
    )
    return document, f"{text}\n  next              crossing check {written}"


def _locate(options: argparse.Namespace) -> Report:
    robot = _load(options)
    path = _path(options, robot)
    points = locate_singularities(robot, path)
    document = {
        "robot": robot.name,
        "singularities": [
            {
                "s": found.s,
                "kind": found.kind,
                "contact": found.contact,
                "corank": found.corank,
                "twist": found.twist.tolist(),
                "platform": found.platform.tolist(),
                "slope": found.slope,
            }
            for found in points
        ],
    }
    if not points:
        return document, f"{robot.name}: no singularity on the path"
    axes = ", ".join(robot.axis_names)
    return document, "\n".join(
        f"s = {found.s:.15f}  {found.kind} ({found.contact})  {axes} = {point(found.platform)}  "
        f"t_s = {point(found.twist)}  dg/ds = {found.slope:.6g}"
        for found in points
    )


def _plan(options: argparse.Namespace) -> Report:
    robot = _load(options)
    path, given = _path(options, robot), _motion_options(options, robot)
    if options.samples < 2:
        raise InvalidInput(f"--samples: needs at least 2, got {options.samples}")
    if options.out == "":
        raise InvalidInput("--out: needs the name of a folder, got an empty text")
    out = None if options.out is None else Path(options.out)
    if out is None:
        return _raw(options, robot, path, given, None) if options.raw else _planned(robot, path, given)
    with written_together(out) as folder:
        if options.raw:
            return _raw(options, robot, path, given, folder)
        document, text = _planned(robot, path, given, lambda plan: _write_plan(plan, folder, options.samples))
    return document, f"{text}\n  written to        {out}"


def _planned(
    robot: ParallelRobot,
    path: MotionPath,
    given: dict[str, Any],
    write: Callable[[CrossingPlan], None] = lambda plan: None,
) -> Report:
    plan = plan_crossing(robot, path, **given)
    write(plan)
    return plan.to_dict(), _plan_text(plan)


def _write_plan(plan: CrossingPlan, folder: Path, samples: int) -> None:
    from framework.show.plots import save_figures

    (folder / "plan.json").write_text(json.dumps(plan.to_dict(), indent=2, allow_nan=False) + "\n")
    plan.to_csv(folder / "motion.csv", samples)
    save_figures(plan, folder)


def _plan_text(plan: CrossingPlan) -> str:
    robot, certificate = plan.robot, plan.certificate
    lines = [
        f"{robot.name}, {robot.flexibility}, {plan.geometry} geometry: law of degree {plan.law.degree} over "
        f"{plan.duration:g} s"
    ]
    for crossing in plan.crossings:
        lines.append(
            f"  crossing          t = {crossing.time:.6g} s at s = {crossing.s:.15f}, "
            f"{', '.join(robot.axis_names)} = {point(crossing.platform)}"
        )
        lines.append(
            f"                    t_s = {point(crossing.twist)}, s' = {crossing.speed:.6g} 1/s, s\" = "
            f"{round(crossing.acceleration, 9) + 0.0:.6g} 1/s2, |t_s . W_p| {crossing.residual:.1e} of its "
            f"peak"
        )
    if not plan.crossings:
        lines.append("  crossing          none")
    peaks = ", ".join(
        f"{joint} {value:.6g} {unit}"
        for (joint, value), unit in zip(plan.peak_torque.items(), robot.torque_units, strict=True)
    )
    lines += [
        f"  peak torque       {peaks}",
        f"  certificate       tail {certificate.tail:.1e} on {certificate.nodes} nodes, "
        f"{certificate.passes} pass{'es' * (certificate.passes != 1)}, loops closed to "
        f"{certificate.max_closure_error:.1e}",
    ]
    for joint, asked in plan.exceeded.items():
        lines.append(f"  mind              {joint} exceeds its limits: {asked}")
    if certificate.end_speed > 1e-6:
        lines.append(
            f"  mind              the motors start and stop with {certificate.end_speed:.1e} of their "
            f"largest speed: the springs carry inertia; a higher --smoothness mends it"
        )
    if not certificate.monotone:
        s = plan.law(np.linspace(0.0, plan.duration, 2001))
        lines.append(
            f"  mind              the law overshoots its ends (s from {s.min():.6g} to {s.max():.6g}); other "
            f"times or speeds, or a higher --smoothness, avoid it"
        )
    return "\n".join(lines)


def _raw(
    options: argparse.Namespace,
    robot: ParallelRobot,
    path: MotionPath,
    given: dict[str, Any],
    folder: Path | None,
) -> Report:
    """The law without its proof: torques sampled as they come."""
    from framework.crossing.plan import unproved_law
    from framework.dynamics.raw import raw_sampling

    law, passages = unproved_law(robot, path, **{k: v for k, v in given.items() if k != "geometry"})
    raw = raw_sampling(robot, path, law, samples=options.samples, geometry=given["geometry"])
    largest = dict(zip(robot.actuator_names, map(float, np.abs(raw.torque).max(axis=0)), strict=True))
    document = {
        "robot": robot.name,
        "raw": True,
        "proved": False,
        "samples": options.samples,
        "largest_sample": largest,
        "passages": [
            {"s": passage.s, "time": passage.time, "wrench": passage.wrench} for passage in passages
        ],
    }
    if folder is not None:
        _write_raw(raw, robot, [passage.time for passage in passages], document, folder)
    lines = [
        f"{robot.name}: raw sampling, proves nothing: {options.samples} samples, largest "
        + ", ".join(f"{joint} {value:.6g} N m" for joint, value in largest.items())
    ]
    lines += [
        f"  singular          t = {passage.time:.9g} s, s = {passage.s:.12g}, t_s . W_p = "
        f"{passage.wrench:.6g}"
        for passage in passages
    ]
    return document, "\n".join(lines)


def _write_raw(
    raw: Any, robot: ParallelRobot, poles: list[float], document: dict[str, Any], folder: Path
) -> None:
    from framework.show.plots import plot_raw_torques, save

    names = ["time"]
    names += [f"motor_angle_{joint}" for joint in robot.actuator_names]
    names += [f"torque_{joint}" for joint in robot.actuator_names]
    names += [f"deflection_{spring}" for spring in robot.elastic_names]
    rows = np.column_stack([raw.time, raw.motor_angle, raw.torque, raw.deflection])
    np.savetxt(folder / "raw.csv", rows, fmt="%.17g", delimiter=",", header=",".join(names), comments="")
    (folder / "raw.json").write_text(json.dumps(document, indent=2, allow_nan=False) + "\n")
    save(lambda: plot_raw_torques(raw, robot, poles), folder / "raw_torques")


# ------------------------------------------------------------------ what the options say


def _load(options: argparse.Namespace) -> ParallelRobot:
    return ParallelRobot.from_description(_describe(options), getattr(options, "flexibility", "rigid"))


def _describe(options: argparse.Namespace) -> RobotDescription:
    """The description in the robot file, or in a file of a foreign dialect and what the options add to it."""
    return read_any(
        robot_file(options.robot),
        platform=getattr(options, "platform", None),
        axes=getattr(options, "axes", None),
        motors=getattr(options, "motors", None),
        reference=_reference(getattr(options, "reference", None) or []),
    )


def _reference(given: Sequence[str]) -> dict[str, float]:
    """Joint values out of JOINT=VALUE."""
    reference: dict[str, float] = {}
    for item in given:
        name, equals, value = item.rpartition("=")
        try:
            number = float(value)
        except ValueError:
            number = float("nan")
        if not (name and equals and np.isfinite(number)):
            raise InvalidInput(f"--reference: needs JOINT=VALUE with a finite number, got {item!r}")
        reference[name] = number
    return reference


def _path(options: argparse.Namespace, robot: ParallelRobot) -> MotionPath:
    """The path of --scene, or the line of --from and --to."""
    ends = (options.start, options.end)
    if options.scene is not None:
        if any(end is not None for end in ends):
            raise InvalidInput("--scene already has a path; give either --scene or --from and --to")
        return scene_path(scene(robot, options.scene))
    if any(end is None for end in ends):
        scenes = ", ".join(robot.description.scenes) or "none"
        raise InvalidInput(f"give --scene (of {robot.name}: {scenes}), or both --from and --to")
    for name, end in zip(("--from", "--to"), ends, strict=True):
        if len(end) != robot.n or not np.all(np.isfinite(end)):
            raise InvalidInput(
                f"{name}: needs {robot.n} finite numbers ({', '.join(robot.axis_names)}), got "
                f"{' '.join(f'{value:g}' for value in end)}"
            )
    return Line(*ends)


def _motion_options(options: argparse.Namespace, robot: ParallelRobot) -> dict[str, Any]:
    """Arguments of `plan_crossing`; what is typed overrides what the scene says."""
    given: dict[str, Any] = {"duration": None, "times": None, "speeds": None, "at": None}
    if options.scene is not None:
        chosen = scene(robot, options.scene)
        given = {key: getattr(chosen, key) for key in given}
    for key in ("duration", "times", "speeds"):
        if getattr(options, key) is not None:
            given[key] = getattr(options, key)
    if given["duration"] is None:
        raise InvalidInput("--duration: required with --from and --to")
    return {**given, "geometry": options.geometry, "smoothness": options.smoothness}


# ------------------------------------------------------------------ the parser


class _Misuse(Exception):
    """argparse found the command line wrong."""


class _OneLineParser(argparse.ArgumentParser):
    def __init__(self, **settings: Any) -> None:
        super().__init__(allow_abbrev=False, **settings)
        # argparse takes -1e-3 for an option: its pattern for negative numbers knows no exponents
        self._negative_number_matcher = re.compile(r"^-(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$")

    def error(self, message: str) -> NoReturn:
        raise _Misuse(f"{message} (see `{self.prog} --help`)")


def _parser() -> argparse.ArgumentParser:
    parser = _OneLineParser(
        prog="crossing",
        description="Carry parallel robots through Type 2 singularities with finite motor torques.",
    )
    parser.set_defaults(json=False)
    parser.add_argument("--version", action="version", version=_version())
    commands = parser.add_subparsers(metavar="COMMAND", required=True, parser_class=_OneLineParser)

    def command(name: str, run: Callable[[argparse.Namespace], Report], text: str) -> Any:
        sub = commands.add_parser(name, help=text, description=text)
        sub.add_argument("--json", action="store_true", help="one JSON object on stdout, nothing else")
        sub.set_defaults(run=run)
        return sub

    command("robots", _robots, "list the catalogue")

    check = command("check", _check, "mobility, rank, redundant rows, masses, closure error, mode")
    _add_robot(check, "catalogue name, or path of a robot file or of a file of a foreign dialect")
    _add_unsaid(check)
    _add_flexibility(check)

    convert = command(
        "convert",
        _convert,
        "write our robot file from another dialect: Gepetto's robot.yaml beside robot.urdf, URDF+ <loop>, "
        "ROS <constraint>, MJCF <equality>",
    )
    _add_robot(convert, "path of a file of a foreign dialect, or catalogue name")
    convert.add_argument("--out", metavar="DIR", required=True, help="write NAME.yaml and NAME.urdf there")
    _add_unsaid(convert)

    locate = command("locate", _locate, "find the singular points on a path")
    _add_robot(locate)
    _add_path(locate)

    plan = command("plan", _plan, "plan a motion through the singular points, with torques and proof")
    _add_robot(plan)
    _add_path(plan)
    _add_flexibility(plan)
    plan.add_argument("--duration", type=float, metavar="T", help="of the motion [s]")
    plan.add_argument("--times", type=float, nargs="*", metavar="t", help="instants of the crossings [s]")
    plan.add_argument("--speeds", type=float, nargs="*", metavar="v", help="s' at the crossings [1/s]")
    plan.add_argument(
        "--geometry",
        choices=("rigid", "deformed"),
        help="forces of the undeformed or of the deformed robot (default: deformed when elastic)",
    )
    plan.add_argument(
        "--smoothness",
        type=int,
        metavar="R",
        help="derivatives of s that vanish at both ends (default: 2 rigid, 4 elastic)",
    )
    plan.add_argument("--out", metavar="DIR", help="write plan.json, motion.csv and figures there")
    plan.add_argument("--samples", type=int, default=1501, metavar="N", help="rows of motion.csv")
    plan.add_argument(
        "--raw",
        action="store_true",
        help="no proof: sample the torques as they come, spikes included, to look at",
    )
    return parser


def _version() -> str:
    return f"crossing {version('parallel-singularity-crossing')}"


def _add_robot(
    parser: argparse.ArgumentParser, text: str = "catalogue name, or path of a robot file"
) -> None:
    parser.add_argument("robot", metavar="ROBOT", help=text)


def _add_unsaid(parser: argparse.ArgumentParser) -> None:
    """What a file of a foreign dialect may leave unsaid."""
    group = parser.add_argument_group("what the file does not say, or says otherwise")
    group.add_argument("--platform", metavar="FRAME", help="frame of the platform")
    group.add_argument("--axes", nargs="+", metavar="AXIS", help="its axes, of x y z rx ry rz")
    group.add_argument("--motors", nargs="+", metavar="JOINT", help="joints with a motor")
    group.add_argument(
        "--reference", nargs="+", metavar="JOINT=VALUE", help="near an assembled configuration [rad, m]"
    )


def _add_flexibility(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--flexibility", choices=FLEXIBILITIES, default="rigid", help="which springs exist (default: rigid)"
    )


def _add_path(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scene", metavar="S", help="a scene of the robot file")
    parser.add_argument(
        "--from", dest="start", type=float, nargs="+", metavar="X", help="first platform point"
    )
    parser.add_argument("--to", dest="end", type=float, nargs="+", metavar="X", help="last platform point")


if __name__ == "__main__":
    raise SystemExit(main())
