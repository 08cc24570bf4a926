"""A wrench of the world on the body of a frame, constant or a table, as robot files and requests state it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from framework.errors import InvalidInput, finite_numbers, short
from framework.laws.path import NO_KNOTS
from framework.numerics.arrays import Array, ReadOnlyArrays
from framework.numerics.fields import Table, anything, one_of, optional, read_table

AXES_OF_WRENCHES = ("base", "tool")
_TABLE: Table = {
    "wrench": optional(anything),
    "axes": optional(one_of("axes", AXES_OF_WRENCHES), AXES_OF_WRENCHES[0]),
}
TABLE_DEGREE = 3  # of the spline through a table: the torque of an elastic robot has w" in it


@dataclass(frozen=True, eq=False)
class FrameWrench(ReadOnlyArrays):
    """A wrench of the world on the body of one frame.

    `rows` are (force, moment) (6,), or a table (K, 7) of rows with the path coordinate s before it, from 0
    to 1: a cubic spline leads through it, twice continuously differentiable (of less degree through fewer
    than four rows).
    """

    frame: str
    rows: Array
    axes: str = AXES_OF_WRENCHES[0]

    def __call__(self, s: Array) -> Array:
        """Compute the wrench (T, 6) at path coordinates s (T,), on its own axes."""
        if self.rows.ndim == 1:
            return np.broadcast_to(self.rows, (len(s), 6))
        return self._spline(s)

    def times(self, factor: float) -> FrameWrench:
        """Return the wrench multiplied by a number."""
        rows = self.rows.copy()
        rows[..., -6:] *= factor
        return replace(self, rows=rows)

    @property
    def knots(self) -> Array:
        """The path coordinates between 0 and 1 at which the third derivative jumps."""
        if self.rows.ndim == 1:
            return NO_KNOTS
        degree = self._spline.k
        return np.unique(self._spline.t[degree + 1 : -degree - 1])

    @property
    def turns(self) -> bool:
        """Whether the wrench turns with its frame."""
        return self.axes != AXES_OF_WRENCHES[0]

    @property
    def document(self) -> Any:
        """The wrench as written in a robot file or plan.json."""
        numbers = self.rows.tolist()
        return {"wrench": numbers, "axes": self.axes} if self.turns else numbers

    @cached_property
    def _spline(self) -> Any:
        """The interpolating spline of the rows over their first column, of degree `TABLE_DEGREE` at most."""
        from scipy.interpolate import make_interp_spline

        return make_interp_spline(self.rows[:, 0], self.rows[:, 1:], k=min(TABLE_DEGREE, len(self.rows) - 1))

    @staticmethod
    def of(frame: str, given: Any, where: str = "wrenches") -> FrameWrench:
        """Read a wrench: 6 numbers, a table, or {wrench: ..., axes: base or tool}.

        `where` names the mapping that it stands in.

        Raises:
            InvalidInput: it is none of these.
        """
        name, axes = f"{where}: {frame}", AXES_OF_WRENCHES[0]
        if isinstance(given, Mapping):
            values = read_table(name, dict(given), _TABLE)
            given, axes = values["wrench"], values["axes"]
        is_list = isinstance(given, list | tuple | np.ndarray) and np.iterable(given)
        if not (is_list and any(map(np.iterable, given))):
            return FrameWrench(frame, finite_numbers(name, given, 6), axes)
        rows = finite_numbers(f"{name}: each row of the table (s, force, moment)", given, 7, stacks=True)
        s = rows[:, 0]
        if len(s) < 2 or np.any(np.diff(s) <= 0) or s[0] != 0.0 or s[-1] != 1.0:
            raise InvalidInput(f"{name}: s of the rows must ascend from 0 to 1, got {short(s.tolist())}")
        return FrameWrench(frame, rows, axes)
