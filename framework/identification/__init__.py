"""The twin: which parameters of a robot its data determine, and their values.

    found = identify(robot, "sensors.csv")        # torques: masses, inertias, rotors, friction
    found.write("my_robot_identified")
    calibrate(robot, "poses.csv").write("my_robot_calibrated")          # poses: where joints are

Open `base_parameters` first: which combinations of masses, inertias and motor parameters torques depend on.
`identify` finds them in a recorded motion, `calibrate` the geometry in measured poses. `read_recording` reads
data, `record_sensors` makes them of a simulation.

    combinations           the combinations of parameters that a regressor determines
    measured_motion        the motion of all joints from recorded samples
    physical               parameters of bodies that can exist
    geometry               errors of joint origins as virtual joints
    calibration_equations  measured poses as equations for these errors
"""

from framework.identification.base_parameters import BaseParameters, base_parameters
from framework.identification.calibrate import Calibration, calibrate
from framework.identification.identify import Identification, identify
from framework.identification.recording import Recording, read_recording
from framework.identification.sensors import Sensors, record_sensors

__all__ = [
    "BaseParameters",
    "Calibration",
    "Identification",
    "Recording",
    "Sensors",
    "base_parameters",
    "calibrate",
    "identify",
    "read_recording",
    "record_sensors",
]
