"""Branches of assembled configurations, followed without a jump. Open `predictor_corrector` first.

* `predictor_corrector`: one step after the other along a branch;
* `turning_point`: where a branch ends at a singularity, by a direct root;
* `tracking`: the platform follows a path: `assemble`, `track_path`;
* `branch`: the result of tracking, a path with its configurations;
* `forward_kinematics`: the motors turn to prescribed angles;
* `pose_stack`: the same for many sets of motor angles, and for a stream of samples.
"""
