"""Types of arrays and names for signatures, stacks of arrays, and frozen objects with read-only arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import is_dataclass
from functools import cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike as ArrayLike
from numpy.typing import NDArray

Array = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.intp]
Names = tuple[str, ...]  # of joints, axes, equations, in the order of the entries that they name
LEAST_DIVISOR = 1e-300  # replaces a divisor of zero: the quotient is zero or huge, but not NaN
_Any = TypeVar("_Any", bound=NDArray[Any])
Stack = TypeVar("Stack", bound=tuple[Any, ...])  # a named tuple of arrays, one item each in all of them


def select(stack: Stack, which: Any) -> Stack:
    """Select items from all arrays of a named tuple, nested named tuples included.

    `which` is an index, a slice or a mask of the first axis.
    """
    make: Any = type(stack)  # the constructor of the named tuple
    return make(*(part[which] if isinstance(part, np.ndarray) else select(part, which) for part in stack))


def assign(stack: Stack, rows: Any, new: Stack) -> None:
    """Assign the items of `new` to `rows` of all arrays of a named tuple."""
    for values, new_values in zip(stack, new, strict=True):
        values[rows] = new_values


def join(stacks: Sequence[Stack]) -> Stack:
    """Concatenate one or more stacks, array by array."""
    if len(stacks) == 1:
        return stacks[0]
    make: Any = type(stacks[0])  # the constructor of the named tuple
    parts = zip(*stacks, strict=True)
    return make(*(np.concatenate(part) if isinstance(part[0], np.ndarray) else join(part) for part in parts))


def mirror_upper(matrices: Array) -> Array:
    """Copy the upper triangles of matrices (T, k, k) to the lower ones, in place; return the matrices.

    Pinocchio fills the upper triangles of mass matrices only.
    """
    row, column = _lower_triangle(matrices.shape[-1])
    matrices[:, row, column] = matrices[:, column, row]
    return matrices


@cache
def _lower_triangle(size: int) -> tuple[IntArray, IntArray]:
    """Return the indices of all entries below the diagonal, which take longer to find than to copy."""
    return np.tril_indices(size, -1)


def read_only(array: _Any) -> _Any:
    """Return a read-only array that owns its data: the same one if possible, else a copy."""
    if array.flags.writeable or not array.flags.owndata:
        array = array.copy()
        array.flags.writeable = False
    return array


def freeze(value: object) -> None:
    """Make all arrays of a tuple or dataclass read-only in place, nested ones included."""
    remaining = [value]
    while remaining:
        item = remaining.pop()
        if type(item) is np.ndarray:
            item.flags.writeable = False
        elif isinstance(item, tuple):
            remaining.extend(item)
        elif is_dataclass(item) and not isinstance(item, ReadOnlyArrays):  # which are read-only already
            remaining.extend(vars(item).values())


class ReadOnlyArrays:
    """Base of frozen dataclasses that hold their arrays read-only.

    Arrays that the caller may still change are copied. So a law always stays the one for which torques were
    computed. A subclass with its own `__post_init__` must call this one.
    """

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a pickled or copied object, whose arrays arrive writeable."""
        self.__dict__.update(state)
        ReadOnlyArrays.__post_init__(self)

    def __post_init__(self) -> None:
        """Replace all arrays by read-only ones."""
        for name, value in self.__dict__.items():
            if type(value) is np.ndarray:
                self.__dict__[name] = read_only(value)


def has_entries(given: object) -> bool:
    """Return whether an object is a list or array of numbers or rows; a text is none."""
    try:
        return bool(np.ndim(given))  # type: ignore[arg-type]
    except ValueError:  # rows of different lengths
        return True
