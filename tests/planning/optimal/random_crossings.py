"""Random rigid robots under gravity, each on a path across its singular locus.

Robot k is of kind k % 5, and its path meets the locus 1 + (k // 5) % 3 times. Five-bars are drawn in all
their dimensions, stand upright, and have a free line, arc or spline. The others are those of the catalogue
in another size, with other masses of every link; the 3-RRR stands upright and has other lengths of every
link. Their paths are a line, an arc or a spline about that of the catalogue's scene for one crossing, a
spline there and back for two, and there, back and there for three.

Seed and ranges were fixed before the first run. Redrawn is only what leaves the workspace, has another
number of crossings, or has them closer than `CLEAR` to one another and to the ends of the path.
"""

import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path as Folder
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
import yaml

import robots
from framework import Arc, InvalidInput, Line, NoAnswer, ParallelRobot, Spline, locate_singularities
from framework.laws.path import Path
from framework.model.description import RobotDescription
from framework.planning.scenes import scene_path
from tests.dynamics.random_five_bars import _body, _joint
from tests.robots.transformed import scaled

SEED = 20261126
SCENES = {"three_rrr": "crossing", "delta": "cross", "orthoglide": "cross", "par4": "cross"}
KINDS = ("five_bar", *SCENES)
G = 9.81  # [m/s^2]
DURATIONS = (0.5, 3.0)  # [s]
SIZES, MASSES, LENGTHS = (0.5, 2.0), (0.5, 2.0), (0.9, 1.1)  # times those of the catalogue
SPREAD, BULGE = 0.3, 0.15  # of the length of the scene's path: of its ends, and of arcs and splines
CLEAR = 0.04  # of s between crossings, and to the ends
MARGIN = 0.05  # of a five-bar's size, to a stretched or folded leg
PATH_SAMPLES, MAX_LENGTH = 241, 2.5  # of five-bars' paths; lengths in robot sizes
EXTENTS = {1: 0.35, 2: 0.6, 3: 0.8}  # of a five-bar's path, in robot sizes, by crossings
MAX_DRAWS = 8000  # of a line or an arc; a spline meets the locus more often


class RandomCrossing(NamedTuple):
    """A rigid robot and what it is to do."""

    name: str
    robot: ParallelRobot
    path: Path
    duration: float  # [s]
    crossings: int

    def plan_arguments(self) -> tuple[ParallelRobot, Path]:
        """The first two arguments of `plan_crossing`."""
        return self.robot, self.path


def random_crossing(k: int) -> RandomCrossing:
    """Draw the k-th robot with its path and duration."""
    rng = np.random.default_rng([SEED, k])
    kind, crossings = KINDS[k % len(KINDS)], 1 + (k // len(KINDS)) % 3
    draw: Callable[[], tuple[RobotDescription, Path]]
    if kind == "five_bar":
        draw = lambda: _five_bar(rng, crossings)  # noqa: E731
    else:
        draw = lambda: _of_catalogue(rng, kind, crossings)  # noqa: E731
    while True:
        try:
            description, path = draw()
            robot = ParallelRobot.from_description(description)
            points = locate_singularities(robot, path)
        except NoAnswer:
            continue
        places = np.array([0.0, *(point.s for point in points), 1.0])
        transversal = all(point.contact == "transversal" for point in points)
        if len(points) == crossings and transversal and np.diff(places).min() > CLEAR:
            duration = round(float(rng.uniform(*DURATIONS)), 3)
            name = f"{k} {kind} {crossings}x {type(path).__name__.lower()}"
            return RandomCrossing(name, robot, path, duration, crossings)


# ------------------------------------------------------------------ robots of the catalogue


def _of_catalogue(rng: np.random.Generator, kind: str, crossings: int) -> tuple[RobotDescription, Path]:
    """Draw size, masses and a path about that of the catalogue's scene."""
    description = scaled(robots.load(kind).description, float(rng.uniform(*SIZES)))
    root = ElementTree.fromstring(description.urdf_text)
    for link in root.iterfind("link"):
        factor = float(rng.uniform(*MASSES))
        for element in [*link.iterfind("inertial/mass"), *link.iterfind("inertial/inertia")]:
            for key, value in list(element.attrib.items()):
                element.set(key, repr(factor * float(value)))
    gravity = (0.0, 0.0, -G)
    if kind == "three_rrr":
        gravity = (0.0, -G, 0.0)
        for origin in root.iterfind("joint/origin"):
            place = np.array(origin.get("xyz", "0 0 0").split(), dtype=float)
            origin.set("xyz", " ".join(repr(float(x)) for x in rng.uniform(*LENGTHS) * place))
    text = ElementTree.tostring(root, encoding="unicode")
    scene = scene_path(description.scenes[SCENES[kind]])
    ends = np.array([scene(0.0), scene(1.0)])
    step = np.abs(ends[1] - ends[0])
    spread = SPREAD * step + 0.1 * SPREAD * step.max()
    ends = ends + rng.uniform(-spread, spread, ends.shape)
    return replace(description, urdf_text=text, gravity=gravity), _there_and_back(rng, *ends, crossings)


def _there_and_back(rng: np.random.Generator, start: np.ndarray, end: np.ndarray, crossings: int) -> Path:
    """Draw a path from start to end, and back, and there again."""
    step = end - start
    aside = rng.uniform(-BULGE, BULGE, (3, len(start))) * np.linalg.norm(step)
    if crossings > 1:
        return Spline([start, end + aside[0], start + aside[1], end + aside[2]][: crossings + 1])
    shape = rng.integers(3)
    if shape == 0:
        return Line(start, end)
    if shape == 1:
        return Arc(start, start + 0.5 * step + aside[0], end)
    return Spline([start, start + step / 3 + 0.5 * aside[0], start + 2 * step / 3 + 0.5 * aside[1], end])


# ------------------------------------------------------------------ five-bars


class _Legs(NamedTuple):
    """Two cranks with their rods; elbows on the left (-1) or the right (1) of the line to the tip."""

    base: np.ndarray  # (2,) [m] along x
    crank: np.ndarray  # (2,) [m]
    rod: np.ndarray  # (2,) [m]
    side: np.ndarray  # (2,)

    def angles(self, tip: np.ndarray) -> np.ndarray | None:
        """Absolute angles (T, 2, 2) [rad] of each leg's crank and rod, the tip at (T, 2), if in reach."""
        way = tip[:, None] - np.stack([self.base, np.zeros(2)], axis=1)
        far, margin = np.hypot(way[..., 0], way[..., 1]), MARGIN * float(self.crank.mean())
        if not np.all(
            (far > np.abs(self.crank - self.rod) + margin) & (far < self.crank + self.rod - margin)
        ):
            return None
        bend = np.arccos((self.crank**2 + far**2 - self.rod**2) / (2 * self.crank * far))
        crank = np.arctan2(way[..., 1], way[..., 0]) - self.side * bend
        rod = way - self.crank[:, None] * np.stack([np.cos(crank), np.sin(crank)], axis=-1)
        return np.stack([crank, np.arctan2(rod[..., 1], rod[..., 0])], axis=-1)


def _five_bar(rng: np.random.Generator, crossings: int) -> tuple[RobotDescription, Path]:
    """Draw a five-bar in all its dimensions, and a path that brings its rods into line so many times."""
    shape, draws = int(rng.integers(3)), 0
    while True:
        draws += 1
        size = 10 ** rng.uniform(-1, 0.5)
        base = np.array([rng.uniform(-0.6, -0.1), rng.uniform(0.1, 0.6)]) * size
        legs = _Legs(base, *(rng.uniform(0.5, 1.2, (2, 2)) * size), rng.choice([-1.0, 1.0], 2))
        points = _points(rng, 2 if draws > MAX_DRAWS else shape, EXTENTS[crossings]) * size
        if legs.angles(points) is None:
            continue
        path = _path_through(points)
        if path is None:
            continue
        x = path(np.linspace(0, 1, PATH_SAMPLES))
        angles = legs.angles(x)
        if angles is None or np.hypot(*np.diff(x, axis=0).T).sum() > MAX_LENGTH * size:
            continue
        measure = np.sin(angles[:, 0, 1] - angles[:, 1, 1])
        if np.sum(measure[1:] * measure[:-1] < 0) == crossings and np.abs(measure[[0, -1]]).min() > 0.08:
            return _five_bar_description(rng, legs, angles[0]), path


def _points(rng: np.random.Generator, shape: int, extent: float) -> np.ndarray:
    """Draw points of a line, an arc or a spline, in robot sizes."""
    centre = rng.uniform([-1, -1.6], [1, 1.6])
    if shape == 2:
        return centre + np.cumsum(rng.normal(0, 0.35 * extent, (5, 2)), axis=0)
    return centre + rng.uniform(-extent, extent, (2 + shape, 2))


def _path_through(points: np.ndarray) -> Path | None:
    try:
        return Line(*points) if len(points) == 2 else Arc(*points) if len(points) == 3 else Spline(points)
    except InvalidInput:  # no curve through these
        return None


def _five_bar_description(rng: np.random.Generator, legs: _Legs, start: np.ndarray) -> RobotDescription:
    """Draw masses, motors and the direction of gravity, and write the robot."""
    size = float(legs.crank.mean())
    parts, reference, actuators = ['<robot name="random_five_bar"><link name="base"/>'], {}, []
    for k, side in enumerate(("left", "right")):
        for part, length, above, along in (
            ("crank", legs.crank[k], "base", legs.base[k]),
            ("rod", legs.rod[k], f"{side}_crank", legs.crank[k]),
        ):
            mass, centre = float(rng.uniform(0.1, 2.0)), float(rng.uniform(0.2, 0.8) * length)
            about = mass * float(rng.uniform(0.01, 0.1) * length**2)
            parts.append(_joint(f"{side}_{part}_hinge", "continuous", above, f"{side}_{part}", float(along)))
            parts.append(_body(f"{side}_{part}", centre, mass, [about] * 3))
        parts.append(_joint(f"{side}_end", "fixed", f"{side}_rod", f"{side}_tip", float(legs.rod[k])))
        turn = float(start[k, 1] - start[k, 0])
        reference[f"{side}_crank_hinge"] = float(start[k, 0])
        reference[f"{side}_rod_hinge"] = (turn + np.pi) % (2 * np.pi) - np.pi
        gear, rotor = float(rng.uniform(1, 60)), float(rng.uniform(0, 1e-4) * size**2)
        actuators.append({"joint": f"{side}_crank_hinge", "gear_ratio": gear, "rotor_inertia": rotor})
    payload, inertia = float(rng.uniform(0.5, 5.0)), float(rng.uniform(0.001, 0.01)) * size**2
    parts += [_body("left_tip", 0.0, payload, [inertia] * 3), '<link name="right_tip"/></robot>']
    down = float(rng.uniform(0, 2 * np.pi))
    file = {
        "version": 1,
        "urdf": "random_five_bar.urdf",
        "gravity": [G * float(np.cos(down)), G * float(np.sin(down)), 0.0],
        "platform": {"frame": "left_tip", "axes": ["x", "y"]},
        "actuators": actuators,
        "closures": [{"name": "tip", "frames": ["left_tip", "right_tip"], "kind": "spherical"}],
        "reference": reference,
    }
    with tempfile.TemporaryDirectory() as folder:
        (Folder(folder) / "random_five_bar.urdf").write_text("".join(parts))
        (Folder(folder) / "random_five_bar.yaml").write_text(yaml.safe_dump(file))
        return ParallelRobot.from_file(Folder(folder) / "random_five_bar.yaml").description
