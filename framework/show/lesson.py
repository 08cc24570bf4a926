"""A page to learn condition (8) by hand, without Python: one file, nothing fetched.

The page has Chebyshev series in s (see `planar_crossing`) and evaluates them for any law that its reader
makes; nothing is drawn beforehand.
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
from framework.show.drawing import visible_outlines
from framework.show.sight import Projection, Sight, robot_sight
from framework.show.standalone import page_part, standalone_page
from framework.singularity.drawn_locus import locus_curves

NODE_COUNTS = (64, 96, 128, 192)  # of the series in s, until they are resolved
LAW_NODE_COUNTS = (160, 320, 640, 1280)  # of the best law's squared speed in sigma, likewise
SERIES_TAIL = 1e-12  # of the largest coefficient, of all series of the page


def lesson_page(robot: ParallelRobot, path: Path, *, duration: float, name: str = "") -> str:
    """Return the page (HTML) about a path that crosses the singular locus once.

    Of a rigid planar robot.

    Args:
        robot, path, duration: as in `planar_crossing`.
        name: what stands beside the robot's name, such as Scene C.

    Raises:
        NoAnswer: the path comes too near another singularity for series.
        As `planar_crossing`.
    """
    sight = robot_sight(robot)
    crossing = planar_crossing(robot, path, duration, sight.onto.up)
    heading = display_name(robot.name) + (f", {name}" if name else "")
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
    series = _fit_series(crossing, onto)
    ends = np.cumsum([0, *(each.shape[1] for each in series.values())]).tolist()
    locus = locus_curves(robot, crossing.point.q, crossing.point.platform)
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
        "series": [_truncate(column) for each in series.values() for column in each.T],
        "slices": {key: [begin, end] for key, begin, end in zip(series, ends, ends[1:], strict=False)},
        "shapes": _body_outlines(crossing, sight),
        "locus": [_places_on_paper(robot, curve, onto).round(6) for curve in (locus.curves if locus else [])],
        "best": {key: _best_law_document(plan) for key, plan in crossing.plans.items()},
    }


def _fit_series(crossing: PlanarCrossing, onto: Projection) -> dict[str, Array]:
    """Fit Chebyshev series (N, k) in s to the functions that the page evaluates."""
    for count in NODE_COUNTS:
        columns = _sample_functions(crossing, 0.5 * (1.0 + nodes(count)), onto)
        series = {key: coefficients(values.reshape(count, -1)) for key, values in columns.items()}
        if max(map(tail, series.values())) < SERIES_TAIL:
            return series
    raise NoAnswer(f"{crossing.robots['off'].name}: the path is too near another singularity for a lesson")


def _sample_functions(crossing: PlanarCrossing, s: Array, onto: Projection) -> dict[str, Array]:
    """Compute the functions that the page evaluates, at s (M,), each (M, ...)."""
    robot, samples = crossing.robots["off"], crossing.sample(s)
    q, q_aside = samples.pop("q"), samples.pop("q_aside")
    forward, back = (
        np.stack([_poses_on_paper(robot, aside, onto) for aside in q_aside[:, side]]) for side in (0, 1)
    )
    along_axes = (forward - back) / (2.0 * STEP_ASIDE * robot.length)  # (2, M, k)
    axes = _places_on_paper(robot, np.eye(2), onto)  # the platform's axes on the paper, orthogonal
    return samples | {
        "place": _places_on_paper(robot, crossing.searched.branch.path(s), onto),
        "poses": _poses_on_paper(robot, q, onto),
        "pose_rates": np.einsum("ab,amk->mbk", axes, along_axes),
    }


def _best_law_document(plan: CrossingPlan) -> Document:
    """Return the best law's peak, limit, and Chebyshev series of z on sigma."""
    law, peak = plan.law, max(plan.peak_torque.values())
    assert isinstance(law, OptimalLaw)
    for count in LAW_NODE_COUNTS:
        series = coefficients(law.squared_speed(0.5 * (1.0 + nodes(count)))[:, None])
        if tail(series) < SERIES_TAIL:
            break
    return {"peak": peak, "limit": 1.5 * peak, "squared_speed": _truncate(series[:, 0])}


def _poses_on_paper(robot: ParallelRobot, q: Array, onto: Projection) -> Array:
    """Return place (2), cosine and sine of each moving joint, (M, 4 per joint)."""
    columns = []
    for pose in joint_poses(robot, q).transpose(1, 0, 2)[1:]:
        columns += [onto(pose[:, :3]), onto(rotate_vector(pose[:, 3:], onto.right))]
    return np.concatenate(columns, axis=1)


def _body_outlines(crossing: PlanarCrossing, sight: Sight) -> list[Document]:
    """Return the outline (m, 2) of each body in its joint's frame, the farthest first."""
    robot, q = crossing.robots["off"], crossing.searched.branch.close(np.zeros(1)).q
    poses = [np.array([0.0, 0.0, 1.0, 0.0]), *_poses_on_paper(robot, q, sight.onto)[0].reshape(-1, 4)]
    shapes = []
    for node, points, colour in visible_outlines(robot, q[0], sight):
        x, y, cosine, sine = poses[node]
        local = (points - (x, y)) @ np.array([[cosine, -sine], [sine, cosine]])
        shapes.append({"node": node, "points": local.round(6), "colour": np.round(colour, 3)})
    return shapes


def _places_on_paper(robot: ParallelRobot, x: Array, onto: Projection) -> Array:
    """Return places (M, 2) on the paper of platform coordinates x (M, 2)."""
    space = np.zeros((len(x), 3))
    space[:, robot.platform.along] = x
    return onto(space)


def _truncate(series: Array) -> Array:
    """Cut the last coefficients of a series that are rounding."""
    large = np.flatnonzero(np.abs(series) > COEFFICIENT_ROUNDING * np.abs(series).max(initial=0.0))
    return series[: large[-1] + 1 if large.size else 1]
