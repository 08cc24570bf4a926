"""A map of a robot over its workspace: quantities at the poses of one working mode.

Coarse poses are reached one from the other in this process, from the reference on. Then bands of rows, each
with the coarse poses in it, are filled independently of one another, here or through any
`concurrent.futures.Executor`. Bands depend on the window alone, so a map comes out the same to the last bit
whatever computes it, and finished ones may be kept for a map that is stopped. At last the poses that are
joined to the reference only across the border of two bands are reached from there.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from framework.arrays import Array, ArrayLike, BoolArray, ReadOnlyArrays
from framework.atlas.quantities import Quantity, chosen, quantity_values
from framework.atlas.survey import MAX_NEIGHBOUR_DISTANCE, longest_cell_edge, seeded, surveyed
from framework.atlas.sweep import REASON_WORDS, PoseReason, fill_grid, stepped
from framework.atlas.window import Window
from framework.kinematics.inverse_kinematics import require_square
from framework.kinematics.linearised_loops import linearised_at
from framework.kinematics.modes import mode_signs
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.locus.locus_on_map import MapLocus, MapPoses, locus_on_map
from framework.parallel.kept import ArrayField, fits
from framework.parallel.tasks import completed
from framework.statics.loading import LOAD_WORDS, LoadReason

BAND_ROWS = 8  # of a band; poses between coarse ones at most
Chunk = Mapping[str, NDArray]


@dataclass(frozen=True, eq=False)
class WorkspaceMap(ReadOnlyArrays):
    """Values over a window on the working mode of the reference; NaN where a pose is not reached."""

    robot: ParallelRobot
    window: Window
    quantities: tuple[Quantity, ...]
    values: Mapping[str, Array]  # (I, J) by the quantity's key
    q: Array  # (I, J, nq)
    reason: NDArray[np.uint8 | np.uint16]  # (I, J) why a pose is not reached, the place in `reason_words`
    working_mode: int  # sign at the reference
    assembly: NDArray[np.int8]  # (I, J) sign of the assembly mode, 0 where not reached
    load: (
        NDArray[np.uint8] | None
    )  # (I, J) `LoadReason` of poses that are reached, with quantities under load
    seconds: float
    reason_words: tuple[str, ...] = tuple(REASON_WORDS.values())  # first those of `sweep.PoseReason`

    @property
    def reached(self) -> BoolArray:
        return self.reason == PoseReason.REACHED

    @cached_property
    def locus(self) -> MapLocus:
        """The singular locus over the window on this branch, traced when it is first asked for."""
        window = self.window
        x, g = window.points(), self.values["g"]
        poses = MapPoses(window.axes, window.lower, window.upper, x, self.q, self.reached, g, self._lead)
        return locus_on_map(self.robot, poses)

    def _lead(self, q: Array, start: Array, end: Array) -> tuple[Array, BoolArray]:
        """Lead q (T, nq) from x = start (T, n) to x = end; return q there, and whether on the same branch."""
        ends = stepped(self.robot, q, start, end)
        return ends.q, ends.reason == PoseReason.REACHED

    @property
    def counts(self) -> dict[str, int]:
        """The number of poses reached, and of others by the reason in words."""
        return {word: int(np.sum(self.reason == code)) for code, word in enumerate(self.reason_words)}

    @property
    def keeps_limits(self) -> bool:
        """Whether only poses within the limits count as reached (`ranges.within_ranges`)."""
        return len(self.reason_words) > len(PoseReason)

    @property
    def beyond_ranges(self) -> BoolArray:
        """(I, J) reached, but not within the ranges of the joints (`ranges.within_ranges`)."""
        return np.asarray(self.reason >= len(PoseReason))

    @property
    def load_counts(self) -> dict[str, int]:
        """The number of poses reached that carry the load, and of others by reason; empty without a load."""
        if self.load is None:
            return {}
        load = self.load[self.reached]
        return {LOAD_WORDS[kind]: int(np.sum(load == kind)) for kind in LoadReason}


class ChunkStore(Protocol):
    """A place for finished bands."""

    def found(self) -> Mapping[str, Chunk]:
        """Return the finished bands, by name."""
        ...

    def keep(self, name: str, arrays: Chunk) -> None:
        """Put a finished band there."""
        ...


class RowBand(NamedTuple):
    """A task: rows of the window, with the coarse poses in them and on the row behind them."""

    first: int
    stop: int
    q: Array  # (rows + 1 or rows, J, nq) NaN but at coarse poses
    reason: NDArray[np.uint8]  # (rows + 1 or rows, J)

    @property
    def name(self) -> str:
        return f"{self.first:05d}-{self.stop:05d}"


def workspace_map(
    robot: ParallelRobot,
    window: Window | None = None,
    quantities: Sequence[str] | None = None,
    *,
    wrench: ArrayLike | None = None,
    executor: Executor | None = None,
    keeper: ChunkStore | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> WorkspaceMap:
    """Compute quantities over a window, at the poses that continuation from the reference reaches.

    Args:
        window: what is reached over the first two translations by default, see `surveyed`.
        quantities: keys of `QUANTITIES`; those that apply by default, and g always.
        wrench: (n,) of the world ON the platform [N, N m], beside the weight, for quantities under load.
        executor: where bands are computed; this process when None. It must be able to pickle the robot.
        keeper: where finished bands are kept, and taken from if they are there already.
        progress: called with the number of poses that are done.

    Raises:
        InvalidInput: x and the loops do not determine the robot's joints, or see `chosen`.
        OutOfReach: no pose near the reference is reached.
    """
    expect_robot(robot)
    require_square(robot)
    started = time.perf_counter()
    quantities_chosen = chosen(robot, quantities, wrench)
    window = surveyed(robot) if window is None else window
    grids = _filled(robot, window, quantities_chosen, executor, keeper, progress)
    _join_bands(robot, window.points(), quantities_chosen, grids)
    reference = linearised_at(robot, robot.reference.q[None], robot.reference.x[None])
    return WorkspaceMap(
        robot=robot,
        window=window,
        quantities=quantities_chosen,
        values={quantity.key: grids[quantity.key] for quantity in quantities_chosen},
        q=grids["q"],
        reason=grids["reason"],
        working_mode=int(mode_signs(robot, reference)[0][0]),
        assembly=grids["assembly"],
        load=grids.get("load"),
        seconds=time.perf_counter() - started,
    )


def _filled(
    robot: ParallelRobot,
    window: Window,
    quantities: tuple[Quantity, ...],
    executor: Executor | None,
    keeper: ChunkStore | None,
    progress: Callable[[int], None],
) -> dict[str, NDArray]:
    """Fill all bands of a window that are not kept already, and put them together."""
    bands = _bands(robot, window)
    kept = {} if keeper is None else dict(keeper.found())
    chunks = {
        band.name: kept[band.name]
        for band in bands
        if fits(kept.get(band.name), _band_arrays(band, quantities))
    }
    missing = [band for band in bands if band.name not in chunks]
    rows = bands[-1].stop - sum(band.stop - band.first for band in missing)
    progress(rows * window.shape[1])
    for band, chunk in completed(partial(filled_band, robot, window, quantities), missing, executor):
        chunks[band.name] = chunk
        if keeper is not None:
            keeper.keep(band.name, chunk)
        rows += band.stop - band.first
        progress(rows * window.shape[1])
    return {key: np.concatenate([chunks[band.name][key] for band in bands]) for key in chunks[bands[0].name]}


def filled_band(
    robot: ParallelRobot, window: Window, quantities: tuple[Quantity, ...], band: RowBand
) -> Chunk:
    """Compute the poses and quantities of one band."""
    x = window.points()[band.first : band.first + len(band.q)]
    q, reason = band.q.copy(), band.reason.copy()
    strides = np.array([1, 2, 4])
    fill_grid(robot, x, q, reason, strides[strides < max(_stride(robot, window), 2)][::-1])
    rows = band.stop - band.first
    return _evaluated(robot, x[:rows], quantities, q[:rows], reason[:rows])


# ------------------------------------------------------------------ the parts


def _stride(robot: ParallelRobot, window: Window) -> int:
    """Return the number of poses between coarse ones: a power of 2."""
    ratio = MAX_NEIGHBOUR_DISTANCE / longest_cell_edge(robot, window)
    return int(2 ** np.clip(np.floor(np.log2(ratio)), 0, np.log2(BAND_ROWS)))


def _bands(robot: ParallelRobot, window: Window) -> list[RowBand]:
    q, reason = seeded(robot, window, _stride(robot, window))
    reason[reason != PoseReason.REACHED] = PoseReason.NO_NEIGHBOUR  # a nearer neighbour may reach it
    bands = []
    for first in range(0, len(q), BAND_ROWS):
        stop = min(first + BAND_ROWS, len(q))
        rows = slice(first, min(stop + 1, len(q)))
        left = reason[rows].copy()
        left[stop - first :][left[stop - first :] == PoseReason.NO_NEIGHBOUR] = (
            PoseReason.OPEN
        )  # the next band's own
        bands.append(RowBand(first, stop, q[rows], left))
    return bands


def _band_arrays(band: RowBand, quantities: tuple[Quantity, ...]) -> dict[str, ArrayField]:
    """Return the arrays of a band that is filled."""
    shape = (band.stop - band.first, band.q.shape[1])
    arrays = {
        "q": ArrayField("f", (*shape, band.q.shape[2])),
        "reason": ArrayField("u", shape),
        "assembly": ArrayField("i", shape),
    }
    if any(quantity.loaded for quantity in quantities):
        arrays["load"] = ArrayField("u", shape)
    return arrays | {quantity.key: ArrayField("f", shape) for quantity in quantities}


def _evaluated(
    robot: ParallelRobot, x: Array, quantities: tuple[Quantity, ...], q: Array, reason: NDArray[np.uint8]
) -> dict[str, NDArray]:
    reached = reason == PoseReason.REACHED
    chunk: dict[str, NDArray] = {"q": q, "reason": reason, "assembly": np.zeros(reason.shape, dtype=np.int8)}
    chunk |= {quantity.key: np.full(reason.shape, np.nan) for quantity in quantities}
    if any(quantity.loaded for quantity in quantities):
        chunk["load"] = np.zeros(reason.shape, dtype=np.uint8)
    if reached.any():
        linearised = linearised_at(robot, q[reached], x[reached])
        for key, values in quantity_values(robot, quantities, q[reached], linearised).items():
            chunk[key][reached] = values
        chunk["assembly"][reached] = mode_signs(robot, linearised)[1]
    return chunk


def _join_bands(
    robot: ParallelRobot, x: Array, quantities: tuple[Quantity, ...], grids: dict[str, NDArray]
) -> None:
    """Reach what only a step across the border of two bands reaches, in place."""
    reason, before = grids["reason"], grids["reason"] == PoseReason.REACHED
    border = np.zeros_like(before)
    for first in range(BAND_ROWS, len(x), BAND_ROWS):
        border[first - 1] = ~before[first - 1] & before[first]
        border[first] = ~before[first] & before[first - 1]
    for unfilled in (border, ~before):  # the others only if a border has let something in
        reason[unfilled & (reason != PoseReason.REACHED)] = PoseReason.NO_NEIGHBOUR
        fill_grid(robot, x, grids["q"], reason, np.array([1]))
        if not (reason[border] == PoseReason.REACHED).any():
            return
    i, j = np.nonzero((reason == PoseReason.REACHED) & ~before)
    chunk = _evaluated(robot, x[i, j][None], quantities, grids["q"][i, j][None], reason[i, j][None])
    for key, values in chunk.items():
        grids[key][i, j] = values[0]
