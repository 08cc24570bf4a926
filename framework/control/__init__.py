"""Motor controllers for a planned crossing, and studies of their robustness to model errors.

    reference = reference_of(plan, period=1e-3)
    study = run_study(tuned_controller("lqr", reference), ControlLoop(), Spread(payload=0.05), runs=200)

Open `study` first (many runs), then `closed_loop` (the loop over sampling periods).

* `controllers`: the plan at the sampling instants, a `Reference`; feedforward and computed torque;
* `linear_model`: the dynamics about the plan, of rigid and elastic robots; `regulators`: lqr and lqg on them;
* `variations`: random robots that differ from the model as `Spread` says; `sensors`: the `ControlLoop`;
* `closed_loop`: `run_closed_loop` drives these robots, with friction and delay between them and a controller;
* `deviation`, `prediction`: standard deviations of the closed loop without runs, by sensors;
* `robust_plan`: `plan_robustly` searches the margin on limits with which robots of a spread pass;
* `table`, `run_table`: a controller as CSV, and a program that runs one without this package;
* `study`: `tuned_controller` makes one of `CONTROLLERS`, others follow the protocol `Controller`; `run_study`
  draws robots and judges their runs, `run_store` stores finished runs, `load_study` reads a study that
  `crossing robustness --out` wrote;
* `control_cycle`: `ControlCycle` computes pose and torques of one robot once a millisecond.
"""

from framework.lazy_names import lazy_names

__getattr__, __dir__ = lazy_names(__name__, __file__)
