"""The positions that the URDF allows its joints, and which of them a set of configurations leaves.

Limits are `lower` and `upper` of a revolute or prismatic joint. Nothing is limited where the two are left out
or are the same, as exporters write them that know of none; one left out alone is 0, as the URDF has it.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from framework.arrays import Array

ROUNDING = 1e-9  # [rad, m] beyond a limit that is still on it


class JointLimit(NamedTuple):
    """What a URDF says of one joint; `coordinate` is its place in q."""

    joint: str
    coordinate: int
    lower: float
    upper: float
    unit: str  # rad or m


def joint_limits(urdf: ElementTree.Element, model: pin.Model) -> tuple[JointLimit, ...]:
    """The limited joints, in the order of the URDF."""
    found = []
    for joint in urdf.findall("joint"):
        limit, kind = joint.find("limit"), joint.get("type")
        if limit is None or kind not in ("revolute", "prismatic"):
            continue
        lower, upper = (float(limit.get(key, "0")) for key in ("lower", "upper"))
        if lower == upper:
            continue
        name = joint.get("name", "")
        place = model.joints[model.getJointId(name)].idx_q
        found.append(JointLimit(name, place, lower, upper, "m" if kind == "prismatic" else "rad"))
    return tuple(found)


def positions_beyond_limits(limits: Sequence[JointLimit], q: Array) -> dict[str, str]:
    """What is beyond limits among configurations q (T, nq), by joint: `position -4.27 rad of -3.2`."""
    found = {}
    for joint, coordinate, lower, upper, unit in limits:
        least, most = float(np.min(q[:, coordinate])), float(np.max(q[:, coordinate]))
        beyond = []
        if least < lower - ROUNDING:
            beyond.append(f"{least:.6g} {unit} of {lower:.6g}")
        if most > upper + ROUNDING:
            beyond.append(f"{most:.6g} {unit} of {upper:.6g}")
        if beyond:
            found[joint] = "position " + " and ".join(beyond)
    return found
