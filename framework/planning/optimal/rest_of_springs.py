"""The check that the springs of an optimal motion start and stop at rest, as its law does.

Balance alone does not ensure this: springs that carry inertia may be in balance while they vibrate at an end.
"""

from __future__ import annotations

import numpy as np

from framework.dynamics.result import InverseDynamics
from framework.errors import NotConverged
from framework.tolerances import MAX_END_ACCELERATION, MAX_END_RATE

END_SAMPLES = 401  # of a motion, for the largest rates of its springs
NEGLIGIBLE_RATE = 1e-6  # of a spring, over that of the quickest; slower springs are not checked, for rounding


def check_rest(dynamics: InverseDynamics, smoothness: int) -> None:
    """Check that springs start and stop at rest, as the law does.

    Args:
        dynamics: the motion.
        smoothness: number of derivatives of the law that vanish at both ends.

    Raises:
        NotConverged: the rate of a spring at an end is more than MAX_END_RATE of its largest, or the
            acceleration more than MAX_END_ACCELERATION.
    """
    robot = dynamics.robot
    t = np.linspace(0.0, dynamics.duration, END_SAMPLES)
    for order, quantity, allowed in ((1, "rate", MAX_END_RATE), (2, "acceleration", MAX_END_ACCELERATION)):
        values = np.abs(dynamics.deflection(t, order)) / robot.column_scale[robot.elastic]  # (T, n_e)
        largest = values.max(axis=0)
        counted = largest > NEGLIGIBLE_RATE * largest.max()
        at_ends = (values[[0, -1]][:, counted] / largest[counted]).max(initial=0.0)
        if at_ends > allowed:
            raise NotConverged(
                f"{robot.name}: springs start or stop with {at_ends:.2g} of their largest {quantity} (at "
                f"most {allowed:g}), though {smoothness} derivatives of the law vanish there",
                residual=float(at_ends),
            )
