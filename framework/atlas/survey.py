"""The window of a map, the survey that finds a default window, and the coarse poses of a window.

A window is a grid over two of the platform's coordinates; the others are constant. The only coordinate of a
mechanism of one freedom has a grid of one column. Coarse poses are reached from the reference.
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
from framework.numerics.arrays import Array, ArrayLike, IntArray, ReadOnlyArrays

EDGE_POSES, MAX_EDGE_POSES = 200, 4000  # poses along an edge of a map: usual and largest number
GridPoses = tuple[Array, ReasonArray]  # configurations (I, J, nq); why they are not reached (I, J)
MAX_NEIGHBOUR_DISTANCE = 0.15  # [robot lengths, rad] largest step from a pose to its neighbour


@dataclass(frozen=True, eq=False)
class Window(ReadOnlyArrays):
    """A grid of poses over k = 1 or 2 platform coordinates, the others constant."""

    axes: tuple[int, ...]  # (k,) indices of the coordinates
    lower: Array  # (k,) [m, rad] their least values
    upper: Array  # (k,) their largest values
    shape: tuple[int, int]  # numbers of poses along them, ends included; (I, 1) along one
    constants: Array  # (n,) platform coordinates; those of `axes` are not used

    def __post_init__(self) -> None:
        """Check the numbers of poses and the order of the ends."""
        super().__post_init__()
        for name in ("lower", "upper", "constants"):
            finite_numbers(f"window: {name}", getattr(self, name), np.size(getattr(self, name)))
        for count in self.shape[: len(self.axes)]:
            whole_number("size of a map", count, 2, MAX_EDGE_POSES)
        if not np.all(self.lower < self.upper):
            raise InvalidInput(
                f"window: its lower ends {self.lower.tolist()} must be below the upper ones "
                f"{self.upper.tolist()}"
            )

    @property
    def spans(self) -> tuple[Array, ...]:
        """Values (I,) and (J,) of the coordinates."""
        return tuple(map(np.linspace, self.lower, self.upper, self.shape))

    @property
    def cell(self) -> Array:
        """Distances (k,) between neighbours along the axes."""
        return (self.upper - self.lower) / (np.array(self.shape[: len(self.axes)]) - 1)

    def points(self) -> Array:
        """Return platform coordinates (I, J, n) of all poses."""
        x = np.tile(self.constants, (*self.shape, 1))
        values = np.stack(np.meshgrid(*self.spans, indexing="ij"), axis=-1)
        x[..., self.axes] = values.reshape(*self.shape, len(self.axes))
        return x


def map_axes(robot: ParallelRobot, names: Sequence[str] | None = None) -> tuple[int, ...]:
    """Return the indices of the two platform coordinates of a map, or of the only one.

    The default is the first two coordinates, translations before turns.

    Raises:
        InvalidInput: `names` are not two coordinates of the robot, or a robot has one only.
    """
    if robot.n < 2:
        if names is not None and list(names) != list(robot.axis_names):
            raise InvalidInput(f"axes of a map: {robot.name} has {robot.axis_names[0]} alone; leave them out")
        return (0,)
    if names is None:
        names = [robot.axis_names[k] for k in np.argsort(~robot.translations, kind="stable")[:2]]
    if len(set(names)) != 2 or not set(names) <= set(robot.axis_names):
        raise InvalidInput(
            f"axes of a map: needs two of {', '.join(robot.axis_names)}, got {', '.join(names)}"
        )
    return robot.axis_names.index(names[0]), robot.axis_names.index(names[1])


def grid_shape(axes: tuple[int, ...], size: int) -> tuple[int, int]:
    """Return the numbers of poses of a window with `size` along each axis."""
    return size, size if len(axes) == 2 else 1


def map_point(robot: ParallelRobot, point: ArrayLike | None) -> Array:
    """Return the platform point (n,) that a map contains; by default the reference."""
    return robot.reference.x if point is None else finite_numbers("at", point, robot.n)


def survey_window(
    robot: ParallelRobot,
    *,
    axes: Sequence[str] | None = None,
    at: ArrayLike | None = None,
    size: int = EDGE_POSES,
    keep_limits: bool = False,
    survey_edge_poses: int = 33,  # poses along an edge of the first survey
    max_survey_edge_poses: int = 257,
    survey_reach: float = 1.6,  # [robot lengths, rad] half an edge of a survey, of two axes
) -> Window:
    """Find the smallest window with all poses of the reference's working mode.

    Surveys cover `survey_reach` about the point `at`, each with half the cells of the one before, until one
    finds no pose beyond the window about those found before: steps of long cells may all miss the poses
    beside a reference near Type 1. The last survey covers the window found, for a narrower margin.

    Args:
        axes: names of two platform coordinates, or of the only one; by default the first two, translations
            first.
        at: platform point (n,); by default the reference. Its other coordinates are constant over the map.
        size: number of poses along an edge of the returned window.
        keep_limits: whether to count only poses within the ranges of all joints, if there are any.

    Raises:
        InvalidInput: the axes are not two coordinates of the platform, or `at` has the wrong length.
        OutOfReach: no pose near the reference is reached.
    """
    columns = map_axes(robot, axes)
    point = map_point(robot, at)
    middle = point[list(columns)]
    half_edges = survey_reach * robot.platform_scale[list(columns)]
    only_turns = len(columns) == 1 and not robot.translations[0]
    if only_turns:
        half_edges = np.array([2 * np.pi])  # a whole turn, whichever way the stroke goes on
    outermost = Window(
        axes=columns,
        lower=middle - half_edges,
        upper=middle + half_edges,
        shape=grid_shape(columns, survey_edge_poses),
        constants=point,
    )
    survey = outermost
    window, poses, may_grow = _reached_window(robot, survey, outermost, keep_limits)
    while may_grow and survey.shape[0] < max_survey_edge_poses:
        known = window
        survey = replace(survey, shape=grid_shape(columns, 2 * survey.shape[0] - 1))
        window, poses, may_grow = _reached_window(robot, survey, outermost, keep_limits, coarser=poses)
        may_grow &= bool(np.any(window.lower < known.lower) or np.any(window.upper > known.upper))
    if np.any(window.upper - window.lower < survey.upper - survey.lower):
        # no longer cells than those that reached the poses
        edge_poses = int(np.ceil(((window.upper - window.lower) / survey.cell).max())) + 1
        fine = replace(window, shape=grid_shape(columns, max(edge_poses, survey_edge_poses)))
        window, *_ = _reached_window(robot, fine, outermost, keep_limits)
    if only_turns and window.upper[0] - window.lower[0] > 2 * np.pi:
        window = replace(window, lower=middle - np.pi, upper=middle + np.pi)
    return replace(window, shape=grid_shape(columns, size))


def _reached_window(
    robot: ParallelRobot,
    survey: Window,
    outermost: Window,
    keep_limits: bool,
    coarser: GridPoses | None = None,
) -> tuple[Window, GridPoses, bool]:
    """Return the window about a survey's reached poses, all poses, and whether the window may grow.

    Args:
        survey: the window of the survey.
        outermost: the window to which the result is cut.
        keep_limits: whether to count only poses within the ranges of all joints, if there are any.
        coarser: every second pose of the survey.
    """
    # [cells] beyond the outermost reached poses, for poses that the survey leaves out
    margin_cells = 2.0
    poses = seed_poses(robot, survey, stride=1, coarser=coarser)
    q, reason = poses
    reached = reason == PoseReason.REACHED
    # a joint's share beyond its range is above 0 outside of the range
    within = reached & (shares_beyond_limits(robot.limits, q) <= 0.0).all(axis=-1)
    counted = within if keep_limits and within.any() else reached
    indices = np.argwhere(counted)[:, : len(survey.axes)]  # (poses, k) rows and columns
    margin = margin_cells * survey.cell
    lower = survey.lower + indices.min(axis=0) * survey.cell - margin
    upper = survey.lower + indices.max(axis=0) * survey.cell + margin
    ends = np.clip([lower, upper], outermost.lower, outermost.upper)
    # (k,) whether an edge of the survey is not reached
    has_gap = np.ptp(indices, axis=0) + 1 < survey.shape[: len(survey.axes)]
    return replace(survey, lower=ends[0], upper=ends[1]), poses, bool(has_gap.any())


def seed_poses(
    robot: ParallelRobot, window: Window, stride: int, *, coarser: GridPoses | None = None
) -> GridPoses:
    """Compute every `stride`-th pose of a window: configurations (I, J, nq), reasons (I, J).

    The reason of a pose is REACHED, or why it is not reached. All other poses are NaN, with the reason
    NO_NEIGHBOUR. The poses nearest to the reference are assembled in turn until one succeeds; the others are
    reached from their neighbours. With a stride of 1, cells longer than MAX_NEIGHBOUR_DISTANCE are
    subdivided: poses between those of the window are computed too, but not returned.

    Args:
        stride: distance between computed poses [rows or columns]; above 1 only if `stride` cells in a row are
            no longer than MAX_NEIGHBOUR_DISTANCE, so that no cell is subdivided.
        coarser: every second pose of the window; those reached are not computed again.

    Raises:
        InvalidInput: the window is too wide.
        OutOfReach: no pose near the reference is reached.
    """
    first_pose_tries = 9  # number of poses nearest to the reference of which one must be assembled
    # the grid of all poses that are computed: that of the window, unless cells are too long
    subdivisions = max(1, int(np.ceil(longest_cell_edge(robot, window) / MAX_NEIGHBOUR_DISTANCE)))
    rows, columns = ((count - 1) * subdivisions + 1 for count in window.shape)
    if max(rows, columns) > MAX_EDGE_POSES:
        width = (window.upper - window.lower).max() / robot.length
        raise InvalidInput(
            f"window: {width:.3g} robot lengths wide is more than poses can be followed over; "
            f"lengths are in m"
        )
    x = replace(window, shape=(rows, columns)).points()  # (rows, columns, n)
    q = np.full((rows, columns, robot.model.nq), np.nan)
    reason = np.full((rows, columns), PoseReason.NO_NEIGHBOUR, dtype=np.uint8)

    # the coarse poses, from those nearest to the reference
    distance = np.abs(x[::stride, ::stride] - robot.reference.x).max(axis=2)
    nearest = np.argsort(distance, axis=None, kind="stable")[:first_pose_tries]  # flat indices
    candidates = stride * np.transpose(np.unravel_index(nearest, distance.shape))  # (tries, 2)
    if coarser is None:
        _assemble_seeds(robot, x, q, reason, candidates, enough=1)
    else:
        every_second = np.s_[:: 2 * subdivisions, :: 2 * subdivisions]
        q[every_second], coarser_reason = coarser
        reason[every_second][coarser_reason == PoseReason.REACHED] = PoseReason.REACHED
    fill_grid(robot, x, q, reason, [stride])
    # beside Type 1 no neighbour may be within a step, but another candidate within reach of the reference
    if _assemble_seeds(robot, x, q, reason, candidates, enough=first_pose_tries):
        reason[reason != PoseReason.REACHED] = PoseReason.NO_NEIGHBOUR
        fill_grid(robot, x, q, reason, [stride])
    window_poses = np.s_[::subdivisions, ::subdivisions]  # without the poses between them
    return q[window_poses].copy(), reason[window_poses].copy()


def _assemble_seeds(
    robot: ParallelRobot, x: Array, q: Array, reason: ReasonArray, candidates: IntArray, *, enough: int
) -> int:
    """Assemble poses x (I, J, n) of a grid from the reference, in place; return their number.

    Of the candidates (c, 2), rows and columns, those that are not reached yet are tried in turn, until
    `enough` of them are.

    Raises:
        OutOfReach: no candidate is reached; gives the reason of the first.
    """
    refusals = list[NoAnswer]()  # of the candidates
    count = 0
    for i, j in candidates:
        if count < enough and reason[i, j] != PoseReason.REACHED:
            try:
                q[i, j] = assemble(robot, x[i, j]).q
            except NoAnswer as error:
                refusals.append(error)
            else:
                reason[i, j] = PoseReason.REACHED
                count += 1
    if len(refusals) < len(candidates):
        return count
    raise OutOfReach(
        f"no pose of the map near the reference is reached from there: {refusals[0].sentence}",
        name=robot.name,
        q=robot.reference.q,
        residual=robot.reference.residual,
        s=0.0,
        platform=robot.reference.x,
        joint="",
    ) from refusals[0]


def longest_cell_edge(robot: ParallelRobot, window: Window) -> float:
    """Return the longer edge [robot lengths, rad] of a window's cell."""
    lengths = robot.platform_scale[list(window.axes)]
    return float((window.cell / lengths).max())
