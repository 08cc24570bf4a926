"""The poses of a map: a grid over two of the platform's coordinates, with the others constant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from framework.errors import InvalidInput, finite_numbers, whole_number
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays

MAX_EDGE_POSES = 4000  # poses along an edge


@dataclass(frozen=True, eq=False)
class Window(ReadOnlyArrays):
    """A grid of poses over two platform coordinates, the others constant.

    `shape` poses between `lower` and `upper` (2,), both included, of the platform coordinates `axes`.
    """

    axes: tuple[int, int]
    lower: Array  # (2,) [m, rad]
    upper: Array  # (2,)
    shape: tuple[int, int]
    constants: Array  # (n,) platform coordinates, constant over the map but for those of `axes`

    def __post_init__(self) -> None:
        """Check the numbers of poses and the order of the ends."""
        super().__post_init__()
        for count in self.shape:
            whole_number("size of a map", count, 2, MAX_EDGE_POSES)
        if not np.all(self.lower < self.upper):
            raise InvalidInput(
                f"window: its lower ends {self.lower.tolist()} must be below the upper ones "
                f"{self.upper.tolist()}"
            )

    @property
    def spans(self) -> tuple[Array, Array]:
        """Values of both coordinates along the edges of the grid."""
        first, second = (
            np.linspace(low, high, count)
            for low, high, count in zip(self.lower, self.upper, self.shape, strict=True)
        )
        return first, second

    @property
    def cell(self) -> Array:
        """Distance (2,) of neighbours along either axis."""
        return (self.upper - self.lower) / (np.array(self.shape) - 1)

    def points(self) -> Array:
        """Return platform coordinates (I, J, n) of all poses."""
        x = np.tile(self.constants, (*self.shape, 1))
        first, second = self.spans
        x[..., self.axes[0]], x[..., self.axes[1]] = first[:, None], second
        return x


def map_axes(robot: ParallelRobot, names: tuple[str, str] | None = None) -> tuple[int, int]:
    """Return the two platform coordinates of a map, by index.

    By default the first two, translations first.

    Raises:
        InvalidInput: the robot has fewer than two coordinates, or not those of `names`.
    """
    if robot.n < 2:
        raise InvalidInput(
            f"{robot.name}: a map needs two platform coordinates, it has {', '.join(robot.axis_names)} alone"
        )
    if names is not None:
        if len(set(names)) != 2 or not set(names) <= set(robot.axis_names):
            raise InvalidInput(
                f"axes of a map: needs two of {', '.join(robot.axis_names)}, got {', '.join(names)}"
            )
        return robot.axis_names.index(names[0]), robot.axis_names.index(names[1])
    order = [*np.flatnonzero(robot.translations), *np.flatnonzero(~robot.translations)]
    return int(order[0]), int(order[1])


def map_point(robot: ParallelRobot, point: ArrayLike | None) -> Array:
    """Return the point (n,) about which a map lies, the reference by default."""
    return robot.reference.x if point is None else finite_numbers("at", point, robot.n)
