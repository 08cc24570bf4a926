"""A map of a robot over its workspace: quantities at the poses of one working mode.

Coarse poses are reached first, from the reference and from one another, in this process. Then bands of rows
are filled from their coarse poses. Bands are independent of one another, and this process or any
`concurrent.futures.Executor` may fill them. Bands depend only on the window, so a map is the same to the last
bit wherever it is computed, and finished bands of an interrupted map can be stored. A last step reaches the
poses that are joined to the reference only across the border between two bands.

`restrict_to_ranges` removes poses beyond the limits of joints and motors: they lose their values, and the
limit becomes their reason.
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

from framework.atlas.quantities import (
    Quantity,
    choose_quantities,
    has_loaded,
    has_torque_limits,
    quantity_values,
)
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
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import positions_beyond_limits, shares_beyond_limits
from framework.lazy_names import notebook_picture
from framework.numerics.arrays import Array, ArrayLike, BoolArray, IntArray, ReadOnlyArrays
from framework.numerics.kept import ArrayField, KeptChunks, complete_chunks
from framework.singularity.locus_on_map import MapLocus, MapPoses, locus_on_map
from framework.tolerances import SAME_PLACE

# [rad, robot lengths] sizes of the random joint offsets from which searches for other working modes start;
# the first search starts at the nearest reached configuration itself
OFFSETS = (0.0, 1.0, 1.0, 1.0)
WHOLE_TURN = 2 * np.pi * (1.0 - SAME_PLACE)  # [rad] beyond this width of a window nothing new is reached
MAX_COARSE_STRIDE = 8  # [rows or columns] between coarse poses, a power of 2
BAND_ROWS = 2 * MAX_COARSE_STRIDE  # rows of a band, which begins with a row of coarse poses


@dataclass(frozen=True, eq=False)
class WorkspaceMap(ReadOnlyArrays):
    """Quantities over a window in the reference's working mode; NaN where not reached.

    Along the stroke of a mechanism of one freedom J is 1.
    """

    robot: ParallelRobot
    window: Window
    quantities: tuple[Quantity, ...]
    values: Mapping[str, Array]  # (I, J) by the quantity's key
    q: Array  # (I, J, nq)
    reason: NDArray[np.uint8 | np.uint16]  # (I, J) why a pose is not reached: index into `reason_words`
    working_mode: int  # sign of the mode at the reference
    assembly: NDArray[np.int8]  # (I, J) sign of the assembly mode, 0 where not reached
    load: ReasonArray | None  # (I, J) `LoadReason` of reached poses; None without loaded quantities
    seconds: float
    reason_words: tuple[str, ...] = tuple(REASON_WORDS.values())  # those of `sweep.PoseReason` first

    _repr_mimebundle_ = notebook_picture("map_picture")

    @property
    def reached(self) -> BoolArray:
        """Mask (I, J) of the poses reached."""
        return self.reason == PoseReason.REACHED

    @cached_property
    def locus(self) -> MapLocus:
        """Singular locus over the window in this working mode, traced on first use."""
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
            continue_pose=self._step_configurations,
        )
        return locus_on_map(self.robot, poses)

    @property
    def locus_sentence(self) -> str:
        """The locus in words; of a window that cuts off what is reached they say so."""
        return self.locus.sentence + ("; more may lie beyond the edges" if self.open_edges else "")

    def _step_configurations(self, q: Array, start: Array, end: Array) -> tuple[Array, BoolArray]:
        """Continue q (T, nq) from `start` to `end` (T, n); return q, mask (T,) of accepted steps."""
        ends = step_poses(self.robot, q, start, end)
        return ends.q, ends.reason == PoseReason.REACHED

    @property
    def counts(self) -> dict[str, int]:
        """Numbers of poses by reason in words; the first is `reached`."""
        return {word: int(np.sum(self.reason == code)) for code, word in enumerate(self.reason_words)}

    @property
    def open_edges(self) -> tuple[str, ...]:
        """Edges of the window with reached poses, such as `least x`.

        Beyond these edges more poses may be reachable.
        """
        edges: dict[str, BoolArray] = {}  # reached poses of each edge
        widths = self.window.upper - self.window.lower
        for k, width, rows in zip(self.window.axes, widths, (self.reached, self.reached.T), strict=False):
            if self.robot.translations[k] or width < WHOLE_TURN:
                name = self.robot.axis_names[k]
                edges |= {f"least {name}": rows[0], f"largest {name}": rows[-1]}
        return tuple(edge for edge, poses in edges.items() if poses.any())

    @property
    def keeps_limits(self) -> bool:
        """Whether only poses within the limits of joints and motors count as reached."""
        return len(self.reason_words) > len(PoseReason)

    @property
    def beyond_ranges(self) -> BoolArray:
        """Mask (I, J) of poses that `restrict_to_ranges` removed; limits have the last reason codes."""
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

    All bands but the last also contain the first row of the next band, as a source of steps.
    """

    first: int
    stop: int
    q: Array  # (rows + 1, J, nq), of the last band (rows, J, nq); NaN except at coarse poses
    reason: ReasonArray  # (rows + 1, J), of the last band (rows, J)

    @property
    def name(self) -> str:
        """Name under which the band is stored."""
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
        window: by default the smallest one with all reached poses, over the first two translations.
        quantities: keys of `QUANTITIES`; by default conditioning, torque if the platform translates, and
            stiffness and frequency if the robot has springs. g is always computed.
        wrench: external wrench (n,) ON the platform [N, N m], in addition to the weight, for quantities that
            depend on it.
        executor: computes the bands, and must be able to pickle the robot; None computes them in this
            process.
        keeper: stores finished bands; bands stored before are not computed again.
        progress: called with the number of finished poses.

    Raises:
        InvalidInput: the platform does not determine the robot's joints; or the robot does not have a
            quantity, or the wrench affects none of them.
        OutOfReach: no pose near the reference is reached.
    """
    require_square(robot)
    started = time.perf_counter()
    choice = choose_quantities(robot, quantities, wrench)
    window = survey_window(robot) if window is None else window

    # fill the bands; each pose belongs to one of them
    bands = {band.name: band for band in _make_bands(robot, window)}
    width = window.shape[1]  # poses of a row
    grids = complete_chunks(
        partial(fill_band, robot, window, choice),
        bands,
        partial(_band_arrays, quantities=choice),
        executor=executor,
        keeper=keeper,
        progress=lambda names: progress(width * sum(bands[name].stop - bands[name].first for name in names)),
    )

    # reach poses across the borders of bands, and find out why others are not reached
    x = window.points()  # (I, J, n)
    _join_bands(robot, x, choice, grids)
    _mark_out_of_reach(robot, x, grids["q"], grids["reason"], _coarse_stride(robot, window))
    working_signs, _assembly_signs = mode_signs(robot, linearised_at_reference(robot))  # (1,) each
    return WorkspaceMap(
        robot=robot,
        window=window,
        quantities=choice,
        values={quantity.key: grids[quantity.key] for quantity in choice},
        q=grids["q"],
        reason=grids["reason"],
        working_mode=int(working_signs[0]),
        assembly=grids["assembly"],
        load=grids.get("load"),
        seconds=time.perf_counter() - started,
    )


def fill_band(
    robot: ParallelRobot, window: Window, quantities: tuple[Quantity, ...], band: RowBand
) -> dict[str, NDArray]:
    """Compute the poses and quantities of one band of a window; return its arrays by name.

    Poses are filled from neighbours 4, then 2, then 1 rows or columns away. Strides that are not below that
    of the coarse poses are left out, except 1.
    """
    x = window.points()[band.first : band.first + len(band.q)]  # (rows, J, n) of the band
    q = band.q.copy()
    reason = band.reason.copy()
    coarse_stride = _coarse_stride(robot, window)  # of the poses that are filled already
    strides = [stride for stride in (4, 2, 1) if stride < max(coarse_stride, 2)]
    fill_grid(robot, x, q, reason, strides)
    rows = band.stop - band.first  # without the first row of the next band
    return _evaluate_poses(robot, quantities, q[:rows], reason[:rows])


# ------------------------------------------------------------------ the parts


def _coarse_stride(robot: ParallelRobot, window: Window) -> int:
    """Return the stride of coarse poses: a power of 2, at most MAX_COARSE_STRIDE.

    Coarse poses are at most MAX_NEIGHBOUR_DISTANCE apart, unless the window's own poses are farther apart.
    """
    largest_stride = MAX_NEIGHBOUR_DISTANCE / longest_cell_edge(robot, window)  # not rounded
    exponent = np.clip(np.floor(np.log2(largest_stride)), 0, np.log2(MAX_COARSE_STRIDE))
    return int(2**exponent)


def _make_bands(robot: ParallelRobot, window: Window) -> list[RowBand]:
    """Return the bands of a window with their coarse poses."""
    q, reason = seed_poses(robot, window, _coarse_stride(robot, window))  # (I, J, nq), (I, J)
    # NO_NEIGHBOUR marks the poses to try, also coarse ones that failed: nearer neighbours may lead to them
    reason[reason != PoseReason.REACHED] = PoseReason.NO_NEIGHBOUR
    bands = []
    for first in range(0, len(q), BAND_ROWS):
        stop = min(first + BAND_ROWS, len(q))
        rows = slice(first, stop + 1)  # with the first row of the next band, if any
        band_reason = reason[rows].copy()
        next_row = band_reason[BAND_ROWS:]  # a view
        # unreached poses of the next band must not be tried here, so they get another reason
        next_row[next_row == PoseReason.NO_NEIGHBOUR] = PoseReason.OPEN
        bands.append(RowBand(first, stop, q[rows], band_reason))
    return bands


def _empty_values(quantities: tuple[Quantity, ...]) -> dict[str, np.generic]:
    """Return the values of a pose that is not reached, by the name of the array, with their types."""
    values: dict[str, np.generic] = {"assembly": np.int8(0)}
    values |= {quantity.key: np.float64(np.nan) for quantity in quantities}
    if has_loaded(quantities):
        values["load"] = np.uint8(0)
    return values


def _band_arrays(band: RowBand, quantities: tuple[Quantity, ...]) -> dict[str, ArrayField]:
    """Return the types and shapes of a filled band's arrays, by name."""
    shape = (band.stop - band.first, band.q.shape[1])
    fields = {key: ArrayField(value.dtype.kind, shape) for key, value in _empty_values(quantities).items()}
    return fields | {"reason": ArrayField("u", shape), "q": ArrayField("f", (*shape, band.q.shape[2]))}


def _evaluate_poses(
    robot: ParallelRobot, quantities: tuple[Quantity, ...], q: Array, reason: ReasonArray
) -> dict[str, NDArray]:
    """Compute quantities and assembly modes at poses q (I, J, nq); return all arrays by name.

    Only poses with the `reason` (I, J) REACHED have values: the others are NaN, or 0 in arrays of integers.
    """
    reached = reason == PoseReason.REACHED
    arrays: dict[str, NDArray] = {"q": q, "reason": reason}
    arrays |= {key: np.full(reason.shape, value) for key, value in _empty_values(quantities).items()}
    if reached.any():
        linearised = linearised_at(robot, q[reached])
        for key, values in quantity_values(robot, quantities, q[reached], linearised).items():
            arrays[key][reached] = values
        arrays["assembly"][reached] = np.sign(arrays["g"][reached])  # g has the sign of det P
    return arrays


def _join_bands(
    robot: ParallelRobot, x: Array, quantities: tuple[Quantity, ...], grids: dict[str, NDArray]
) -> None:
    """Reach poses that only steps across a border between bands can reach, in place.

    First the unfilled poses with a filled neighbour across a border are tried. If any of them is reached, all
    unfilled poses are tried, because they may be reached from it.

    Args:
        x: platform coordinates (I, J, n).
        quantities: of the map, whose values are computed at the new poses.
        grids: arrays (I, J, ..) of the whole map: q, reason, assembly, and the values by key.
    """
    reason = grids["reason"]
    was_filled = reason == PoseReason.REACHED
    border = np.zeros_like(was_filled)
    first = np.arange(BAND_ROWS, len(x), BAND_ROWS)  # first rows of all bands but the first one
    # on either side of a border: unfilled poses whose neighbour on the other side is filled
    border[first - 1] = ~was_filled[first - 1] & was_filled[first]
    border[first] = ~was_filled[first] & was_filled[first - 1]

    # NO_NEIGHBOUR marks the poses that are tried
    for wanted in (border, ~was_filled):  # poses at the border first, then all poses
        reason[wanted & (reason != PoseReason.REACHED)] = PoseReason.NO_NEIGHBOUR
        fill_grid(robot, x, grids["q"], reason, [1])
        if not (reason[border] == PoseReason.REACHED).any():
            return

    # evaluate the new poses as a map of one row: arrays (1, new, ..)
    is_new = (reason == PoseReason.REACHED) & ~was_filled
    chunk = _evaluate_poses(robot, quantities, grids["q"][is_new][None], reason[is_new][None])
    for key, values in chunk.items():
        grids[key][is_new] = values[0]


def _mark_out_of_reach(robot: ParallelRobot, x: Array, q: Array, reason: ReasonArray, stride: int) -> None:
    """Set the reason (I, J) of poses in other working modes or out of reach, in place.

    At every `stride`-th unreached pose Newton's method searches for a configuration of any working mode. It
    starts from the nearest reached configuration and from random configurations about it. The configurations
    that it finds are continued to neighbouring poses. The remaining poses are out of reach.

    Args:
        x: platform coordinates (I, J, n).
        q: configurations (I, J, nq); NaN at poses that are not reached.
        reason: (I, J) `PoseReason` of each pose.
        stride: distance between the poses of the search [rows or columns].
    """
    unjoined = (reason == PoseReason.NO_NEIGHBOUR) | (reason == PoseReason.OPEN)
    coarse = np.zeros_like(unjoined)  # poses of the search
    coarse[::stride, ::stride] = unjoined[::stride, ::stride]
    # the reached pose that is nearest to one of the search lies beside a pose that is not reached
    reached = np.pad(reason == PoseReason.REACHED, 1)
    inner = reached[:-2, 1:-1] & reached[2:, 1:-1] & reached[1:-1, :-2] & reached[1:-1, 2:]
    border = np.argwhere(reached[1:-1, 1:-1] & ~inner)  # (b, 2)
    nearest = np.zeros((*coarse.shape, 2), dtype=np.intp)  # row and column
    for pose in np.argwhere(coarse):
        nearest[tuple(pose)] = border[np.argmin(((border - pose) ** 2).sum(axis=1))]
    other_q = np.full_like(q, np.nan)  # configurations of any working mode
    random = np.random.default_rng(0)
    for offset_size in OFFSETS:
        is_searched = coarse & np.isnan(other_q[..., 0])  # nothing found so far
        start = q[tuple(nearest[is_searched].T)]
        offset = offset_size * random.standard_normal((len(start), robot.model.nv)) * robot.column_scale
        end = close_each(robot, x[is_searched], integrate(robot, start, offset))
        other_q[is_searched] = np.where(end.closed[:, None], end.q, np.nan)

    # continue the configurations that were found; OPEN marks poses that are not tried
    other_reason = np.where(unjoined, PoseReason.NO_NEIGHBOUR, PoseReason.OPEN).astype(np.uint8)
    other_reason[np.isfinite(other_q[..., 0])] = PoseReason.REACHED
    fill_grid(robot, x, other_q, other_reason, [1])

    # poses to which no neighbour led, but at which a configuration was found, are not out of reach
    is_other = other_reason == PoseReason.REACHED
    reason[(reason == PoseReason.OPEN) & is_other] = PoseReason.OTHER_MODE
    reason[unjoined & ~is_other] = PoseReason.OPEN


NOT_JOINED = "within all limits, not joined to the reference within them"
TOO_WEAK = "beyond the torque limits at rest"


def restrict_to_ranges(workspace: WorkspaceMap) -> WorkspaceMap:
    """Remove the values of poses that no steps within all limits join to the reference.

    The limits are the ranges of joints and the torque limits of motors, if any. The torque at rest is the
    quantity `holding`. For a pose beyond several ranges the reason is the joint farthest beyond its range,
    relative to the range. Codes of `reason` are indices into `reason_words`: those of `PoseReason`, then
    NOT_JOINED, TOO_WEAK, and one for each joint with a range.

    Raises:
        InvalidInput: motors have torque limits and the map lacks `holding`; or the window contains no pose
            within one step of the reference.
        LimitsExceeded: the reference itself is beyond a range, or no pose next to it is within all limits.
    """
    robot = workspace.robot
    check_reference(robot)
    check_window(robot, workspace.window)
    if has_torque_limits(robot) and "holding" not in workspace.values:
        raise InvalidInput(
            f"quantities: {robot.name} has torque limits, which need the quantity holding; add it"
        )

    # sort the reached poses: beyond a range, too weak, or within all limits
    shares = shares_beyond_limits(robot.limits, workspace.q)  # (I, J, limits) of the ranges; > 0 if beyond
    in_range = workspace.reached & (shares <= 0.0).all(axis=-1)
    beyond = workspace.reached & ~in_range
    # without torque limits no pose is too weak, and the map may lack `holding`
    too_weak = in_range & (workspace.values.get("holding", np.zeros(1)) > 1.0)
    within = in_range & ~too_weak
    joined = _join_to_reference(workspace, within)

    # give the removed poses their reasons
    words = (*REASON_WORDS.values(), NOT_JOINED, TOO_WEAK)
    reason = workspace.reason.astype(np.uint16)
    reason[within & ~joined] = words.index(NOT_JOINED)
    reason[too_weak] = words.index(TOO_WEAK)
    if beyond.any():
        reason[beyond] = len(words) + np.argmax(shares[beyond], axis=-1)
    return replace(
        workspace,
        values={key: np.where(joined, values, np.nan) for key, values in workspace.values.items()},
        reason=reason,
        assembly=np.where(joined, workspace.assembly, 0).astype(np.int8),
        reason_words=(*words, *(f"beyond the range of {limit.joint}" for limit in robot.limits)),
    )


def check_reference(robot: ParallelRobot) -> None:
    """Raise LimitsExceeded if the reference is beyond the range of a joint."""
    beyond = positions_beyond_limits(robot.limits, robot.reference.q[None])
    if beyond:
        listed = "; ".join(f"{joint}: {excess}" for joint, excess in beyond.items())
        raise LimitsExceeded(f"the reference is beyond ranges: {listed}", name=robot.name, exceeded=beyond)


def check_window(robot: ParallelRobot, window: Window) -> None:
    """Raise InvalidInput if a window has no pose within one step of the reference.

    One step is the longest edge of a cell.
    """
    # distances in steps; the form `not ... <= 1.0` also refuses an infinite window, whose distances are NaN
    if not _reference_distances(robot, window).min() <= 1.0:
        raise InvalidInput(
            f"window: it does not contain the reference {point(robot.reference.x)} of {robot.name}, to which "
            f"poses within limits have to be joined; take one that does, or leave the limits out"
        )


def _reference_distances(robot: ParallelRobot, window: Window) -> Array:
    """Compute distances (I, J) of poses from the reference in steps: longest edges of a cell.

    The distance is the largest offset of a coordinate [robot lengths, rad]. The edge is lengthened by a
    relative SAME_PLACE, so that a pose exactly one edge away is no farther than 1 in spite of rounding.
    """
    # (I, J, n), made dimensionless by the units (n,) of the coordinates
    offset = np.abs(window.points() - robot.reference.x) / robot.platform_scale
    return offset.max(axis=2) / (longest_cell_edge(robot, window) * (1.0 + SAME_PLACE))


def _join_to_reference(workspace: WorkspaceMap, within: BoolArray) -> BoolArray:
    """Return a mask (I, J) of the poses `within` limits that are joined to the reference.

    A pose is joined if neighbouring poses within limits connect it with the pose nearest to the reference.

    Raises:
        LimitsExceeded: the nearest of these poses is more than one step away from the reference.
    """
    steps = _reference_distances(workspace.robot, workspace.window)
    distance = np.where(within, steps, np.inf)
    nearest = np.argmin(distance)
    if distance.flat[nearest] > 1.0:  # farther than one step, the longest cell edge
        raise LimitsExceeded(
            "no pose of the map within one step of the reference is within all "
            "limits; take a finer map, or leave the limits out",
            name=workspace.robot.name,
            exceeded={},
        )
    from scipy.ndimage import label  # slow to import

    labels: IntArray = label(within)[0]  # (I, J) number of the connected region
    return labels == labels.flat[nearest]
