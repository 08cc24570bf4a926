"""The ankle of the MJCF leg in tests/data/dialects, made fit to be planned as notebook 07 does it."""

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np

from framework import ParallelRobot

FILE = Path(__file__).parents[2] / "data" / "dialects" / "humanoid_leg.xml"
SAID = {"base": "left_knee_pitch_link", "platform": "left_ankle_roll_link", "axes": ["ry", "rx"]}


def with_thin_rods(text: str) -> str:
    """MJCF whose rods on balls have their mass on a line, and no armature."""
    root = ElementTree.fromstring(text)
    for body in root.iter("body"):
        ball = body.find("joint[@type='ball']")
        if ball is not None:
            ball.set("armature", "0")
            along = np.array(body.find("geom").get("fromto").split(), float)[3:]
            inertial = body.find("inertial")
            inertia = float(inertial.get("mass")) / 12 * (along @ along * np.eye(3) - np.outer(along, along))
            del inertial.attrib["diaginertia"]
            entries = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
            inertial.set("fullinertia", " ".join(map(repr, entries.tolist())))
    return ElementTree.tostring(root, encoding="unicode")


def ankle(folder: Path, text: str | None = None, **said: object) -> ParallelRobot:
    """The ankle of the leg file, or of another text of it."""
    file = folder / "leg.xml"
    file.write_text(with_thin_rods(FILE.read_text()) if text is None else text)
    return ParallelRobot.from_file(file, **{**SAID, **said})
