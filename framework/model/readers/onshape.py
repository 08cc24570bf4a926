"""URDFs of onshape-to-robot, whose loops are pairs of links: `closing_NAME_1` and `closing_NAME_2`.

A mate named closing_NAME in the CAD makes the two (onshape-to-robot.readthedocs.io, kinematic loops); the
file says where they are, and not of which kind the mate was. Their origins coincide, as in the exporter's own
use of them (a relative position of zero in PlaCo, `connect` in MuJoCo): a ball. A hinge whose axis nothing
else holds has a second pair on it, `closing_NAME_1_z` and `closing_NAME_2_z`. The file says nothing about
platform and motors.
"""

from __future__ import annotations

import re

from framework.errors import RobotFileError
from framework.model.description import Closure, locked_axes
from framework.model.readers.urdf_tree import UrdfTree

_END = re.compile(r"closing_(?P<name>.+)_(?P<end>[12])(?P<second>_z)?")


def read_closing_frames(tree: UrdfTree) -> list[Closure]:
    """Return the closures of a tree with closing frames.

    Raises:
        RobotFileError: one of a pair of closing frames is missing.
    """
    pairs: dict[str, dict[str, str]] = {}
    for link in tree.links:
        if match := _END.fullmatch(link):
            pairs.setdefault(match["name"] + (match["second"] or ""), {})[match["end"]] = link
    closures = []
    for name, ends in pairs.items():
        if len(ends) < 2:
            (only_link,) = ends.values()
            end, missing = ("1", "2") if "1" in ends else ("2", "1")
            missing = re.sub(rf"_{end}(_z)?$", rf"_{missing}\1", only_link)
            raise RobotFileError(f"link {only_link!r}: the other end of its loop, {missing!r}, is missing")
        closures.append(Closure(name, (ends["1"], ends["2"]), locked_axes("spherical")))
    return closures
