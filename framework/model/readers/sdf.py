"""SDF is recognised and refused: no parser for it comes with what this package is built on."""

from __future__ import annotations

from framework.errors import RobotFileError


def raise_for_sdf() -> None:
    """Raise the error that points to a converter.

    Raises:
        RobotFileError: always.
    """
    raise RobotFileError(
        "<sdf>: SDF is not read; convert it first: to MJCF with sdf2mjcf (Python package sdformat-mjcf), "
        "then close the loops with <equality>, or to URDF, then declare the loops in a robot file"
    )
