"""`crossing simulate`: check a plan by forward dynamics under the planned torques."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path as FilePath

import numpy as np

from framework.cli import arguments
from framework.cli.commands import OneLineParser
from framework.cli.parser import Report, add_number, add_out, add_path_and_motion, add_robot_or_plan
from framework.errors import InvalidInput, NoAnswer
from framework.identification.recording import make_sensors, record_sensors
from framework.numerics.output import json_text, write_csv
from framework.planning.result import CrossingPlan
from framework.simulation import Simulation, simulate
from framework.simulation.methods import METHODS
from framework.tolerances import MOTION_OFF_PATH

HEAD = (
    "{0.robot.name}, {0.robot.flexibility}: {0.duration:g} s of forward dynamics, {0.method} method, "
    "{0.steps} steps{1}, {0.seconds:.2g} s"
)
OFF_PATH = (
    "{0.robot.name}: the planned torques do not bring the robot along its path: it comes off by {1}; energy "
    "balances to {0.energy_error:.1e}, loops are closed to {0.closure_error:.1e}"
)
TRACKING = "  tracking error    {0.tracking_error:.2e} {1} from the planned path"
TURNING = "                    {0.turning_error:.2e} rad from the planned orientation"
FRAME = "                    {0.frame_error:.2e} m of {0.robot.description.platform.frame} from its place"
DRIFT = """\
  drift             loops closed to {0.closure_error:.1e} m or rad
  energy            balances to {0.energy_error:.1e} of what is exchanged"""


def add_simulate_options(parser: OneLineParser) -> None:
    """Add the arguments of `crossing simulate`."""
    add_robot_or_plan(parser)
    add_path_and_motion(parser)
    group = parser.topic("the simulation")
    group.add_argument(
        "--method",
        choices=tuple(METHODS),
        default="reference",
        help="reference: steps to 1e-12; stiff: to 1e-7; fast: fixed ones; explicit (deprecated): reference",
    )
    add_number(group, "--tolerance", "E", "largest error of reference and stiff [rad, robot lengths]")
    add_number(group, "--step", "H", "time step of fast, longest one of others [s]")
    add_number(group, "--damping", "D", "viscous, on every joint [N m s/rad, N s/m]")
    parser.add_argument(
        "--sensors",
        nargs="*",
        metavar="NAME=VALUE",
        help="with --out: write sensors.csv too, what sensors record, with noise and steps; of rate [Hz], "
        "angle_noise, angle_step, slide_step, torque_noise, torque_step, platform_noise, seed",
    )
    add_out(parser, "write simulation.json and simulation.csv there")


def run_simulate(options: Namespace) -> Report:
    """Plan or read a plan, simulate its torques and report the tracking error."""
    sensors = None
    if options.sensors is not None:
        if options.out is None:
            words = "--sensors: writes sensors.csv into a folder; give --out"
            raise InvalidInput(words).advising({"out": "run"})
        sensors = make_sensors(arguments.named_numbers("--sensors", options.sensors, "NAME=VALUE"))
    files = ("simulation.csv",) if sensors is None else ("simulation.csv", "sensors.csv")
    with arguments.written_out(options, "simulation.json", files) as folder:
        plan = arguments.load_or_plan(options)
        result = simulate(
            plan.robot,
            plan.dynamics,
            method=options.method,
            tolerance=options.tolerance,
            step=options.step,
            damping=options.damping,
            progress=options.progress.start("simulating", 1.0, "the motion"),
        )
        document = result.to_dict()
        if folder is not None:
            (folder / "simulation.json").write_text(json_text(document))
            _write_csv(result, plan, folder / "simulation.csv")
            if sensors is not None:
                (folder / "sensors.csv").write_text(record_sensors(result, plan.torque, sensors).as_csv())
    unit, allowed = _unit_and_limit(result)
    tracking, turning = result.tracking_error or 0.0, result.turning_error or 0.0
    if tracking > allowed or turning > MOTION_OFF_PATH:
        turned = "" if result.turning_error is None else f" and {turning:.3g} rad"
        raise NoAnswer(OFF_PATH.format(result, f"{tracking:.3g} {unit}{turned}"))
    return document, simulation_lines(result)


def _unit_and_limit(result: Simulation) -> tuple[str, float]:
    """Return the unit of tracking errors, and the largest error on a path."""
    moves = result.robot.translations.any()
    return ("m", MOTION_OFF_PATH * result.robot.length) if moves else ("rad", MOTION_OFF_PATH)


def simulation_lines(result: Simulation) -> list[str]:
    """Return the report on a simulation, in words."""
    unit, _ = _unit_and_limit(result)
    iterations = "" if METHODS[result.method].stages == 0 else f", {result.iterations} iterations"
    lines = [HEAD.format(result, iterations)]
    if result.tracking_error is not None:
        lines.append(TRACKING.format(result, unit))
    if result.turning_error is not None:
        lines.append(TURNING.format(result))
    if result.frame_error is not None:
        lines.append(FRAME.format(result))
    return [*lines, DRIFT.format(result)]


def _write_csv(result: Simulation, plan: CrossingPlan, file: FilePath) -> None:
    """Write platform, planned platform, motor angles and deflections over time, SI units."""
    robot = result.robot
    times = result.times
    q = result.q
    planned = plan.platform(np.minimum(times, plan.duration))
    motor_angles = robot.gear_ratio * robot.actuated_coordinates(q)
    deflections = robot.coordinates.positions(q)[:, robot.elastic]
    names = {
        "platform": robot.axis_names,
        "planned": robot.axis_names,
        "motor_angle": robot.actuator_names,
        "deflection": robot.elastic_names,
    }
    rows = np.column_stack([times, result.platform(times), planned, motor_angles, deflections])
    write_csv(file, names, rows)
