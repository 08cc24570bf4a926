"""Random robots under gravity with elastic drives and links, each across its singular locus.

Drawn are the kind of robot, its size, masses and way of standing, a line, an arc or a spline that meets the
locus of the rigid robot one to three times, and a duration of 0.5 to 3 s. Springs are those of the catalogue
(for the five-bars those of the paper).

A plan is judged by the equations of motion in all coordinates (`tests.oracles.equations_of_motion`), also
1e-3, 1e-6 and 1e-9 s before and after each crossing.
"""

import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path as Folder
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

import robots
from framework import Arc, CrossingPlan, Line, NoAnswer, ParallelRobot, Spline, locate_singularities
from framework.laws.path import Path
from framework.model.description import RobotDescription
from framework.planning.scenes import scene_path
from tests.dynamics.random_five_bars import _drawn
from tests.oracles.equations_of_motion import Defects, defects_at
from tests.robots.transformed import scaled

SEED = 20261122
KINDS = {
    "light five-bar": None,
    "heavy five-bar": None,
    "three_rrr": "crossing",
    "three_rpr": "crossing",
    "delta": "cross",
    "orthoglide": "cross",
    "gough_stewart": "turn",
}
UPRIGHT = {"light five-bar", "heavy five-bar", "three_rrr"}  # their plane stands on edge
G = 9.81  # [m/s^2]
SIZES = (0.5, 2.0)  # times the lengths of the catalogue
MASSES = (0.5, 2.0)  # times its masses
SLANTS = (np.pi / 6, np.pi / 2)  # [rad] of the plane of the 3-RPR
DURATIONS = (0.5, 3.0)  # [s]
LIGHT = (0.01, 0.1)  # [kg] of a bar of a light five-bar; heavy ones as in `random_five_bars`
SPREAD, BULGE = 0.3, 0.15  # of the length of the scene's path: of its ends, and of arcs and splines
AGAIN = 1 / 6  # share of the paths that meet the locus more than once
BESIDE = (1e-3, 1e-6, 1e-9)  # [s] before and after each crossing
FORCE, OPEN = 1e-9, 1e-11  # of the largest force; [m, rad]


class Drawn(NamedTuple):
    """A robot and what it is to do."""

    kind: str
    description: RobotDescription
    path: Path
    duration: float  # [s]
    crossings: int  # of the rigid robot

    def robot(self, softness: float, flexibility: str = "flexible_links") -> ParallelRobot:
        """The robot with springs `softness` times as soft."""
        springs = tuple(
            replace(spring, stiffness=tuple(value / softness for value in spring.stiffness))
            for spring in self.description.springs
        )
        description = replace(self.description, springs=springs)
        return ParallelRobot.from_description(description, flexibility=flexibility)


class Crossing(NamedTuple):
    """A robot with a path across its locus and a duration."""

    name: str
    robot: ParallelRobot
    path: Path
    duration: float  # [s]

    def plan_arguments(self) -> tuple[ParallelRobot, Path]:
        """The first two arguments of `plan_crossing`."""
        return self.robot, self.path


@cache
def rigid_crossing(k: int) -> Crossing:
    """The k-th of the random robots without its springs."""
    one = drawn(k)
    return Crossing(f"{k} {one.kind}", one.robot(1.0, "rigid"), one.path, one.duration)


def drawn(k: int) -> Drawn:
    """The k-th of the random robots."""
    rng = np.random.default_rng([SEED, k])
    kind = list(KINDS)[k % len(KINDS)]
    while True:
        description, path = _five_bar(rng, kind) if KINDS[kind] is None else _of_catalogue(rng, kind)
        duration = float(rng.uniform(*DURATIONS))
        try:
            points = locate_singularities(ParallelRobot.from_description(description), path)
        except NoAnswer:
            continue
        if 1 <= len(points) <= 3 and all(point.contact == "transversal" for point in points):
            return Drawn(kind, description, path, duration, len(points))


def _five_bar(rng: np.random.Generator, kind: str) -> tuple[RobotDescription, Path]:
    own = replace(_drawn(rng, inertia=bool(rng.integers(2))), gravity=(0.0, -G, 0.0))
    if kind.startswith("light"):
        own = replace(own, masses=rng.uniform(*LIGHT, 2))
    with tempfile.TemporaryDirectory() as folder:
        description = own.robot(Folder(folder)).description
    return description, _path(rng, own.start, own.end)


def _of_catalogue(rng: np.random.Generator, kind: str) -> tuple[RobotDescription, Path]:
    description = scaled(robots.load(kind).description, float(rng.uniform(*SIZES)))
    description = _with_masses(description, float(rng.uniform(*MASSES)))
    gravity = (0.0, 0.0, -G)
    if kind in UPRIGHT:
        gravity = (0.0, -G, 0.0)
    elif kind == "three_rpr":
        slant = rng.uniform(*SLANTS)
        gravity = (0.0, -G * float(np.sin(slant)), -G * float(np.cos(slant)))
    scene = scene_path(description.scenes[str(KINDS[kind])])
    ends = np.array([scene(0.0), scene(1.0)])
    step = np.abs(ends[1] - ends[0])
    spread = SPREAD * step + 0.1 * SPREAD * step.max()
    ends = ends + rng.uniform(-spread, spread, ends.shape)
    return replace(description, gravity=gravity), _path(rng, *ends)


def _path(rng: np.random.Generator, start: np.ndarray, end: np.ndarray) -> Path:
    """A line, an arc or a spline between two points; one in six goes back again, or there, back and there."""
    shape, step = rng.integers(3), end - start
    aside = rng.uniform(-BULGE, BULGE, (3, len(start))) * np.linalg.norm(step)
    if rng.uniform() < AGAIN:
        places = [start, end + aside[0], start + aside[1], end + aside[2]]
        return Spline(places[: rng.integers(3, 5)])
    if shape == 0:
        return Line(start, end)
    if shape == 1:
        return Arc(start, start + 0.5 * step + aside[0], end)
    return Spline([start, start + step / 3 + 0.5 * aside[0], start + 2 * step / 3 + 0.5 * aside[1], end])


def _with_masses(description: RobotDescription, factor: float) -> RobotDescription:
    """All masses and inertias times a factor."""
    root = ElementTree.fromstring(description.urdf_text)
    for part in [*root.iterfind("link/inertial/mass"), *root.iterfind("link/inertial/inertia")]:
        for key, value in list(part.attrib.items()):
            part.set(key, repr(factor * float(value)))
    return replace(description, urdf_text=ElementTree.tostring(root, encoding="unicode"))


def instants(plan: CrossingPlan) -> np.ndarray:
    """Instants [s] along the motion, and those beside its crossings."""
    crossings = np.array([crossing.time for crossing in plan.crossings])
    beside = [crossings + sign * step for step in BESIDE for sign in (-1.0, 1.0)]
    times = np.concatenate([np.linspace(0.0, plan.duration, 41), crossings, *beside])
    return np.sort(times[(times >= 0.0) & (times <= plan.duration)])


def judged(plan: CrossingPlan) -> Defects:
    """What a plan leaves of the equations of motion in all coordinates."""
    return defects_at(plan, instants(plan))


def is_right(defect: Defects) -> bool:
    """Whether the equations of motion hold, and the loops are closed."""
    return defect.force <= FORCE and defect.open <= OPEN
