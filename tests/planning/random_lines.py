"""Random lines across the singular loci of planar and spatial robots, about the lines of their own scenes."""

import numpy as np

import robots
from framework import Line, NoAnswer, ParallelRobot, locate_singularities
from framework.planning.scenes import scene_path

# a scene of each robot whose line crosses the locus
SCENES = {
    "biglide": "across",
    "five_bar": "C",
    "three_rpr": "crossing",
    "three_rrr": "crossing",
    "delta": "cross",
    "orthoglide": "cross",
    "par4": "cross",
    "gough_stewart": "turn",
}


def random_crossings(name: str, count: int, seed: int) -> tuple[ParallelRobot, list[tuple[Line, float]]]:
    """Lines across the locus whose ends lie about those of the robot's own scene, and durations [s]."""
    robot = robots.load(name)
    own = scene_path(robot.description.scenes[SCENES[name]])
    ends = np.array([own(0.0), own(1.0)])
    spread = 0.35 * np.abs(np.diff(ends, axis=0)[0]) + 0.05 * np.abs(np.diff(ends)).max()
    rng, found = np.random.default_rng([seed, len(name)]), []
    while len(found) < count:
        line = Line(*(ends + rng.uniform(-spread, spread, ends.shape)))
        duration = float(rng.uniform(0.5, 3.0))
        try:
            points = locate_singularities(robot, line)
        except NoAnswer:
            continue
        if points and all(point.contact != "tangential" for point in points):
            found.append((line, duration))
    return robot, found
