"""Forward dynamics in all coordinates: the motion of a robot under given motor torques.

The simulation is the independent witness of every plan: it shares frames and loop equations with the planner,
but no solver. Open `simulate` first, which checks its arguments and calls one of `methods`.

* `drive`: the motor torques and external wrenches;
* `equations`: the equations of motion with their derivatives;
* `consistent_states`: the state at the start, and the accelerations of single states;
* `collocation`, `step_size_control`: methods reference and stiff;
  `stepper`: method fast, and fixed steps for control loops and for many runs;
* `trajectory`: the motion between steps with its events.
"""

from framework.lazy_names import lazy_names

__getattr__, __dir__ = lazy_names(__name__, __file__, ("simulate",))
