"""Files for other programs: a simulator's model of a robot, a controller's trajectory of a plan.

Open `mjcf` first, the model for MuJoCo. `trajectory_file` makes the message for ros2_control.
"""
