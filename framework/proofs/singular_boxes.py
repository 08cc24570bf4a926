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

from framework.arrays import Array, BoolArray, IntArray
from framework.kinematics.modes import legs
from framework.kinematics.parallel_robot import ParallelRobot
from framework.proofs.branch_and_bound import NO_AXIS, Boxes, Examined, narrowed_or_halved
from framework.proofs.derivative_bounds import DerivativeBounds, Derivatives, Remainders
from framework.proofs.interval_newton import (
    LinearEnclosure,
    bordered_bounds,
    contracted,
    existence,
    pivoted,
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
    bordered = bordered_bounds(
        derivatives.slopes[:, rows, columns], remainders.slopes[:, rows, columns], rounding
    )
    eta, psi = bordered.right[:, :-1], bordered.left[:, :-1]
    eta_error, psi_error = bordered.right_errors[:, :-1], bordered.left_errors[:, :-1]
    eta_size, psi_size = np.abs(eta) + eta_error, np.abs(psi)
    dP = derivatives.hessians[:, rows, columns]  # (S, s, s, k)
    dP_size, dP_change = np.abs(dP), remainders.hessians[:, rows, columns] + rounding

    def product(left: Array, middle: Array, right: Array) -> Array:
        return np.asarray(np.einsum("si,sijl,sj->sl", left, middle, right, optimize=True))

    slope_changes = product(psi_size, dP_change, eta_size) + product(psi_size, dP_size, eta_error)
    slope_changes += product(psi_error, dP_size + dP_change, eta_size)
    return MeasureBounds(
        bordered.valid,
        bordered.right[:, -1],
        bordered.g_error,
        -product(psi, dP, eta),
        ROUND_UP * slope_changes,
    )


class Arcs(NamedTuple):
    """Boxes with a proof, and where the platform is there."""

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

    def take(self, which: BoolArray) -> _SingularEquations:
        """Return those of some boxes."""
        enclosure, *others = self
        own = LinearEnclosure(*(part[which] for part in enclosure))
        return _SingularEquations(own, *(part[which] for part in others))


class _Decision(NamedTuple):
    """Conclusions from {loops = 0, g = 0} over S boxes."""

    lower: Array  # (S, k) off the middle: all singular poses are within
    upper: Array
    axis: IntArray  # (S,) to cut across where an arc is proved that is not small enough yet, else NO_AXIS
    small: BoolArray  # (S,) the arc is small enough to be kept
    arcs: Arcs  # those


@dataclass(frozen=True, eq=False)
class SingularBoxTest:
    """The test for one set of singular poses."""

    bounds: DerivativeBounds
    which: SingularSet
    window: Array | None  # (2, n) least and largest platform coordinates
    resolution: float  # [m, robot lengths]

    def __call__(self, boxes: Boxes) -> Examined[Boxes, Arcs]:
        """Drop, keep, narrow or cut boxes."""
        n = self.bounds.robot.n
        derivatives = self.bounds.at(self.bounds.moved(boxes.middle))
        errors = derivatives.remainders(boxes.radii).values
        loops = LinearEnclosure(derivatives.values[:, n:], derivatives.slopes[:, n:], errors[:, n:])
        left = contracted(loops, boxes.radii, pivoted(loops.slopes, boxes.radii))
        possible = ~left.empty & self._meets_window(derivatives, boxes.radii, errors)
        boxes, derivatives, errors = boxes.take(possible), derivatives.take(possible), errors[possible]
        lower, upper = left.lower[possible], left.upper[possible]
        axis, is_arc = np.full(boxes.size, NO_AXIS), np.zeros(boxes.size, dtype=bool)

        widest = boxes.radii.max(axis=1, keepdims=True, initial=0.0)
        wider = TESTED_BOX_RATIO * boxes.radii + WIDENING_CURVATURE * widest**2
        remainders = derivatives.remainders(wider)
        g = measure_bounds(self.which, derivatives, remainders)
        valid = g.valid  # elsewhere nothing is concluded from g
        equations = self._equations(derivatives, remainders, errors[:, n:], g, boxes.radii)
        decision = self._decided(boxes.take(valid), wider[valid], equations.take(valid))
        lower[valid], upper[valid] = decision.lower, decision.upper
        axis[valid], is_arc[valid] = decision.axis, decision.small

        open_ = (lower <= upper).all(axis=1) & ~is_arc
        before, narrow = boxes.take(open_), boxes.within(lower, upper).take(open_)
        size = self.bounds.robot.length * narrow.radii.sum(axis=1)
        is_small = size < MIN_SIZE_RATIO * self.resolution
        return Examined(decision.arcs, *narrowed_or_halved(before, narrow, axis[open_], is_small))

    def _meets_window(self, derivatives: Derivatives, radii: Array, errors: Array) -> BoolArray:
        """Whether boxes may have poses in the window, whose angles are the same after a whole turn."""
        robot, n = self.bounds.robot, self.bounds.robot.n
        if self.window is None:
            return np.ones(len(radii), dtype=bool)
        extent = times(np.abs(derivatives.slopes[:, :n]), radii) + errors[:, :n] + self.bounds.rounding
        off = robot.platform.coordinates(derivatives.frames) - self.window.mean(axis=0)
        off = np.where(robot.translations, off, np.remainder(off + np.pi, 2 * np.pi) - np.pi)
        reach = 0.5 * np.ptp(self.window, axis=0) + robot.platform_scale * ROUND_UP * extent
        return np.asarray((np.abs(off) <= reach).all(axis=1))

    def _equations(
        self,
        derivatives: Derivatives,
        remainders: Remainders,
        loop_errors: Array,
        g: MeasureBounds,
        radii: Array,
    ) -> _SingularEquations:
        n, rounding = self.bounds.robot.n, self.bounds.rounding
        g_errors = ROUND_UP * (g.g_error + np.sum(g.slope_changes * radii, axis=1))
        loops = LinearEnclosure(derivatives.values[:, n:], derivatives.slopes[:, n:], loop_errors)
        measure = LinearEnclosure(g.g[:, None], g.slope[:, None], g_errors[:, None])
        return _SingularEquations(
            loops.joined(measure),
            exact=np.concatenate([np.full_like(loop_errors, rounding), g.g_error[:, None]], axis=1),
            changes=np.concatenate([remainders.slopes[:, n:], g.slope_changes[:, None]], axis=1),
            x=self.bounds.robot.platform.coordinates(derivatives.frames),
            x_slopes=derivatives.slopes[:, :n],
            x_errors=remainders.values[:, :n],
        )

    def _decided(self, boxes: Boxes, wider: Array, equations: _SingularEquations) -> _Decision:
        """Narrow boxes by the equations, and look for an arc in boxes of the radii `wider` (S, k)."""
        robot, radii, each = self.bounds.robot, boxes.radii, np.arange(boxes.size)
        values, slopes, _ = equations.enclosure
        left = contracted(equations.enclosure, radii, pivoted(slopes, radii))
        parameter = None
        along, reach = np.full(boxes.size, NO_AXIS), np.zeros(boxes.size)
        if robot.n == 2:  # the joint along which a curve leaves the box first
            tangent = np.linalg.svd(slopes)[2][:, -1]
            parameter = along = np.argmax(np.abs(tangent) / radii, axis=1)
            reach = radii[each, along]
            wider[each, along] = reach
        proof = existence(values, slopes, equations.changes, equations.exact, wider, parameter)
        proved = proof.proved[:, None]
        lower = np.where(proved, np.maximum(left.lower, proof.lower), left.lower)
        upper = np.where(proved, np.minimum(left.upper, proof.upper), left.upper)
        x_radii = np.abs(times(equations.x_slopes, proof.along)) * reach[:, None] + equations.x_errors
        x_radii = ROUND_UP * (x_radii + times(np.abs(equations.x_slopes), proof.spread))
        small = proof.proved & (lower <= upper).all(axis=1)
        small &= (2 * robot.length * x_radii <= self.resolution).all(axis=1)
        tubes = boxes.within(proof.lower, proof.upper)
        arcs = Arcs(
            equations.x[small], (robot.platform_scale * x_radii)[small], tubes.take(small), along[small]
        )
        return _Decision(lower, upper, np.where(proof.proved, along, NO_AXIS), small, arcs)
