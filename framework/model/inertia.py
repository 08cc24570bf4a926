"""The test whether a body can have an inertia, the same for every file that gives one.

The inertia about the centre of mass is the integral of (r.r 1 - r r') dm over the body. Its principal moments
are I1 = b + c, I2 = a + c, I3 = a + b with a, b, c >= 0 the second moments of mass along its axes: none is
negative, and none is above the sum of the other two (Wensing, Kim and Slotine, IEEE Robotics and Automation
Letters 3(1), 2018). A matrix that is not of this kind makes kinetic energy negative or of no body.
"""

from __future__ import annotations

import numpy as np

from framework.errors import RobotFileError
from framework.numerics.arrays import Array, ArrayLike
from framework.tolerances import INERTIA_ROUNDING

ENTRIES = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


def symmetric(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> Array:
    """Return the matrix (3, 3) of six ENTRIES."""
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def check_inertia(where: str, matrix: ArrayLike, *, negligible: float = 0.0) -> None:
    """Refuse an inertia that no body has; `where` starts the complaint.

    Args:
        matrix: (3, 3) [kg m^2] about the centre of mass, symmetric, finite.
        negligible: [kg m^2] what the body is a point with, if no entry is larger: nothing is asked of it.

    Raises:
        RobotFileError: a principal moment is negative, or exceeds the sum of the other two.
    """
    entries = np.asarray(matrix, dtype=float)
    size = float(np.abs(entries).max())
    if size <= negligible:
        return
    moments = np.linalg.eigvalsh(entries / size)  # without overflow
    rounding = INERTIA_ROUNDING * float(np.abs(moments).max())
    if moments[0] < -rounding or moments[2] - moments[1] - moments[0] > rounding:
        with np.errstate(over="ignore"):
            shown = ", ".join(f"{moment:.4g}" for moment in size * moments)
        raise RobotFileError(
            f"{where}: has the principal moments {shown} kg m^2, as no body has: none may be negative, none "
            f"above the sum of the other two"
        )
