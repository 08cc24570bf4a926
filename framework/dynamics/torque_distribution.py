"""Torques of redundant motors: how the motors of a rigid robot share the load of a motion.

The motion determines torques tau of its n_a motors up to internal torques N x, which move nothing and strain
the robot alone: M N = 0 with the M of `forces.balanced_forces`, r = n_a - n columns. In units of a reference,
torques t = tau / reference have the projector Q on internal torques, and

    t = (1 - Q) t + Q sum_k B_k(time) N_k x_k

is a distribution of the load for any x: the first part is the one of least norm, B_k are cubic splines, and
the columns of N_k are an orthonormal basis of internal torques at the centre of spline k. Q makes the sum
internal at every instant, so that the equations of motion hold whatever the x. Of all x that keep the limits,
the one of least norm is taken: it is unique.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial import chebyshev

from framework.dynamics.forces import internal_projectors
from framework.dynamics.motion_checks import check_instants, residual_torques
from framework.dynamics.result import InverseDynamics
from framework.numerics.arrays import Array
from framework.numerics.chebyshev import TimeFunction, TimeGrid, nodes, peak_sizes
from framework.numerics.cone_program import (
    AffineRows,
    ConeProgram,
    Unsolved,
    linear_rows,
    solve_cone_program,
)
from framework.numerics.sparse_rows import SparseRows
from framework.numerics.splines import Splines
from framework.tolerances import LIMIT_MARGIN

SPLINE_DEGREE = 3  # of the B-splines B_k of internal torques
MIN_PARTS, MIN_CELLS = 2, 48  # of a panel of the torques; of a motion
FIRST_ROWS = 0.7  # torques of least norm above this share of a limit have rows of it from the first
INNER_POINTS = np.array([0.25, 0.5, 0.75])  # of the interval of two nodes, where torques are compared, too
MAX_ROUNDS = 8  # of adding rows
MAX_NODES = 16  # of a cell, on which internal torques are polynomials times a smooth projector
ROOM = 0.1 * LIMIT_MARGIN  # share of limits that is left free for peaks between the nodes
PEAK_ROUNDING = 1e-5  # share by which a least peak may be exceeded: an error of the solver
ROW_ROUNDING = 3e-5  # share by which a limit is exceeded at a node that then gets rows


def internal_frames(projectors: Array, r: int, reference: Array | None = None) -> Array:
    """Compute orthonormal bases (T, n_a, r) of the internal torques of r redundant motors.

    Args:
        reference: (n_a,) by which internal torques are divided; 1 by default.
    """
    frames = np.linalg.eigh(projectors)[1][..., -r:]  # of the eigenvalue 1, the largest
    return frames if reference is None else np.linalg.qr(frames / reference[:, None])[0]


def internal_rows(projectors: Array, splines: SparseRows, frames: Array) -> tuple[SparseRows, ...]:
    """Compute rows (T, n r) of each motor's internal torque on coefficients x (n r,).

    The torques at a point are Q sum_k B_k N_k x_k, of n splines.

    Args:
        projectors: Q (T, n_a, n_a).
        splines: values (T, n) of B_k.
        frames: N_k (n, n_a, r).
    """
    n, n_a, r = frames.shape
    blocks = projectors[splines.row] @ frames[splines.column] * splines.values[:, None, None]  # (E, n_a, r)
    row = splines.row.repeat(r)
    column = (splines.column[:, None] * r + np.arange(r)).ravel()
    shape = (splines.shape[0], n * r)
    return tuple(SparseRows(row, column, blocks[:, j].ravel(), shape) for j in range(n_a))


def second_differences(frames: Array) -> SparseRows:
    """Compute rows of c_(k-1) - 2 c_k + c_(k+1) of the internal torques c_k = N_k x_k of splines k.

    Args:
        frames: N_k (n, n_a, r).

    Returns:
        A matrix ((n - 2) n_a, n r).
    """
    n, n_a, r = frames.shape
    k, motor, column, step = np.indices((n - 2, n_a, r, 3)).reshape(4, -1)
    weights = np.array([1.0, -2.0, 1.0])
    values = weights[step] * frames[k + step, motor, column]
    return SparseRows.sort_entries(k * n_a + motor, (k + step) * r + column, values, ((n - 2) * n_a, n * r))


def least_peak_torques(torques: Array, projectors: Array, limit: Array, r: int) -> Array:
    """Compute torques (T, n_a) of least peak over the limits, point by point.

    Redundant motors add internal torques, which move nothing: those of r dimensions with coefficients x (r,).
    At each point |torque| <= peak limit for all motors, and the peak is minimised.

    Args:
        torques: (T, n_a) [N m], of any distribution; returned if no motor counts or no solution is found.
        projectors: (T, n_a, n_a) on the internal torques.
        limit: (n_a,) [N m]; infinite for motors that do not count.
        r: number of redundant motors.
    """
    limited = np.flatnonzero(np.isfinite(limit))
    if not len(limited):
        return torques
    unit = limit.min()  # of x and of torques in the program
    points = SparseRows.identity(len(torques))  # each point has an x and a peak of its own
    rows = internal_rows(projectors, points, internal_frames(projectors, r))
    bounds = [  # peak limit -+ torque >= 0
        AffineRows(
            {"x": sign * rows[motor], "peak": points * (limit[motor] / unit)}, sign * torques[:, motor] / unit
        )
        for motor in limited
        for sign in (-1.0, 1.0)
    ]
    count = len(torques)
    # |PEAK_ROUNDING x|^2 in the cost chooses nearly the least of all x with the same peak
    smallest = linear_rows(x=SparseRows.identity(r * count) * PEAK_ROUNDING)
    unknowns, cost = {"x": r * count, "peak": count}, {"peak": np.ones(count)}
    optimum = solve_cone_program(ConeProgram(unknowns, cost, square=smallest, nonnegative=bounds))
    if isinstance(optimum, Unsolved):
        return torques
    return torques + unit * np.stack([row @ optimum["x"] for row in rows], axis=1)


def distribute_torques(
    result: InverseDynamics, limit: Array, reference: Array, *, least_norm: bool, least_peak: bool
) -> InverseDynamics:
    """Distribute a rigid motion's torques over redundant motors, within limits if possible.

    Torques of least norm that keep the limits stay as they are, unless another goal is asked for. If no
    distribution keeps the limits, the one that exceeds them least is taken.

    Args:
        limit: (n_a,) [N m], motor side; infinite for motors without a limit.
        reference: (n_a,) [N m] by which torques are divided.
        least_norm: whether the norm of torque / reference is to be the least at each instant.
        least_peak: whether the largest torque / reference of the motion is to be the least.
    """
    if not (least_norm or least_peak) and _limit_ratio(result, result.torques, limit) <= 1.0:
        return result
    motion = _SharedMotion.of(result, reference)
    if not least_peak:
        torques = motion.fit_torques(None)
        if _limit_ratio(result, torques, limit) <= 1.0:
            return motion.certify(torques)
    # of least norm within the limits, or within the least peak
    allowed = (1.0 - ROOM) * limit
    least = None
    if least_peak:
        least = motion.solve_within(reference, least_peak=True)
        if least is None:
            return result
        _, peak = least
        allowed = np.minimum(limit, (1.0 + PEAK_ROUNDING) * peak * reference)
    internal = motion.solve_within(allowed, least_peak=False) or least
    internal = internal or motion.solve_within(limit, least_peak=True)
    return result if internal is None else motion.certify(motion.fit_torques(internal[0]))


def _limit_ratio(result: InverseDynamics, torques: TimeFunction, limit: Array) -> float:
    """Compute the largest ratio of torques, with dry friction, to limits (n_a,)."""
    changed = replace(result, torques=torques)
    peaks = peak_sizes(changed.torque, torques.grid)
    return float((peaks / limit).max())


@dataclass(frozen=True, eq=False)
class _SharedMotion:
    """A motion whose torques are to be distributed, on a grid of T nodes.

    least_norm: torques (T, n_a) of least norm over the reference, without dry friction.
    friction: dry friction (T, n_a) over the reference.
    rows: internal torques (T, n r) of each motor, linear in x.
    """

    result: InverseDynamics
    reference: Array
    grid: TimeGrid
    least_norm: Array
    friction: Array
    rows: tuple[SparseRows, ...]

    @staticmethod
    def of(result: InverseDynamics, reference: Array) -> _SharedMotion:
        """Cut a motion's panels in MIN_CELLS or more cells of splines in time."""
        edges, size = result.torques.edges, result.torques.grid.size
        parts = max(MIN_PARTS, -(-MIN_CELLS // (len(edges) - 1)))
        starts = edges[:-1, None] + np.diff(edges)[:, None] * np.arange(parts) / parts
        grid = TimeGrid(np.append(starts, edges[-1]), min(size, MAX_NODES))
        times = grid.times
        projectors = _scaled_projectors(result, times, reference)
        torques = result.torques(times) / reference
        least_norm = torques - (projectors @ torques[..., None])[..., 0]  # (T, n_a)
        friction = np.zeros_like(torques) if result.friction is None else result.friction(times) / reference

        splines = Splines.on_cells(grid.edges, SPLINE_DEGREE)
        at_centres = _scaled_projectors(result, splines.centres, reference)
        frames = internal_frames(at_centres, result.robot.n_a - result.robot.n)
        rows = internal_rows(projectors, splines.matrix(times), frames)
        return _SharedMotion(result, reference, grid, least_norm, friction, rows)

    def _add_internal(self, x: Array | None) -> Array:
        """Compute torques (T, n_a) over the reference, with internal ones of x (n r,) if any."""
        if x is None:
            return self.least_norm
        return self.least_norm + np.stack([row @ x for row in self.rows], axis=1)

    def fit_torques(self, x: Array | None) -> TimeFunction:
        """Fit torques with internal ones of x (n r,), if any, without dry friction."""
        return self.grid.fit(self.reference * self._add_internal(x))

    def certify(self, torques: TimeFunction) -> InverseDynamics:
        """Return the motion certified with other torques."""
        result, robot = self.result, self.result.robot
        times = check_instants(robot, self.grid)
        motion = result.motion(times, closed=False)
        rotors = robot.rotor_inertia * robot.gear_ratio * motion.a[:, robot.actuated]
        joint_torques = robot.gear_ratio * (torques(times) - rotors)
        residual = residual_torques(robot, motion, joint_torques)
        residual[:, robot.structure.idle] = 0.0  # limited by `check_idle_joints`
        certificate = replace(
            result.certificate,
            tail=max(result.certificate.tail, torques.tail),
            max_residual_torque=float(np.abs(residual).max()),
        )
        return replace(result, torques=torques, certificate=certificate)

    def solve_within(self, limit: Array, *, least_peak: bool) -> tuple[Array, float] | None:
        """Solve for x (n r,), of least norm or of least peak, with |torque| <= peak limit at all nodes.

        Rows where torques of least norm are large come first, and others where the solution exceeds limits.

        Args:
            limit: (n_a,) [N m]; motors with an infinite limit have no rows.
            least_peak: whether the peak is minimised; otherwise it is 1.

        Returns:
            x and the peak, or None if unsolved.
        """
        count = self.rows[0].shape[1]
        if least_peak:
            program = ConeProgram({"x": count, "peak": 1}, {"peak": np.ones(1)})
        else:
            program = ConeProgram({"x": count}, square=linear_rows(x=SparseRows.identity(count)))
        torques = self.least_norm + self.friction  # (T, n_a) over the reference
        allowed = np.tile(limit / self.reference, (len(torques), 1))  # (T, n_a)
        has_row = np.abs(torques) > FIRST_ROWS * allowed
        if least_peak:
            has_row |= np.isfinite(allowed)
        has_row[::2] = False
        for _ in range(MAX_ROUNDS):
            bounds = []
            for motor in np.flatnonzero(has_row.any(axis=0)):
                chosen = np.flatnonzero(has_row[:, motor])
                largest = allowed[chosen, motor]
                for sign in (-1.0, 1.0):
                    parts = {"x": sign * self.rows[motor][chosen]}
                    offset = sign * torques[chosen, motor]
                    if least_peak:
                        parts["peak"] = SparseRows.of(largest[:, None])
                    else:
                        offset = offset + largest
                    bounds.append(AffineRows(parts, offset))
            optimum = solve_cone_program(replace(program, nonnegative=bounds))
            if isinstance(optimum, Unsolved):
                return None
            x, peak = optimum["x"], float(optimum["peak"][0]) if least_peak else 1.0

            # rows where a limit is exceeded at a node or beside it; lower limits by the excess beside it
            sizes = np.abs(self._add_internal(x) + self.friction)
            beside = np.maximum(sizes, self._largest_beside(x))
            ratio = beside / (peak * limit / self.reference)
            is_exceeded = ratio > 1.0 + ROW_ROUNDING
            if not is_exceeded.any():
                break
            between = is_exceeded & has_row & (beside > sizes)
            allowed[between] /= ratio[between]
            has_row |= is_exceeded
        return x, peak

    def _largest_beside(self, x: Array) -> Array:
        """Compute the largest torques (T, n_a) over the reference beside each node, for coefficients x.

        They are those at the INNER_POINTS of the intervals between the nodes of a cell.
        """
        series = self.grid.fit(self._add_internal(x)).coefficients  # (cells, size, n_a)
        size = series.shape[1]
        at_nodes = nodes(size)
        points = at_nodes[:-1, None] + np.diff(at_nodes)[:, None] * INNER_POINTS  # (size - 1, p)
        values = chebyshev.chebvander(points, size - 1) @ series[:, None]  # (cells, size - 1, p, n_a)
        friction = self.friction.reshape(len(series), size, -1)
        pad = ((0, 0), (1, 1), (0, 0))
        right = np.pad(np.abs(values + friction[:, :-1, None]).max(axis=2), pad)  # (cells, size + 1, n_a)
        left = np.pad(np.abs(values + friction[:, 1:, None]).max(axis=2), pad)
        return np.maximum(right[:, 1:], left[:, :-1]).reshape(self.least_norm.shape)


def _scaled_projectors(result: InverseDynamics, times: Array, reference: Array) -> Array:
    """Compute the projectors (T, n_a, n_a) on internal torques over a reference (n_a,), at times (T,)."""
    robot = result.robot
    projectors = internal_projectors(robot, result.motion(times).linearised)
    frames = internal_frames(projectors, robot.n_a - robot.n, reference)
    return np.asarray(frames @ frames.swapaxes(1, 2))
