"""Branches of assembled configurations, followed without a jump. Open `tracking` first.

* `predictor_corrector`: by which measures a step stays on its branch;
* `turning_point`: where a branch ends at a singularity, by a direct root;
* `tracking`: the platform follows a path: `assemble`, `track_path`;
* `branch`: the result of tracking, a path with its configurations;
* `motor_curves`: the motors turn to prescribed angles, many sets of them at once;
* `forward_kinematics`: the pose at prescribed angles, or the error that ends its way;
* `pose_stack`: poses of many sets of motor angles, and of a stream of samples.
"""
