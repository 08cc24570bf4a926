"""The torques and speeds of all laws along a path, as series in s on cells.

The search for a law takes dozens of cone programs with thousands of points. `SampledDemand` gives torques and
speeds there by Chebyshev series, which require the robot's equations at only some hundred poses. All torques
have a pole at a crossing s_c, so that the series are those of torque (s - s_c).

Bounds of all laws need error bounds and products, and so functions in Bernstein form, `PathSeries`. A law
s(t) has z = s'^2 and u = s" = z'/2. Over their reference, torques are c + cz z + cu u + d sqrt(z). Their
multipliers nu (m,) are sought as the sum of x_i v_i, with x (m,) polynomials on each cell, and

    v_0 = 2 cu / |cu|^2,     v_i = e_i - cu (cu . e_i) / |cu|^2,     e_i constant on the cell,

so that nu . cu / 2 = x_0. Redundant motors can distribute a load in many ways, which differ by internal
torques. A bound of all distributions needs a nu orthogonal to internal torques: cu and e_i of these formulas
are then projected on the complement of internal torques. At a crossing c, cz, cu and d have poles along the
same vector. All v, and their products with c, cz, cu and d, are therefore smooth at the crossing, and
condition (8) needs no multiplier. The functions do not resolve if the path touches the locus, runs orthogonal
to t_s, or loses hold of several motions at once.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.dynamics.torque_distribution import internal_frames
from framework.laws.optimal_law import Smoothstep
from framework.laws.squared_speed import Stretch
from framework.numerics.arrays import Array, BoolArray, IntArray
from framework.numerics.bernstein import NODES, Bernstein, cell_nodes, fit_bernstein
from framework.numerics.chebyshev import TimeFunction, TimeGrid
from framework.planning.optimal.optimal_task import Task
from framework.planning.optimal.phase_plane import Demand, PathTerms, demand
from framework.tolerances import MEASURE_TAIL

END_ORDER = 4  # of the smoothstep that makes cells narrower towards both ends of the path
LEAST_WIDTH = 1e-6  # of a cell in s: an edge or knot nearer to a crossing counts as equal to it
MAX_CUTS = 14  # rounds of cutting cells where functions do not resolve or a motor with dry friction reverses
MAX_RESOLVED_CELLS = 4000  # functions that do not resolve on so many cells count as unresolved
TORQUE_ROUNDING = 1e-13  # of torques per s'^2, relative to torques per s"
FIRST_CHEBYSHEV_CELLS = 4
CHEBYSHEV_NODES = 16  # an even number: no node in the middle of a cell, where a crossing is
MAX_CHEBYSHEV_CELLS = 60  # with more cells, the equations are evaluated at each point of a program instead


class PathSeries(NamedTuple):
    """Functions of m torques and n motor speeds on k cells between edges (k + 1,) of s.

    There are l functions v_i, as many as torques without redundant motors.
    """

    edges: Array
    directions: Array  # (k, l - 1, m) e_i
    v: Bernstein  # (..., l, m) v_i by rows
    constant: Bernstein  # (..., l) v_i . c
    per_z: Bernstein  # (..., l) v_i . cz
    damping: Bernstein  # (..., l) v_i . d
    squared_speed: Bernstein  # (..., n) of motors with a speed limit, over the squared limit and z

    @property
    def width(self) -> Array:
        return np.diff(self.edges)


def uniform_cells(task: Task, count: int) -> Array:
    """Return edges (k + 1,) in s of about `count` cells, with each crossing in the middle of one.

    Cells have equal widths in the stretched parameter of optimal laws, so that they are narrow towards both
    ends and beside crossings. Knots of the path and of wrenches are edges. The cell about a crossing reaches
    a third of the way to the next edge or crossing.
    """
    branch = task.branch
    phi = Smoothstep(END_ORDER)
    crossings = _crossings(task)
    stretch = Stretch(tuple(map(float, phi.inverse(crossings))))
    xi = np.linspace(-1.0, 1.0, count + 1)
    edges = np.clip(phi(stretch.inverse(xi)), 0.0, 1.0)
    edges = np.unique(np.concatenate([edges, branch.path.knots, branch.wrenches.knots]))
    for s in crossings:  # replace an edge on the crossing by the edges of a cell about it
        edges = edges[(np.abs(edges - s) > LEAST_WIDTH) | (edges == 0.0) | (edges == 1.0)]
        others = np.append(edges, crossings[crossings != s])
        third = np.abs(others - s).min() / 3.0
        edges = np.append(edges, [s - third, s + third])
    return np.sort(edges)


def cut_cells(task: Task, edges: Array, parts: IntArray) -> Array:
    """Cut each cell in `parts` (k,) of equal width; return the new edges.

    A cell about a crossing is cut in an odd number of parts: the crossing stays in the middle of a cell.
    """
    has_crossing = cells_about(edges, _crossings(task))
    parts = parts + (has_crossing & (parts % 2 == 0))
    cell_of_part = np.repeat(np.arange(len(parts)), parts)
    first_part = np.cumsum(parts) - parts  # of each cell
    number_in_cell = np.arange(len(cell_of_part)) - first_part[cell_of_part]
    width = np.diff(edges) / parts
    starts = edges[cell_of_part] + number_in_cell * width[cell_of_part]
    return np.append(starts, edges[-1])


def cells_about(edges: Array, points: Array) -> BoolArray:
    """Return the mask (k,) of cells between edges (k + 1,) with a point in their interior."""
    return np.asarray(((edges[:-1, None] < points) & (points < edges[1:, None])).any(axis=1))


def _crossings(task: Task) -> Array:
    """Return the crossings, s in (0, 1)."""
    return np.array([point.s for point in task.to_cross.points if 0.0 < point.s < 1.0])


def resolve_series(task: Task, reference: Array, edges: Array) -> PathSeries | None:
    """Fit functions on cells, halved until all functions resolve; None without success.

    Args:
        reference: torques (n_a,) [N m] by which torques are divided, such as their limits; motors with an
            infinite reference are left out.
        edges: edges (k + 1,) of the cells in s, all knots among them.
    """
    for _ in range(MAX_CUTS):
        series, is_resolved, reverses = _fit_series(task, reference, edges)
        to_cut = ~is_resolved | reverses
        if not to_cut.any() or len(edges) > MAX_RESOLVED_CELLS:
            break
        edges = cut_cells(task, edges, np.where(to_cut, 2, 1))
    # a motor may still reverse in a narrow cell: the friction error of that cell covers it
    return series if is_resolved.all() else None


def _fit_series(task: Task, reference: Array, edges: Array) -> tuple[PathSeries, BoolArray, BoolArray]:
    """Fit the functions of `PathSeries` on k cells: v_i, v_i . c, v_i . cz, v_i . d and squared speeds.

    Args:
        reference: torques (n_a,) [N m] by which torques are divided; infinite for motors that are left out.
        edges: edges (k + 1,) of the cells in s.

    Returns:
        The functions; masks (k,) of cells on which they resolve, and in which a motor with friction reverses.
    """
    specification = task.specification
    s = (edges[:-1, None] + np.diff(edges)[:, None] * cell_nodes()).ravel()
    required = demand(task.branch, Smoothstep(0), s)  # Smoothstep(0) is the identity: sigma = s

    def split(values: Array, limit: Array) -> Array:
        """Return values (k NODES, n_a) over limits (n_a,) by cell, (k, NODES, m) of the m motors with any."""
        return (values / limit).reshape(-1, NODES, len(limit))[..., np.isfinite(limit)]

    # the torque c + cz z + cu u + d sqrt(z), with the mean dry friction of a cell in c. A constant is a
    # series; friction jumps by twice its size where a motor reverses. Two reversals between neighbouring
    # nodes remain unseen, as in plans
    friction = split(required.friction(specification.friction), reference)
    c = split(required.torque.constant, reference) + friction.mean(axis=1, keepdims=True)
    cz, cu, d = (
        split(part, reference) for part in (required.torque.per_z, required.torque.per_u, required.damping)
    )
    sizes_of_friction = (specification.friction / reference)[np.isfinite(reference)]  # (m,)
    friction_error = np.where(np.ptp(friction, axis=1) > 0.0, 2.0 * sizes_of_friction, 0.0)  # (k, m) of c
    internal = None
    if required.internal is not None:
        frames = internal_frames(required.internal, task.robot.n_a - task.robot.n)  # (k NODES, n_a, r)
        internal = np.stack([split(frame, reference) for frame in np.moveaxis(frames, 2, 0)], axis=3)

    # e_i (k, l - 1, m), v_i (k, NODES, l, m) and v_i . torque (k, NODES, l)
    directions, v = _multiplier_basis(cu, internal)
    v_c, v_cz, v_d = (np.matvec(v, torque) for torque in (c, cz, d))
    # a path without centrifugal torques has rounding in their place, which no cell resolves
    sizes = np.linalg.norm(v, axis=3) * np.linalg.norm(cu, axis=2)[..., None]
    largest = np.abs(v_cz).max(axis=1)  # (k, l)
    rounding = np.where(largest <= TORQUE_ROUNDING * sizes.max(axis=1), largest, 0.0)
    v_cz = np.where(rounding[:, None] > 0.0, 0.0, v_cz)
    squared_speed = split(required.speed, specification.speed_limit) ** 2
    functions, masks = zip(*map(fit_bernstein, (v, v_c, v_cz, v_d, squared_speed)), strict=True)
    series = PathSeries(edges, directions, *functions)  # functions are in the order of its fields
    # an error of c changes v_i . c by at most that error times the largest |v_i| in the cell
    error = np.matvec(np.abs(v).max(axis=1), friction_error)  # (k, l)
    series = series._replace(
        constant=series.constant._replace(error=series.constant.error + error),
        per_z=series.per_z._replace(error=series.per_z.error + rounding),
    )
    return series, np.asarray(np.all(masks, axis=0)), np.asarray(friction_error.any(axis=1))


def _multiplier_basis(per_u: Array, internal: Array | None) -> tuple[Array, Array]:
    """Compute the directions e (k, l - 1, m) and v (k, NODES, l, m) of multipliers nu.

    With the torques cu (k, NODES, m) per u, v_0 = 2 cu / |cu|^2 and v_i = e_i - cu (cu . e_i) / |cu|^2. The
    e_i of a cell are orthogonal to cu at the node beside its middle.

    Args:
        internal: bases (k, NODES, m, r) of internal torques, on whose complement cu and e_i are projected;
            None without redundant motors.
    """
    projectors = None
    if internal is not None:
        Q = np.linalg.qr(internal)[0]
        projectors = np.eye(per_u.shape[2]) - Q @ Q.swapaxes(2, 3)  # (k, NODES, m, m)
        per_u = np.matvec(projectors, per_u)
    along = per_u / (per_u**2).sum(axis=2, keepdims=True)  # cu / |cu|^2
    middle = per_u[:, NODES // 2, :, None]
    if internal is not None:
        middle = np.concatenate([middle, internal[:, NODES // 2]], axis=2)
    orthonormal = np.linalg.svd(middle)[0]  # (k, m, m) with cu, then internal torques, in the first columns
    e_columns = orthonormal[:, :, middle.shape[2] :]
    e = e_columns.swapaxes(1, 2)
    components = per_u @ e_columns  # (k, NODES, l - 1) cu . e_i
    directions = e[:, None] if projectors is None else e[:, None] @ projectors
    across = directions - components[..., None] * along[:, :, None]  # v_i
    return e, np.concatenate([2.0 * along[:, :, None], across], axis=2)


class SampledDemand(NamedTuple):
    """The demand on the motors along a path as series in s.

    poles: path coordinates s (k,) of the crossings; listed twice for a pole of second order.
    series: functions (5 n_a,) of s: torques at rest, per s'^2, per s" and per s', each multiplied by
        s - pole for all poles; and motor speeds per s'. With redundant motors, n_a^2 more are the entries of
        the projectors on internal torques.
    has_friction: whether dry friction acts on any motor.
    motors: number of motors n_a.
    """

    poles: Array
    series: TimeFunction
    has_friction: bool
    motors: int

    def evaluate(self, phi: Smoothstep, sigma: Array) -> Demand:
        """Compute the motors' torques and speeds at sigma (M,), affine in z and u."""
        s = phi(sigma)
        pole_product = _pole_product(s, self.poles)
        values = self.series(s)
        internal = None
        if values.shape[1] > 5 * self.motors:
            values, entries = np.split(values, [5 * self.motors], axis=1)
            internal = entries.reshape(len(s), self.motors, self.motors)
        *torques, speed = np.split(values, 5, axis=1)  # the five quantities of all motors
        torque, damping = PathTerms(*(torque / pole_product for torque in torques)).transform(phi, sigma)
        direction = speed if self.has_friction else None
        return Demand(torque, damping, speed * phi(sigma, 1)[:, None], direction, internal)


def _pole_product(s: Array, poles: Array) -> Array:
    """Compute the product (T, 1) of s - pole over all poles (k,), at s (T,)."""
    return (s[:, None] - poles).prod(axis=1)[:, None]


def sample_demand(task: Task) -> SampledDemand | None:
    """Fit Chebyshev series to the undeformed robot's demand along a path; None without success.

    Cells are halved until all quantities are resolved, or until there are too many cells.
    """
    points = task.to_cross.points
    # the pole is of second order if the path touches the locus, or if several motions are uncontrolled
    pole_orders = [1 + (point.corank > 1 or point.contact == "tangential") for point in points]
    poles = np.repeat([point.s for point in points], pole_orders)
    edges = uniform_cells(task, FIRST_CHEBYSHEV_CELLS)
    while len(edges) <= MAX_CHEBYSHEV_CELLS:
        grid = TimeGrid(edges, CHEBYSHEV_NODES)
        required = demand(task.branch, Smoothstep(0), grid.times)  # sigma = s, not times
        pole_product = _pole_product(grid.times, poles)
        torques = [part * pole_product for part in (*required.torque, required.damping)]
        quantities = [*torques, required.speed]
        if required.internal is not None:
            quantities.append(required.internal.reshape(len(grid.times), -1))
        series = grid.fit(np.concatenate(quantities, axis=1))
        # a quantity is resolved on a panel if it is finite and its last two coefficients are small compared
        # with the largest one, over all motors; torques per s'^2 and per s" have one unit, and either may be
        # rounding of the other
        sizes = np.abs(series.coefficients)  # (P, size, quantities)
        motors = task.robot.n_a
        by_quantity = sizes[..., : 5 * motors].reshape(*sizes.shape[:2], 5, motors).max(axis=3)
        at_rest, per_z, per_u, damping, speed = np.moveaxis(by_quantity, 2, 0)  # (P, size) each
        internal = sizes[..., 5 * motors :].max(axis=2, initial=0.0)
        sizes = np.stack([at_rest, np.maximum(per_z, per_u), damping, speed, internal], axis=2)
        is_resolved = sizes[:, -2:].max(axis=1) <= MEASURE_TAIL * sizes.max(axis=1)  # (P, 5), false for NaN
        if is_resolved.all():
            return SampledDemand(poles, series, required.direction is not None, motors)
        edges = cut_cells(task, edges, np.where(is_resolved.all(axis=1), 1, 2))
    return None
