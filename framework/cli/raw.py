"""`crossing plan --raw`: the law without its proof, and the torques as they come."""

from __future__ import annotations

import argparse
import json
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from framework.cli.parser import Report
from framework.crossing.plan import unproved_law
from framework.dynamics.raw import raw_sampling
from framework.model import ParallelRobot
from framework.motion.path import Path


def report_raw(
    options: argparse.Namespace,
    robot: ParallelRobot,
    path: Path,
    given: dict[str, Any],
    folder: FilePath | None,
) -> Report:
    """The law without its proof: torques sampled as they come."""
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
    raw: Any, robot: ParallelRobot, poles: list[float], document: dict[str, Any], folder: FilePath
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
