"""Numerical and system services without any robot: arrays, series, solvers, processes and files.

The modules do not build on one another much; any can be read alone. Open `chebyshev` first, whose series
represent all functions of time.

* `arrays`: types of arrays, frozen objects; `rotations`: rotation vectors and the left Jacobian of SO(3);
* `ordered_sums`: linear algebra of stacks, in which each item is computed as if it were alone, to the last
  bit; row space and null space of a matrix;
* `sparse_rows`: sparse matrices as entries; `banded_lu`: factorisation of those in a band;
* `splines`: B-splines, and least squares with them; `polytope`: zonotopes and slabs;
* `chebyshev`: functions of time as Chebyshev series on panels, and their largest values; `bernstein`: bounds
  of functions on cells;
* `cone_program`: second-order cone programs in named unknowns, the only access to the solver;
* `tasks`, `kept`: many independent computations on the cores of this machine or of a cluster, in
  chunks whose results do not depend on where they are computed, stored as they finish;
* `input`, `output`: files read within limits, and written together or not at all; `fields`: typed values
  from documents; `interruption`: Ctrl-C and SIGTERM; `time_limit`: searches that end with their best result.
"""

from framework.lazy_names import lazy_names

MAX_WORKERS = 1000  # processes
__getattr__, __dir__ = lazy_names(__name__, __file__)
