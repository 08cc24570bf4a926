"""The robots and the path that the stages are about, from the catalogue."""

from functools import lru_cache

from framework import Condition, Law, Line, ParallelRobot, track_path
from framework.catalogue import robot_file
from framework.kinematics.continuation.tracking import Branch
from tests.benchmarks.chart import closed_form
from tests.benchmarks.chart.closed_form import ExactMotion

MASSES = {"five_bar": 0.0, "five_bar_heavy": 1.0}  # of each crank and rod [kg]
DURATION, CROSSING_TIME = float(closed_form.DURATION), float(closed_form.CROSSING_TIME)  # [s]


def robot(name: str = "five_bar", flexibility: str = "rigid") -> ParallelRobot:
    """A robot of the catalogue."""
    return _robot(name, flexibility)


@lru_cache(maxsize=8)
def _robot(name: str, flexibility: str) -> ParallelRobot:
    return ParallelRobot.from_file(robot_file(name), flexibility=flexibility)


@lru_cache(maxsize=1)
def path() -> Line:
    """Scene C's."""
    start, end = ([float(c) for c in point] for point in (closed_form.START, closed_form.END))
    return Line(start, end)


def branch(name: str = "five_bar") -> Branch:
    """The path as followed by the rigid robot."""
    return _branch(name)


@lru_cache(maxsize=4)
def _branch(name: str) -> Branch:
    return track_path(robot(name), path())


def exact(name: str = "five_bar", *, offset: float = 0.0) -> ExactMotion:
    """The reference for a robot of the catalogue, condition (8) imposed `offset` off the singular point."""
    return closed_form.motion(MASSES[name], offset=offset)


@lru_cache(maxsize=64)
def law(name: str = "five_bar", *, offset: float = 0.0) -> Law:
    """The reference's law as the framework has laws: the same conditions, in floats."""
    wanted = exact(name, offset=offset)
    inner = [
        Condition(CROSSING_TIME, order, float(wanted.law(closed_form.CROSSING_TIME, order)))
        for order in range(3)
    ]
    return Law.rest_to_rest(DURATION, 2, inner)
