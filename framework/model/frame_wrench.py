"""An external wrench on the body of a frame, constant or tabulated, as robot files and requests state it."""

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
TABLE_DEGREE = 3  # of the spline through a table; elastic robots need a continuous second derivative


@dataclass(frozen=True, eq=False)
class FrameWrench(ReadOnlyArrays):
    """An external wrench on the body of one frame.

    `rows` is a constant (force, moment) (6,), or a table (K, 7) whose rows are (s, force, moment), with the
    path coordinate s from 0 to 1. A cubic spline interpolates the table, twice continuously differentiable;
    through fewer than four rows it is of lower degree.
    """

    frame: str
    rows: Array
    axes: str  # one of AXES_OF_WRENCHES

    def __call__(self, s: Array) -> Array:
        """Compute the wrench (T, 6) at path coordinates s (T,), along `axes`."""
        if self.rows.ndim == 1:
            return np.broadcast_to(self.rows, (len(s), 6))
        return self._spline(s)

    def times(self, factor: float) -> FrameWrench:
        """Return the wrench multiplied by a number."""
        rows = self.rows.copy()
        rows[..., -6:] *= factor  # force and moment; a table has s before them
        return replace(self, rows=rows)

    @property
    def knots(self) -> Array:
        """Path coordinates in (0, 1) where the spline's highest derivative jumps."""
        if self.rows.ndim == 1:
            return NO_KNOTS
        repeats = self._spline.k + 1  # number of equal knots at either end
        return np.unique(self._spline.t[repeats:-repeats])

    @property
    def turns(self) -> bool:
        """Whether the wrench turns with the frame, on axes of the tool."""
        return self.axes != AXES_OF_WRENCHES[0]

    @property
    def document(self) -> Any:
        """Wrench as written in a robot file or plan.json."""
        numbers = self.rows.tolist()
        return {"wrench": numbers, "axes": self.axes} if self.turns else numbers

    @cached_property
    def _spline(self) -> Any:
        """Spline that interpolates the table over s, of degree TABLE_DEGREE at most."""
        from scipy.interpolate import make_interp_spline

        degree = min(TABLE_DEGREE, len(self.rows) - 1)
        return make_interp_spline(self.rows[:, 0], self.rows[:, 1:], k=degree)

    @staticmethod
    def of(frame: str, given: Any, where: str = "wrenches") -> FrameWrench:
        """Read a wrench: 6 numbers, a table, or {wrench: ..., axes: base or tool}.

        `where` names the mapping that contains the wrench, for messages.

        Raises:
            InvalidInput: `given` is none of these.
        """
        name = f"{where}: {frame}"
        axes = AXES_OF_WRENCHES[0]
        if isinstance(given, Mapping):
            values = read_table(name, dict(given), _TABLE)
            given, axes = values["wrench"], values["axes"]
        # an array without dimensions is an ndarray, but is not iterable
        is_list = isinstance(given, list | tuple | np.ndarray) and np.iterable(given)
        if not (is_list and any(map(np.iterable, given))):
            return FrameWrench(frame, finite_numbers(name, given, 6), axes)
        rows = finite_numbers(f"{name}: each row of the table (s, force, moment)", given, 7, stacks=True)
        s = rows[:, 0]
        if len(s) < 2 or np.any(np.diff(s) <= 0) or s[0] != 0.0 or s[-1] != 1.0:
            raise InvalidInput(f"{name}: s of the rows must ascend from 0 to 1, got {short(s.tolist())}")
        return FrameWrench(frame, rows, axes)
