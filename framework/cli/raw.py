"""`crossing plan --raw`: the law without its proof, and the torques as they come."""

from __future__ import annotations

import argparse
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from framework.cli.parser import Report
from framework.crossing.plan import law_before_proof
from framework.crossing.request import Request
from framework.dynamics.finite_differences import finite_difference_torques
from framework.errors import InvalidInput
from framework.kinematics.parallel_robot import ParallelRobot
from framework.output import json_text
from framework.singularity.points_on_path import search_path


def report_raw(
    options: argparse.Namespace,
    robot: ParallelRobot,
    request: Request,
    folder: FilePath | None,
) -> Report:
    """Report the law without its proof: raw samples of its torques.

    Raises:
        InvalidInput: the optimal law is asked for, which is nothing without its proof.
    """
    if request.kind == "optimal":
        raise InvalidInput(
            "--raw samples the polynomial law only, which needs no proof to be chosen"
        ).advising({"raw": None})
    if request.keep_limits:
        raise InvalidInput(
            "--keep-limits: is for a plan, and --raw proves none; leave one of them out"
        ).advising({"raw": None})
    searched = search_path(robot, request.path).under(request.external_wrenches)
    law, crossings = law_before_proof(searched, request)
    raw = finite_difference_torques(
        robot,
        request.path,
        law,
        samples=options.samples,
        geometry=request.geometry,
        branch=searched.branch,
    )
    largest = dict(zip(robot.actuator_names, np.abs(raw.torque).max(axis=0), strict=True))
    document = {
        "robot": robot.name,
        "raw": True,
        "proved": False,
        "samples": options.samples,
        # a sample at the singular instant itself can be infinite, for which JSON has no number
        "largest_sample": largest,
        "crossings": [
            {"s": crossing.s, "time": crossing.time, "wrench": crossing.wrench} for crossing in crossings
        ],
    }
    if folder is not None:
        _write_raw(raw, robot, [crossing.time for crossing in crossings], document, folder)
    lines = [
        f"{robot.name}: raw sampling, proves nothing: {options.samples} samples, largest "
        + ", ".join(f"{joint} {value:.6g} N m" for joint, value in largest.items())
    ]
    lines += [
        f"  singular          t = {crossing.time:.9g} s, s = {crossing.s:.12g}, t_s . W_p = "
        f"{crossing.wrench:.6g}"
        for crossing in crossings
    ]
    return document, "\n".join(lines)


def _write_raw(
    raw: Any, robot: ParallelRobot, poles: list[float], document: dict[str, Any], folder: FilePath
) -> None:
    from framework.show.plots import plot_raw_torques, save

    names = ["time"]
    names += [f"motor_angle_{joint}" for joint in robot.actuator_names]
    names += [f"torque_{joint}" for joint in robot.actuator_names]
    names += [f"deflection_{spring}" for spring in robot.elastic_names]
    rows = np.column_stack([raw.time, raw.motor_angle, raw.torque, raw.deflection])
    np.savetxt(folder / "raw.csv", rows, fmt="%.17g", delimiter=",", header=",".join(names), comments="")
    (folder / "raw.json").write_text(json_text(document))
    save(lambda: plot_raw_torques(raw, robot, poles), folder / "raw_torques")
