"""Branches of assembled configurations, followed without jumping to another branch. Open `tracking` first.

* `predictor_corrector`: tests that a step stays on its branch;
* `turning_point`: finds the turning point at which a branch ends, as the root of an equation;
* `tracking`: the configurations while the platform follows a path: `assemble`, `track_path`;
* `branch`: the result of tracking, a path with its configurations;
* `motor_curves`: the configurations while the motors turn to prescribed angles, many sets of angles at once;
* `forward_kinematics`: the pose at prescribed motor angles, or the error where its curve ends;
* `pose_search`: the pose nearest to a target that may be out of reach;
* `pose_stack`: poses of many sets of motor angles, and of a stream of samples.
"""
