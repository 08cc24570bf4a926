"""Forward dynamics in all coordinates: what the robot does when given torques drive it.

The witness of every plan: it shares frames and loop equations with the planner, and no solver. Open
`simulate` first, which checks what is given and calls one of `methods`.

* `equations`: the equations of motion and their derivatives;
  `terms`: the same without derivatives, for stacks of robots;
* `consistent`: the state at the start; `drive`: the torques;
* `collocation`, `step_size_control`: methods reference and stiff; `contacts`: method explicit;
  `stepper`, `schemes`: method fast, and steps for control loops and for many runs;
* `trajectory`, `events`, `result`: the motion between steps, instants to report, and what comes back;
* `accelerations`: forward dynamics at instants, without a step.
"""

from framework.simulation.drive import PlannedMotion
from framework.simulation.events import Event, Occurrence
from framework.simulation.result import Simulation
from framework.simulation.schemes import State
from framework.simulation.simulate import simulate
from framework.simulation.stepper import Stepper

__all__ = ["Event", "Occurrence", "PlannedMotion", "Simulation", "State", "Stepper", "simulate"]
