"""Andrews' squeezing mechanism: a problem that others have published, with the solution to more digits.

F. Mazzia and C. Magherini, Test Set for Initial Value Problem Solvers, release 2.4, University of Bari 2008,
chapter "Andrews' squeezing mechanism"; dimensions from W. Schiehlen (ed.), Multibody Systems Handbook 1990.
"""

from functools import cache
from pathlib import Path

from framework import ParallelRobot
from framework.numerics.arrays import Array

FILE = Path(__file__).parent / "data" / "andrews_squeezer" / "andrews_squeezer.yaml"
TORQUE, DURATION = 0.033, 0.03  # [N m], [s]
REFERENCE = FILE.with_name("angles.txt")  # at the end, by two programs; see tests/benchmarks/README.md
ANGLES = {  # at the end, as published [rad]: right to nine digits
    "beta": 0.1581077119629904e2,
    "theta": -0.1575637105984298e2,
    "gamma": 0.4082224013073101e-1,
    "phi": -0.5347301163226948,
    "delta": 0.5244099658805304,
    "omega": 0.5347301163226948,
    "epsilon": 0.1048080741042263e1,
}


@cache
def squeezer() -> ParallelRobot:
    """The mechanism."""
    return ParallelRobot.from_file(FILE)


@cache
def angles() -> dict[str, float]:
    """Angles at the end [rad]."""
    lines = REFERENCE.read_text(encoding="utf-8").splitlines()
    pairs = (line.split() for line in lines if not line.startswith("#"))
    return {name: float(angle) for name, angle in pairs}


def off(robot: ParallelRobot, q: Array) -> float:
    """The largest error of the angles of q (nq,) at the end [rad]."""
    found = {robot.coordinates.name_of(column): float(value) for column, value in enumerate(q)}
    return max(abs(found[joint] - angle) for joint, angle in angles().items())


def floor() -> float:
    """The largest error of the published angles [rad]."""
    return max(abs(ANGLES[joint] - angle) for joint, angle in angles().items())
