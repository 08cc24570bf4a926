"""Branches of assembled configurations, followed without a jump. Open `predictor_corrector` first.

* `predictor_corrector`: one step after the other along a branch;
* `turning_point`: where a branch ends at a singularity, by a direct root;
* `tracking`: the platform led along a path: `assemble`, `track_path`;
* `branch`: what tracking returns: a path with its configurations;
* `forward_kinematics`: the motors led to given angles;
* `pose_stack`: the same for many sets of motor angles, and for a stream of samples.
"""
