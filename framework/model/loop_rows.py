"""The closures of a description as tables: scalar loop equations, and the directions that they keep alike.

Each equation is a weighted product of two vectors less a constant. Two frames have three such products
(`LoopRows`), and the other modules know these three: values and derivatives (`kinematics.closures`,
`frame_variations`) and bounds over boxes (`proofs.derivative_bounds`, `proofs.leg_paving`)
serve every weight and constant. So a kind of row is stated in `ROW_KINDS` alone, and kinds of closures that
have it in `description.locked_axes`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np

from framework.model.description import AXES, Closure
from framework.numerics.arrays import Array, BoolArray, IntArray, Names, ReadOnlyArrays, read_only

Product = Literal["u.d", "u.w", "d.d"]  # u, w: an axis of the first, of the second frame; d = p2 - p1


class RowKind(NamedTuple):
    """A kind of row that needs the closure's length: weight times a product less a constant.

    The value is to first order an error in m, or in rad if the product is u.w: tolerances are for these.
    """

    product: Product
    coefficients: Callable[[float], tuple[float, float]]  # weight and constant for a length [m]
    satisfy: Callable[[Array, float], Array]  # makes d (3,) on axes of the first frame obey; zeros stay
    axes: tuple[int, int] = (0, 0)  # 0..2, of u and w


ROW_KINDS = {
    "distance": RowKind(  # (d.d - length^2) / (2 length) = 0, to first order the error in length
        "d.d",
        coefficients=lambda length: (0.5 / length, 0.5 * length),
        satisfy=lambda offset, length: offset * (length / np.linalg.norm(offset)),
    ),
}


@dataclass(frozen=True, eq=False)
class LoopRows(ReadOnlyArrays):
    """The scalar loop equations of a robot as a table; m rows.

    With u the axis `first_axis` of the first frame, w the axis `second_axis` of the second and d = p2 - p1, a
    translation row is u.d = 0. A rotation row is u.w = 0 (Haug's dot-1 primitive): polynomial in the
    rotation matrices, so it has no angle that jumps, and to first order, with weight 1 or -1, it is the
    relative rotation about the locked axis. Rows with a length are in `ROW_KINDS`. A coupling row is
    q_a - ratio q_b - offset = 0 of two joints; as a loop equation of frames it is one that always holds.
    """

    first: IntArray  # (m,) frame, as index into Mechanism.frames
    second: IntArray  # (m,)
    square: BoolArray  # (m,) whether the product is d.d
    rotation: BoolArray  # (m,) whether it is u.w
    first_axis: IntArray  # (m,)
    second_axis: IntArray  # (m,)
    weight: Array  # (m,) zero of couplings
    constant: Array  # (m,)
    coupled: BoolArray  # (m,)
    columns: IntArray  # (m, 2) of coupling rows a and b, as indices into the velocity vector
    places: IntArray  # (m, 2) the same in the configuration vector
    ratio: Array  # (m,)
    offset: Array  # (m,) [rad or m]
    names: Names  # closure.axis

    @cached_property
    def translation(self) -> BoolArray:
        """Whether each row is u.d = 0, (m,)."""
        return read_only(~(self.rotation | self.square) & (self.weight == 1.0) & (self.constant == 0.0))

    @cached_property
    def only_translations(self) -> bool:
        """Whether all rows are u.d = 0."""
        return bool(self.translation.all())

    @cached_property
    def has_couplings(self) -> bool:
        """Whether any row is a coupling."""
        return bool(self.coupled.any())

    @cached_property
    def derivative_weight(self) -> Array:
        """Factors (m,) of `first vector . rate of the second` in each row's rate."""
        return read_only(self.weight * (1.0 + self.square))

    @cached_property
    def force_weight(self) -> Array:
        """Factors (m,) of the first vector in each row's force; 0 of rotations."""
        return read_only(np.where(self.rotation, 0.0, self.derivative_weight))

    @cached_property
    def couple_weight(self) -> Array:
        """Factors (m,) of `second vector x first vector` in each row's couple."""
        return read_only(np.where(self.rotation, self.weight, 0.0))

    @property
    def reach(self) -> Array:
        """Distances (m,) [m] that rows prescribe, along an axis or in all; 0 of rotations."""
        has_size = ~self.rotation & (self.weight != 0.0)  # of a coupling it is zero
        along = np.abs(np.divide(self.constant, self.weight, out=np.zeros(len(self.weight)), where=has_size))
        return np.where(self.square, np.sqrt(along), along)

    @cached_property
    def vectors(self) -> IntArray:
        """Indices (4, m) of u, w and both origins of each row.

        A frame has four vectors: its three axes, then its origin.
        """
        ends = np.array([self.first, self.second])
        axes = np.array([self.first_axis, self.second_axis])
        return read_only(np.concatenate([4 * ends + axes, 4 * ends + 3]))

    def joint_signs(self, carried: Array) -> Array:
        """Return how each joint moves the two bodies of each row, (m, nv).

        It is 1 if the joint carries the second body alone, -1 if the first alone, 0 if both or neither.
        `carried` (F, nv) is 1 where the joint carries the frame, else 0.
        """
        return carried[self.second] - carried[self.first]

    def coupling_residual(self, q: Array) -> Array:
        """Compute residuals (T, c) [rad, m] of the c couplings at configurations q (T, nq)."""
        rows = self.coupled
        joint, of = self.places[rows].T
        return q[:, joint] - self.ratio[rows] * q[:, of] - self.offset[rows]

    def coupling_jacobian(self, nv: int) -> Array:
        """Return derivatives (m, nv) of coupling rows along the velocities; 0 in other rows."""
        jacobian, rows = np.zeros((len(self.names), nv)), np.flatnonzero(self.coupled)
        joint, of = self.columns[rows].T
        jacobian[rows, joint] = 1.0
        jacobian[rows, of] = -self.ratio[rows]
        return jacobian

    def take(self, rows: IntArray) -> LoopRows:
        """Return the table of the rows at indices (k,)."""
        names = tuple(self.names[i] for i in rows)
        return LoopRows(**{name: getattr(self, name)[rows] for name in _COLUMNS}, names=names)


_COLUMNS = tuple(field.name for field in fields(LoopRows) if field.name != "names")


class CoupledJoints(NamedTuple):
    """A coupling q_a = ratio q_b + offset with the places of its joints a and b."""

    name: str
    columns: tuple[int, int]  # in the velocity vector
    places: tuple[int, int]  # in the configuration vector
    ratio: float
    offset: float
    turns: bool  # whether a is a hinge, so that the row is in radians


def loop_rows(
    closures: Sequence[Closure], frames: Sequence[str], couplings: Sequence[CoupledJoints] = ()
) -> LoopRows:
    """Make a row for each locked axis and each coupling, on a mechanism's frames."""
    table = [
        (f"{closure.name}.{axis}", *map(frames.index, closure.frames), *_row_entries(closure, axis))
        for closure in closures
        for axis in closure.axes
    ]
    for coupling in couplings:  # two axes of one frame stay perpendicular, its origin at rest
        entries = (0, 0, False, coupling.turns, 0, 1, 0.0, 0.0, True, *coupling[1:5])
        table.append((f"{coupling.name}.q", *entries))
    names, *columns = zip(*table, strict=True)
    return LoopRows(**dict(zip(_COLUMNS, map(np.array, columns), strict=True)), names=names)


def _row_entries(closure: Closure, axis: str) -> tuple[Any, ...]:
    """Return the entries of `LoopRows` for one axis of a closure, from `square` on."""
    if closure.length is not None and axis in ROW_KINDS:
        product, coefficients, _, axes = ROW_KINDS[axis]
        entries = (product == "d.d", product == "u.w", *axes, *coefficients(closure.length))
    else:
        k, rotation = "xyz".index(axis[-1]), axis.startswith("r")
        locked = {AXES.index(name) - 3 for name in closure.axes if name in ("rx", "ry", "rz")}
        pair = _perpendicular_pair(k, locked) if rotation else (k, 0, 1.0)
        entries = (False, rotation, *pair, 0.0)
    return *entries, False, (0, 0), (0, 0), 0.0, 0.0


def _perpendicular_pair(locked_axis: int, locked: set[int]) -> tuple[int, int, float]:
    """Return the axes of both frames whose product locks a rotation, and its sign.

    With i, j, k cyclic, R = 1 + [phi]x gives x_j . (R x_k) = -phi_i and x_k . (R x_j) = +phi_i. Here i is
    `locked_axis`, and `locked` are all locked rotations (0..2).
    """
    following, preceding = (locked_axis + 1) % 3, (locked_axis + 2) % 3
    free = {0, 1, 2} - locked
    if free == {following}:  # the free axis is carried by the second frame
        return preceding, following, 1.0
    if free == {preceding} or not free:
        return following, preceding, -1.0
    # two free axes: a universal joint, its first axis on the first frame, its second on the second
    first, second = min(following, preceding), max(following, preceding)
    return first, second, -1.0 if first == following else 1.0


class LockedDirections(NamedTuple):
    """Pairs of parallel axes of two frames that closures prescribe; d pairs."""

    first: IntArray  # (d,) frame, as index into Mechanism.frames
    second: IntArray  # (d,)
    axis: IntArray  # (d,) 0..2, of both frames
    closures: Names  # (d,) names

    def take(self, which: IntArray) -> LockedDirections:
        """Return the pairs at indices (k,)."""
        names = tuple(self.closures[i] for i in which)
        return LockedDirections(self.first[which], self.second[which], self.axis[which], names)


def locked_directions(closures: Sequence[Closure], frames: Sequence[str]) -> LockedDirections:
    """Return the parallel axes of closures: one if two rotations are locked, two if all."""
    table, names = [], []
    for closure in closures:
        turns = [axis for axis in closure.axes if axis in ("rx", "ry", "rz")]
        free = [k for k in range(3) if f"r{'xyz'[k]}" not in turns]
        for k in {3: (0, 1), 2: free}.get(len(turns), ()):
            table.append((*map(frames.index, closure.frames), k))
            names.append(closure.name)
    first, second, axis = map(read_only, np.array(table, dtype=np.intp).reshape(-1, 3).T)
    return LockedDirections(first, second, axis, tuple(names))
