"""The optimal law: the cone program and what is around it. Open `optimal_motion` first.

* `optimal_task`: what is asked, and the conditions at the crossings;
* `phase_plane`: torques and condition (8) as functions affine in the squared speed z and u = z'/2;
* `sampled_demand`: the same as series in s, from some hundred poses;
* `law_problem`: what a law has to meet, as sparse rows; `speed_program`: the cone program of these
  (`framework.numerics.cone_program` solves it);
* `best_law`: the smoothest law (`smooth_search`) that costs hardly more than the least (`least_cost`);
* `undeformed_law`: the best law of a task, or why it has none (`limit_refusals`);
* `optimal_motion`: law and certified torques in turn; those of elastic robots by `dynamics.torque_response`,
  refused where `dynamics.static_fold` finds that springs give way;
* `elastic_balance`: the nearest law that an elastic robot can follow;
* `rest_of_springs`: whether springs start and stop at rest, as the law does;
* `peak_bound`: bounds of every law, by duality (`dual_program`, on the functions of `path_series`);
* `limit_curves`: speeds that the motors allow.
"""
