"""Paths x(s) and motion laws s(t), independent of any robot. Open `law` first.

* `path`: paths, the straight line, and the check of a user's own path; `curves`: arcs, splines, polylines;
* `law`: the protocol of motion laws, and the polynomial law;
* `optimal_law`: the law of free shape, and the parameter in which functions along it are smooth;
* `squared_speed`: the functions that represent the speed of this law, and its exact duration.
"""

from framework.lazy_names import lazy_names

__getattr__, __dir__ = lazy_names(__name__, __file__)
