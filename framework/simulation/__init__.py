"""Forward dynamics in all coordinates: the motion of a robot under given motor torques.

The simulation is the independent witness of every plan: it shares frames and loop equations with the planner,
but no solver. Open `simulate` first, which checks its arguments and calls one of `methods`.

* `equations`: the equations of motion with their derivatives;
  `terms`: the same without derivatives, for stacks of robots;
* `consistent`: the state at the start; `drive`: the motor torques; `world_forces`: external wrenches;
* `collocation`, `step_size_control`: methods reference and stiff; `contacts`: method explicit;
  `stepper`, `schemes`: method fast, and fixed steps for control loops and for many runs;
* `trajectory`, `events`, `result`: the motion between steps, the instants to report, and the result;
* `accelerations`: forward dynamics at single instants, without time steps.
"""

from framework.simulation.drive import PlannedMotion
from framework.simulation.events import Event, Occurrence
from framework.simulation.result import Simulation
from framework.simulation.schemes import State
from framework.simulation.simulate import simulate
from framework.simulation.stepper import Stepper

__all__ = ["Event", "Occurrence", "PlannedMotion", "Simulation", "State", "Stepper", "simulate"]
