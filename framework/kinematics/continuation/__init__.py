"""Branches of assembled configurations, followed without jumping to another branch. Open `tracking` first.

* `predictor_corrector`: tests that a step stays on its branch;
* `arclength`: curves along which a share grows, also of loads, up to the turning point at which they end;
* `path_sheet`: the branch along a path on panels of Chebyshev nodes, closed in stacks;
* `tracking`: the configurations while the platform follows a path: `assemble`, `track_path`; where panels
  end, single steps, and the error where the branch ends;
* `branch`: the result of tracking, a path with its configurations;
* `motor_curves`: the configurations while the motors turn to prescribed angles, many sets of angles at once;
* `forward_kinematics`: the pose at prescribed motor angles, or the error where its curve ends; also for many
  sets of motor angles, and for a stream of samples;
* `pose_search`: the pose nearest to a target that may be out of reach.
"""
