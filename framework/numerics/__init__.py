"""What knows no robot: arrays, series, solvers, many processes, and files read and written whole.

Each file stands for itself. Open `chebyshev` first: in its series all functions of time are written.

* `arrays`: types of arrays, frozen objects; `rotations`: rotation vectors and the left Jacobian of SO(3);
* `ordered_sums`: products of stacks whose items do not feel each other, to the last bit;
* `banded_lu`: the factorisation of sparse matrices in a band; `krylov`: systems of which only products are
  known; `polytope`: zonotopes and slabs; `subspaces`: row spaces and null spaces;
* `chebyshev`: functions of time as Chebyshev series on panels; `peaks`: their largest values;
  `bernstein`: bounds of functions on cells;
* `cone_program`: second-order cone programs in named unknowns, the only door to the solver;
* `tasks`, `workers`, `kept`: many independent computations on the cores of this machine or of a cluster, in
  chunks that are the same whatever computes them, kept as they are finished;
* `input`, `output`, `fields`: files within limits, written together or not at all; typed values out of
  documents; `interruption`: Ctrl-C and SIGTERM; `time_limit`: a search that ends with its best so far.
"""

MAX_WORKERS = 1000  # processes
