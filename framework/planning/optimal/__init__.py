"""The optimal law: a cone program, its data and its checks. Open `optimal_motion` first.

* `optimal_task`: the task, and the conditions at the crossings;
* `phase_plane`: torques and condition (8) as affine functions of the squared speed z and of u = z'/2;
* `path_series`: the same as series in s on cells, for the search and for bounds of all laws;
* `law_problem`: the requirements of a law as sparse rows; `speed_program`: the cone program of these rows
  (`framework.numerics.cone_program` solves it);
* `best_law`: the smoothest law (`smooth_search`) that costs hardly more than the least (`least_cost`);
* `undeformed_law`: the best law of a task, or the refusal of its limits;
* `optimal_motion`: law and certified torques in turn (`certified_motion`);
* `elastic_search`: the same for elastic robots with `dynamics.torque_response`, refused if
  `dynamics.static_fold` finds that springs give way;
* `elastic_balance`: the nearest law that an elastic robot can follow, with springs at rest at both ends;
* `least_softening`: whether loads leave any law with deflections in balance;
* `peak_bound`: bounds of every law by duality (`dual_program`);
* `limit_curves`: speeds and accelerations that the motors allow.
"""
