"""A map of a robot over its workspace: quantities at the poses of one working mode.

Coarse poses are reached from the reference, one from the other, in this process. Then bands of rows, each
with its coarse poses, are filled independently of one another, in this process or by any
`concurrent.futures.Executor`. Bands depend only on the window, so a map is the same to the last bit whatever
computes it, and finished bands can be stored for a map that is interrupted. Finally those poses are reached
that only steps across the border of two bands join to the reference.

`restrict_to_ranges` leaves out poses beyond the limits of joints and motors: they have no values, and that
limit as their reason.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.ndimage import distance_transform_edt

from framework.atlas.quantities import Quantity, choose_quantities, has_torque_limits, quantity_values
from framework.atlas.survey import (
    MAX_NEIGHBOUR_DISTANCE,
    Window,
    longest_cell_edge,
    seed_poses,
    survey_window,
)
from framework.atlas.sweep import REASON_WORDS, PoseReason, ReasonArray, fill_grid, step_poses
from framework.dynamics.loading import LOAD_WORDS, LoadReason
from framework.errors import InvalidInput, LimitsExceeded, point
from framework.kinematics.frames import integrate
from framework.kinematics.inverse_kinematics import close_each, require_square
from framework.kinematics.linearised_loops import linearised_at, linearised_at_reference
from framework.kinematics.modes import mode_signs
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.kinematics.tree_model import positions_beyond_limits, shares_beyond_limits
from framework.numerics.arrays import Array, ArrayLike, BoolArray, IntArray, ReadOnlyArrays
from framework.numerics.kept import ArrayField, KeptChunks, complete_chunks
from framework.singularity.locus_on_map import MapLocus, MapPoses, locus_on_map
from framework.tolerances import SAME_PLACE

ASIDE = (0.0, 1.0, 1.0, 1.0)  # [rad, robot lengths] of joints: starts of searches in other working modes
BAND_ROWS = 8  # of a band; poses between coarse ones at most
Chunk = Mapping[str, NDArray]


@dataclass(frozen=True, eq=False)
class WorkspaceMap(ReadOnlyArrays):
    """Quantities over a window on the reference's working mode; NaN where not reached."""

    robot: ParallelRobot
    window: Window
    quantities: tuple[Quantity, ...]
    values: Mapping[str, Array]  # (I, J) by the quantity's key
    q: Array  # (I, J, nq)
    reason: NDArray[np.uint8 | np.uint16]  # (I, J) why a pose is not reached: index into `reason_words`
    working_mode: int  # its sign at the reference
    assembly: NDArray[np.int8]  # (I, J) sign of the assembly mode, 0 where not reached
    load: ReasonArray | None  # (I, J) `LoadReason` of poses that are reached, with quantities under load
    seconds: float
    reason_words: tuple[str, ...] = tuple(REASON_WORDS.values())  # first those of `sweep.PoseReason`

    @property
    def reached(self) -> BoolArray:
        """Mask (I, J) of the poses reached."""
        return self.reason == PoseReason.REACHED

    @cached_property
    def locus(self) -> MapLocus:
        """Singular locus over the window in this working mode, traced at the first use."""
        window = self.window
        poses = MapPoses(
            axes=window.axes,
            lower=window.lower,
            upper=window.upper,
            cell=window.cell,
            x=window.points(),
            q=self.q,
            reached=self.reached,
            g=self.values["g"],
            lead=self._step_configurations,
        )
        return locus_on_map(self.robot, poses)

    def _step_configurations(self, q: Array, start: Array, end: Array) -> tuple[Array, BoolArray]:
        """Step q (T, nq) from start to end (T, n); return the ends, accepted (T,)."""
        ends = step_poses(self.robot, q, start, end)
        return ends.q, ends.reason == PoseReason.REACHED

    @property
    def counts(self) -> dict[str, int]:
        """Numbers of poses by reason in words; the first is `reached`."""
        return {word: int(np.sum(self.reason == code)) for code, word in enumerate(self.reason_words)}

    @property
    def open_edges(self) -> tuple[str, ...]:
        """Edges of the window with reached poses, such as `least x`.

        More may be reached beyond.
        """
        reached = self.reached
        first, second = (self.robot.axis_names[k] for k in self.window.axes)
        edges = {
            f"least {first}": reached[0],
            f"largest {first}": reached[-1],
            f"least {second}": reached[:, 0],
            f"largest {second}": reached[:, -1],
        }
        return tuple(edge for edge, poses in edges.items() if poses.any())

    @property
    def keeps_limits(self) -> bool:
        """Whether only poses within the limits count as reached (`ranges.restrict_to_ranges`)."""
        return len(self.reason_words) > len(PoseReason)

    @property
    def beyond_ranges(self) -> BoolArray:
        """Mask (I, J) of poses reached but left out because of limits (`ranges.restrict_to_ranges`)."""
        return self.reason >= len(PoseReason)

    @property
    def load_counts(self) -> dict[str, int]:
        """Numbers of reached poses by `LoadReason` in words; empty without a load."""
        if self.load is None:
            return {}
        load = self.load[self.reached]
        return {LOAD_WORDS[kind]: int(np.sum(load == kind)) for kind in LoadReason}


class RowBand(NamedTuple):
    """Rows of the window from `first` to `stop` - 1, with their coarse poses.

    Coarse poses of the next row are there too, but for the last band.
    """

    first: int
    stop: int
    q: Array  # (rows + 1 or rows, J, nq) NaN except at coarse poses
    reason: ReasonArray  # (rows + 1 or rows, J)

    @property
    def name(self) -> str:
        """Name of the band's stored chunk."""
        return f"{self.first:05d}-{self.stop:05d}"


def workspace_map(
    robot: ParallelRobot,
    window: Window | None = None,
    quantities: Sequence[str] | None = None,
    *,
    wrench: ArrayLike | None = None,
    executor: Executor | None = None,
    keeper: KeptChunks | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> WorkspaceMap:
    """Compute quantities over a window, at the poses reached from the reference.

    Args:
        window: by default all that is reached over the first two translations, see `survey_window`.
        quantities: keys of `QUANTITIES`; by default see `choose_quantities`; g always.
        wrench: (n,) of the world ON the platform [N, N m], beside the weight, for quantities under load.
        executor: computes bands; this process if None. It must be able to pickle the robot.
        keeper: stores finished bands; bands that it has already are not computed again.
        progress: called with the number of poses that are done.

    Raises:
        InvalidInput: the platform does not determine the robot's joints, or see `choose_quantities`.
        OutOfReach: no pose near the reference is reached.
    """
    expect_robot(robot)
    require_square(robot)
    started = time.perf_counter()
    choice = choose_quantities(robot, quantities, wrench)
    window = survey_window(robot) if window is None else window
    bands = {band.name: band for band in _make_bands(robot, window)}
    width = window.shape[1]
    grids = complete_chunks(
        partial(fill_band, robot, window, choice),
        bands,
        partial(_band_arrays, quantities=choice),
        executor=executor,
        keeper=keeper,
        progress=lambda names: progress(width * sum(bands[name].stop - bands[name].first for name in names)),
    )
    x = window.points()
    _join_bands(robot, x, choice, grids)
    _mark_out_of_reach(robot, x, grids["q"], grids["reason"], _coarse_stride(robot, window))
    return WorkspaceMap(
        robot=robot,
        window=window,
        quantities=choice,
        values={quantity.key: grids[quantity.key] for quantity in choice},
        q=grids["q"],
        reason=grids["reason"],
        working_mode=int(mode_signs(robot, linearised_at_reference(robot))[0][0]),
        assembly=grids["assembly"],
        load=grids.get("load"),
        seconds=time.perf_counter() - started,
    )


def fill_band(robot: ParallelRobot, window: Window, quantities: tuple[Quantity, ...], band: RowBand) -> Chunk:
    """Compute the poses and quantities of one band."""
    x = window.points()[band.first : band.first + len(band.q)]
    q, reason = band.q.copy(), band.reason.copy()
    coarse_stride = _coarse_stride(robot, window)
    strides = np.array([stride for stride in (4, 2, 1) if stride < max(coarse_stride, 2)])
    fill_grid(robot, x, q, reason, strides)
    rows = band.stop - band.first  # without the next band's row
    return _evaluate_poses(robot, quantities, q[:rows], reason[:rows])


# ------------------------------------------------------------------ the parts


def _coarse_stride(robot: ParallelRobot, window: Window) -> int:
    """Return the stride of coarse poses, a power of 2.

    At most MAX_NEIGHBOUR_DISTANCE and BAND_ROWS.
    """
    largest = MAX_NEIGHBOUR_DISTANCE / longest_cell_edge(robot, window)
    return int(2 ** np.clip(np.floor(np.log2(largest)), 0, np.log2(BAND_ROWS)))


def _make_bands(robot: ParallelRobot, window: Window) -> list[RowBand]:
    """Return the bands of a window with their coarse poses."""
    q, reason = seed_poses(robot, window, _coarse_stride(robot, window))
    reason[reason != PoseReason.REACHED] = PoseReason.NO_NEIGHBOUR  # try again from nearer neighbours
    bands = []
    for first in range(0, len(q), BAND_ROWS):
        stop = min(first + BAND_ROWS, len(q))
        rows = slice(first, min(stop + 1, len(q)))
        band_reason = reason[rows].copy()
        next_row = band_reason[stop - first :]
        next_row[next_row == PoseReason.NO_NEIGHBOUR] = PoseReason.OPEN  # left to the next band
        bands.append(RowBand(first, stop, q[rows], band_reason))
    return bands


def _band_arrays(band: RowBand, quantities: tuple[Quantity, ...]) -> dict[str, ArrayField]:
    """Return types and shapes of the arrays of a filled band, by name."""
    shape = (band.stop - band.first, band.q.shape[1])
    arrays = {
        "q": ArrayField("f", (*shape, band.q.shape[2])),
        "reason": ArrayField("u", shape),
        "assembly": ArrayField("i", shape),
    }
    if any(quantity.loaded for quantity in quantities):
        arrays["load"] = ArrayField("u", shape)
    return arrays | {quantity.key: ArrayField("f", shape) for quantity in quantities}


def _evaluate_poses(
    robot: ParallelRobot, quantities: tuple[Quantity, ...], q: Array, reason: ReasonArray
) -> dict[str, NDArray]:
    """Compute quantities and assembly modes at poses q (I, J, nq), with q and reason."""
    reached = reason == PoseReason.REACHED
    chunk: dict[str, NDArray] = {"q": q, "reason": reason, "assembly": np.zeros(reason.shape, dtype=np.int8)}
    chunk |= {quantity.key: np.full(reason.shape, np.nan) for quantity in quantities}
    if any(quantity.loaded for quantity in quantities):
        chunk["load"] = np.zeros(reason.shape, dtype=np.uint8)
    if reached.any():
        linearised = linearised_at(robot, q[reached], None)
        for key, values in quantity_values(robot, quantities, q[reached], linearised).items():
            chunk[key][reached] = values
        chunk["assembly"][reached] = mode_signs(robot, linearised)[1]
    return chunk


def _join_bands(
    robot: ParallelRobot, x: Array, quantities: tuple[Quantity, ...], grids: dict[str, NDArray]
) -> None:
    """Reach the poses that only steps across a border of bands reach, in place.

    First unfilled poses with a filled neighbour across a border are tried. If one is reached, all unfilled
    poses are tried, as it may lead to them.
    """
    reason, was_filled = grids["reason"], grids["reason"] == PoseReason.REACHED
    border = np.zeros_like(was_filled)
    for first in range(BAND_ROWS, len(x), BAND_ROWS):
        border[first - 1] = ~was_filled[first - 1] & was_filled[first]
        border[first] = ~was_filled[first] & was_filled[first - 1]
    for unfilled in (border, ~was_filled):
        reason[unfilled & (reason != PoseReason.REACHED)] = PoseReason.NO_NEIGHBOUR
        fill_grid(robot, x, grids["q"], reason, np.array([1]))
        if not (reason[border] == PoseReason.REACHED).any():
            return
    i, j = np.nonzero((reason == PoseReason.REACHED) & ~was_filled)
    chunk = _evaluate_poses(robot, quantities, grids["q"][i, j][None], reason[i, j][None])
    for key, values in chunk.items():
        grids[key][i, j] = values[0]


def _mark_out_of_reach(robot: ParallelRobot, x: Array, q: Array, reason: ReasonArray, stride: int) -> None:
    """Set the reason (I, J) of poses that do not close or are in other modes, in place.

    Poses are q (I, J, nq) at x (I, J, n). Newton's method looks for a pose of any working mode at every
    `stride`-th of them, from the nearest pose reached and from others beside it; those that it finds are
    continued to their neighbours.
    """
    unjoined = (reason == PoseReason.NO_NEIGHBOUR) | (reason == PoseReason.OPEN)
    coarse = np.zeros_like(unjoined)
    coarse[::stride, ::stride] = unjoined[::stride, ::stride]
    nearest: IntArray = distance_transform_edt(  # (2, I, J), row and column of the nearest pose reached
        reason != PoseReason.REACHED, return_distances=False, return_indices=True
    )
    others, random = np.full_like(q, np.nan), np.random.default_rng(0)
    for spread in ASIDE:
        i, j = np.nonzero(coarse & np.isnan(others[..., 0]))
        offset = spread * random.standard_normal((len(i), robot.model.nv)) * robot.column_scale
        closing = close_each(robot, x[i, j], integrate(robot, q[tuple(nearest[:, i, j])], offset))
        others[i, j] = np.where(closing.closed[:, None], closing.q, np.nan)
    other_reason = np.where(unjoined, PoseReason.NO_NEIGHBOUR, PoseReason.OPEN).astype(np.uint8)
    other_reason[np.isfinite(others[..., 0])] = PoseReason.REACHED
    fill_grid(robot, x, others, other_reason, np.array([1]))
    reason[(reason == PoseReason.OPEN) & (other_reason == PoseReason.REACHED)] = PoseReason.OTHER_MODE
    reason[unjoined & (other_reason != PoseReason.REACHED)] = PoseReason.OPEN


NOT_JOINED = "within all limits, not joined to the reference within them"
TOO_WEAK = "beyond the torque limits at rest"


def restrict_to_ranges(workspace: WorkspaceMap) -> WorkspaceMap:
    """Keep values at poses that steps within all limits join to the reference.

    Limits are the ranges of joints and, if motors have torque limits, these at rest, by the quantity
    `holding`. The reason of a pose beyond several ranges is the joint farthest beyond its range, as a share
    of the range. Codes of `reason` are indices into `reason_words`: first those of `PoseReason`, then not
    joined, too weak, and one for each joint.

    Raises:
        InvalidInput: motors have limits of torque and the map lacks `holding`; or see `check_window`.
        LimitsExceeded: the reference itself is beyond a range, or no pose beside it is within all limits.
    """
    robot = workspace.robot
    check_reference(robot)
    check_window(robot, workspace.window)
    if has_torque_limits(robot) and "holding" not in workspace.values:
        raise InvalidInput(
            f"quantities: {robot.name} has limits of torque, with which the quantity holding is compared; "
            f"add it"
        )
    shares = shares_beyond_limits(robot.limits, workspace.q)
    in_range = workspace.reached & (shares <= 0.0).all(axis=-1)
    beyond = workspace.reached & ~in_range
    too_weak = in_range & (workspace.values.get("holding", np.zeros(in_range.shape)) > 1.0)
    within = in_range & ~too_weak
    joined = _join_to_reference(workspace, within)
    reason = workspace.reason.astype(np.uint16)
    reason[within & ~joined] = len(PoseReason)
    reason[too_weak] = len(PoseReason) + 1
    if beyond.any():
        reason[beyond] = len(PoseReason) + 2 + np.argmax(shares[beyond], axis=-1)
    words = (
        *REASON_WORDS.values(),
        NOT_JOINED,
        TOO_WEAK,
        *(f"beyond the range of {limit.joint}" for limit in robot.limits),
    )
    return replace(
        workspace,
        values={key: np.where(joined, values, np.nan) for key, values in workspace.values.items()},
        reason=reason,
        assembly=np.where(joined, workspace.assembly, 0).astype(np.int8),
        reason_words=words,
    )


def check_reference(robot: ParallelRobot) -> None:
    """Refuse a robot whose reference is beyond the range of a joint."""
    beyond = positions_beyond_limits(robot.limits, robot.reference.q[None])
    if beyond:
        listed = "; ".join(f"{joint}: {excess}" for joint, excess in beyond.items())
        raise LimitsExceeded(f"{robot.name}: the reference is beyond ranges: {listed}", exceeded=beyond)


def check_window(robot: ParallelRobot, window: Window) -> None:
    """Refuse a window without a pose within one step of the reference."""
    if not _reference_distances(robot, window).min() <= 1.0:
        raise InvalidInput(
            f"window: it does not contain the reference {point(robot.reference.x)} of {robot.name}, to which "
            f"poses within limits have to be joined; take one that does, or leave the limits out"
        )


def _reference_distances(robot: ParallelRobot, window: Window) -> Array:
    """Compute distances (I, J) of poses from the reference, in longest cell edges."""
    offset = np.abs(window.points() - robot.reference.x) / robot.platform_scale
    return offset.max(axis=2) / (longest_cell_edge(robot, window) * (1.0 + SAME_PLACE))


def _join_to_reference(workspace: WorkspaceMap, within: BoolArray) -> BoolArray:
    """Mark poses (I, J) joined to the reference by neighbours within limits.

    Raises:
        LimitsExceeded: the nearest pose is more than one step away from the reference.
    """
    distance = np.where(within, _reference_distances(workspace.robot, workspace.window), np.inf)
    nearest = np.argmin(distance)
    if not distance.flat[nearest] <= 1.0:
        raise LimitsExceeded(
            f"{workspace.robot.name}: no pose of the map within one step of the reference is within all "
            f"limits; take a finer map, or leave the limits out",
            exceeded={},
        )
    labels: IntArray = ndimage.label(within)[0]
    return labels == labels.flat[nearest]
