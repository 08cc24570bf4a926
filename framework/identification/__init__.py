"""Identification: which parameters of a robot its data determine, and their values.

    result = identify(robot, "sensors.csv")       # torques determine masses, inertias, rotors, friction
    result.write("my_robot_identified")
    calibrate(robot, "poses.csv").write("my_robot_calibrated")          # poses determine joint origins

Open `base_parameters` first: it computes the combinations of masses, inertias and motor parameters on which
torques depend. `identify` estimates these from a recorded motion, `calibrate` estimates the geometry from
measured poses. `excite` designs a motion to record. `recording` reads data and simulates them, `conversions`
declares their units and signs.

    combinations     the combinations of parameters that a regressor determines
    unknowns         what is asked for, in units of what the file leaves open
    measured_motion  the motion of all joints from recorded samples
    torque_rows      torques as linear equations of the base parameters
    least_squares    their solution, with the covariance of their own noise
    possible_bodies  bodies that can exist, nearest to the solution
    geometry         errors of joint origins and of lengths, and equations for these errors
    fixtures         points and planes from which poses are measured
"""

from framework.lazy_names import lazy_names

__getattr__, __dir__ = lazy_names(__name__, __file__, ("base_parameters", "calibrate", "excite", "identify"))
