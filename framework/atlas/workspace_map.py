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
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from framework.arrays import Array, ArrayLike, BoolArray, ReadOnlyArrays
from framework.atlas.locus_on_map import MapLocus, locus_on_map
from framework.atlas.quantities import Quantity, chosen, evaluate
from framework.atlas.sweep import WORDS, Reason, spread
from framework.atlas.window import MOST, Window, held_coordinates, map_axes
from framework.dynamics.loading import LOAD_WORDS, LoadReason
from framework.errors import InvalidInput, NoAnswer, OutOfReach
from framework.kinematics.inverse_kinematics import mode_signs, require_square, system_at
from framework.kinematics.parallel_robot import ParallelRobot, expect_robot
from framework.kinematics.tracking import assemble
from framework.parallel.tasks import completed

SIZE = 200  # poses along an edge
ROWS = 8  # of a band; poses between coarse ones at most
LONGEST = 0.15  # [robot lengths, rad] between neighbours that are reached one from the other
NEAREST = 9  # coarse poses near the reference that are tried as the first one
SURVEY = 33  # poses along an edge of what is looked at for the reach of a robot
REACH, REACH_OF_TURNS = 1.6, 1.6  # half an edge of it: in lengths of the robot, in rad
MARGIN = 1.0  # cells of that, beyond the outermost poses reached: the next pose is not
Chunk = Mapping[str, NDArray]


@dataclass(frozen=True, eq=False)
class WorkspaceMap(ReadOnlyArrays):
    """Values over a window on the working mode of the reference; NaN where a pose is not reached."""

    robot: ParallelRobot
    window: Window
    quantities: tuple[Quantity, ...]
    values: Mapping[str, Array]  # (I, J) by the quantity's key
    q: Array  # (I, J, nq)
    reason: NDArray[np.uint8]  # (I, J) why a pose is not reached, `sweep.Reason`
    working_mode: int  # sign at the reference
    assembly: NDArray[np.int8]  # (I, J) sign of the assembly mode, 0 where not reached
    load: (
        NDArray[np.uint8] | None
    )  # (I, J) `LoadReason` of poses that are reached, with quantities under load
    seconds: float

    @property
    def reached(self) -> BoolArray:
        return self.reason == Reason.REACHED

    @cached_property
    def locus(self) -> MapLocus:
        """The singular locus over the window on this branch, traced when it is first asked for."""
        return locus_on_map(self.robot, self.window, self.q, self.reason, self.values["g"])

    @property
    def counts(self) -> dict[str, int]:
        """How many poses are reached, and why others are not, in words."""
        return {WORDS[kind]: int(np.sum(self.reason == kind)) for kind in Reason}

    @property
    def load_counts(self) -> dict[str, int]:
        """How many of the poses reached carry the load, and why others do not; empty without a load."""
        if self.load is None:
            return {}
        load = self.load[self.reached]
        return {LOAD_WORDS[kind]: int(np.sum(load == kind)) for kind in LoadReason}


class Keeper(Protocol):
    """A place for finished bands."""

    def found(self) -> Mapping[str, Chunk]:
        """What is there, by name."""
        ...

    def keep(self, name: str, arrays: Chunk) -> None:
        """Put a finished band there."""
        ...


class Band(NamedTuple):
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
    keeper: Keeper | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> WorkspaceMap:
    """Quantities over a window, at the poses that continuation from the reference reaches.

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
    wanted = chosen(robot, quantities, wrench)
    window = surveyed(robot) if window is None else window
    x, bands = window.points(), _bands(robot, window)
    found = {} if keeper is None else dict(keeper.found())
    chunks = {band.name: found[band.name] for band in bands if _fits(found.get(band.name), band, wanted)}
    done = sum(band.stop - band.first for band in bands if band.name in chunks)
    progress(done * window.shape[1])
    task = partial(filled_band, robot, window, wanted)
    for band, chunk in completed(task, [band for band in bands if band.name not in chunks], executor):
        chunks[band.name] = chunk
        if keeper is not None:
            keeper.keep(band.name, chunk)
        done += band.stop - band.first
        progress(done * window.shape[1])
    whole = {key: np.concatenate([chunks[band.name][key] for band in bands]) for key in chunks[bands[0].name]}
    _join_bands(robot, x, wanted, whole)
    reference = system_at(robot, robot.reference.q[None], robot.reference.x[None])
    return WorkspaceMap(
        robot=robot,
        window=window,
        quantities=wanted,
        values={quantity.key: whole[quantity.key] for quantity in wanted},
        q=whole["q"],
        reason=whole["reason"],
        working_mode=int(mode_signs(robot, reference)[0][0]),
        assembly=whole["assembly"],
        load=whole.get("load"),
        seconds=time.perf_counter() - started,
    )


def filled_band(robot: ParallelRobot, window: Window, quantities: tuple[Quantity, ...], band: Band) -> Chunk:
    """The poses and quantities of one band."""
    x = window.points()[band.first : band.first + len(band.q)]
    q, reason = band.q.copy(), band.reason.copy()
    strides = np.array([1, 2, 4])
    spread(robot, x, q, reason, strides[strides < max(_stride(robot, window), 2)][::-1])
    rows = band.stop - band.first
    return _evaluated(robot, x[:rows], quantities, q[:rows], reason[:rows])


def surveyed(
    robot: ParallelRobot,
    *,
    axes: tuple[str, str] | None = None,
    at: ArrayLike | None = None,
    size: int = SIZE,
) -> Window:
    """The window about all that the reference's working mode reaches, within bounds.

    Those are `REACH` robot lengths and `REACH_OF_TURNS` about the point `at`.

    Args:
        axes: two of the platform's axes, by default its first translations.
        at: platform point (n,), the reference by default; its other coordinates are held.
        size: poses along an edge.

    Raises:
        InvalidInput: see `map_axes`; or `at` has the wrong length.
        OutOfReach: no pose near the reference is reached.
    """
    over, held = map_axes(robot, axes), held_coordinates(robot, at)
    half = np.where(robot.translations, REACH * robot.length, REACH_OF_TURNS)[list(over)]
    about = held[list(over)]
    whole = Window(over, about - half, about + half, (SURVEY, SURVEY), held)
    reached = np.argwhere(_seeded(robot, whole, 1)[1] == Reason.REACHED)
    low, high = reached.min(axis=0) - MARGIN, reached.max(axis=0) + MARGIN
    lower, upper = whole.lower + low * whole.cell, whole.lower + high * whole.cell
    lower, upper = np.maximum(lower, whole.lower), np.minimum(upper, whole.upper)
    return Window(over, lower, upper, (size, size), held)


# ------------------------------------------------------------------ the parts


def _cell(robot: ParallelRobot, window: Window) -> float:
    """The longer edge of a cell [robot lengths, rad]."""
    lengths = np.where(robot.translations, robot.length, 1.0)[list(window.axes)]
    return float((window.cell / lengths).max())


def _stride(robot: ParallelRobot, window: Window) -> int:
    """Poses between coarse ones: a power of 2."""
    return int(2 ** np.clip(np.floor(np.log2(LONGEST / _cell(robot, window))), 0, np.log2(ROWS)))


def _seeded(robot: ParallelRobot, window: Window, stride: int) -> tuple[Array, NDArray[np.uint8]]:
    """Configurations (I, J, nq) and reasons at every `stride`-th pose, reached from the reference.

    Where cells are longer than a step may be, poses between them are looked at on the way.
    """
    finer = max(1, int(np.ceil(_cell(robot, window) / LONGEST)))
    shape = tuple((count - 1) * finer + 1 for count in window.shape)
    if max(shape) > MOST:
        wide = float((window.upper - window.lower).max()) / robot.length
        raise InvalidInput(
            f"window: {wide:.3g} robot lengths wide is more than poses can be followed over; lengths are in m"
        )
    x = replace(window, shape=(shape[0], shape[1])).points()
    q = np.full((*shape, robot.model.nq), np.nan)
    reason = np.full(shape, Reason.NO_NEIGHBOUR, dtype=np.uint8)
    away = np.abs(x[::stride, ::stride] - robot.reference.x).max(axis=2)
    order = np.dstack(np.unravel_index(np.argsort(away, axis=None, kind="stable"), away.shape))[0]
    refusal: NoAnswer | None = None
    for i, j in order[:NEAREST] * stride:
        try:
            q[i, j] = assemble(robot, x[i, j]).q
        except NoAnswer as error:
            refusal = refusal or error
            continue
        reason[i, j] = Reason.REACHED
        spread(robot, x, q, reason, np.array([stride]))
        return q[::finer, ::finer].copy(), reason[::finer, ::finer].copy()
    raise OutOfReach(
        f"{robot.name}: no pose of the map near the reference is reached from there: {refusal}",
        q=robot.reference.q,
        residual=robot.reference.residual,
        s=0.0,
        platform=robot.reference.x,
        joint="",
    ) from refusal


def _bands(robot: ParallelRobot, window: Window) -> list[Band]:
    q, reason = _seeded(robot, window, _stride(robot, window))
    reason[reason != Reason.REACHED] = Reason.NO_NEIGHBOUR  # a nearer neighbour may reach it
    bands = []
    for first in range(0, len(q), ROWS):
        stop = min(first + ROWS, len(q))
        rows = slice(first, min(stop + 1, len(q)))
        left = reason[rows].copy()
        left[stop - first :][left[stop - first :] == Reason.NO_NEIGHBOUR] = Reason.OPEN  # the next band's own
        bands.append(Band(first, stop, q[rows], left))
    return bands


def _fits(chunk: Chunk | None, band: Band, quantities: tuple[Quantity, ...]) -> bool:
    """Whether a kept chunk has what this band is to have."""
    keys = {"q", "reason", "assembly", *(quantity.key for quantity in quantities)}
    keys |= {"load"} if any(quantity.loaded for quantity in quantities) else set()
    shape = (band.stop - band.first, band.q.shape[1])
    return chunk is not None and set(chunk) == keys and all(a.shape[:2] == shape for a in chunk.values())


def _evaluated(
    robot: ParallelRobot, x: Array, quantities: tuple[Quantity, ...], q: Array, reason: NDArray[np.uint8]
) -> dict[str, NDArray]:
    reached = reason == Reason.REACHED
    chunk: dict[str, NDArray] = {"q": q, "reason": reason, "assembly": np.zeros(reason.shape, dtype=np.int8)}
    chunk |= {quantity.key: np.full(reason.shape, np.nan) for quantity in quantities}
    if any(quantity.loaded for quantity in quantities):
        chunk["load"] = np.zeros(reason.shape, dtype=np.uint8)
    if reached.any():
        system = system_at(robot, q[reached], x[reached])
        for key, values in evaluate(robot, quantities, q[reached], system).items():
            chunk[key][reached] = values
        chunk["assembly"][reached] = mode_signs(robot, system)[1]
    return chunk


def _join_bands(
    robot: ParallelRobot, x: Array, quantities: tuple[Quantity, ...], whole: dict[str, NDArray]
) -> None:
    """Reach what only a step across the border of two bands reaches, in place."""
    reason, before = whole["reason"], whole["reason"] == Reason.REACHED
    border = np.zeros_like(before)
    for first in range(ROWS, len(x), ROWS):
        border[first - 1] = ~before[first - 1] & before[first]
        border[first] = ~before[first] & before[first - 1]
    for wanted in (border, ~before):  # the others only if a border has let something in
        reason[wanted & (reason != Reason.REACHED)] = Reason.NO_NEIGHBOUR
        spread(robot, x, whole["q"], reason, np.array([1]))
        if not (reason[border] == Reason.REACHED).any():
            return
    i, j = np.nonzero((reason == Reason.REACHED) & ~before)
    chunk = _evaluated(robot, x[i, j][None], quantities, whole["q"][i, j][None], reason[i, j][None])
    for key, values in chunk.items():
        whole[key][i, j] = values[0]
