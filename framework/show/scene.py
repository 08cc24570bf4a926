"""A film as a document for the page: shapes, poses, curves and sentences, ready for JSON.

Arrays are base64 of little-endian float32, row after row; on a robot of a metre they are exact to a tenth of
a micrometre. The page (framework/show/page) draws this document and computes nothing about robots.

A film has F frames of a robot with n_a motors. The pose (7,) of a joint is its position and quaternion.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence

import numpy as np

from framework.dynamics.platform_wrench import action_lines
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.placements import carried_points, frame_positions, joint_axis, joint_poses
from framework.kinematics.platform import FramePlatform
from framework.model.description import RobotDescription
from framework.model.visuals import Shape
from framework.numerics.arrays import Array, ArrayLike
from framework.numerics.output import Document, plain, select_fields
from framework.show.captions import (
    describe_film,
    describe_film_briefly,
    describe_motors,
    describe_proof,
    display_name,
    explain_crossing,
    why_singular,
    wrench_kind,
    wrench_unit,
)
from framework.show.film import (
    Film,
    film_limit,
    films_with_motors_of,
    largest_drawn_torque,
    peak_torque,
    stated_limits,
)
from framework.show.shapes import placement_with_z_along
from framework.show.sight import Sight, film_sight, tilt_direction
from framework.singularity.drawn_locus import LocusCurves, locus_curves, locus_patch

COIL_LENGTH = 0.18  # length of a spring's coil, over the `length` of the document
LOCUS_MARGIN = 0.9  # largest distance of the drawn locus from the path, in lengths of the robot

Traced = list[tuple[RobotDescription, LocusCurves]]  # curves with the robot for which they were traced


def encode_array(values: np.ndarray) -> str:
    """Encode an array for the scripts, as base64 of its rows."""
    return base64.b64encode(values.tobytes()).decode("ascii")


def encode_floats(values: ArrayLike) -> str:
    """Encode an array as float32 for the page."""
    return encode_array(np.asarray(values, dtype="<f4"))


def encode_each(**arrays: ArrayLike) -> Document:
    """Encode arrays as float32 for the page, by name."""
    return {name: encode_floats(values) for name, values in arrays.items()}


def film_documents(films: Sequence[Film]) -> list[Document]:
    """Return the page's documents of films side by side.

    Films of one robot share its locus.
    """
    traced: Traced = []
    return [plain(_film_document(film, films, traced)) for film in films]


def _film_document(film: Film, films: Sequence[Film], traced: Traced) -> Document:
    """Return a film's data for the page.

    All `films` of the robot share sight, torque limits and scale, and the curves in `traced`.
    """
    robot = film.robot
    time = film.time
    same_robot = [other for other in films if other.robot.description == robot.description]
    sight = film_sight(min(same_robot, key=lambda other: not other.instants))  # one that crosses, if any
    limit = film_limit(film, films)  # (n_a,) [N m]
    alike = films_with_motors_of(film, films)
    peak = peak_torque(alike)
    poses = joint_poses(robot, film.q)
    arrows = [_arrow_document(film.demands)]  # of W_p, then of the nonzero wrenches of the world
    for wrench in film.wrenches:
        if wrench.wrench.any():
            frame = {"frame": display_name(wrench.frame), "origin": encode_floats(wrench.origin)}
            arrows.append(_arrow_document(wrench.at_origin) | frame)
    largest = np.max([arrow["largest"] for arrow in arrows], axis=0)  # to one scale
    W_p, *world = (arrow | {"largest": largest} for arrow in arrows)
    reason = ", no limit given" if np.isinf(stated_limits(alike)).all() else ""
    drawn = page_robot_document(robot, poses, sight)
    # lines of action, if there are any and the film has singular instants
    lines = action_lines(robot, film.motors.motor_speed) if film.instants else None
    action_document = None
    if lines is not None:
        action_document = encode_each(place=lines.point, way=lines.direction) | {"count": robot.n_a}
    curves = encode_each(
        time=time,
        poses=poses,
        platform=film.platform,
        torque=film.torque,
        law=film.law(time),
        power=_power(film),
        band=film.motors.band(film.t_s, limit),
    )
    return (
        drawn
        | curves
        | {
            "kind": "film",
            "title": film.name or display_name(robot.name),
            "proved": film.proved,
            "refusal": film.refusal,
            "subtitle": describe_film_briefly(film),
            "summary": describe_film(film),
            "proof": describe_proof(film),
            "why": why_singular(robot),
            "asked": wrench_kind(robot),
            "unit": wrench_unit(robot),
            "duration": time[-1],
            "torque_limit": largest_drawn_torque(film),
            "g": encode_floats(film.g) if film.has_measure else None,
            "stated": describe_motors(robot, limit, peak, reason=reason),
            "polytope": _force_figure(film, limit),
            "no_figure": why_no_figure(robot),
            "lines": action_document,
            "t_s": _arrow_document(film.twists),
            "W_p": W_p,
            "world": world,
            "instants": _instant_documents(film),
            "springs": _spring_document(film, drawn["length"]),
            "locus": _locus_document(film, traced),
        }
    )


def _power(film: Film) -> Array:
    """Return t_s . W_p (F,) in all frames; t_s keeps its sense across the locus."""
    return np.sum(film.t_s * film.W_p, axis=1)


def _instant_documents(film: Film) -> list[Document]:
    """Return the singular instants of a film, with places and t_s . W_p."""
    power = _power(film)
    return [
        {
            "time": instant.time,
            "wrench": np.copysign(instant.wrench, np.interp(instant.time, film.time, power)),
            "how": explain_crossing(film, instant),
            "place": film.platform[film.frame_at(instant.time)],
            "where": film.robot.place(instant.platform),
        }
        for instant in film.instants
    ]


def page_robot_document(robot: ParallelRobot, poses: Array, sight: Sight) -> Document:
    """Return the entries of a robot's document that its motion leaves alone, and the view."""
    # a picture contains the joints in all poses, and the bodies in the first, the middle and the last one
    points = [frame_positions(robot, poses)]
    for pose in poses[[0, len(poses) // 2, -1]]:
        points += [carried_points(pose[shape.node], shape.corners()) for shape in sight.bodies]
    all_points = np.concatenate(points)
    low, high = all_points.min(axis=0), all_points.max(axis=0)
    center = 0.5 * (low + high)
    view = {
        "center": center,
        "radius": max(np.linalg.norm(all_points - center, axis=1).max(), 1e-6),
        "from": tilt_direction(sight.toward) if sight.planar else sight.toward,  # to the eye
        "lowest": low[2],
        "flat": sight.planar,
    }
    motors = zip(sight.motors, robot.actuator_names, robot.torque_units, strict=True)
    frames = [robot.model.frames[frame] for frame in robot.frames]  # at the ends of springs
    places = [{"node": end.parentJoint, "place": end.placement.translation.copy()} for end in frames]
    ends = zip(robot.line_springs.first, robot.line_springs.second, strict=True)
    return {
        "robot": robot.name,
        "flexibility": robot.flexibility,
        "axes": robot.axis_names,
        "turning": ~robot.platform.translations,
        "joints": robot.model.njoints,
        "length": 1.2 * view["radius"],
        "shapes": [_shape_document(shape) for shape in sight.bodies],
        "motors": [_shape_document(shape) | {"name": name, "unit": unit} for shape, name, unit in motors],
        "line_springs": [[places[first], places[second]] for first, second in ends],
        "view": view,
    }


def _column_major(placement: Array) -> Array:
    """Return a placement (4, 4) column by column, (16,)."""
    return placement.T.ravel().round(9)


def _shape_document(shape: Shape) -> Document:
    """Return a shape for the page, a mesh with its vertices and faces."""
    document = select_fields(shape, "node", "kind", "size", "color")
    document["placement"] = _column_major(shape.placement)
    if shape.vertices is not None and shape.faces is not None:
        document["vertices"] = encode_floats(shape.vertices)
        document["faces"] = encode_array(shape.faces.astype("<u4"))
    return document


def _spring_document(film: Film, size: float) -> Document | None:
    """Return the coils of the springs, and the factors that magnify their deflections.

    `size` [m] is that of the picture.
    """
    robot = film.robot
    if not robot.n_e:
        return None
    slides = robot.sliding[robot.elastic]  # (n_e,)
    length = COIL_LENGTH * size  # [m] of a coil
    coils = []
    for k, name in enumerate(robot.elastic_names):
        node, place, axis = joint_axis(robot, int(robot.elastic[k]))
        placement = _column_major(placement_with_z_along(place, axis))
        coils.append({"name": name, "node": node, "placement": placement, "slides": slides[k], "column": k})
    return {
        "coils": coils,
        "factors": {
            "slide": _magnification(film.deflection[:, slides], largest_drawn=0.35 * length),
            "turn": _magnification(film.deflection[:, ~slides], largest_drawn=0.35),  # [rad]
        },
        "length": length,
        "deflection": encode_floats(film.deflection),
    }


def _magnification(deflection: Array, largest_drawn: float) -> float:
    """Return the factor, 1, 2 or 5 times a power of ten, that draws deflections (F, k).

    The largest deflection is drawn as `largest_drawn` or a little less.
    """
    largest = np.abs(deflection).max(initial=0.0)
    if largest == 0.0:
        return 1.0
    factor = largest_drawn / largest
    power = float(10.0 ** np.floor(np.log10(factor)))
    return max(part for part in (1.0, 2.0, 5.0) if part * power <= factor * (1 + 1e-9)) * power


def _arrow_document(vectors: Array) -> Document:
    """Return linear and angular parts (F, 3) of twists or wrenches (F, 6)."""
    linear, angular = vectors[:, :3], vectors[:, 3:]
    largest = [np.linalg.norm(part, axis=1).max() for part in (linear, angular)]
    return encode_each(linear=linear, angular=angular) | {"largest": largest}


def _force_figure(film: Film, limit: Array) -> Document | None:
    """Return the set of forces that motors within limits (n_a,) can give.

    Torques if the platform only turns. The corners of the set are `center` (F, 3) plus the sums of plus or
    minus the `sides` (F, n_a, 3), one for each motor.
    """
    robot = film.robot
    sides = force_edges(robot, film.motors.motor_speed, limit)
    if sides is None or not len(robot.passive):
        return None
    center = -figure_vectors(robot, film.motors.rotors)
    return encode_each(center=center, sides=sides) | {"count": robot.n_a, "flat": robot.n == 2}


def force_edges(robot: ParallelRobot, motor_speed: Array, limit: Array) -> Array | None:
    """Compute the edges (F, n_a, 3) of the set of forces that all motors can give.

    Within the torque limits (n_a,) the sums of the rows of G (F, n_a, n) = `motor_speed` (see
    `framework.dynamics.platform_wrench`) fill a polygon or a parallelepiped. At a Type 2 singularity it is
    flat across t_s. Its edges are the forces or torques of each motor at its limit. None where the set is no
    figure of the plane or of space: for one motor, or for forces together with torques.
    """
    if robot.n == 1 or why_no_figure(robot):
        return None
    return figure_vectors(robot, limit[:, None] * motor_speed)


def figure_vectors(robot: ParallelRobot, wrenches: Array) -> Array:
    """Return the forces (..., 3) of wrenches (..., n) on base axes.

    Torques if the platform only turns.
    """
    assert isinstance(robot.platform, FramePlatform)
    vectors = np.zeros((*wrenches.shape[:-1], 3))
    vectors[..., robot.platform.axes % 3] = wrenches  # of the axes 0..5 the last three are turns
    return vectors


def why_no_figure(robot: ParallelRobot) -> str:
    """Return why the motors' forces are not drawn as one figure; empty if drawn."""
    platform = robot.platform
    kinds = len(set(robot.translations))
    if robot.n == 1:
        return ""
    if not isinstance(platform, FramePlatform) or not platform.constant:
        return "on axes of its own: not drawn in the scene"
    if kinds > 1:
        return f"forces and torques have {robot.n} dimensions: not drawn in the scene"
    if (robot.n == 2 and platform.is_point) or (robot.n == 3 and robot.n_a == 3):
        return ""
    return f"{robot.n_a} motors for {robot.n} freedoms: not drawn in the scene"


def _locus_document(film: Film, traced: Traced) -> Document | None:
    """Return the locus near the film's closest approach; None without a measure.

    It is a patch of a surface about the singular point, if there is one in space, or else curves.
    """
    if not film.has_measure:
        return None
    nearest = film.key_frame if film.instants else int(np.argmin(np.abs(film.g)))
    patch = locus_patch(film.robot, film.q[nearest], film.x[nearest]) if film.instants else None
    if patch is not None:
        return {"kind": "patch", "count": len(patch), "points": encode_floats(patch)}
    if film.robot.platform.is_point:
        curves = _trace_once(film, frame=0, x=film.x, traced=traced)
    else:  # the locus also depends on the platform's other coordinates, which are those of one frame
        curves = _trace_once(film, nearest, film.x[[nearest]], traced)
    return encode_locus(film.robot, curves, film.platform)


def _trace_once(film: Film, frame: int, x: Array, traced: Traced) -> LocusCurves | None:
    """Return the locus curves around a frame of a film, wide enough for x (T, n).

    Reuse the curves traced for the same robot if x lies well inside them.
    """
    for description, curves in traced:
        if description == film.robot.description and curves.covers(x):
            return curves
    locus = locus_curves(film.robot, film.q[frame], film.x[frame])
    if locus is not None:
        traced.append((film.robot.description, locus))
    return locus


def locus_lines(
    robot: ParallelRobot, curves: LocusCurves | None, platform: Array, *, max_distance: float = LOCUS_MARGIN
) -> list[Array]:
    """Return the pieces (m, 3) of the locus near places (F, 3) of the platform.

    A point is near within `max_distance` robot lengths.
    """
    if curves is None:
        return []
    pieces = []
    for curve in curves.curves:
        line = np.repeat(platform[:1], len(curve), axis=0)  # (M, 3): other coordinates as in the first frame
        line[:, robot.platform.along] = curve
        offsets = line[:, None] - platform[::20]  # (M, F / 20, 3); every 20th frame is dense enough
        is_near = np.linalg.norm(offsets, axis=2).min(axis=1) < max_distance * robot.length
        is_near |= is_near.mean() > 0.5  # a curve that is mostly near is drawn whole
        ends = np.flatnonzero(np.diff(is_near)) + 1
        for piece, near in zip(np.split(line, ends), np.split(is_near, ends), strict=True):
            if near[0] and len(piece) > 1:  # all points of a piece are near, or none is
                pieces.append(piece)
    return pieces


def encode_locus(
    robot: ParallelRobot, curves: LocusCurves | None, platform: Array, *, max_distance: float = LOCUS_MARGIN
) -> Document | None:
    """Encode the locus near the platform for the page; None if no curve is near."""
    pieces = [encode_floats(line) for line in locus_lines(robot, curves, platform, max_distance=max_distance)]
    whole = robot.platform.is_point
    return {"kind": "curves", "curves": pieces, "whole": whole} if pieces else None
