"""Where the robot files are: beside the packages in a checkout, inside `robots` in the wheel."""

from __future__ import annotations

from pathlib import Path

_HERE = Path(__file__).resolve().parent
URDF = _HERE / "urdf" if (_HERE / "urdf").is_dir() else _HERE.parent / "urdf"


def robot_file(name: str) -> Path:
    """The robot file of a mechanism of this project."""
    return URDF / name / f"{name}.yaml"
