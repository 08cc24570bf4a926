from framework.numerics.arrays import Array, ArrayLike
from framework.numerics.chebyshev import TimeFunction, TimeGrid
from framework.numerics.polytope import Polytope

MAX_WORKERS: int

__all__ = ["Array", "ArrayLike", "Polytope", "TimeFunction", "TimeGrid"]
