"""Files for other programs: a simulator's model of a robot, a controller's trajectory of a plan.

Open `mjcf` first, the model for MuJoCo. `joint_trajectory` is the message for ros2_control, and
`trajectory_file` its reader.
"""
