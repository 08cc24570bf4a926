"""Linear algebra that knows no robot. Each file stands for itself.

* `ordered_sums`: products of stacks whose items do not feel each other, to the last bit;
* `rotations`: rotation vectors and the left Jacobian of SO(3);
* `banded_lu`: stacked matrices of one sparsity, factored in a band;
* `krylov`: systems of which only products are known;
* `polytope`: zonotopes and slabs.
"""
