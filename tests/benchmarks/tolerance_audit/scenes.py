"""What the audit plans: 60 scenes of rigid robots and 15 of elastic ones, as plain data.

Half of them cannot be planned, or nearly cannot: laws without condition (8), or with it imposed beside the
locus; paths that touch the locus, just miss it, end on it or run along it; laws that nearly stop; legs that
are nearly stretched; motors that are too weak.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import robots
from framework import Arc, Line, locate_singularities
from framework.crossing.scenes import scene_path
from tests.benchmarks.tolerance_audit.runs import Scene
from tests.crossing import test_random_five_bars, test_random_spatial
from tests.singularity.test_points_on_path import locus
from tests.stability.test_stop_on_the_locus import end_before
from tests.stability.test_touch import chord
from tests.stability.test_working_mode import past_the_motor

CATALOGUE = {
    "agile_eye": ("orient",),
    "biglide": ("across", "unprepared"),
    "bricard": ("fold", "dead_point"),
    "delta": ("cross", "cross-unprepared"),
    "five_bar": ("B", "C", "C-printed"),
    "five_bar_heavy": ("B", "C"),
    "four_bar": ("dead_point", "unprepared"),
    "gough_stewart": ("turn",),
    "humanoid_knee": ("deep",),
    "orthoglide": ("cross",),
    "par4": ("cross",),
    "slider_crank": ("dead_centre",),
    "spherical_rrr": ("cross",),
    "three_rpr": ("crossing",),
    "three_rrr": ("crossing",),
    "three_upu": ("across",),
    "two_arms": ("lift",),
}
ELASTIC = {
    ("biglide", "flexible_links"): ("across", "unprepared"),
    ("bricard", "flexible_joints"): ("dead_point",),
    ("five_bar", "flexible_joints"): ("C",),
    ("five_bar", "flexible_links"): ("A", "B", "C", "C-printed"),
    ("five_bar_heavy", "flexible_links"): ("C",),
    ("slider_crank", "flexible_links"): ("dead_centre", "unprepared"),
    ("three_rpr", "flexible_links"): ("crossing",),
}
OFFSETS = (1e-3, 1e-8, 1e-9, 1e-10, 1e-12)  # of the imposed point from the locus, in s
DEPTHS = (1e-3, 1e-6, 1e-7, -1e-9, -1e-6, -1e-3)  # [m] by which a path reaches over the locus
GAPS = (1e-2, 1e-5, 1e-7, 0.0, -1e-9, -1e-8)  # [m] left between the end of a path and the locus
SHORT = (1e-2, -1e-6)  # [m] by which a leg is not stretched
SPEEDS = (1e-5, 1e-7)  # [1/s] at a crossing, which nearly stop there
BOWS = (6e-8, 6e-9)  # sines of arcs that are nearly straight
TURNS = (1e-4, 3e-9)  # [rad] of a path from orthogonal to t_s
CLOSE = (1e-8, 1e-9)  # [m] over the locus: two crossings, 1e-3 of the path apart
PASSING = (1e-2, 1e-8)  # [m] between a path and the left motor
FIVE_BARS = (8, 12)  # of the random ones, upright, those that take less than a second
OPEN = {"duration": 1.5}
TIMED = {"duration": 1.5, "times": [1.0], "speeds": [1.5]}


def rigid(folder: Path) -> list[Scene]:
    """Return the rigid scenes; files of random robots are written into a folder."""
    return [
        *_of_catalogue(),
        *_beside_the_locus(),
        *_nearly_undecided(),
        *_beside_type_1(),
        *_limited(),
        *_random(folder),
    ]


def elastic() -> list[Scene]:
    """Return the elastic scenes."""
    found = [
        Scene(f"{name} {scene}, {flexibility}", name, flexibility, scene, "", (), {})
        for (name, flexibility), scenes in ELASTIC.items()
        for scene in scenes
    ]
    line = scene_path(robots.load("five_bar").description.scenes["C"])
    soft = "flexible_links"
    for offset in (0.0, 1e-6):  # the locus of the undeformed robot is beside that of the deformed one
        options = {**TIMED, "at": [_crossing(line) + offset]}
        found.append(
            _planned(f"five_bar imposed rigid + {offset:g}, {soft}", "five_bar", line, options, soft)
        )
    across = scene_path(robots.load("biglide").description.scenes["across"])
    options, soft = {"law": "optimal", "duration": 1.0}, "flexible_joints"
    found.append(_planned(f"biglide optimal, {soft}", "biglide", across, options, soft))
    return found


def _of_catalogue() -> Iterator[Scene]:
    for name, scenes in CATALOGUE.items():
        for scene in scenes:
            yield Scene(f"{name} {scene}", name, "rigid", scene, "", (), {})


def _beside_the_locus() -> Iterator[Scene]:
    line = scene_path(robots.load("five_bar").description.scenes["C"])
    for offset in OFFSETS:
        options = {**TIMED, "at": [_crossing(line) + offset]}
        yield _planned(f"five_bar imposed {offset:g} beside", "five_bar", line, options)
    for depth in DEPTHS:
        yield _planned(f"five_bar reaches {depth:g} m over the locus", "five_bar", chord(depth), OPEN)
    for gap in GAPS:
        yield _planned(f"five_bar ends {gap:g} m before the locus", "five_bar", end_before(gap), OPEN)


def _nearly_undecided() -> Iterator[Scene]:
    """Requests beside which another answer is right."""
    line = scene_path(robots.load("five_bar").description.scenes["C"])
    for speed in SPEEDS:
        yield _planned(f"five_bar crosses at {speed:g} 1/s", "five_bar", line, {**TIMED, "speeds": [speed]})
    for sine in BOWS:
        along = line.end - line.start
        middle = 0.5 * (line.start + line.end) + 0.5 * sine * np.array([-along[1], along[0]])
        points = tuple(tuple(map(float, point)) for point in (line.start, middle, line.end))
        name = f"five_bar on an arc of sine {sine:g}"
        yield Scene(name, "five_bar", "rigid", "", "arc", points, OPEN)
    for turn in TURNS:
        yield _planned(f"five_bar {turn:g} rad off orthogonal to t_s", "five_bar", _orthogonal(turn), OPEN)
    for depth in CLOSE:
        times = [1.5 * point.s for point in locate_singularities(robots.load("five_bar"), chord(depth))]
        options = {"duration": 1.5, "times": times}
        yield _planned(f"five_bar twice over the locus by {depth:g} m", "five_bar", chord(depth), options)
    yield _planned("five_bar loosely", "five_bar", line, {**TIMED, "tolerance": 1e-6})


def _orthogonal(turn: float) -> Arc:
    """Return an arc whose middle is on the locus, and there a turn [rad] from orthogonal to t_s."""
    middle, aside = locus(1.6), np.array([0.03, 0.06])
    twist = locate_singularities(robots.load("five_bar"), Line(middle + aside, middle - aside))[0].twist
    angle = np.arctan2(twist[0], -twist[1]) + turn
    along, across = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return Arc(middle - 0.05 * along + 0.02 * across, middle, middle + 0.05 * along + 0.02 * across)


def _crossing(path: Any) -> float:
    return locate_singularities(robots.load("five_bar"), path)[0].s


def _beside_type_1() -> Iterator[Scene]:
    for short in SHORT:
        yield _planned(f"five_bar leg {short:g} m short of stretched", "five_bar", _reaching(short), OPEN)
    for distance in PASSING:
        yield _planned(
            f"five_bar passes its motor at {distance:g} m", "five_bar", past_the_motor(distance), OPEN
        )


def _reaching(short: float) -> Arc:
    """Return an arc whose middle is short of the reach of the left leg [m]."""
    middle = np.deg2rad(60)
    centre = np.array([-0.2, 0.0]) + (0.4 - short) * np.array([np.cos(middle), np.sin(middle)])
    turned = middle + np.array([-0.6, 0.0, 0.9])
    return Arc(*(centre + 0.1 * np.column_stack([np.cos(turned), np.sin(turned)])))


def _limited() -> Iterator[Scene]:
    line = scene_path(robots.load("five_bar").description.scenes["C"])
    for limit in (0.05, 0.035):  # [N m]; the least peak is 0.040
        options = {"duration": 1.5, "torque_limit": limit}
        yield _planned(f"five_bar within {limit:g} N m", "five_bar", line, options)
    yield _planned("five_bar quickest", "five_bar", line, {"optimize": "time", "torque_limit": 0.165})


def _random(folder: Path) -> Iterator[Scene]:
    for k in FIVE_BARS:
        own = folder / str(k)
        own.mkdir()
        _, _, line, duration = test_random_five_bars.random_motion(k, own)
        options = {"law": "optimal", "duration": duration}
        yield _planned(f"random five-bar {k}", str(own / "robot.yaml"), line, options)
    for name in ("orthoglide",):
        ((line, duration),) = test_random_spatial.random_motions(name, 1)[1]
        yield _planned(f"random line of {name}", name, line, {"law": "optimal", "duration": duration})


def _planned(
    name: str, robot: str, path: Line | Arc, options: dict[str, Any], flexibility: str = "rigid"
) -> Scene:
    points = (path.start, path.end) if isinstance(path, Line) else (path.start, path.via, path.end)
    kind = "line" if isinstance(path, Line) else "arc"
    return Scene(name, robot, flexibility, "", kind, tuple(tuple(map(float, p)) for p in points), options)
