"""Paths x(s) and motion laws s(t). Knows no robot. Open `law` first.

* `path`: paths, and the check of a user's own path;
* `law`: the protocol of motion laws, and the polynomial law; `optimal_law`: the law of free shape;
* `exact_duration`: a law of free shape of an exact duration;
* `clock`: the parameter in which functions that follow from a law are smooth;
* `speed_basis`: the splines in which such a law writes its speed.
"""
