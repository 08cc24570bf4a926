"""Paths x(s), motion laws s(t) and functions of time. Knows no robot. Open `law` first.

* `path`: paths, and the check of a user's own path;
* `law`: the protocol of motion laws, and the polynomial law; `optimal_law`: the law of free shape;
* `exact_duration`: a law of free shape of an exact duration;
* `clock`: the parameter in which functions that follow from a law are smooth;
* `chebyshev`: functions of time as Chebyshev series on panels;
* `speed_basis`: the splines in which such a law writes its speed; `bernstein`: bounds of functions on cells;
* `cone_program`: second-order cone programs in named unknowns, the only door to the solver.
"""
