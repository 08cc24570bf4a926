"""An estimate of the best possible law: the phase plane without smoothness at the ends, on a refined grid.

z = (ds/dt)^2 is linear on each cell of the path, zero at both ends; torques are looked at in the middle of
the cells, and a crossing is the middle of one. Accelerations may jump: up to the size of the cells this is a
relaxation, and its optimum is an estimate of the best that any law can do, and no proof.

Viscous damping is linearised about the law before, first that of the plan, until the optimum settles.

Source: Verscheure et al., IEEE TAC 54 (2009), whose discretisation this is; condition (8) is added.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from framework.arrays import Array
from framework.crossing.condition import CrossingPoint, crossing_point
from framework.crossing.optimal.phase_plane import SquaredSpeed, crossing_rows, demand
from framework.crossing.optimal.speed_program import OnPath, Units
from framework.crossing.result import CrossingPlan
from framework.crossing.specification import Specification
from framework.errors import NotConverged
from framework.kinematics.continuation.tracking import Branch, track_path
from framework.motion.cone_program import Affine, ConeProgram, Optimum, Unsolved, solve_cone_program
from framework.motion.optimal_law import Smoothstep
from framework.singularity.points_on_path import locate_singularities
from framework.tolerances import SAME_PLACE

PATH_CELLS = 120
MAX_TANGENTS = 20  # of damping
CROSSING_OFFSET = 1e-6  # in s, beside a crossing, where a cell's middle would be on it
SPEED_SAMPLES = 2001  # of the speed of a plan
MIN_LINEARISED_SPEED_RATIO = 1e-3  # of the mean or largest speed, about which damping is linearised
OPTIMUM_CHANGE = 1e-3  # share by which the optimum changes no more
# units of time over the plan's duration, one after the other if the solver gives up
TIME_UNITS = (1.0, 0.5, 2.0)


def estimated_best(plan: CrossingPlan, cells: int = PATH_CELLS) -> float | None:
    """Estimate the least duration [s], or the least peak of torque over its limit, of any law.

    Of the undeformed robot, with its damping and the dry friction planned with, under what the plan's law was
    asked for. None for energy and for a polynomial.

    Raises:
        NotConverged: the solver finds no optimum, or that with damping does not settle.
    """
    if plan.optimality is None or plan.optimality.specification.goal == "energy":
        return None
    specification = plan.optimality.specification
    branch = track_path(plan.robot, plan.path)
    points = locate_singularities(plan.robot, plan.path, branch=branch)
    branch = branch.under(plan.dynamics.wrenches)
    places = [crossing_point(branch, singular, None, singular.s) for singular in points]
    edges = _edges(np.array([place.s for place in places]), cells)
    torque = np.where(specification.limited_motors, specification.torque_limit, plan.optimality.reference)
    before = _speed_of(plan) if plan.robot.is_damped else None
    best = np.inf
    for _ in range(MAX_TANGENTS):
        on_path = _on_path(branch, places, edges, before)
        optimum, units = _solved(on_path, edges, plan, specification, torque)
        size = optimum.duration * units.time if specification.goal == "time" else optimum.peak
        if before is None or abs(size / best - 1.0) <= OPTIMUM_CHANGE:
            break
        best, before = size, _speed_between(edges, optimum.y * units.time**-2)
    else:
        raise NotConverged(
            f"{plan.robot.name}: no estimate of the best law: damping does not settle", residual=np.inf
        )
    if specification.goal == "time":
        return size
    return max(size, float((_at_rest(branch, specification.friction) / torque).max()))


def _solved(
    on_path: OnPath, edges: Array, plan: CrossingPlan, specification: Specification, torque: Array
) -> tuple[Optimum, Units]:
    """Compute the optimum of a specification, and the units of its time [s] and of `torque` (n_a,) [N m].

    Raises:
        NotConverged: the solver finds none.
    """
    for factor in TIME_UNITS:
        units = Units(factor * plan.duration, torque)
        longest = None if specification.most is None else specification.most / units.time
        optimum = solve_cone_program(
            _program(on_path, edges, specification, units), specification.goal, longest=longest
        )
        if isinstance(optimum, Optimum):
            return optimum, units
    why = optimum.status if isinstance(optimum, Unsolved) else "its limits contradict each other"
    raise NotConverged(f"{plan.robot.name}: no estimate of the best law found ({why})", residual=np.inf)


def _speed_of(plan: CrossingPlan) -> SquaredSpeed:
    """Return s'^2 of a plan as a function of s."""
    t = np.linspace(0.0, plan.duration, SPEED_SAMPLES)
    s, speed = plan.law(t), plan.law(t, 1)
    least = MIN_LINEARISED_SPEED_RATIO / plan.duration
    return lambda at: np.interp(at, s, np.maximum(speed, least) ** 2)


def _speed_between(edges: Array, inner: Array) -> SquaredSpeed:
    """Return s'^2 as a function of s, linear between its values at the edges, zero at both ends."""
    z = np.concatenate([[0.0], inner, [0.0]])
    least = MIN_LINEARISED_SPEED_RATIO**2 * float(z.max())
    return lambda at: np.maximum(np.interp(at, edges, z), least)


def _at_rest(branch: Branch, friction: Array) -> Array:
    """Compute the larger torque (n_a,) [N m] of both ends, of gravity and dry friction under a smooth law."""
    demanded = demand(branch, Smoothstep(2), np.array([0.0, 1.0]), None, "rigid")
    return np.asarray(np.abs(demanded.torque.constant + demanded.friction(friction)).max(axis=0))


def _edges(crossings: Array, cells: int) -> Array:
    """Return ends of the cells in s, narrower towards both ends of the path; crossings are in a middle."""
    edges = 0.5 - 0.5 * np.cos(np.pi * np.arange(cells + 1) / cells)
    for s in crossings:
        half = 0.25 * np.pi / cells * np.sqrt(s * (1.0 - s))
        edges = np.concatenate([edges[np.abs(edges - s) > 1.5 * half], [s - half, s + half]])
    return np.sort(edges)


def _on_path(
    branch: Branch, places: Sequence[CrossingPoint], edges: Array, before: SquaredSpeed | None
) -> OnPath:
    """Compute torques, speeds and condition (8) in the middle of the cells, or beside a crossing there."""
    middle = 0.5 * (edges[1:] + edges[:-1])
    conditions = [crossing_rows(branch, Smoothstep(0), place, None, before) for place in places]
    # u' is not in these unknowns: without its rows the bound is lower, and still one
    rows = [(sigma, row) for sigma, several in conditions for row in several if row[3] == 0.0]
    crossings = np.array([sigma for sigma, _ in rows])
    for s in crossings:
        middle = np.where(np.abs(middle - s) < SAME_PLACE, s + CROSSING_OFFSET, middle)
    demanded = demand(branch, Smoothstep(0), middle, None, "rigid", before)
    return OnPath(middle, demanded, crossings, np.array([row for _, row in rows]).reshape(-1, 4))


def _program(on_path: OnPath, edges: Array, specification: Specification, units: Units) -> ConeProgram:
    """Return the program on the values of z at the inner edges of the cells."""
    width = np.diff(edges)
    cells, n = len(width), len(edges) - 2
    whole = np.eye(n + 2)[:, 1:-1]
    mean, slope = 0.5 * (whole[1:] + whole[:-1]), (whole[1:] - whole[:-1]) / (2.0 * width[:, None])
    scale = units.time**-2
    torque = on_path.demand.torque
    constant = torque.constant + on_path.demand.friction(specification.friction)
    crossed = [int(np.searchsorted(edges, s)) - 1 for s in on_path.crossings]
    smooth = np.setdiff1d(np.arange(cells), crossed)  # in a crossing's cell condition (8) stands instead
    by_z, by_u = (values[smooth, :, None] for values in (torque.per_z, torque.per_u))
    matrix = scale * (by_z * mean[smooth, None] + by_u * slope[smooth, None])
    limited = np.isfinite(specification.speed_limit)
    squared = scale * (on_path.demand.speed[:, limited] / specification.speed_limit[limited]) ** 2
    required, per_z, per_u, _ = on_path.conditions.T[:, :, None]
    return ConeProgram(
        speeds=np.eye(n),
        average=mean,
        weights=width,
        positive=np.empty((0, n)),
        torque=Affine(
            (matrix / units.torque[:, None]).reshape(-1, n), (constant[smooth] / units.torque).ravel()
        ),
        bounded=np.tile(specification.limited_motors, len(smooth)),
        below_one=(squared[:, :, None] * mean[:, None]).reshape(-1, n),
        power=Affine(np.empty((0, n)), np.empty(0)),
        equalities=Affine(scale * (per_z * mean[crossed] + per_u * slope[crossed]), required[:, 0]),
        roughness=np.zeros((1, n)),
    )
