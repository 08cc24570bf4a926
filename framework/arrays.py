"""Names for the array types that signatures use."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.intp]

__all__ = ["Array", "ArrayLike", "IntArray"]
