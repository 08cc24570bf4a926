"""Paths x(s), motion laws s(t) and functions of time. Knows no robot. Open `law` first.

* `path`, `path_check`: paths, and the check of those that a user has made;
* `law`: what a motion law is, and the polynomial law; `optimal_law`: the law of free shape;
* `exact_duration`: a law of free shape made to last exactly so long;
* `clock`: the parameter in which what follows from a law is smooth;
* `chebyshev`: functions of time as Chebyshev series on panels;
* `cone_program`, `infeasibility`: the best speed along a path, or the proof that there is none. The only door
  to the solver.
"""
