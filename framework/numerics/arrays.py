"""Types of arrays and of names that signatures use, and frozen objects whose arrays are frozen too."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import is_dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike as ArrayLike
from numpy.typing import NDArray

Array = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.intp]
Names = tuple[str, ...]  # of joints, axes, equations, in the order of the entries that they name
LEAST_DIVISOR = 1e-300  # the least divisor: what it divides is zero too, or infinite
_Any = TypeVar("_Any", bound=NDArray[Any])
Stack = TypeVar("Stack", bound=tuple[Any, ...])  # a named tuple of arrays, one item each in all of them


def select(stack: Stack, which: Any) -> Stack:
    """Return the items `which` (index, slice or mask) of all arrays of a named tuple, nested ones too."""
    make: Any = type(stack)
    return make(*(part[which] if isinstance(part, np.ndarray) else select(part, which) for part in stack))


def assign(stack: Stack, rows: Any, new: Stack) -> None:
    """Assign the items of `new` to some rows of all arrays of a named tuple."""
    for values, new_values in zip(stack, new, strict=True):
        values[rows] = new_values


def join(stacks: Sequence[Stack]) -> Stack:
    """Return the items of several stacks, at least one, one after the other."""
    make: Any = type(stacks[0])
    parts = zip(*stacks, strict=True)
    return make(*(np.concatenate(part) if isinstance(part[0], np.ndarray) else join(part) for part in parts))


def read_only(array: _Any) -> _Any:
    """Return the array if read-only and owner of its data, else a read-only copy."""
    if array.flags.writeable or not array.flags.owndata:
        array = array.copy()
        array.flags.writeable = False
    return array


def freeze(value: object) -> None:
    """Make the arrays of our own tuple or dataclass read-only, nested ones included."""
    remaining = [value]
    while remaining:
        item = remaining.pop()
        if isinstance(item, np.ndarray):
            item.setflags(write=False)
        elif isinstance(item, tuple):
            remaining.extend(item)
        elif not isinstance(item, ReadOnlyArrays) and is_dataclass(item):
            remaining.extend(vars(item).values())


class ReadOnlyArrays:
    """Base of frozen dataclasses that hold their arrays read-only.

    The arrays of the caller may change, the copies do not: a law always fits the torques computed for it. A
    subclass with a `__post_init__` of its own calls this one, too.
    """

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():  # from another process, or a deep copy: arrays come writeable
            self.__dict__[name] = read_only(value) if isinstance(value, np.ndarray) else value

    def __post_init__(self) -> None:
        """Replace all arrays by read-only ones."""
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                self.__dict__[name] = read_only(value)
