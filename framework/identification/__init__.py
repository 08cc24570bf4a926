"""The twin: which parameters of a robot its data determine, and their values.

Open `base_parameters` first: which combinations of masses, inertias and motor parameters torques depend on.
"""

from framework.identification.base_parameters import BaseParameters, base_parameters
from framework.identification.recording import Recording, read_recording
from framework.identification.sensors import Sensors, record_sensors

__all__ = ["BaseParameters", "Recording", "Sensors", "base_parameters", "read_recording", "record_sensors"]
