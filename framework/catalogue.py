"""The robots known by name. Any installed package can add its own.

A package registers a mapping from names to `CatalogueEntry` under the entry point group
`crossing.catalogue`; this project's `robots` is the first of them.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path

from framework.errors import InvalidInput, choose_from
from framework.kinematics.parallel_robot import ParallelRobot


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


def catalogue() -> Mapping[str, CatalogueEntry]:
    """Return all registered robots, by name."""
    entries: dict[str, CatalogueEntry] = {}
    for point in entry_points(group="crossing.catalogue"):
        entries.update(point.load())
    return dict(sorted(entries.items()))


def robot_file(name_or_path: str) -> Path:
    """Return the file, ours or of a foreign dialect, that a catalogue name or a path stands for.

    Raises:
        InvalidInput: neither a known name nor a robot file.
    """
    entries = catalogue()
    if name_or_path in entries:
        return entries[name_or_path].file
    path = Path(name_or_path)
    if path.suffix in (".yaml", ".yml", ".urdf", ".xml", ".mjcf", ".sdf") or os.path.exists(path):
        return path
    raise InvalidInput(
        f"{choose_from('robot', name_or_path, entries)}, or give the path of a robot file (.yaml)"
    )
