"""Paths x(s), motion laws s(t) and functions of time. Knows no robot. Open `law` first.

* `path`, `path_check`: paths, and the check of those that a user has made;
* `law`: what a motion law is, and the polynomial law; `optimal_law`: the law of free shape;
* `exact_duration`: a law of free shape made to last exactly so long;
* `clock`: the parameter in which what follows from a law is smooth;
* `chebyshev`: functions of time as Chebyshev series on panels;
* `speed_basis`: the splines in which such a law writes its speed; `bernstein`: bounds of functions on cells;
* `cone_program`: second-order cone programs in named unknowns, the only door to the solver.
"""
