"""Search closed poses of a robot from several starts, within the joints' limits, where its reference is none.

Loops that share a joint are closed together and all others apart, so that two legs do not have to succeed at
once. For each such group the starts are the reference itself, then poses drawn around it from a fixed seed:
from a quarter, a half, all of the range of each joint. The range is that of its limits, or a half turn or a
length of the robot either way. From each start bounded trust-region least squares (`scipy.optimize`) nearly
closes the loops with joints near the reference, then closes them. The nearest of the first few closed poses
is returned.

The result closes the loops and keeps the limits. Parts may collide, and another way to assemble the robot may
be meant.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.errors import NotAssembled
from framework.kinematics.closures import (
    direction_gap_derivatives,
    direction_gaps,
    find_flipped_closure,
    loop_equations,
    row_weights,
    scale_jacobian,
)
from framework.kinematics.frames import FrameStack, frames_at, integrate, integrate_columns
from framework.kinematics.mechanism import Mechanism
from framework.kinematics.pinocchio_memory import scratch_of
from framework.model.loop_rows import LockedDirections, LoopRows
from framework.numerics.arrays import Array, IntArray
from framework.numerics.rotations import wrap_angles
from framework.tolerances import LOOP_GAP

MAX_STARTS = 32  # a group of loops, at most
ENOUGH_POSES = 8  # closed poses of a group to choose from
MAX_EVALUATIONS = (100, 20)  # of the loop equations: in the search for nearly closed ones, and to close them
START_SPREADS = (0.25, 0.5, 1.0)  # share of each joint's range that starts are drawn from, in turn
RANDOM_SEED = 0
MIN_JOINT_ROOM = 1e-9  # of a joint [rad, lengths of the robot], or of how far away its limits are
GAP_PER_RADIAN = 0.1  # gap of the loops that weighs as much as a joint one radian from the reference
ROUGH_TOLERANCE, FINE_TOLERANCE = 1e-6, 1e-12  # relative change, and slope, at which the two searches end


class ClosedPose(NamedTuple):
    """A configuration with closed loops, and its distance from the reference."""

    q: Array  # (nq,)
    joint: str  # farthest from the reference
    distance: str  # of that joint, "0.6 rad"


def find_closed_pose(mechanism: Mechanism) -> ClosedPose:
    """Find a configuration that closes all loops within the joints' limits, springs at rest.

    Raises:
        NotAssembled: no start leads to one; names a loop equation and the least gap.
    """
    lower, upper = _joint_ranges(mechanism)
    u = np.zeros(mechanism.nv)
    for group in _group_loops(mechanism, lower, upper):
        u[group.columns] = _nearest_closing(group)
    farthest, step = int(np.argmax(np.abs(u))), u * mechanism.column_scale
    distance = f"{abs(step[farthest]):.3g} {'m' if mechanism.sliding[farthest] else 'rad'}"
    q = integrate(mechanism, mechanism.q_near, step)
    return ClosedPose(q, mechanism.coordinates.name_of(farthest), distance)


@dataclass(frozen=True, eq=False)
class _Group:
    """m loop equations as functions of offsets u (k,) of their joints from the reference.

    Offsets are in radians and lengths of the robot.
    """

    mechanism: Mechanism
    rows: LoopRows
    directions: LockedDirections  # which the rows alone do not keep from turning over
    columns: IntArray  # (k,)
    lower: Array  # (k,) limits of the joints, else infinite
    upper: Array  # (k,)

    def equations(self, u: Array) -> Array:
        """Compute the loop equations (m,), in lengths of the robot and radians."""
        residual = loop_equations(self.rows, self._frames(u)).residual[0]
        return row_weights(self.mechanism, self.rows.rotation) * residual

    def gap(self, u: Array) -> Array:
        """Compute the loop equations (m,), then the vectors (3 d,) that vanish unless a loop is flipped."""
        vectors = direction_gaps(self.directions, self._frames(u))[0]
        return np.concatenate([self.equations(u), vectors.ravel()])

    def slope(self, u: Array) -> Array:
        """Compute the derivative (m + 3 d, k) of `gap` along the k joints."""
        frames = self._frames(u)
        jacobian = loop_equations(self.rows, frames).jacobian
        rows = scale_jacobian(self.mechanism, jacobian, self.rows.rotation)[0]  # (m, nv)
        vectors = (
            direction_gap_derivatives(self.directions, frames)[0] * self.mechanism.column_scale
        )  # (d, 3, nv)
        return np.concatenate([rows, vectors.reshape(-1, rows.shape[1])])[:, self.columns]

    def close(self, start: Array) -> tuple[Array, float]:
        """Find offsets (k,) near a start that close the loops best, and their largest gap."""
        # steps of least norm: there are more joints than independent equations
        u, gap = self._least_squares(self.gap, self.slope, start, MAX_EVALUATIONS[1], FINE_TOLERANCE, "lsmr")
        return u, float(np.abs(gap).max())

    def nearly_close(self, start: Array) -> Array:
        """Find the smallest offsets u (k,) that nearly close the loops.

        The sum of squares of gap / `GAP_PER_RADIAN` and of u is least.
        """

        def residual(u: Array) -> Array:
            return np.concatenate([self.gap(u) / GAP_PER_RADIAN, u])

        def slope(u: Array) -> Array:
            return np.concatenate([self.slope(u) / GAP_PER_RADIAN, np.eye(len(u))])

        return self._least_squares(residual, slope, start, MAX_EVALUATIONS[0], ROUGH_TOLERANCE)[0]

    def _least_squares(
        self,
        residual: Callable[[Array], Array],
        slope: Callable[[Array], Array],
        start: Array,
        evaluations: int,
        tolerance: float,
        solver: str | None = None,
    ) -> tuple[Array, Array]:
        """Find offsets (k,) within bounds with the least residual, and that residual."""
        from scipy.optimize import least_squares

        answer = least_squares(
            residual,
            start,
            slope,
            bounds=(self.lower, self.upper),
            tr_solver=solver,
            max_nfev=evaluations,
            **dict.fromkeys(("xtol", "ftol", "gtol"), tolerance),
        )
        return answer.x, answer.fun

    def configuration(self, u: Array) -> Array:
        """Return the configuration (nq,) at offsets u (k,)."""
        steps = u * self.mechanism.column_scale[self.columns]
        return integrate_columns(self.mechanism, self.mechanism.q_near, self.columns, steps)

    def _frames(self, u: Array) -> FrameStack:
        """Compute the frames at offsets u (k,), T = 1."""
        return frames_at(self.mechanism, self.configuration(u)[None])


def _group_loops(mechanism: Mechanism, lower: Array, upper: Array) -> list[_Group]:
    """Split the loops of a robot into groups that share no joint.

    Springs rest. Rows of one group are a connected component of the graph of rows that share joints.
    """
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    carried = scratch_of(mechanism).carried
    depends = mechanism.rows.joint_signs(carried) != 0.0  # (m, nv) whether a row changes with a joint
    depends |= mechanism.rows.coupling_jacobian(depends.shape[1]) != 0.0
    depends[:, mechanism.elastic] = False
    pattern = csr_array(depends.astype(float))
    label = connected_components(pattern @ pattern.T, directed=False)[1]  # (m,) rows that share joints
    groups, directions = [], mechanism.directions
    for k in range(int(label.max()) + 1):
        rows = np.flatnonzero(label == k)
        columns = np.flatnonzero(depends[rows].any(axis=0))
        table = mechanism.rows.take(rows)
        names = {name.rpartition(".")[0] for name in table.names}
        leg_directions = directions.take(np.flatnonzero([name in names for name in directions.closures]))
        groups.append(_Group(mechanism, table, leg_directions, columns, lower[columns], upper[columns]))
    return groups


def _joint_ranges(mechanism: Mechanism) -> tuple[Array, Array]:
    """Return the limits of all joints as offsets from the reference, (nv,) each [rad, robot lengths]."""
    lower, upper = np.full(mechanism.nv, -np.inf), np.full(mechanism.nv, np.inf)
    for limit in mechanism.limits:
        reference = mechanism.q_near[limit.coordinate]
        lower[limit.column], upper[limit.column] = limit.lower - reference, limit.upper - reference
    lower, upper = lower / mechanism.column_scale, upper / mechanism.column_scale
    # the solver's bounds may not meet: leave a little room between limits that do
    limited = np.isfinite(lower)
    room = MIN_JOINT_ROOM * np.maximum(np.abs(lower[limited]), 1.0)
    upper[limited] = np.maximum(upper[limited], lower[limited] + room)
    return lower, upper


def _nearest_closing(group: _Group) -> Array:
    """Find the smallest offsets (k,) that close a group's loops from several starts.

    The first start is the reference; others are drawn around it, within limits or half a turn or a length.
    """
    turning = ~group.mechanism.sliding[group.columns]
    limited = np.isfinite(group.lower)
    reach = np.where(turning, np.pi, 1.0)
    low = np.where(limited, group.lower, -reach)
    high = np.where(limited, group.upper, reach)
    reference = np.clip(0.0, low, high)
    rng = np.random.default_rng(RANDOM_SEED)
    poses: list[Array] = []
    best, least = reference, np.inf
    for k in range(MAX_STARTS):
        spread = START_SPREADS[k % len(START_SPREADS)] if k else 0.0
        start = reference + spread * (rng.uniform(low, high) - reference)
        u, gap = group.close(group.nearly_close(start))
        if gap < least:
            best, least = u, gap
        if gap < LOOP_GAP:
            poses.append(np.where(turning & ~limited, wrap_angles(u), u))
            if k == 0 or len(poses) == ENOUGH_POSES:
                break
    if not poses:
        raise _still_open_error(group, best)
    return min(poses, key=np.linalg.norm)


def _still_open_error(group: _Group, u: Array) -> NotAssembled:
    """Return the error for a group that no start has closed; `u` (k,) came nearest."""
    gap, mechanism = np.abs(group.equations(u)), group.mechanism
    row, q = np.argmax(gap), group.configuration(u)
    turning = bool(group.rows.rotation[row])
    residual = float(gap[row]) * (1.0 if turning else mechanism.length)
    best = f"{group.rows.names[row]} stays {residual:.3g} {'rad' if turning else 'm'} apart"
    if gap[row] < LOOP_GAP:
        best = f"{find_flipped_closure(mechanism, frames_at(mechanism, q[None]))} is turned over"
    return NotAssembled(
        f"{mechanism.name}: the loops do not close: of {MAX_STARTS} starts within the joints' limits none "
        f"leads to a closed pose; in the best {best}; check the link lengths and the closures, or give a "
        f"reference near to an assembled configuration",
        q=q,
        residual=residual,
    )
