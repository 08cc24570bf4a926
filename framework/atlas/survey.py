"""The window of a map, its default, and coarse poses of a window, reached from the reference.

A window is a grid over two of the platform's coordinates, with the others constant.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from framework.atlas.sweep import PoseReason, ReasonArray, fill_grid
from framework.errors import InvalidInput, NoAnswer, OutOfReach, finite_numbers, whole_number
from framework.kinematics.continuation.tracking import assemble
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import shares_beyond_limits
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays

MAX_EDGE_POSES = 4000  # poses along an edge


@dataclass(frozen=True, eq=False)
class Window(ReadOnlyArrays):
    """A grid of poses over two platform coordinates, the others constant.

    `shape` poses between `lower` and `upper` (2,), both included, of the platform coordinates `axes`.
    """

    axes: tuple[int, int]
    lower: Array  # (2,) [m, rad]
    upper: Array  # (2,)
    shape: tuple[int, int]
    constants: Array  # (n,) platform coordinates, constant over the map but for those of `axes`

    def __post_init__(self) -> None:
        """Check the numbers of poses and the order of the ends."""
        super().__post_init__()
        for count in self.shape:
            whole_number("size of a map", count, 2, MAX_EDGE_POSES)
        if not np.all(self.lower < self.upper):
            raise InvalidInput(
                f"window: its lower ends {self.lower.tolist()} must be below the upper ones "
                f"{self.upper.tolist()}"
            )

    @property
    def spans(self) -> tuple[Array, Array]:
        """Values of both coordinates along the edges of the grid."""
        first, second = (
            np.linspace(low, high, count)
            for low, high, count in zip(self.lower, self.upper, self.shape, strict=True)
        )
        return first, second

    @property
    def cell(self) -> Array:
        """Distance (2,) of neighbours along either axis."""
        return (self.upper - self.lower) / (np.array(self.shape) - 1)

    def points(self) -> Array:
        """Return platform coordinates (I, J, n) of all poses."""
        x = np.tile(self.constants, (*self.shape, 1))
        first, second = self.spans
        x[..., self.axes[0]], x[..., self.axes[1]] = first[:, None], second
        return x


def map_axes(robot: ParallelRobot, names: Sequence[str] | None = None) -> tuple[int, int]:
    """Return the two platform coordinates of a map, by index.

    By default the first two, translations first.

    Raises:
        InvalidInput: the robot has fewer than two coordinates, or not those of `names`.
    """
    if robot.n < 2:
        raise InvalidInput(
            f"{robot.name}: a map needs two platform coordinates, it has {', '.join(robot.axis_names)} alone"
        )
    if names is not None:
        if len(set(names)) != 2 or not set(names) <= set(robot.axis_names):
            raise InvalidInput(
                f"axes of a map: needs two of {', '.join(robot.axis_names)}, got {', '.join(names)}"
            )
        return robot.axis_names.index(names[0]), robot.axis_names.index(names[1])
    order = [*np.flatnonzero(robot.translations), *np.flatnonzero(~robot.translations)]
    return int(order[0]), int(order[1])


def map_point(robot: ParallelRobot, point: ArrayLike | None) -> Array:
    """Return the point (n,) about which a map lies, the reference by default."""
    return robot.reference.x if point is None else finite_numbers("at", point, robot.n)


EDGE_POSES = 200  # poses along an edge
MAX_NEIGHBOUR_DISTANCE = 0.15  # [robot lengths, rad] of a step from a pose to its neighbour
FIRST_POSE_TRIES = 9  # coarse poses near the reference that are tried as the first one
SURVEY_EDGE_POSES = 33  # poses along an edge of a look for the reach of a robot
SURVEY_REACH, SURVEY_TURN = 1.6, 1.6  # [robot lengths], [rad] half an edge of the first
SURVEY_MARGIN = 2.0  # [cells] of a look, beyond the outermost poses reached: between poses more may be
FINE_LOOKS = 2  # looks at the window that the look before has found


def survey_window(
    robot: ParallelRobot,
    *,
    axes: Sequence[str] | None = None,
    at: ArrayLike | None = None,
    size: int = EDGE_POSES,
    keep_limits: bool = False,
) -> Window:
    """Find the smallest window with all poses of the reference's working mode.

    Looks at coarse poses, then at those of the window found, twice. The bounds are `SURVEY_REACH` robot
    lengths and `SURVEY_TURN` about the point `at`.

    Args:
        axes: two of the platform's axes, by default its first translations.
        at: platform point (n,), by default the reference; its other coordinates are constant over the map.
        size: poses along an edge.
        keep_limits: contain only poses within the ranges of all joints, if there are any.

    Raises:
        InvalidInput: see `map_axes`; or `at` has the wrong length.
        OutOfReach: no pose near the reference is reached.
    """
    columns, point = map_axes(robot, axes), map_point(robot, at)
    half = np.where(robot.translations, SURVEY_REACH * robot.length, SURVEY_TURN)[list(columns)]
    centre = point[list(columns)]
    shape = (SURVEY_EDGE_POSES, SURVEY_EDGE_POSES)
    bounds = Window(columns, centre - half, centre + half, shape, point)
    window = _reached_window(robot, bounds, bounds, keep_limits)
    for _ in range(FINE_LOOKS):
        window = _reached_window(robot, window, bounds, keep_limits)
    return replace(window, shape=(size, size))


def _reached_window(robot: ParallelRobot, look: Window, bounds: Window, keep_limits: bool) -> Window:
    """Return the window about the reached poses of a coarse look, within bounds."""
    q, reason = seed_poses(robot, look, 1)
    is_reached = reason == PoseReason.REACHED
    within = is_reached & (shares_beyond_limits(robot.limits, q) <= 0.0).all(axis=-1)
    reached = np.argwhere(within if keep_limits and within.any() else is_reached)
    first, last = look.lower + reached.min(axis=0) * look.cell, look.lower + reached.max(axis=0) * look.cell
    margin = SURVEY_MARGIN * look.cell
    lower = np.maximum(first - margin, bounds.lower)
    return replace(look, lower=lower, upper=np.minimum(last + margin, bounds.upper))


def seed_poses(robot: ParallelRobot, window: Window, stride: int) -> tuple[Array, ReasonArray]:
    """Compute every `stride`-th pose of a window, reached from the reference.

    Return configurations (I, J, nq) and reasons (I, J). The poses nearest to the reference are assembled from
    it until one succeeds; the others are reached from their neighbours. Where cells are longer than a step
    may be, `subdivisions` of them are computed and left out.

    Raises:
        InvalidInput: the window is too wide.
        OutOfReach: no pose near the reference is reached.
    """
    subdivisions = max(1, int(np.ceil(longest_cell_edge(robot, window) / MAX_NEIGHBOUR_DISTANCE)))
    shape = tuple((count - 1) * subdivisions + 1 for count in window.shape)
    if max(shape) > MAX_EDGE_POSES:
        width = float((window.upper - window.lower).max()) / robot.length
        raise InvalidInput(
            f"window: {width:.3g} robot lengths wide is more than poses can be followed over; "
            f"lengths are in m"
        )
    x = replace(window, shape=(shape[0], shape[1])).points()
    q = np.full((*shape, robot.model.nq), np.nan)
    reason = np.full(shape, PoseReason.NO_NEIGHBOUR, dtype=np.uint8)
    distance = np.abs(x[::stride, ::stride] - robot.reference.x).max(axis=2)
    nearest_first = np.argsort(distance, axis=None, kind="stable")
    coarse_indices = np.dstack(np.unravel_index(nearest_first, distance.shape))[0]
    refusal: NoAnswer | None = None
    for i, j in coarse_indices[:FIRST_POSE_TRIES] * stride:
        try:
            q[i, j] = assemble(robot, x[i, j]).q
        except NoAnswer as error:
            refusal = refusal or error
            continue
        reason[i, j] = PoseReason.REACHED
        fill_grid(robot, x, q, reason, np.array([stride]))
        window_poses = np.s_[::subdivisions, ::subdivisions]
        return q[window_poses].copy(), reason[window_poses].copy()
    raise OutOfReach(
        f"{robot.name}: no pose of the map near the reference is reached from there: {refusal}",
        q=robot.reference.q,
        residual=robot.reference.residual,
        s=0.0,
        platform=robot.reference.x,
        joint="",
    ) from refusal


def longest_cell_edge(robot: ParallelRobot, window: Window) -> float:
    """Return the longer edge [robot lengths, rad] of a window's cell."""
    lengths = robot.platform_scale[list(window.axes)]
    return float((window.cell / lengths).max())
