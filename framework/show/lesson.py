"""A page on which readers try condition (8) by hand, without Python: one file, nothing fetched.

The page holds Chebyshev series in s (see `planar_crossing`) and evaluates them for every law that a reader
shapes; no motion is computed beforehand.
"""

from __future__ import annotations

import html

import numpy as np

from framework.errors import NoAnswer
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.placements import joint_poses, rotate_vector
from framework.laws.optimal_law import OptimalLaw
from framework.laws.path import Path
from framework.numerics.arrays import Array
from framework.numerics.chebyshev import COEFFICIENT_ROUNDING, coefficients, nodes, tail
from framework.numerics.output import Document
from framework.planning.planar_crossing import PATH_SMOOTHNESS, STEP_ASIDE, PlanarCrossing, planar_crossing
from framework.planning.result import CrossingPlan
from framework.show.captions import display_name, why_singular
from framework.show.drawing import project_faces
from framework.show.page import page_part, standalone_page
from framework.show.sight import Projection, Sight, robot_sight
from framework.singularity.drawn_locus import locus_curves

NODE_COUNTS = (64, 96, 128, 192)  # of the series in s, tried until their tails are small
LAW_NODE_COUNTS = (160, 320, 640, 1280)  # of the best law's squared speed in sigma, likewise
SERIES_TAIL = 1e-12  # of the largest coefficient: a series with this tail is resolved


def lesson_page(robot: ParallelRobot, path: Path, *, duration: float, name: str = "") -> str:
    """Return the page (HTML) about a path on which a robot crosses the locus once.

    The robot is planar and rigid.

    Args:
        robot, path, duration: as in `planar_crossing`.
        name: part of the heading after the robot's name, such as Scene C.

    Raises:
        NoAnswer: the path passes so near another singularity that no series is resolved.
        As `planar_crossing`.
    """
    sight = robot_sight(robot)
    crossing = planar_crossing(robot, path, duration, sight.onto.up)
    heading = ", ".join(filter(None, [display_name(robot.name), name]))
    title = f"Thread the needle: {heading}"
    return standalone_page(
        title,
        page_part("lesson.html", title=html.escape(title)),
        _lesson_document(robot, crossing, sight),
        styles=["lesson.css"],
        scripts=["curves.js", "lesson.js"],
    )


def _lesson_document(robot: ParallelRobot, crossing: PlanarCrossing, sight: Sight) -> Document:
    """Return the lesson's data: series of all plans, outlines, locus, best laws."""
    onto = sight.onto
    columns: list[Array] = []  # all series side by side
    slices = {}
    for key, series in _fit_series(crossing, onto).items():
        slices[key] = [len(columns), len(columns) + series.shape[1]]
        columns += map(_truncate, series.T)
    locus = locus_curves(robot, crossing.point.q, crossing.point.platform)
    curves = locus.curves if locus else []
    return {
        "robot": display_name(robot.name),
        "upright": bool(np.linalg.norm(onto(np.array(robot.description.gravity))) > 0.0),
        "duration": crossing.plans["off"].duration,
        "smoothness": PATH_SMOOTHNESS,
        "motors": [display_name(motor) for motor in robot.actuator_names],
        "unit": robot.torque_units[0],
        "crossing": crossing.point.s,
        "why": why_singular(robot),
        "length": robot.length,
        "series": columns,
        "slices": slices,
        "shapes": _body_outlines(crossing, sight),
        "locus": [_places_on_paper(robot, curve, onto).round(6) for curve in curves],
        "best": {key: _best_law_document(plan) for key, plan in crossing.plans.items()},
    }


def _fit_series(crossing: PlanarCrossing, onto: Projection) -> dict[str, Array]:
    """Fit Chebyshev series (N, k) in s to the functions that the page evaluates, by key.

    N is the first of NODE_COUNTS with which all series are resolved.
    """
    for count in NODE_COUNTS:
        samples = _sample_functions(crossing, 0.5 * (1.0 + nodes(count)), onto)  # arrays (N, ...)
        series = {key: coefficients(values.reshape(count, -1)) for key, values in samples.items()}
        if max(map(tail, series.values())) < SERIES_TAIL:  # relative size of the last coefficients
            return series
    raise NoAnswer("the path is too near another singularity for a lesson", name=crossing.robots["off"].name)


def _sample_functions(crossing: PlanarCrossing, s: Array, onto: Projection) -> dict[str, Array]:
    """Compute the functions that the page evaluates, at s (M,), by key, each (M, ...).

    Poses are places and turns of the joints on the paper, onto which `onto` projects. Their rates by the
    platform's coordinates come from poses STEP_ASIDE to both sides of the path (`q_aside`).
    """
    robot = crossing.robots["off"]  # gravity off, which changes no pose
    samples = crossing.sample(s)
    rates = []  # of the poses along each axis of the platform, (M, k), by central differences
    for forward, back in samples.pop("q_aside"):
        change = _poses_on_paper(robot, forward, onto) - _poses_on_paper(robot, back, onto)
        rates.append(change / (2.0 * STEP_ASIDE * robot.length))
    axes = _places_on_paper(robot, np.eye(2), onto)  # (2, 2) the platform's axes on the paper, orthogonal
    return samples | {
        "place": _places_on_paper(robot, crossing.searched.branch.path(s), onto),
        "poses": _poses_on_paper(robot, samples.pop("q"), onto),
        "pose_rates": np.einsum("ab,amk->mbk", axes, rates),  # along the axes of the paper
    }


def _best_law_document(plan: CrossingPlan) -> Document:
    """Return the best law's peak, limit, and series of its squared speed in sigma."""
    law = plan.law
    peak = max(plan.peak_torque.values())
    assert isinstance(law, OptimalLaw)
    for count in LAW_NODE_COUNTS:
        series = coefficients(law.squared_speed(0.5 * (1.0 + nodes(count)))[:, None])
        if tail(series) < SERIES_TAIL:
            break
    return {"peak": peak, "limit": 1.5 * peak, "squared_speed": _truncate(series[:, 0])}


def _poses_on_paper(robot: ParallelRobot, q: Array, onto: Projection) -> Array:
    """Return x, y, cosine and sine of moving joints on the paper at q (M, nq), (M, 4 * joints)."""
    columns = []
    for pose in joint_poses(robot, q).transpose(1, 0, 2)[1:]:  # (M, 7) position, quaternion; not of the base
        columns += [onto(pose[:, :3]), onto(rotate_vector(pose[:, 3:], onto.right))]
    return np.concatenate(columns, axis=1)


def _body_outlines(crossing: PlanarCrossing, sight: Sight) -> list[Document]:
    """Return the outline (m, 2) of each body in its joint's frame, farthest first."""
    robot = crossing.robots["off"]  # gravity off: the bodies are those with gravity
    q = crossing.searched.branch.close(np.zeros(1)).q  # (1, nq) at the start of the path
    base = np.array([0.0, 0.0, 1.0, 0.0])  # at the origin, not turned
    poses = [base, *_poses_on_paper(robot, q, sight.onto)[0].reshape(-1, 4)]
    shapes = []
    for face in project_faces(robot, q[0], sight):
        x, y, cosine, sine = poses[face.node]
        rotation = np.array([[cosine, -sine], [sine, cosine]])
        points = (face.outline - (x, y)) @ rotation
        shapes.append({"node": face.node, "points": points.round(6), "colour": face.color.round(3)})
    return shapes


def _places_on_paper(robot: ParallelRobot, x: Array, onto: Projection) -> Array:
    """Project platform coordinates x (M, 2) onto the paper, (M, 2)."""
    places = np.zeros((len(x), 3))
    places[:, robot.platform.along] = x
    return onto(places)


def _truncate(series: Array) -> Array:
    """Cut off the last coefficients of a series, which are rounding."""
    large = np.flatnonzero(np.abs(series) > COEFFICIENT_ROUNDING * np.abs(series).max(initial=0.0))
    return series[: large[-1] + 1 if large.size else 1]
