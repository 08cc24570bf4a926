"""Points and planes beside a robot, from which its platform is measured: ball bars, draw wires, touches.

    distance_NAME    distance [m] of the platform's frame from a point that stands still
    touch_AXIS       its offset [m] along a base axis from a plane across this axis; 0 where a probe touches

Nobody needs to know where point and plane are. Three numbers of each are parameters beside those of the
robot: the point's coordinates; the plane's height and its two slopes, times the robot's length.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from framework.identification.recording import DISTANCE, LINEAR_AXES, TOUCH
from framework.numerics.arrays import LEAST_DIVISOR, Array, Names

IN_PLANE = 1e-6  # least spread of points over the largest, below which they lie in a plane


class Fixture(NamedTuple):
    """A point, or a plane across a base axis, where the robot file's poses have it."""

    column: str
    axis: int | None  # that the plane is across; None for a point
    start: Array  # (3,) [m]
    length: float  # of the robot [m]

    @property
    def names(self) -> Names:
        """Names of its three parameters."""
        if self.axis is None:
            return tuple(f"{self.column}.{axis}" for axis in LINEAR_AXES)
        slopes = (f"slope_{axis}" for axis in LINEAR_AXES if axis != LINEAR_AXES[self.axis])
        return tuple(f"{self.column}.{name}" for name in ("height", *slopes))

    def offsets(self, points: Array, values: Array, change: Array) -> tuple[Array, Array, Array]:
        """Compute model minus measurement (T,), and slopes (T, 3) by points (T, 3) and change (3,)."""
        numbers = self.start + change
        if self.axis is None:
            arms = points - numbers
            distances = np.linalg.norm(arms, axis=1)
            directions = arms / np.maximum(distances, LEAST_DIVISOR)[:, None]  # at the point itself none
            return distances - values, directions, -directions
        columns = _plane_columns(points, self.axis, self.length)
        normal = np.insert(-numbers[1:] / self.length, self.axis, 1.0)
        return points @ normal - numbers[0] - values, np.tile(normal, (len(points), 1)), -columns


def find_fixtures(columns: Names, points: Array, values: Array, length: float) -> tuple[Fixture, ...]:
    """Place the fixtures of columns by points (T, 3) of the file's poses and their values (T, columns).

    Differences of d^2 = |p|^2 - 2 p . c + |c|^2 from their means are linear in the point c.
    """
    fixtures = []
    for column, measured in zip(columns, values.T, strict=True):
        if column.startswith(DISTANCE):
            squares = np.vecdot(points, points) - measured**2  # (T,)
            mean = points.mean(axis=0)
            rows = 2.0 * (points - mean)  # (T, 3)
            right = squares - squares.mean() - rows @ mean
            start = mean + np.linalg.lstsq(rows, right, rcond=IN_PLANE)[0]
            _, sizes, V_rows = np.linalg.svd(rows)
            if len(rows) < 3 or sizes[-1] < IN_PLANE * sizes[0]:  # points in a plane: the point is beside it
                rest = np.mean(measured**2 - np.sum((points - start) ** 2, axis=1))
                start = start + np.sqrt(max(rest, 0.0)) * V_rows[-1]
            fixtures.append(Fixture(column, None, start, length))
        else:
            axis = LINEAR_AXES.index(column.removeprefix(TOUCH))
            matrix = _plane_columns(points, axis, length)
            start = np.linalg.lstsq(matrix, points[:, axis] - measured, rcond=IN_PLANE)[0]
            fixtures.append(Fixture(column, axis, start, length))
    return tuple(fixtures)


def _plane_columns(points: Array, axis: int, length: float) -> Array:
    """Return the derivatives (T, 3) of a plane's height along an axis by its three numbers."""
    return np.column_stack([np.ones(len(points)), np.delete(points, axis, axis=1) / length])
