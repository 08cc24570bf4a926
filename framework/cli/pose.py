"""`crossing pose`: all joints of a pose, by its motors or its platform, and its loads in motion."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import asdict, replace
from pathlib import Path as FilePath

import numpy as np

from framework.atlas.nearest import nearest_pose
from framework.cli import arguments
from framework.cli.commands import OneLineParser
from framework.cli.parser import (
    Report,
    add_flexibility,
    add_number,
    add_options,
    add_overwrite,
    add_reference,
    add_robot,
    add_wrenches,
    not_empty,
)
from framework.dynamics.platform_wrench import platform_limits
from framework.dynamics.pointwise_dynamics import dynamics_at
from framework.dynamics.stiffness import platform_stiffness
from framework.errors import (
    InvalidInput,
    NoAnswer,
    NotAssembled,
    Type1Singularity,
    check_choice,
    finite_numbers,
)
from framework.kinematics.assembly import remark_on_turns
from framework.kinematics.assembly_search import can_close, find_closed_pose
from framework.kinematics.continuation.forward_kinematics import forward_kinematics
from framework.kinematics.continuation.tracking import assemble, remark_on_reach
from framework.kinematics.diagnostics.diagnosis import describe_pose
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array
from framework.numerics.output import Document, select_fields, write_files
from framework.planning.plan_facts import excess_facts, join_facts, torque_facts
from framework.proofs.assembly_modes import assembly_modes
from framework.proofs.working_modes import working_modes
from framework.singularity.pose_classes import Classification, classify

HEAD = """\
{robot}, {flexibility}
  platform          {platform}
  motors            {motor_joints}
  motor angles      {motor_angles} (motor side)
  joints            {joints}
  mode              working {working_mode:+d}, assembly {assembly_mode:+d}"""
NEAREST = "the nearest pose found within the joints' ranges has {1}, {0.distance:.6g} {0.unit} away: {2}"
DISTANCES = "  distances         g {0.g:.3g}, sigma_A {0.sigma_A:.3g} (length {0.length:.3g} m){1}"
SHOWN_MODES = 6  # vibrations that are listed
OF_ONE_POSE = (
    "picture",
    "torque_limit",
    "speed_limit",
    "velocity",
    "acceleration",
    "wrench",
    "wrench_on",
)  # options
WORST = (
    "  worst torque      {0.motor_torque_largest:.3g} {1} of one motor, norm {0.motor_torque_norm:.3g} "
    "(motor side), to hold a unit force in any direction"
)


def add_pose_options(parser: OneLineParser) -> None:
    """Add the arguments of `crossing pose`."""
    add_robot(parser)
    add_reference(parser)
    group = parser.topic("which pose")
    add_number(
        group,
        "--motors",
        "Q",
        "joints with motors, joint side of the gears [rad, m], in the order of the robot file",
        dest="motor_joints",
        nargs="+",
    )
    add_number(group, "--platform", "X", "its coordinates [m, rad]", dest="point", nargs="+")
    add_number(
        group,
        "--near-platform",
        "X",
        "coordinates near which the loops are to be assembled, whatever the reference [m, rad]",
        nargs="+",
    )
    group.add_argument(
        "--all",
        dest="every",
        action="store_true",
        help="every pose for these motors (assembly modes), or every way to this platform (working modes)",
    )
    group = parser.topic("its motion")
    add_number(
        group,
        "--velocity",
        "V",
        "rates of the platform's coordinates [m/s, rad/s]: with them, --acceleration or a wrench, the "
        "motor torques and the forces in loops and joints at that instant, springs rigid (default: 0)",
        nargs="+",
    )
    add_number(group, "--acceleration", "A", "their rates [m/s2, rad/s2] (default: 0)", nargs="+")
    add_flexibility(parser)
    parser.add_argument(
        "--picture",
        type=not_empty,
        metavar="FILE",
        help="of a robot with springs: draw the platform's softest direction, and the shapes of its first "
        "vibrations (.png, .svg, .pdf)",
    )
    add_overwrite(parser)
    add_wrenches(parser)
    add_options(parser, "torque_limit", "speed_limit")


def run_pose(options: Namespace) -> Report:
    """Report the pose of motor angles or of a platform point, springs at rest."""
    if options.near_platform is not None:
        return _report_near(options)
    robot = arguments.load(options)
    arguments.check_page(options.picture, options, "--picture")
    if (options.motor_joints is None) == (options.point is None):
        motors = options.motor_joints or robot.actuated_coordinates(robot.reference.q[None])[0].tolist()
        remedy = {"platform": None, "motors": motors}
        raise InvalidInput("give either --motors or --platform").advising(remedy)
    stated = [name for name in OF_ONE_POSE if getattr(options, name) is not None]
    if not options.every:
        return _report_pose(robot, _close_pose(robot, options, advise_all=not stated), options)
    if stated:
        flag = arguments.flag_of(stated[0])
        message = f"--all: lists poses alone; {flag} is for a single pose"
        raise InvalidInput(message).advising(dict.fromkeys(stated))
    report_all = _report_working_modes if options.motor_joints is None else _report_assembly_modes
    return report_all(robot, options)


def _report_near(options: Namespace) -> Report:
    """Report the pose within ranges that a search finds near --near-platform, and its reference."""
    for name in ("motor_joints", "point", "every"):
        if getattr(options, name) not in (None, False):
            message = "--near-platform: assembles one pose; leave --motors, --platform and --all out"
            raise InvalidInput(message).advising({"motors": None, "platform": None, "all": None})
    mechanism = arguments.load_mechanism(options)
    description = mechanism.description
    axes = description.platform.joints or description.platform.axes
    target = finite_numbers(f"--near-platform ({', '.join(axes)})", options.near_platform, len(axes))
    found = find_closed_pose(mechanism, target).q
    reference = mechanism.reference_values(found)
    posed = replace(description, reference=reference)
    robot = ParallelRobot.from_description(posed, flexibility=mechanism.flexibility)
    q, sentence = robot.reference.q, ""
    try:
        nearest = nearest_pose(robot, target)
    except NotAssembled as failure:  # out of reach, and the search has ended at Type 1
        sentence = f"{robot.place(robot.reference.x)}; {failure.sentence}"
    else:
        q = nearest.q
        if nearest.stops:
            sentence = NEAREST.format(nearest, robot.place(nearest.x), " and ".join(nearest.stops))
    facts, lines = _report_pose(robot, q, options)
    lines += [f"  near              {sentence}"] if sentence else []
    lines.append(_reference_to_paste(robot, q))
    return {**facts, "reference": robot.reference_values(q)}, lines


def _report_pose(robot: ParallelRobot, q: Array, options: Namespace) -> Report:
    """Report the pose q (nq,): coordinates, modes, singularity, limits and loads."""
    pose = describe_pose(robot, q)
    document = asdict(pose)
    by_name = ("platform", "motor_joints", "motor_angles", "joints")
    words = {key: _format_values(document[key]) for key in by_name}
    lines = [HEAD.format_map(document | words)]
    singularity, limits = _report_singularity(robot, q), _report_limits(robot, q, options)
    has_stiffness = robot.has_springs or options.picture is not None
    stiffness = _report_stiffness(robot, q, options) if has_stiffness else ({}, [])
    for facts, sentences in (singularity, limits, stiffness, _report_loads(robot, q, options)):
        document |= facts
        lines += sentences
    lines.append(f"  closures          closed to {pose.closure_error:.1e} m or rad")
    lines += [fact.line for fact in excess_facts(pose.exceeded)]
    if pose.exceeded and options.point is not None:
        _, sentence, document["nearest"] = _find_nearest(robot, options.point)
        lines.append(f"  within ranges     {sentence}")
    return document, lines


def _report_singularity(robot: ParallelRobot, q: Array) -> Report:
    """Report the singularity class of a pose, and how far the pose is from singularities."""
    classification = classify(robot, q)
    lines = [f"  singularity       {classification.sentence}"]
    for twist in classification.twists:
        components = dict(zip(robot.axis_names, twist, strict=True))
        lines.append(f"  t_s               {_format_values(components, 6)}")
    angles = np.rad2deg(classification.transmission_angle)
    named = dict(zip(robot.actuator_names, angles, strict=True))
    transmission = f", transmission {_format_values(named, 4)} degrees" * bool(np.isfinite(angles).all())
    lines.append(DISTANCES.format(classification, transmission))
    if not np.isnan(classification.torque_norm):  # NaN for a platform that only turns
        units = " or ".join(f"{unit}/N" for unit in sorted(set(robot.torque_units)))
        lines.append(WORST.format(classification, units))
    return {"singularity": _singularity_document(classification)}, lines


def _report_stiffness(robot: ParallelRobot, q: Array, options: Namespace) -> Report:
    """Report stiffness and vibrations of an unloaded pose with locked motors; draw --picture."""
    try:
        result = platform_stiffness(robot, q)
    except InvalidInput as failure:  # springs that leave the platform rigid along some axis
        if options.picture is not None:
            if robot.has_springs or not robot.description.springs:
                raise failure.advising({"picture": None}) from None
            elastic = robot.description.least_flexibility("flexible_links")
            raise failure.advising({"flexibility": elastic}) from None
        return {}, []
    names = robot.axis_names
    along = dict(zip(names, result.along_axes.tolist(), strict=True))
    softest = dict(zip(names, result.softest_direction.tolist(), strict=True))
    lines = [
        f"  stiffness         {_format_values(along)} (N/m, N m/rad; a force along the axis, motors locked)",
        f"  softest           {result.softest_in_words}: {_format_values(softest, 3)} (robot lengths, rad)",
    ]
    lines += [
        f"    row {name:<13} " + " ".join(f"{value:.4g}" for value in row)
        for name, row in zip(names, result.stiffness, strict=True)
    ]
    modes = []
    for frequency, mode in zip(result.frequencies[:SHOWN_MODES], result.platform_modes, strict=False):
        moves = mode / robot.platform_scale
        largest = np.abs(moves).max()
        shape = dict(zip(names, moves / largest if largest else moves, strict=True))
        modes.append({"frequency": float(frequency), "shape": shape})
        lines.append(f"  vibration         {frequency:.4g} Hz, platform {_format_values(shape, 2)}")
    facts = {"matrix": result.stiffness, "along": along, "softest": softest, "vibrations": modes}
    facts["softest_in_words"] = result.softest_in_words
    if options.picture is not None:
        from framework.show.vibration_figures import modes_picture  # matplotlib takes time to import

        file = FilePath(options.picture)
        check_choice("--picture: kind of file", file.suffix[1:], ("png", "svg", "pdf"))
        picture = modes_picture(result, file.suffix[1:])
        write_files({file: picture}, option="--picture", overwrite=options.overwrite)
        lines.append(f"  drawn             its softest direction and vibrations, into {options.picture}")
    return {"stiffness": facts}, lines


def _singularity_document(classification: Classification) -> Document:
    """Return the singularity class of a pose for JSON."""
    return {"regular": classification.regular, **vars(classification)}


def _close_pose(robot: ParallelRobot, options: Namespace, *, advise_all: bool) -> Array:
    """Compute the pose q (nq,) of --motors or --platform.

    Raises:
        NotAssembled, Type1Singularity: no pose in the modes of the reference. With `advise_all` the remedy
            is --all, if a search finds a pose in another mode.
    """
    motor_joints = options.motor_joints
    point = options.point
    try:
        closed = assemble(robot, point) if motor_joints is None else forward_kinematics(robot, motor_joints)
    except (NotAssembled, Type1Singularity) as failure:  # another mode may have such a pose
        impossible = addition = _explain_failure(robot, options)
        if point is not None:
            q, addition, nearest = _find_nearest(robot, point)
            if not nearest["stops"]:
                options.warnings.append(
                    "no straight path from the reference leads there, but another one does"
                )
                return q
            failure = failure.with_changes(nearest=nearest)
        end = None if point is None else np.array(point)  # in place of motors
        columns = robot.actuated if end is None else robot.actuated[:0]
        motors = np.array(motor_joints if end is None else ())
        has_pose = advise_all and not impossible and can_close(robot, columns, motors, end)  # in any mode
        raise failure.adding(addition).advising({"all": True} if has_pose else None) from None
    return closed.q


def _find_nearest(robot: ParallelRobot, point: list[float]) -> tuple[Array, str, Document]:
    """Find the pose nearest to a platform point: q (nq,), a sentence, the entry for JSON."""
    try:
        nearest = nearest_pose(robot, point)
    except NotAssembled as failure:  # no pose within ranges
        return failure.q, failure.sentence, {"stops": [str(failure)]}
    motors = robot.actuated_coordinates(nearest.q[None])[0].tolist()
    document = {
        "platform": dict(zip(robot.axis_names, nearest.x.tolist(), strict=True)),
        "motor_joints": dict(zip(robot.actuator_names, motors, strict=True)),
        **select_fields(nearest, "distance", "unit", "stops"),
    }
    place = robot.place(nearest.x)
    sentence = f"another pose with {place}"
    if nearest.stops:
        sentence = NEAREST.format(nearest, place, " and ".join(nearest.stops))
    return nearest.q, sentence, document


def _report_limits(robot: ParallelRobot, q: Array, options: Namespace) -> Report:
    """Report the platform's limits; empty at a Type 1 singularity, or if no motor has a limit."""
    try:
        limits = platform_limits(robot, q, **arguments.typed_options(options)).polytopes
    except NotAssembled:
        return {"limits": {}}, []
    document: Document = {}
    lines = []
    units = [("N", "m/s") if moves else ("N m", "rad/s") for moves in robot.translations]
    alone = ", each alone" if robot.n > 1 else ""
    for k, (name, polytope) in enumerate(limits.items()):
        ranges = polytope.axis_ranges()
        document[name] = {"alone": ranges, "bounds": polytope.bounds()}
        document[name] |= select_fields(polytope, "vertices", "normals", "offsets")
        words = [
            f"{axis} {low:.4g} .. {high:.4g} {unit[k]}"
            for axis, (low, high), unit in zip(robot.axis_names, ranges, units, strict=True)
        ]
        lines.append(f"  {name + ' limits':<17} {', '.join(words)}{alone}")
    if lines:
        lines.append(f"  {'':<17} of the motors in this pose; rigid, without contact, the weight held")
    return {"limits": document}, lines


def _report_loads(robot: ParallelRobot, q: Array, options: Namespace) -> Report:
    """Report the forces of motors, loops and joints.

    Empty without a velocity, an acceleration or a wrench among the options.
    """
    wrenches = arguments.wrenches(options, robot)
    if options.velocity is None and options.acceleration is None and not wrenches:
        return {}, []
    instant = dynamics_at(robot, q, dx=options.velocity, ddx=options.acceleration, **wrenches)
    torques = torque_facts(robot, instant.torque.round(12) + 0.0, 9)
    lines = [f"  motor torque      {join_facts(torques)} (motor side)"]
    for label, forces in (("loop", instant.loop_forces), ("joint", instant.reactions)):
        for name, wrench in forces.items():
            values = ["-" if np.isnan(value) else f"{round(value, 12) + 0.0:.6g}" for value in wrench]
            force, moment = ", ".join(values[:3]), ", ".join(values[3:])
            lines.append(f"  {label:<17} {name}: force ({force}) N, moment ({moment}) N m")
    if instant.indeterminate:
        lines.append(f"  indeterminate     {', '.join(instant.indeterminate)}")
    document = select_fields(instant, "loop_forces", "reactions", "indeterminate")
    document["torque"] = dict(zip(robot.actuator_names, instant.torque, strict=True))
    return {"dynamics": document}, lines


def _explain_failure(robot: ParallelRobot, options: Namespace) -> str:
    """Return a clause on units that seem mistaken; empty if none does.

    Motors that turn more than once suggest degrees, a platform out of reach suggests millimetres.
    """
    if options.point is not None:
        return remark_on_reach(robot, np.array(options.point)[robot.platform.sliding])
    return remark_on_turns(robot, dict(zip(robot.actuator_names, options.motor_joints, strict=True)))


def _report_assembly_modes(robot: ParallelRobot, options: Namespace) -> Report:
    """Report all poses for the motor angles asked for."""
    assembly = assembly_modes(robot, options.motor_joints)
    degrees = "" if assembly.modes else _explain_failure(robot, options)
    if degrees:
        options.warnings.append(degrees)
    lines = [f"  assembly modes    {assembly.sentence}"]
    modes = []
    for mode in assembly.modes:
        pose = describe_pose(robot, mode.q)
        kind = classify(robot, mode.q)
        lines.append(f"  platform          {_format_values(pose.platform)}; g {kind.g:.3g}, {kind.sentence}")
        lines.append(_reference_to_paste(robot, mode.q))
        modes.append(asdict(pose) | {"proved": mode.proved, "singularity": _singularity_document(kind)})
    about = select_fields(assembly, "complete", "status", "bound", "method")
    paths = assembly.count and asdict(assembly.count)
    return _report_modes(robot, {"assembly_modes": {**about, "paths": paths, "modes": modes}}, lines)


def _report_working_modes(robot: ParallelRobot, options: Namespace) -> Report:
    """Report all working modes of a platform point; refuse without any."""
    working = working_modes(robot, options.point)
    if not working.modes:
        refusal = NoAnswer("out of reach: no pose was found with this platform", name=robot.name)
        options.refusal = refusal.adding(_explain_failure(robot, options))
    lines = [f"  working modes     {working.sentence}"]
    modes = []
    for mode in working.modes:
        pose = describe_pose(robot, mode.q)
        signs = "".join("+" if sign > 0 else "-" for sign in mode.signs)
        remarks = ("" if mode.proved else "; not proved") + (
            "" if mode.within_limits else "; beyond the joints' limits"
        )
        lines.append(f"  {signs:17s} {_format_values(pose.motor_joints)}{remarks}")
        lines.append(_reference_to_paste(robot, mode.q))
        modes.append(asdict(pose) | {"signs": mode.signs, "proved": mode.proved})
    about = select_fields(working, "status", "solutions", "legs", "proved_legs")
    about |= {"complete": working.status == "proved", "modes": modes}
    return _report_modes(robot, {"working_modes": about}, lines)


def _reference_to_paste(robot: ParallelRobot, q: Array) -> str:
    """Return the line of a robot file that selects the modes of q (nq,)."""
    values = ", ".join(f"{name}: {value + 0.0:.9g}" for name, value in robot.reference_values(q).items())
    return f"  reference         {{{values}}}"


def _report_modes(robot: ParallelRobot, facts: Document, lines: list[str]) -> Report:
    """Return a report on all modes of a robot."""
    head = {"robot": robot.name, "flexibility": robot.flexibility}
    return head | facts, [", ".join(head.values()), *lines]


def _format_values(values: dict[str, float], digits: int = 9) -> str:
    """State values by name; rounding to 12 decimals and adding 0.0 avoids -0."""
    return ", ".join(f"{name} {round(value, 12) + 0.0:.{digits}g}" for name, value in values.items())
