"""The check that the springs of an optimal motion start and stop at rest, as its law does.

Balance alone does not ensure this: springs that carry inertia may be in balance while they vibrate at an end.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from framework.errors import NotConverged
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array
from framework.tolerances import MAX_END_RATE

END_SAMPLES = 401  # of a motion, for the largest rates of its springs
NEGLIGIBLE_RATE = 1e-6  # of a spring, over that of the quickest; slower springs are not checked, for rounding


def check_rest(
    robot: ParallelRobot, deflections: Callable[[Array], Sequence[Array]], duration: float, smoothness: int
) -> None:
    """Check that springs start and stop at rest, as the law does.

    Args:
        deflections: function of times (T,) that returns deflections and rates, each (T, n_e), and, if they
            are to be checked, accelerations.
        duration: of the motion [s].
        smoothness: number of derivatives of the law that vanish at both ends.

    Raises:
        NotConverged: the rate or acceleration of a spring at an end is more than MAX_END_RATE of its largest.
    """
    t = np.linspace(0.0, duration, END_SAMPLES)
    _, *rates = deflections(t)
    # accelerations may be missing
    for quantity, values in zip(("rate", "acceleration"), rates, strict=False):
        sizes = np.abs(values) / robot.column_scale[robot.elastic]  # (T, n_e)
        largest = sizes.max(axis=0)  # (n_e,)
        is_checked = largest > NEGLIGIBLE_RATE * largest.max()
        at_ends = (sizes[[0, -1]][:, is_checked] / largest[is_checked]).max(initial=0.0)
        if at_ends > MAX_END_RATE:
            raise NotConverged(
                f"{robot.name}: springs start or stop with {at_ends:.2g} of their largest {quantity} (at "
                f"most {MAX_END_RATE:g}), though {smoothness} derivatives of the law vanish there",
                residual=float(at_ends),
            )
