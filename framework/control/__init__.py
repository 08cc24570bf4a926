"""Motor controllers for a planned crossing, and studies of their robustness to model errors.

    reference = reference_of(plan, period=1e-3)
    study = run_study(tuned_controller("lqr", reference), ControlLoop(), Spread(payload=0.05), runs=200)

Open `study` first (many runs), then `closed_loop` (the loop over sampling periods).

* `controllers`: the plan at the sampling instants, a `Reference`; `tuned_controller` makes one of
  `CONTROLLERS` for it; other controllers follow the protocol `Controller`;
* `closed_loop`: random robots that differ from the model as `Spread` says; `run_closed_loop` drives them,
  with friction and delay between controller and robot;
* `study`: `run_study` draws robots and judges their runs, `run_store` stores finished runs, `load_study`
  reads a study that `crossing robustness --out` wrote;
* `control_cycle`: `ControlCycle` computes pose and torques of one robot once a millisecond.
"""

from framework.lazy_names import lazy_names

__getattr__, __dir__ = lazy_names(__name__, __file__)
