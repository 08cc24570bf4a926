"""All singular poses of a robot with one or two freedoms, in boxes, with a proof that there are no others.

Boxes are of all joints that move: hinges all the way round, slides within a reach. One is dropped where the
loops cannot close in it, or where g, the bordered scalar of the block that would lose rank, is not zero in it
(`singular_sets`); it is narrowed by the linear equations {loops = 0, g = 0} with what is left of them as
errors (hull consistency); Krawczyk's test proves in a box a little larger that there is one singular pose for
each value of one of its joints, and nothing else, and then the box shrinks to a tube about that arc. Where
none of this decides, it is cut in two. So what is kept is a piece of a smooth curve (with one freedom: a
pose), or is listed as undecided. The bounds are those of `slope_bounds` and `interval_newton`; what they
trust is that pinocchio's positions and directions at one configuration are right to `ROUNDING`, and that
sums and products are rounded as IEEE 754 has it.

Sources: Merlet, Parallel Robots, 2nd ed., Springer 2006, chapter 11; Bohigas, Manubens and Ros, Singularities
of Robot Mechanisms, Springer 2017, who pave {closures = 0, rank lost} by linear relaxations.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from framework.arrays import Array, ArrayLike, BoolArray, IntArray, ReadOnlyArrays
from framework.errors import InvalidInput, finite_numbers
from framework.kinematics.inverse_kinematics import require_square
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.kinematics.placements import planar_normal
from framework.kinematics.platform import JointPlatform
from framework.kinematics.slope_bounds import Changes, Linearised, SlopeBounds
from framework.linalg.interval_newton import contracted, existence
from framework.linalg.krawczyk import UP
from framework.singularity.singular_sets import Measure, SingularSet, measure, singular_sets

RESOLUTION = 1e-3  # [m], or in robot lengths of turns
REACH = 1.2  # of slides about the reference, in lengths of the robot
MOST = 500_000  # boxes that are looked at for each set
NUMBERS = 4_000_000  # of second derivatives in work at a time: 32 MB
WIDER, BEND = 1.5, 4.0  # the larger box of Krawczyk's test: a half more, and what arcs bend in it
SHRUNK = 0.5  # of its volume: a box that has shrunk to less is looked at again before it is cut
SMALLEST = 0.01  # of the resolution: an undecided box that is smaller is left
LEAST = 1e-15  # [rad, lengths] added to radii: the middle of a box is rounded
NONE = -1  # no joint


@dataclass(frozen=True, eq=False)
class PavedSet(ReadOnlyArrays):
    """The poses of one kind of singularity: B boxes that hold them, U boxes of which that is not known.

    Each of the B holds exactly one singular pose for every value of one of its joints, the `along` one (with
    one freedom: exactly one). Neighbours overlap.
    """

    name: str  # type_2; or type_1 of the motors of a leg
    x: Array  # (B, n) middles in the platform's coordinates
    x_radii: Array  # (B, n) the poses that are proved are within
    q: Array  # (B, nq) middles
    q_radii: Array  # (B, k) of the joints that move [rad, m]
    along: Array  # (B,) index into the joints that move; -1: none
    undecided_x: Array  # (U, n)
    undecided_x_radii: Array  # (U, n)
    undecided_q: Array  # (U, nq)
    undecided_q_radii: Array  # (U, k)
    examined: int  # boxes

    @property
    def complete(self) -> bool:
        """Whether all boxes are decided."""
        return not len(self.undecided_x)


@dataclass(frozen=True, eq=False)
class SingularPaving:
    """All sets of a robot. Outside of their boxes no pose in the region is singular."""

    robot: ParallelRobot
    sets: tuple[PavedSet, ...]  # Type 2, then Type 1 of each leg
    resolution: float  # [m, robot lengths] the boxes are no wider
    reach: float  # [robot lengths] of slides about the reference; hinges turn all the way round
    seconds: float

    @property
    def complete(self) -> bool:
        """Whether every box is decided."""
        return all(one.complete for one in self.sets)

    @property
    def sentence(self) -> str:
        """What is proved."""
        kept = ", ".join(f"{one.name}: {len(one.x)}" for one in self.sets)
        left = sum(len(one.undecided_x) for one in self.sets)
        rest = "no box undecided" if self.complete else f"{left} boxes undecided"
        return f"all singular poses within boxes of {self.resolution:.3g} ({kept}), {rest}"


def pave_singularities(
    robot: ParallelRobot,
    *,
    window: ArrayLike | None = None,
    resolution: float = RESOLUTION,
    reach: float = REACH,
    most: int = MOST,
) -> SingularPaving:
    """The Type 2 and Type 1 poses of a robot with one or two freedoms, over all its modes.

    Joint limits do not count; springs are at rest. Poses in which P loses rank without a motion of the
    platform are among those of Type 2; `classify` tells them apart.

    Args:
        window: (2, n) least and largest platform coordinates [m, rad]; everywhere by default.
        resolution: largest width of a box in the platform's coordinates [m; robot lengths for turns].
        reach: of slides about the reference, in lengths of the robot.
        most: boxes that are looked at for each set; those left over are undecided.

    Raises:
        InvalidInput: the robot has more freedoms, redundant motors or no passive joints; or an option is no
            positive number.
    """
    expect_robot(robot)
    _check(robot)
    for name, value in (("resolution", resolution), ("reach", reach), ("most", most)):
        if not 0 < value < np.inf:
            raise InvalidInput(f"{name}: needs a positive number, got {value!r}")
    region = None
    if window is not None:
        region = finite_numbers(
            "window, least and largest platform coordinates,", window, robot.n, stacks=True
        )
        if region.shape != (2, robot.n) or not (region[0] < region[1]).all():
            raise InvalidInput(f"window: needs (2, {robot.n}) numbers, the least and the largest")
    start = time.perf_counter()
    bounds = SlopeBounds.of(robot)
    sets = tuple(
        _paved(_Paver(bounds, which, region, resolution), reach, most) for which in singular_sets(robot)
    )
    return SingularPaving(robot, sets, resolution, reach, time.perf_counter() - start)


def _check(robot: ParallelRobot) -> None:
    require_square(robot)
    if robot.n > 2 or robot.n_a != robot.n or not len(robot.following):
        raise InvalidInput(
            f"{robot.name}: paving is for robots of one or two freedoms, a motor for each, and passive joints"
        )
    turning = not robot.translations.all() and not isinstance(robot.platform, JointPlatform)
    if turning and planar_normal(robot) is None:
        raise InvalidInput(f"{robot.name}: a platform that turns is paved in a plane only")


class _Boxes(NamedTuple):
    """S boxes of the joints that move, off the reference [rad, lengths]."""

    middle: Array  # (S, k)
    radii: Array  # (S, k)

    def take(self, which: BoolArray) -> _Boxes:
        """Some of them."""
        return _Boxes(self.middle[which], self.radii[which])

    def within(self, lower: Array, upper: Array) -> _Boxes:
        """What is left of them between offsets (S, k) from their middles."""
        return _Boxes(self.middle + 0.5 * (lower + upper), UP * 0.5 * (upper - lower) + LEAST)

    def halves(self, joint: IntArray) -> _Boxes:
        """Both halves of each along one joint (S,)."""
        every, radii, shift = np.arange(len(joint)), self.radii.copy(), np.zeros_like(self.radii)
        radii[every, joint] *= 0.5 * UP
        shift[every, joint] = 0.5 * self.radii[every, joint]
        both = np.concatenate([self.middle - shift, self.middle + shift])
        return _Boxes(both, np.concatenate([radii, radii]))

    @staticmethod
    def joined(parts: list[_Boxes], k: int) -> _Boxes:
        """All boxes of several stacks."""
        nothing = _Boxes(np.zeros((0, k)), np.zeros((0, k)))
        return _Boxes(*map(np.concatenate, zip(nothing, *parts, strict=True)))


class _Arcs(NamedTuple):
    """Boxes with a proof, and where the platform is there."""

    x: Array  # (B, n)
    x_radii: Array  # (B, n)
    boxes: _Boxes
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


class _Step(NamedTuple):
    """What becomes of boxes."""

    kept: _Arcs
    small: _Boxes
    ahead: _Boxes


@dataclass(frozen=True, eq=False)
class _Paver:
    """What one set of singular poses is looked for with."""

    bounds: SlopeBounds
    which: SingularSet
    window: Array | None
    resolution: float

    def step(self, boxes: _Boxes) -> _Step:
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
        narrow = _Boxes.joined([narrow.take(~known), found], boxes.radii.shape[1])
        before = np.concatenate([boxes.radii[~known], boxes.radii[known][alive]])
        joint = np.concatenate([np.full(np.count_nonzero(~known), NONE), joint])
        small = (joint == NONE) & (narrow.radii.sum(axis=1) * robot.length < SMALLEST * self.resolution)
        go = ~small
        shrunk = (joint == NONE) & (np.prod(narrow.radii / before, axis=1) < SHRUNK)
        cut = narrow.take(go & ~shrunk)
        along = np.where(joint == NONE, narrow.radii.argmax(axis=1), joint)[go & ~shrunk]
        ahead = _Boxes.joined([narrow.take(go & shrunk), cut.halves(along)], boxes.radii.shape[1])
        return _Step(kept, narrow.take(small), ahead)

    def _in_window(self, at: Linearised, radii: Array, errors: Array) -> BoolArray:
        robot, n = self.bounds.robot, self.bounds.robot.n
        if self.window is None:
            return np.ones(len(radii), dtype=bool)
        x = robot.platform.coordinates(at.frames)
        far = _scale(robot) * (np.einsum("snk,sk->sn", np.abs(at.slopes[:, :n]), radii) + errors[:, :n]) * UP
        return np.asarray(((x + far >= self.window[0]) & (x - far <= self.window[1])).all(axis=1))

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
        self, boxes: _Boxes, wider: Array, here: _Equations
    ) -> tuple[_Arcs, _Boxes, IntArray, BoolArray]:
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
        kept = _Arcs(here.x[last], (_scale(robot) * far)[last], arcs.take(last), joint[last])
        go = alive & ~last
        joint = np.where(proved, joint, NONE)[go]
        return kept, boxes.within(lower, upper).take(go), joint, go


def _scale(robot: ParallelRobot) -> Array:
    return np.where(robot.translations, robot.length, 1.0)


def _paved(paver: _Paver, reach: float, most: int) -> PavedSet:
    """One set, from the whole region on."""
    robot, bounds = paver.bounds.robot, paver.bounds
    k = len(robot.moving)
    at_once = max(NUMBERS // (len(bounds.row_scale) * k**2), 1)
    ahead = _Boxes(np.zeros((1, k)), np.where(robot.sliding[robot.moving], reach, UP * np.pi)[None])
    kept, small, examined = list[_Arcs](), list[_Boxes](), 0
    while len(ahead.middle) and examined < most:
        examined += len(ahead.middle)
        steps = [
            paver.step(_Boxes(*(part[first : first + at_once] for part in ahead)))
            for first in range(0, len(ahead.middle), at_once)
        ]
        kept += [step.kept for step in steps]
        small += [step.small for step in steps]
        ahead = _Boxes.joined([step.ahead for step in steps], k)
    left = _Boxes.joined([*small, ahead], k)
    at = bounds.at(bounds.moved(left.middle))
    far = np.einsum("snk,sk->sn", np.abs(at.slopes[:, : robot.n]), left.radii)
    arcs = _Boxes.joined([arc.boxes for arc in kept], k)
    return PavedSet(
        name=paver.which.name,
        x=np.concatenate([arc.x for arc in kept]),
        x_radii=np.concatenate([arc.x_radii for arc in kept]),
        q=bounds.moved(arcs.middle),
        q_radii=arcs.radii * bounds.column_scale,
        along=np.concatenate([arc.along for arc in kept]),
        undecided_x=robot.platform.coordinates(at.frames),
        undecided_x_radii=_scale(robot) * UP * (far + at.changes(left.radii).values[:, : robot.n]),
        undecided_q=at.frames.q,
        undecided_q_radii=left.radii * bounds.column_scale,
        examined=examined,
    )
