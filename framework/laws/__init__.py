"""Paths x(s) and motion laws s(t), independent of any robot. Open `law` first.

* `path`: paths, and the check of a user's own path;
* `law`: the protocol of motion laws, and the polynomial law;
* `optimal_law`: the law of free shape, which stores its squared speed;
* `speed_basis`: the functions that represent this squared speed;
* `exact_duration`: adjusts a squared speed to an exact duration;
* `clock`: the parameter in which functions along a law, such as deflections, are smooth.
"""
