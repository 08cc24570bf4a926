"""The closures of a description as tables: scalar loop equations, and the axes that closures keep parallel.

Each equation is a weighted product of two vectors less a constant. The vectors come from two frames, and
there are three kinds of products (`LoopRows`). The modules that compute values and derivatives
(`kinematics.closures`), bounds over boxes (`proofs.derivative_bounds`) and algebraic terms
(`proofs.equation_terms`) implement the three products for every weight and constant. A new kind of row
therefore needs an entry in `ROW_KINDS` and nothing else; `description.locked_axes` says which closures have
it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from framework.model.description import AXES, Closure
from framework.numerics.arrays import Array, BoolArray, IntArray, Names, ReadOnlyArrays, read_only

Product = Literal["u.d", "u.w", "d.d"]  # u, w: axis of the first, of the second frame; d = p2 - p1


class RowKind(NamedTuple):
    """A kind of row that needs the closure's length: weight times a product less a constant.

    To first order the value must be an error in m, or in rad if the product is u.w, since tolerances are in
    these units.
    """

    product: Product
    coefficients: Callable[[float], tuple[float, float]]  # weight and constant for a length [m]
    satisfy: Callable[[Array, float], Array]  # d (3,) in the first frame's axes -> d that fits a length [m]
    axes: tuple[int, int] = (0, 0)  # 0..2, of u and w


ROW_KINDS = {
    "distance": RowKind(  # (d.d - length^2) / (2 length) = 0, to first order the error in length
        "d.d",
        coefficients=lambda length: (0.5 / length, 0.5 * length),
        satisfy=lambda offset, length: offset * (length / np.linalg.norm(offset)),
    )
}


@dataclass(frozen=True, eq=False)
class LoopRows(ReadOnlyArrays):
    """The scalar loop equations of a robot as a table with m rows.

    Let u be the axis `first_axis` of the first frame, w the axis `second_axis` of the second, and
    d = p2 - p1. A translation row is u.d = 0. A rotation row is u.w = 0 (Haug's dot-1 primitive). It is
    polynomial in the rotation matrices, so it has no angle that jumps. To first order, with weight 1 or -1,
    it is the relative rotation about the locked axis. Rows with a length are in `ROW_KINDS`. A coupling row
    is a polynomial of M terms in the coordinates z of K joints, the sum of coefficient times the product of
    z^exponent; its frames, weight and constant are those of an equation that always holds.
    """

    names: Names  # closure.axis
    first: IntArray  # (m,) frame, as index into Mechanism.frames
    second: IntArray  # (m,)
    square: BoolArray  # (m,) whether the product is d.d
    rotation: BoolArray  # (m,) whether the product is u.w
    first_axis: IntArray  # (m,) 0..2
    second_axis: IntArray  # (m,) 0..2
    weight: Array  # (m,) zero in coupling rows
    constant: Array  # (m,)
    coupled: BoolArray  # (m,) whether the row is a coupling
    columns: IntArray  # (m, K) joints of coupling rows, as indices into the velocity vector
    places: IntArray  # (m, K) joints of coupling rows, as indices into the configuration vector
    coefficients: Array  # (m, M) of coupling rows [rad or m over the units of the product]; 0 fills up
    exponents: IntArray  # (m, M, K)

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
        """Factors (m,) of `first vector . rate of the second vector` in the rate of each row."""
        # the rate of d.d is 2 d . (rate of d): `square`, 0 or 1, adds the factor 2
        return read_only(self.weight * (1.0 + self.square))

    @cached_property
    def force_weight(self) -> Array:
        """Factors (m,) of the first vector in the force of each row; 0 for rotations."""
        return read_only(np.where(self.rotation, 0.0, self.derivative_weight))

    @cached_property
    def couple_weight(self) -> Array:
        """Factors (m,) of `second vector x first vector` in the couple of each row; 0 but for rotations."""
        return read_only(np.where(self.rotation, self.weight, 0.0))

    @property
    def reach(self) -> Array:
        """Distances (m,) [m] that rows prescribe between two points; 0 for rotations and couplings."""
        prescribes = ~self.rotation & (self.weight != 0.0)  # the weight of a coupling row is zero
        no_reach = np.zeros_like(self.weight)
        reach = np.abs(np.divide(self.constant, self.weight, out=no_reach, where=prescribes))
        return np.where(self.square, np.sqrt(reach), reach)  # the product d.d is a distance squared

    @cached_property
    def vectors(self) -> IntArray:
        """Indices (4, m) of u, w and both origins in a list of vectors.

        The list has four vectors of each frame: its three axes, then its origin.
        """
        ends = np.array([self.first, self.second])
        axes = np.array([self.first_axis, self.second_axis])
        return read_only(np.concatenate([4 * ends + axes, 4 * ends + 3]))

    def joint_signs(self, carried: Array) -> Array:
        """Return which of a row's two bodies each joint carries, as signs (m, nv).

        The sign is 1 if the joint carries only the second body, -1 if only the first, 0 if both or neither.

        Args:
            carried: (F, nv), 1 where the joint of a velocity coordinate carries a frame, else 0.
        """
        return carried[self.second] - carried[self.first]

    def append(self, other: LoopRows) -> LoopRows:
        """Return these rows and then the `other` ones."""
        arrays = {name: np.concatenate([vars(self)[name], vars(other)[name]]) for name in _ARRAYS}
        return LoopRows(self.names + other.names, **arrays)

    def take(self, rows: IntArray) -> LoopRows:
        """Return the table of the `rows` at indices (k,)."""
        arrays = {name: vars(self)[name][rows] for name in _ARRAYS}
        return LoopRows(tuple(self.names[i] for i in rows), **arrays)


_ARRAYS = [field.name for field in fields(LoopRows)][1:]  # of LoopRows, each with an item a row


class CoupledJoints(NamedTuple):
    """The polynomial of a coupling that vanishes, with the indices of its joints."""

    name: str
    columns: tuple[int, ...]  # of the joints, in the velocity vector
    places: tuple[int, ...]  # in the configuration vector
    terms: Mapping[tuple[int, ...], float]  # coefficient by the exponents of all joints
    turns: bool  # whether the row is in radians


def loop_rows(
    closures: Sequence[Closure], frames: Sequence[str], couplings: Sequence[CoupledJoints] = ()
) -> LoopRows:
    """Make a row for each locked axis of the closures, then one for each coupling.

    `frames` are the names of the mechanism's frames; rows refer to their indices.
    """
    # all couplings are filled up to the same numbers of joints K and terms M
    K = max((len(coupling.columns) for coupling in couplings), default=0)
    M = max((len(coupling.terms) for coupling in couplings), default=0)
    indices, exponents = np.zeros(K, dtype=np.intp), np.zeros((M, K), dtype=np.intp)
    # each row has the fields of LoopRows in their order: name, two frames, those of _RowProduct, and those of
    # couplings from `coupled` to `exponents`
    rows: list[tuple[Any, ...]] = []
    no_coupling = (False, indices, indices, np.zeros(M), exponents)
    for closure in closures:
        ends = [frames.index(frame) for frame in closure.frames]
        for axis in closure.axes:
            rows.append((f"{closure.name}.{axis}", *ends, *_product_of_axis(closure, axis), *no_coupling))
    for coupling in couplings:
        # the product always holds: its axes x and y of frame 0 are perpendicular, its weight is 0
        product = _RowProduct(rotation=coupling.turns, second_axis=1, weight=0.0)
        k, terms = len(coupling.columns), len(coupling.terms)
        columns, places = (np.pad(joints, (0, K - k)) for joints in (coupling.columns, coupling.places))
        coefficients = np.pad(list(coupling.terms.values()), (0, M - terms))
        powers = np.pad(list(coupling.terms), ((0, M - terms), (0, K - k)))
        rows.append((f"{coupling.name}.q", 0, 0, *product, True, columns, places, coefficients, powers))
    # a row that is not kept gives columns of a table without rows their types
    count = len(rows)
    rows.append(("", 0, 0, *_RowProduct(), *no_coupling))
    names, *tables = zip(*rows, strict=True)  # a column for each field
    return LoopRows(names, *map(np.array, tables)).take(np.arange(count))


class _RowProduct(NamedTuple):
    """The product of one row: fields of `LoopRows`, in the same order."""

    square: bool = False  # whether it is d.d
    rotation: bool = False  # whether it is u.w
    first_axis: int = 0  # 0..2, of u
    second_axis: int = 0  # 0..2, of w
    weight: float = 1.0  # factor of the product
    constant: float = 0.0  # which is subtracted


def _product_of_axis(closure: Closure, axis: str) -> _RowProduct:
    """Return the product that locks one axis of a closure.

    The axis is x, y, z (a translation), rx, ry, rz (a rotation), or a kind in ROW_KINDS.
    """
    if closure.length is not None and axis in ROW_KINDS:
        kind = ROW_KINDS[axis]
        weight_and_constant = kind.coefficients(closure.length)
        return _RowProduct(kind.product == "d.d", kind.product == "u.w", *kind.axes, *weight_and_constant)
    k = "xyz".index(axis[-1])
    if axis.startswith("r"):
        # Let R = 1 + [phi]x be a small rotation of the second frame with axes R x_0, R x_1, R x_2 from the
        # first with axes x_0, x_1, x_2. With the locked axis k, and k, j, i cyclic, x_j . (R x_i) = -phi_k
        # and x_i . (R x_j) = +phi_k; the weight -1 or 1 makes the product phi_k. Of these two products, that
        # one is chosen that stays zero when the closure turns about its free axes by large angles.
        following, preceding = (k + 1) % 3, (k + 2) % 3
        free = _free_turns(closure)
        axes = following, preceding  # of the first frame, of the second frame
        if free == [following]:  # the second frame carries the free axis
            axes = preceding, following
        elif len(free) == 2:  # a universal joint: its first axis on the first frame, its second on the second
            axes = free[0], free[1]
        weight = -1.0 if axes == (following, preceding) else 1.0
        first_axis, second_axis = axes
        return _RowProduct(rotation=True, first_axis=first_axis, second_axis=second_axis, weight=weight)
    return _RowProduct(first_axis=k)  # u.d = 0


def _free_turns(closure: Closure) -> list[int]:
    """Return the axes (0..2) about which a closure lets the second frame turn."""
    return [k for k, name in enumerate(AXES[3:]) if name not in closure.axes]


class LockedDirections(NamedTuple):
    """The d pairs of axes of two frames that closures keep parallel."""

    first: IntArray  # (d,) frame, as index into Mechanism.frames
    second: IntArray  # (d,)
    axis: IntArray  # (d,) 0..2, of both frames
    closures: NDArray[np.str_]  # (d,) names


def locked_directions(closures: Sequence[Closure], frames: Sequence[str]) -> LockedDirections:
    """Return the pairs of axes, one of each frame, that closures keep parallel.

    A closure that leaves one rotation free keeps the axis of this rotation parallel in both frames. One that
    locks all rotations keeps all three axes parallel; two pairs say so, since the third follows.

    Args:
        frames: names of the mechanism's frames.
    """
    pairs: list[tuple[Any, ...]] = []  # both frames, the axis, the closure
    for closure in closures:
        free = _free_turns(closure)  # axes 0..2; with several no axes stay parallel
        parallel = [] if len(free) > 1 else free or [0, 1]
        pairs += [(*map(frames.index, closure.frames), k, closure.name) for k in parallel]
    *indices, names = ([pair[i] for pair in pairs] for i in range(4))
    first, second, axes = (read_only(np.array(column, dtype=np.intp)) for column in indices)
    return LockedDirections(first, second, axes, read_only(np.array(names, dtype=str)))
