"""The robots known by name, and the way from a name or a file to a robot.

A file of `robots` with an `ENTRY` is in the catalogue; nothing else needs to know it. Other packages add
theirs: mappings from names to `CatalogueEntry`, registered under the entry point group `crossing.catalogue`.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from runpy import run_path
from typing import Never

from framework.errors import InvalidInput, RobotFileError, choose_from, did_you_mean, short
from framework.kinematics.parallel_robot import ParallelRobot

# By their place and not by name, which a robots.py of the user's own would hide.
_ROBOTS = Path(__file__).resolve().parents[1] / "robots"
_IN_WHEEL = _ROBOTS / "urdf"
URDF = _IN_WHEEL if _IN_WHEEL.is_dir() else _ROBOTS.parent / "urdf"


@dataclass(frozen=True)
class CatalogueEntry:
    """A mechanism of the catalogue: its robot file, its description and its source."""

    file: Path
    summary: str
    source: str
    singularities: tuple[str, ...] = ()  # kinds that its scenes and tests meet
    why: str = ""  # what its Type 2 singularities look like, one sentence

    @property
    def name(self) -> str:
        return self.file.stem

    def load(self, *, flexibility: str = "rigid") -> ParallelRobot:
        """Return the robot with the springs of one flexibility; raise RobotFileError for an unknown one."""
        return ParallelRobot.from_file(self.file, flexibility=flexibility)


def own_file(name: str) -> Path:
    """Return the robot file of a mechanism of this project."""
    return URDF / name / f"{name}.yaml"


@cache
def own_robots() -> Mapping[str, CatalogueEntry]:
    """Return the robots of this project, by name."""
    entries = [run_path(str(file)).get("ENTRY") for file in sorted(_ROBOTS.glob("[!_]*.py"))]
    return {entry.name: entry for entry in entries if entry is not None}


def catalogue() -> Mapping[str, CatalogueEntry]:
    """Return all registered robots, by name."""
    from importlib.metadata import entry_points  # takes time to import

    entries = dict(own_robots())
    for point in entry_points(group="crossing.catalogue"):
        entries.update(point.load())
    return dict(sorted(entries.items()))


def find_entry(name: str) -> CatalogueEntry | None:
    """Return the robot of a name, first of our own: to look for packages with others takes time."""
    return own_robots().get(name) or catalogue().get(name)


def robot_file(name_or_path: str | os.PathLike[str], *, others: str = "") -> Path:
    """Return the file, ours or of a foreign dialect, that a catalogue name or a path stands for.

    Args:
        others: what else would do, for the complaint.

    Raises:
        InvalidInput: neither a known name nor a robot file; names a file in the folder that is alike.
    """
    if isinstance(name_or_path, str):
        entry = find_entry(name_or_path)
        if entry is not None:
            return entry.file
    if isinstance(name_or_path, str | os.PathLike):
        path = Path(name_or_path)
        if not os.path.lexists(path) and os.path.isdir(path.parent):
            hint = did_you_mean(path.name, os.listdir(path.parent)) if path.suffix else ""
            if hint:
                raise RobotFileError(f"{path}: there is no such file{hint}")
        if path.suffix in (".yaml", ".yml", ".urdf", ".xml", ".mjcf", ".sdf") or os.path.exists(path):
            return path
    unknown = choose_from("robot", name_or_path, catalogue())
    raise InvalidInput(f"{unknown}; or give the path of a robot file (.yaml){others}")


def load_robot(
    name_or_path: str | os.PathLike[str],
    *misplaced: Never,
    flexibility: str = "rigid",
    parameters: Mapping[str, float] | None = None,
    reference: Mapping[str, float] | None = None,
) -> ParallelRobot:
    """Load a robot by its name in the catalogue, or by the path of its robot file.

    Args:
        name_or_path: a name that `crossing robots` lists, such as "five_bar"; or a path, "my_robot.yaml".
        flexibility: which of the springs in the file exist: "rigid", "flexible_joints" or "flexible_links".
        parameters: values in place of those that the file declares under `parameters`, by name.
        reference: joint positions by name [rad, m] near an assembled pose, in place of the file's.

    Returns:
        The robot, assembled at the reference of its file.

    Raises:
        InvalidInput: an unknown name or flexibility; lists the valid ones.
        RobotFileError: the file cannot be read, or its robot cannot be what it says.
        NotAssembled, SingularReference: the loops do not close at the reference, or it is singular.

    Example:
        >>> from framework import load_robot
        >>> load_robot("five_bar").actuator_names
        ('left_motor', 'right_motor')
    """
    if misplaced:
        given = short(misplaced[0])
        raise InvalidInput(f"flexibility: has to be given by name, flexibility={given}, got {given} alone")
    return ParallelRobot.from_file(
        robot_file(name_or_path), flexibility=flexibility, parameters=parameters, reference=reference
    )
