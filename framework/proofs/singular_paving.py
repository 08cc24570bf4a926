"""All singular poses of a robot with one or two freedoms, in boxes, with a proof that there are no others.

Boxes are of all joints that move: hinges all the way round, slides within a reach. `singular_boxes` drops,
keeps, narrows or cuts them. What is kept is a piece of a smooth curve (with one freedom: a pose), or is
listed as undecided. The proof trusts that pinocchio's positions and directions at one configuration
are right to `tolerances.FRAME_ROUNDING`.

Sources: Merlet, Parallel Robots, 2nd ed., Springer 2006, chapter 11; Bohigas, Manubens and Ros, Singularities
of Robot Mechanisms, Springer 2017, who pave {closures = 0, rank lost} by linear relaxations.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from framework.arrays import Array, ArrayLike, IntArray, ReadOnlyArrays, join
from framework.errors import InvalidInput, finite_numbers, whole_number
from framework.kinematics.inverse_kinematics import require_square
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.kinematics.placements import planar_normal
from framework.kinematics.platform import JointPlatform
from framework.proofs.branch_and_bound import Boxes, branch_and_bound
from framework.proofs.derivative_bounds import DerivativeBounds
from framework.proofs.rounding import ROUND_UP, times
from framework.proofs.singular_boxes import SingularBoxTest, singular_sets

RESOLUTION = 1e-3  # [m], or in robot lengths of turns
SLIDE_REACH = 1.2  # [robot lengths] of slides about the reference
MAX_BOXES = 500_000  # that are tested for each set
MAX_HESSIAN_ENTRIES = 4_000_000  # second derivatives of a batch of boxes: 32 MB


@dataclass(frozen=True, eq=False)
class PavedSet(ReadOnlyArrays):
    """The poses of one kind of singularity, in B proved boxes and U undecided ones.

    Each of the B holds exactly one singular pose for every value of one of its joints, the `along` one (with
    one freedom: exactly one). Neighbours overlap.
    """

    name: str  # type_2; or type_1 of the motors of a leg
    x: Array  # (B, n) middles in the platform's coordinates
    x_radii: Array  # (B, n) the poses that are proved are within
    q: Array  # (B, nq) middles
    q_radii: Array  # (B, k) of the joints that move [rad, m]
    along: IntArray  # (B,) index into the joints that move; -1: none
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
    window: Array | None  # (2, n) least and largest platform coordinates [m, rad]
    resolution: float  # [m, robot lengths] the boxes are no wider
    reach: float  # [robot lengths] of slides about the reference; hinges turn all the way round
    seconds: float

    @property
    def complete(self) -> bool:
        """Whether every box is decided."""
        return all(paved.complete for paved in self.sets)

    @property
    def sentence(self) -> str:
        """State the result in a sentence."""
        where = "" if self.window is None else " in the window"
        if self.robot.sliding[self.robot.moving].any():
            where += f", slides within {self.reach:.3g} robot lengths of the reference,"
        counts = ", ".join(f"{paved.name}: {len(paved.x)}" for paved in self.sets)
        left = sum(len(paved.undecided_x) for paved in self.sets)
        rest = "no box undecided" if self.complete else f"or within {left} undecided ones"
        return f"all singular poses{where} lie within boxes of {self.resolution:.3g} ({counts}), {rest}"


def pave_singularities(
    robot: ParallelRobot,
    *,
    window: ArrayLike | None = None,
    resolution: float = RESOLUTION,
    reach: float = SLIDE_REACH,
    max_boxes: int = MAX_BOXES,
) -> SingularPaving:
    """Enclose the Type 2 and Type 1 poses of a robot with one or two freedoms, over all its modes.

    Joint limits do not count; springs are at rest; loop equations that repeat others at the reference are
    left out. Poses in which P loses rank without a motion of the platform are among those of Type 2;
    `classify` tells them apart.

    Args:
        window: (2, n) least and largest platform coordinates [m, rad], angles up to whole turns; everywhere
            by default.
        resolution: largest width of a box in the platform's coordinates [m; robot lengths for turns].
        reach: of slides about the reference, in lengths of the robot.
        max_boxes: that are looked at for each set; those left over are undecided.

    Raises:
        InvalidInput: the robot has more freedoms, redundant motors, no passive joints or ball joints that
            move; or an option is no positive number.
    """
    expect_robot(robot)
    _check(robot)
    resolution, reach = _positive("resolution", resolution), _positive("reach", reach)
    max_boxes = whole_number("max_boxes", max_boxes, 1, 10**9)
    region = None
    if window is not None:
        region = finite_numbers(
            "window, least and largest platform coordinates,", window, robot.n, stacks=True
        )
        if region.shape != (2, robot.n) or not (region[0] < region[1]).all():
            raise InvalidInput(f"window: needs (2, {robot.n}) numbers, the least and the largest")
    start = time.perf_counter()
    bounds = DerivativeBounds.of(robot, reach=reach)
    sets = tuple(
        _pave(SingularBoxTest(bounds, which, region, resolution), reach, max_boxes)
        for which in singular_sets(robot)
    )
    return SingularPaving(robot, sets, region, resolution, reach, time.perf_counter() - start)


def _positive(name: str, number: object) -> float:
    """Return a positive number; raise InvalidInput for any other."""
    value = float(finite_numbers(name, [number], 1)[0])  # type: ignore[arg-type]
    if value <= 0:
        raise InvalidInput(f"{name}: needs a positive number, got {number!r}")
    return value


def _check(robot: ParallelRobot) -> None:
    """Raise InvalidInput for a robot that cannot be paved."""
    require_square(robot)
    if robot.n > 2 or robot.n_a != robot.n or not len(robot.following):
        raise InvalidInput(
            f"{robot.name}: paving is for robots of one or two freedoms, a motor for each, and passive joints"
        )
    turning = not robot.translations.all() and not isinstance(robot.platform, JointPlatform)
    if turning and planar_normal(robot) is None:
        raise InvalidInput(f"{robot.name}: a platform that turns is paved in a plane only")


def _pave(test: SingularBoxTest, reach: float, max_boxes: int) -> PavedSet:
    """Pave one set, from the whole region on."""
    robot, bounds = test.bounds.robot, test.bounds
    k = len(robot.moving)
    region = Boxes(np.zeros((1, k)), np.where(robot.sliding[robot.moving], reach, ROUND_UP * np.pi)[None])
    batch = max(MAX_HESSIAN_ENTRIES // (len(bounds.row_scale) * k**2), 1)
    partition = branch_and_bound(test, region, batch=batch, max_examined=max_boxes)
    left = join([partition.undecided, partition.ahead])
    derivatives = bounds.evaluate(bounds.configurations(left.middle))
    left_reach = times(np.abs(derivatives.slopes[:, : robot.n]), left.radii)
    left_reach += derivatives.remainders(left.radii).values[:, : robot.n]
    arcs = join(partition.proved)
    return PavedSet(
        name=test.which.name,
        x=arcs.x,
        x_radii=arcs.x_radii,
        q=bounds.configurations(arcs.boxes.middle),
        q_radii=arcs.boxes.radii * bounds.column_scale,
        along=arcs.along,
        undecided_x=robot.platform.coordinates(derivatives.frames),
        undecided_x_radii=robot.platform_scale * ROUND_UP * left_reach,
        undecided_q=derivatives.frames.q,
        undecided_q_radii=left.radii * bounds.column_scale,
        examined=partition.examined,
    )
