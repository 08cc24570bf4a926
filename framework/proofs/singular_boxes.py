"""The test of `singular_paving`: whether a box of joints holds poses of a singular set.

A set is the poses in which a block of dF/dq loses rank, F = [platform - x ; loops], which they do where the
bordered scalar g of the block is zero. A box is dropped where the loops cannot close in it or g is not zero
in it; it is narrowed by {loops = 0, g = 0}; it is kept where Krawczyk's test proves, in a box a little
larger, one singular pose for each value of one of its joints and nothing else, and the tube about that arc is
small.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray, IntArray, select
from framework.kinematics.modes import legs
from framework.kinematics.parallel_robot import ParallelRobot
from framework.linalg.rotations import wrap_angles
from framework.proofs.branch_and_bound import NO_AXIS, Boxes, Examined, narrow_or_halve
from framework.proofs.derivative_bounds import DerivativeBounds, Derivatives, Remainders
from framework.proofs.interval_newton import (
    Contracted,
    LinearEnclosure,
    bordered_bounds,
    contract,
    existence,
    pivoting_mixers,
)
from framework.proofs.rounding import ROUND_UP, times

TESTED_BOX_RATIO = 1.5  # the box of Krawczyk's test over the box whose points it is about
WIDENING_CURVATURE = 4.0  # [1/rad] what is added for the curvature of arcs, times the radius squared
MIN_SIZE_RATIO = 0.01  # of the resolution: an undecided box that is smaller is not cut


class SingularSet(NamedTuple):
    """Poses in which a block of dF/dq loses rank."""

    name: str  # type_2, or type_1 with the motors of the leg
    rows: IntArray  # (s,)
    columns: IntArray  # (s,) among the `moving` ones


def singular_sets(robot: ParallelRobot) -> tuple[SingularSet, ...]:
    """Return Type 2 first, then Type 1 of each leg, see `legs`."""
    n = robot.n
    loops, passive = np.arange(n, n + len(robot.loops.names)), np.arange(robot.n_a, len(robot.moving))
    of_legs = [
        SingularSet(
            f"type_1 of {' and '.join(leg.motors) or 'joints without a motor'}", leg.rows, leg.columns
        )
        for leg in legs(robot)
    ]
    return (SingularSet("type_2", loops, passive), *of_legs)


class MeasureBounds(NamedTuple):
    """g over S boxes."""

    valid: BoolArray  # (S,) a pose in the box is singular where g = 0, and there alone
    g: Array  # (S,) at the middle
    g_error: Array  # (S,)
    slope: Array  # (S, k) at the middle
    slope_changes: Array  # (S, k) within the box


def measure_bounds(which: SingularSet, derivatives: Derivatives, remainders: Remainders) -> MeasureBounds:
    """Enclose the bordered scalar g of a block, dg = -psi' dP eta (Govaerts 2000), over boxes."""
    rows, columns = which.rows[:, None], which.columns
    rounding = derivatives.bounds.rounding
    right, left = bordered_bounds(
        derivatives.slopes[:, rows, columns], remainders.slopes[:, rows, columns], rounding
    )
    eta, psi = right.z[:, :-1], left.z[:, :-1]
    eta_error, psi_error = right.error[:, :-1], left.error[:, :-1]
    eta_size, psi_size = np.abs(eta) + eta_error, np.abs(psi)
    dP = derivatives.hessians[:, rows, columns]  # (S, s, s, k)
    dP_size, dP_change = np.abs(dP), remainders.hessians[:, rows, columns] + rounding

    def product(left: Array, middle: Array, right: Array) -> Array:
        return np.einsum("si,sijl,sj->sl", left, middle, right, optimize=True)

    slope_changes = product(psi_size, dP_change, eta_size) + product(psi_size, dP_size, eta_error)
    slope_changes += product(psi_error, dP_size + dP_change, eta_size)
    return MeasureBounds(
        right.valid & left.valid,
        right.z[:, -1],
        right.last_error,
        -product(psi, dP, eta),
        ROUND_UP * slope_changes,
    )


class Arcs(NamedTuple):
    """Boxes with a proof, and the platform's coordinates in the boxes."""

    x: Array  # (B, n)
    x_radii: Array  # (B, n)
    boxes: Boxes
    along: IntArray  # (B,) the joint that is the parameter


class _SingularEquations(NamedTuple):
    """{loops = 0, g = 0} in S boxes, and the platform's coordinates."""

    enclosure: LinearEnclosure  # in the box itself
    exact: Array  # (S, m + 1) errors of the values at the middle
    changes: Array  # (S, m + 1, k) of the slopes in the wider box
    x: Array  # (S, n)
    x_slopes: Array  # (S, n, k) without dimension
    x_errors: Array  # (S, n) of these in the wider box


@dataclass(frozen=True, eq=False)
class SingularBoxTest:
    """The test for one set of singular poses."""

    bounds: DerivativeBounds
    which: SingularSet
    window: Array | None  # (2, n) least and largest platform coordinates
    resolution: float  # [m, robot lengths]

    def __call__(self, boxes: Boxes) -> Examined[Boxes, Arcs]:
        """Drop, keep, narrow or cut boxes."""
        boxes, (lower, upper), derivatives, loops = self._close(boxes)
        axis, is_arc = np.full(boxes.size, NO_AXIS), np.zeros(boxes.size, dtype=bool)

        wider = TESTED_BOX_RATIO * boxes.radii
        wider += WIDENING_CURVATURE * boxes.radii.max(axis=1, keepdims=True, initial=0.0) ** 2
        remainders = derivatives.remainders(wider)
        g = measure_bounds(self.which, derivatives, remainders)
        equations = select(self._equations(derivatives, remainders, loops, g, boxes.radii), g.valid)
        # elsewhere g says nothing
        (lower[g.valid], upper[g.valid]), axis[g.valid], is_arc[g.valid], arcs = self._decide(
            select(boxes, g.valid), wider[g.valid], equations
        )

        is_open = (lower <= upper).all(axis=1) & ~is_arc
        narrow, boxes = select(boxes.clip(lower, upper), is_open), select(boxes, is_open)
        is_small = self.bounds.robot.length * narrow.radii.sum(axis=1) < MIN_SIZE_RATIO * self.resolution
        return Examined(arcs, *narrow_or_halve(boxes, narrow, axis[is_open], is_small))

    def _close(self, boxes: Boxes) -> tuple[Boxes, Contracted, Derivatives, LinearEnclosure]:
        """Return the boxes in which the loops may close within the window.

        With the parts left by the loops, the derivatives, and the loops in the boxes.
        """
        n = self.bounds.robot.n
        derivatives = self.bounds.evaluate(self.bounds.configurations(boxes.middle))
        errors = derivatives.remainders(boxes.radii).values
        loops = LinearEnclosure(derivatives.values[:, n:], derivatives.slopes[:, n:], errors[:, n:])
        remaining = contract(loops, boxes.radii, pivoting_mixers(loops.slopes, boxes.radii))
        possible = ~remaining.empty & self._meets_window(derivatives, boxes.radii, errors)
        boxes, parts = select(boxes, possible), select(remaining, possible)
        return boxes, parts, derivatives.take(possible), select(loops, possible)

    def _meets_window(self, derivatives: Derivatives, radii: Array, errors: Array) -> BoolArray:
        """Whether boxes may have poses in the window, whose angles are the same after a whole turn."""
        robot, n = self.bounds.robot, self.bounds.robot.n
        if self.window is None:
            return np.ones(len(radii), dtype=bool)
        extent = times(np.abs(derivatives.slopes[:, :n]), radii) + errors[:, :n] + self.bounds.rounding
        off = robot.platform.coordinates(derivatives.frames) - self.window.mean(axis=0)
        off = np.where(robot.translations, off, wrap_angles(off))
        reach = 0.5 * np.ptp(self.window, axis=0) + robot.platform_scale * ROUND_UP * extent
        return (np.abs(off) <= reach).all(axis=1)

    def _equations(
        self,
        derivatives: Derivatives,
        remainders: Remainders,
        loops: LinearEnclosure,
        g: MeasureBounds,
        radii: Array,
    ) -> _SingularEquations:
        """Return the equations in boxes of radii (S, k)."""
        n, rounding = self.bounds.robot.n, self.bounds.rounding
        g_errors = ROUND_UP * (g.g_error + np.sum(g.slope_changes * radii, axis=1))
        measure = LinearEnclosure(g.g[:, None], g.slope[:, None], g_errors[:, None])
        return _SingularEquations(
            loops.join(measure),
            exact=np.concatenate([np.full_like(loops.errors, rounding), g.g_error[:, None]], axis=1),
            changes=np.concatenate([remainders.slopes[:, n:], g.slope_changes[:, None]], axis=1),
            x=self.bounds.robot.platform.coordinates(derivatives.frames),
            x_slopes=derivatives.slopes[:, :n],
            x_errors=remainders.values[:, :n],
        )

    def _decide(
        self, boxes: Boxes, wider: Array, equations: _SingularEquations
    ) -> tuple[Contracted, IntArray, BoolArray, Arcs]:
        """Narrow boxes by the equations, and look for an arc in boxes of the radii `wider` (S, k).

        Returns:
            The parts that hold all singular poses; the axis (S,) to cut across where an arc is proved that is
            not small enough yet, else NO_AXIS; which arcs are small enough to be kept (S,); those arcs.
        """
        robot, each = self.bounds.robot, np.arange(boxes.size)
        values, slopes, _ = equations.enclosure
        lower, upper = contract(equations.enclosure, boxes.radii, pivoting_mixers(slopes, boxes.radii))
        parameter = None
        along, reach = np.full(boxes.size, NO_AXIS), np.zeros(boxes.size)
        if robot.n == 2:  # the joint along which a curve leaves the box first
            tangent = np.linalg.svd(slopes)[2][:, -1]
            parameter = along = np.argmax(np.abs(tangent) / boxes.radii, axis=1)
            reach = boxes.radii[each, along]
            wider[each, along] = reach
        proof = existence(values, slopes, equations.changes, equations.exact, wider, parameter)
        lower = np.where(proof.proved[:, None], np.maximum(lower, proof.lower), lower)
        upper = np.where(proof.proved[:, None], np.minimum(upper, proof.upper), upper)
        x_radii = np.abs(times(equations.x_slopes, proof.along)) * reach[:, None] + equations.x_errors
        x_radii = ROUND_UP * (x_radii + times(np.abs(equations.x_slopes), proof.spread))
        small = proof.proved & (lower <= upper).all(axis=1)
        small &= (2 * robot.length * x_radii <= self.resolution).all(axis=1)
        x_radii = robot.platform_scale * x_radii
        boxes = select(boxes.clip(proof.lower, proof.upper), small)
        return (
            Contracted(lower, upper),
            np.where(proof.proved, along, NO_AXIS),
            small,
            Arcs(equations.x[small], x_radii[small], boxes, along[small]),
        )
