"""The functions of s that the torques of all laws along a path are made of, as polynomials on cells.

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

from framework.arrays import Array, BoolArray, IntArray
from framework.crossing.optimal.optimal_task import Task
from framework.crossing.optimal.phase_plane import Demand, demand
from framework.motion.bernstein import NODES, Bernstein, cell_nodes, fit_bernstein
from framework.motion.optimal_law import Smoothstep, Stretch

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
    """Return edges (k + 1,) in s of about `count` cells: knots among them, each crossing in a middle."""
    branch, phi = task.branch, Smoothstep(END_ORDER)
    crossings = _crossings(task)
    stretch = Stretch(tuple(map(float, phi.inverse(crossings))))
    edges = np.clip(phi(stretch.inverse(np.linspace(-1.0, 1.0, count + 1))), 0.0, 1.0)
    edges = np.unique(np.concatenate([edges, branch.path.knots, branch.wrenches.knots]))
    for s in crossings:
        edges = edges[np.abs(edges - s) > LEAST_WIDTH]
        others = np.append(edges, crossings[crossings != s])
        third = np.abs(others - s).min() / 3.0
        edges = np.append(edges, [s - third, s + third])
    return np.sort(edges)


def cut_cells(task: Task, edges: Array, parts: IntArray) -> Array:
    """Return edges of which each cell is cut in `parts` (k,), in an odd number about a crossing."""
    crossings = _crossings(task)
    about = ((edges[:-1, None] < crossings) & (crossings < edges[1:, None])).any(axis=1)
    parts = parts + (about & (parts % 2 == 0))
    width = np.repeat(np.diff(edges) / parts, parts)
    number = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    return np.append(np.repeat(edges[:-1], parts) + number * width, edges[-1])


def _crossings(task: Task) -> Array:
    return np.array([point.s for point in task.to_cross.points if 0.0 < point.s < 1.0])


def resolve_series(task: Task, reference: Array, edges: Array) -> PathSeries | None:
    """Compute the functions on cells, or on parts of them; None where they do not resolve.

    Args:
        reference: (n_a,) of the torques; a motor where that is infinite is left out.
        edges: (k + 1,) of s, with all knots.
    """
    for _ in range(MAX_CUTS):
        series, resolved, certain = _series_on(task, reference, edges)
        if (resolved & certain).all():
            break
        edges = cut_cells(task, edges, np.where(resolved & certain, 1, 2))
    return series if resolved.all() else None


def _series_on(task: Task, reference: Array, edges: Array) -> tuple[PathSeries, BoolArray, BoolArray]:
    """Compute the functions on cells, and masks (k,): resolved, and without a reversal of a motor."""
    branch, specification, motors = task.branch, task.specification, np.isfinite(reference)
    s = (edges[:-1, None] + np.diff(edges)[:, None] * cell_nodes()).ravel()
    asked = demand(branch, Smoothstep(0), s, None, task.geometry)
    friction, unknown = _mean_friction(asked, specification.friction)
    parts = (asked.torque.constant + friction, asked.torque.per_z, asked.damping, asked.torque.per_u)
    *torques, per_u = (_by_cell(part / reference)[..., motors] for part in parts)
    directions, v = _multiplier_basis(per_u)
    ratio = _by_cell(asked.speed / specification.speed_limit)[..., np.isfinite(specification.speed_limit)]
    fitted = [
        fit_bernstein(v),
        *(fit_bernstein((v @ torque[..., None])[..., 0]) for torque in torques),
        fit_bernstein(ratio**2),
    ]
    series = PathSeries(edges, directions, *(function for function, _ in fitted))
    left = (np.abs(v).max(axis=1) @ (unknown / reference)[:, motors, None])[..., 0]
    constant = series.constant._replace(error=series.constant.error + left)
    resolved = np.asarray(np.all([mask for _, mask in fitted], axis=0))
    return series._replace(constant=constant), resolved, np.asarray(~unknown.any(axis=1))


def _by_cell(values: Array) -> Array:
    return values.reshape(-1, NODES, values.shape[-1])


def _mean_friction(asked: Demand, size: Array) -> tuple[Array, Array]:
    """Return dry friction (k NODES, n_a), its mean on each cell, and what that may be off (k, n_a).

    A reversal and back between two nodes is not seen, as in plans.
    """
    friction = _by_cell(asked.friction(size))
    mean = np.repeat(friction.mean(axis=1), NODES, axis=0)
    return mean, np.where(np.ptp(friction, axis=1) > 0.0, 2.0 * size, 0.0)


def _multiplier_basis(per_u: Array) -> tuple[Array, Array]:
    """Return e (k, m - 1, m) and v (k, NODES, m, m) for torques (k, NODES, m) per u."""
    along = per_u / (per_u**2).sum(axis=2, keepdims=True)
    e = np.linalg.svd(per_u[:, NODES // 2, :, None])[0][:, :, 1:].swapaxes(1, 2)
    share = per_u @ e.swapaxes(1, 2)  # (k, NODES, m - 1)
    across = e[:, None] - share[..., None] * along[:, :, None]
    return e, np.concatenate([2.0 * along[:, :, None], across], axis=2)
