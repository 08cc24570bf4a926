from framework.numerics.arrays import Array
from framework.numerics.chebyshev import TimeFunction, TimeGrid
from framework.numerics.polytope import Polytope

MAX_WORKERS: int

__all__ = ["Array", "Polytope", "TimeFunction", "TimeGrid"]
