"""The torques of all laws along a path, as functions of s that are polynomials on cells.

Over their reference, torques are c + cz z + cu u + d sqrt(z), with z = s'^2 and u = z'/2. Multipliers nu (m,)
of them are sought as the sum of x_i v_i, with x (m,) polynomials on each cell, and

    v_0 = 2 cu / |cu|^2,     v_i = e_i - cu (cu . e_i) / |cu|^2,     e_i constant on the cell,

so that nu . cu / 2 = x_0. At a crossing c, cz, cu and d have a pole along one and the same vector: there all
v and their products with these are smooth, and condition (8) needs no multiplier. Where that is not so (the
path touches the locus, runs orthogonal to t_s, or several motions escape at once) functions do not resolve.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.laws.optimal_law import Smoothstep, Stretch
from framework.numerics.arrays import Array, BoolArray, IntArray
from framework.numerics.bernstein import NODES, Bernstein, cell_nodes, fit_bernstein
from framework.planning.optimal.optimal_task import Task
from framework.planning.optimal.phase_plane import Demand, demand

END_ORDER = 4  # of the smoothstep by which cells are narrower towards both ends of the path
LEAST_WIDTH = 1e-6  # of a cell in s: an edge or a knot nearer to a crossing is taken to be at it
MAX_CUTS = 14  # of cells on which functions do not resolve, or a motor with dry friction reverses


class PathSeries(NamedTuple):
    """The functions of m torques and n motor speeds on cells between edges (k + 1,) of s."""

    edges: Array
    directions: Array  # (k, m - 1, m) e_i
    v: Bernstein  # (..., m, m) v_i by rows
    constant: Bernstein  # (..., m) v_i . c
    per_z: Bernstein  # (..., m) v_i . cz
    damping: Bernstein  # (..., m) v_i . d
    squared_speed: Bernstein  # (..., n) of motors with a limit, over its square and z

    @property
    def width(self) -> Array:
        return np.diff(self.edges)


def uniform_cells(task: Task, count: int) -> Array:
    """Return edges (k + 1,) in s of about `count` cells, each crossing in the middle of one.

    Cells are equal in the stretched parameter of optimal laws: narrow towards both ends and beside crossings.
    Knots of the path and of wrenches are edges. The cell about a crossing reaches a third of the way to the
    next edge or crossing.
    """
    branch = task.branch
    phi = Smoothstep(END_ORDER)
    crossings = _crossings(task)
    stretch = Stretch(tuple(map(float, phi.inverse(crossings))))
    xi = np.linspace(-1.0, 1.0, count + 1)
    edges = np.clip(phi(stretch.inverse(xi)), 0.0, 1.0)
    edges = np.unique(np.concatenate([edges, branch.path.knots, branch.wrenches.knots]))
    for s in crossings:
        edges = edges[np.abs(edges - s) > LEAST_WIDTH]
        others = np.append(edges, crossings[crossings != s])
        third = np.abs(others - s).min() / 3.0
        edges = np.append(edges, [s - third, s + third])
    return np.sort(edges)


def cut_cells(task: Task, edges: Array, parts: IntArray) -> Array:
    """Return the edges after each cell is cut in `parts` (k,), an odd number about a crossing.

    Then no edge is on a crossing, which stays in the middle of a cell.
    """
    has_crossing = cells_about(edges, _crossings(task))
    parts = parts + (has_crossing & (parts % 2 == 0))
    width = np.repeat(np.diff(edges) / parts, parts)
    first_part = np.cumsum(parts) - parts  # of each cell
    number_in_cell = np.arange(parts.sum()) - np.repeat(first_part, parts)
    return np.append(np.repeat(edges[:-1], parts) + number_in_cell * width, edges[-1])


def cells_about(edges: Array, points: Array) -> BoolArray:
    """Return a mask (k,) of the cells between edges (k + 1,) that have a point inside."""
    return np.asarray(((edges[:-1, None] < points) & (points < edges[1:, None])).any(axis=1))


def _crossings(task: Task) -> Array:
    """Return s of the crossings inside (0, 1)."""
    return np.array([point.s for point in task.to_cross.points if 0.0 < point.s < 1.0])


def resolve_series(task: Task, reference: Array, edges: Array) -> PathSeries | None:
    """Compute the functions on cells, cut in two until all functions resolve; None without success.

    Args:
        reference: (n_a,) of the torques; a motor where that is infinite is left out.
        edges: (k + 1,) of s, with all knots.
    """
    for _ in range(MAX_CUTS):
        fit = _fit_series(task, reference, edges)
        to_cut = ~fit.is_resolved | fit.reverses
        if not to_cut.any():
            break
        edges = cut_cells(task, edges, np.where(to_cut, 2, 1))
    return fit.series if fit.is_resolved.all() else None  # a reversal in a narrow cell counts as an error


class _Fit(NamedTuple):
    """The functions on k cells, and the cells on which the fit is poor."""

    series: PathSeries
    is_resolved: BoolArray  # (k,)
    reverses: BoolArray  # (k,) a motor with dry friction reverses in the cell


def _fit_series(task: Task, reference: Array, edges: Array) -> _Fit:
    """Fit the functions v_i, v_i . c, v_i . cz, v_i . d and the squared speeds on cells."""
    samples = _sample_cells(task, reference, edges)
    directions, v = _multiplier_basis(samples.per_u)
    torques = (samples.constant, samples.per_z, samples.damping)
    products = [(v @ torque[..., None])[..., 0] for torque in torques]  # (k, NODES, m) v_i . torque
    values = (v, *products, samples.speed_ratio**2)
    functions, masks = zip(*map(fit_bernstein, values), strict=True)
    series = PathSeries(edges, directions, *functions)
    # an error of c changes v_i . c by the largest |v_i| in the cell times that error
    largest_v = np.abs(v).max(axis=1)  # (k, m, m)
    error = (largest_v @ samples.friction_error[..., None])[..., 0]
    series = series._replace(constant=series.constant._replace(error=series.constant.error + error))
    return _Fit(series, np.asarray(np.all(masks, axis=0)), np.asarray(samples.friction_error.any(axis=1)))


class _Samples(NamedTuple):
    """Torques and speeds at the nodes of k cells, of the m motors whose torques count."""

    constant: Array  # (k, NODES, m) c over the reference, with dry friction
    per_z: Array  # (k, NODES, m) cz
    damping: Array  # (k, NODES, m) d
    per_u: Array  # (k, NODES, m) cu
    speed_ratio: Array  # (k, NODES, n) speeds per s' over the limits, of the n motors with a limit
    friction_error: Array  # (k, m) of dry friction in the constant


def _sample_cells(task: Task, reference: Array, edges: Array) -> _Samples:
    """Sample torques and speeds at the nodes of each cell."""
    specification = task.specification
    counts = np.isfinite(reference)
    s = (edges[:-1, None] + np.diff(edges)[:, None] * cell_nodes()).ravel()
    required = demand(task.branch, Smoothstep(0), s)
    friction, friction_error = _mean_friction(required, specification.friction)
    torque = required.torque
    parts = (torque.constant + friction, torque.per_z, required.damping, torque.per_u)
    constant, per_z, damping, per_u = (_split_by_cell(part / reference)[..., counts] for part in parts)
    is_limited = np.isfinite(specification.speed_limit)
    speed_ratio = _split_by_cell(required.speed / specification.speed_limit)[..., is_limited]
    return _Samples(constant, per_z, damping, per_u, speed_ratio, (friction_error / reference)[:, counts])


def _split_by_cell(values: Array) -> Array:
    """Return values (k NODES, n) as (k, NODES, n)."""
    return values.reshape(-1, NODES, values.shape[-1])


def _mean_friction(required: Demand, size: Array) -> tuple[Array, Array]:
    """Return the mean dry friction of each cell at its nodes (k NODES, n_a), and its error (k, n_a).

    The error is 2 size where a motor reverses within a cell. A reversal and back between two nodes is not
    seen, as in plans.
    """
    friction = _split_by_cell(required.friction(size))
    mean = np.repeat(friction.mean(axis=1), NODES, axis=0)
    return mean, np.where(np.ptp(friction, axis=1) > 0.0, 2.0 * size, 0.0)


def _multiplier_basis(per_u: Array) -> tuple[Array, Array]:
    """Compute e (k, m - 1, m) and v (k, NODES, m, m) for torques per u (k, NODES, m).

    v_0 = 2 cu / |cu|^2 and v_i = e_i - cu (cu . e_i) / |cu|^2. The e_i are orthogonal to cu at a node beside
    the middle of the cell.
    """
    along = per_u / (per_u**2).sum(axis=2, keepdims=True)  # cu / |cu|^2
    orthonormal = np.linalg.svd(per_u[:, NODES // 2, :, None])[0]  # its first column is along cu
    e = orthonormal[:, :, 1:].swapaxes(1, 2)
    cosines = per_u @ e.swapaxes(1, 2)  # (k, NODES, m - 1) cu . e_i
    across = e[:, None] - cosines[..., None] * along[:, :, None]
    return e, np.concatenate([2.0 * along[:, :, None], across], axis=2)
