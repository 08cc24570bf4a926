"""One step of paving: stacks of boxes of joints that are dropped, kept, narrowed or cut in two."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.arrays import Array, BoolArray, IntArray
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.slope_bounds import Changes, Linearised, SlopeBounds
from framework.linalg.interval_newton import contracted, existence
from framework.linalg.krawczyk import UP
from framework.singularity.singular_sets import Measure, SingularSet, measure

WIDER, BEND = 1.5, 4.0  # the larger box of Krawczyk's test: a half more, and what arcs bend in it
SHRUNK = 0.5  # of its volume: a box that has shrunk to less is looked at again before it is cut
SMALLEST = 0.01  # of the resolution: an undecided box that is smaller is left
LEAST = 1e-15  # of the middle of a box, added to its radii: it is rounded
NONE = -1  # no joint


class Boxes(NamedTuple):
    """S boxes of the joints that move, off the reference [rad, lengths]."""

    middle: Array  # (S, k)
    radii: Array  # (S, k)

    def take(self, which: BoolArray) -> Boxes:
        """Some of them."""
        return Boxes(self.middle[which], self.radii[which])

    def within(self, lower: Array, upper: Array) -> Boxes:
        """What is left of them between offsets (S, k) from their middles."""
        return Boxes(
            self.middle + 0.5 * (lower + upper),
            UP * 0.5 * (upper - lower) + LEAST * (1.0 + np.abs(self.middle)),
        )

    def halves(self, joint: IntArray) -> Boxes:
        """Both halves of each along one joint (S,)."""
        every, radii, shift = np.arange(len(joint)), self.radii.copy(), np.zeros_like(self.radii)
        radii[every, joint] *= 0.5 * UP
        shift[every, joint] = 0.5 * self.radii[every, joint]
        both = np.concatenate([self.middle - shift, self.middle + shift])
        return Boxes(both, np.concatenate([radii, radii]))

    @staticmethod
    def joined(parts: list[Boxes], k: int) -> Boxes:
        """All boxes of several stacks."""
        nothing = Boxes(np.zeros((0, k)), np.zeros((0, k)))
        return Boxes(*map(np.concatenate, zip(nothing, *parts, strict=True)))


class Arcs(NamedTuple):
    """Boxes with a proof, and where the platform is there."""

    x: Array  # (B, n)
    x_radii: Array  # (B, n)
    boxes: Boxes
    along: IntArray  # (B,)


class _Equations(NamedTuple):
    """{loops = 0, g = 0} in S boxes, and the platform's coordinates."""

    values: Array  # (S, m + 1) at the middle
    exact: Array  # (S, m + 1) errors of these
    slopes: Array  # (S, m + 1, k)
    changes: Array  # (S, m + 1, k) in the wider box
    errors: Array  # (S, m + 1) of values + slopes d in the box itself
    x: Array  # (S, n)
    platform: Array  # (S, n, k) slopes of x, without dimension
    bend: Array  # (S, n) errors of these in the wider box

    def take(self, which: BoolArray) -> _Equations:
        """Those of some boxes."""
        return _Equations(*(part[which] for part in self))


class Step(NamedTuple):
    """What becomes of boxes."""

    kept: Arcs
    small: Boxes
    ahead: Boxes


@dataclass(frozen=True, eq=False)
class Paver:
    """What one set of singular poses is looked for with."""

    bounds: SlopeBounds
    which: SingularSet
    window: Array | None
    resolution: float

    def step(self, boxes: Boxes) -> Step:
        """Drop, keep, narrow or cut boxes."""
        robot, n = self.bounds.robot, self.bounds.robot.n
        at = self.bounds.at(self.bounds.moved(boxes.middle))
        errors = at.changes(boxes.radii).values
        left = contracted(at.values[:, n:], at.slopes[:, n:], errors[:, n:], boxes.radii)
        alive = ~left.empty & self._in_window(at, boxes.radii, errors)
        boxes, at, errors = boxes.take(alive), at.take(alive), errors[alive]
        narrow = boxes.within(left.lower[alive], left.upper[alive])
        wider = WIDER * boxes.radii + BEND * boxes.radii.max(axis=1, keepdims=True, initial=0.0) ** 2
        changes = at.changes(wider)
        g = measure(self.which, at, changes)
        equations = self._equations(at, changes, errors[:, n:], g, boxes.radii)
        known = g.valid  # elsewhere nothing is concluded from g
        kept, found, joint, alive = self._decided(boxes.take(known), wider[known], equations.take(known))
        narrow = Boxes.joined([narrow.take(~known), found], boxes.radii.shape[1])
        before = np.concatenate([boxes.radii[~known], boxes.radii[known][alive]])
        joint = np.concatenate([np.full(np.count_nonzero(~known), NONE), joint])
        small = (joint == NONE) & (narrow.radii.sum(axis=1) * robot.length < SMALLEST * self.resolution)
        go = ~small
        shrunk = (joint == NONE) & (np.prod(narrow.radii / before, axis=1) < SHRUNK)
        cut = narrow.take(go & ~shrunk)
        along = np.where(joint == NONE, narrow.radii.argmax(axis=1), joint)[go & ~shrunk]
        ahead = Boxes.joined([narrow.take(go & shrunk), cut.halves(along)], boxes.radii.shape[1])
        return Step(kept, narrow.take(small), ahead)

    def _in_window(self, at: Linearised, radii: Array, errors: Array) -> BoolArray:
        """Whether boxes may have poses in the window, whose angles are the same after a whole turn."""
        robot, n = self.bounds.robot, self.bounds.robot.n
        if self.window is None:
            return np.ones(len(radii), dtype=bool)
        extent = np.einsum("snk,sk->sn", np.abs(at.slopes[:, :n]), radii) + errors[:, :n]
        off = robot.platform.coordinates(at.frames) - self.window.mean(axis=0)
        off = np.where(robot.translations, off, np.remainder(off + np.pi, 2 * np.pi) - np.pi)
        reach = 0.5 * np.ptp(self.window, axis=0) + scale_of(robot) * UP * (extent + self.bounds.rounding)
        return np.asarray((np.abs(off) <= reach).all(axis=1))

    def _equations(
        self, at: Linearised, changes: Changes, loop_errors: Array, g: Measure, radii: Array
    ) -> _Equations:
        n, rounding = self.bounds.robot.n, self.bounds.rounding
        g_errors = UP * (g.g_error + np.sum(g.slope_changes * radii, axis=1))
        return _Equations(
            values=np.concatenate([at.values[:, n:], g.g[:, None]], axis=1),
            exact=np.concatenate([np.full_like(loop_errors, rounding), g.g_error[:, None]], axis=1),
            slopes=np.concatenate([at.slopes[:, n:], g.slope[:, None]], axis=1),
            changes=np.concatenate([changes.slopes[:, n:], g.slope_changes[:, None]], axis=1),
            errors=np.concatenate([loop_errors, g_errors[:, None]], axis=1),
            x=self.bounds.robot.platform.coordinates(at.frames),
            platform=at.slopes[:, :n],
            bend=changes.values[:, :n],
        )

    def _decided(
        self, boxes: Boxes, wider: Array, here: _Equations
    ) -> tuple[Arcs, Boxes, IntArray, BoolArray]:
        """Those that are kept; what is left of the others, the joint to cut them along, which those are."""
        robot, radii, every = self.bounds.robot, boxes.radii, np.arange(len(boxes.radii))
        left = contracted(here.values, here.slopes, here.errors, radii)
        joint = np.full(len(every), NONE)
        if robot.n == 2:  # the joint along which a curve leaves the box first
            tangent = np.linalg.svd(here.slopes)[2][:, -1]
            joint = np.argmax(np.abs(tangent) / radii, axis=1)
            wider[every, joint] = radii[every, joint]
        found = existence(
            here.values, here.slopes, here.changes, here.exact, wider, joint if robot.n == 2 else None
        )
        proved = found.proved
        lower = np.where(proved[:, None], np.maximum(left.lower, found.lower), left.lower)
        upper = np.where(proved[:, None], np.minimum(left.upper, found.upper), left.upper)
        alive = (lower <= upper).all(axis=1)
        reach = radii[every, joint] if robot.n == 2 else np.zeros(len(every))
        far = np.abs(np.einsum("snk,sk->sn", here.platform, found.along)) * reach[:, None] + here.bend
        far = UP * (far + np.einsum("snk,sk->sn", np.abs(here.platform), found.spread))
        last = alive & proved & (2 * robot.length * far <= self.resolution).all(axis=1)
        arcs = boxes.within(found.lower, found.upper)
        kept = Arcs(here.x[last], (scale_of(robot) * far)[last], arcs.take(last), joint[last])
        go = alive & ~last
        joint = np.where(proved, joint, NONE)[go]
        return kept, boxes.within(lower, upper).take(go), joint, go


def scale_of(robot: ParallelRobot) -> Array:
    """What the platform's coordinates (n,) are divided by to be without dimension."""
    return np.where(robot.translations, robot.length, 1.0)
