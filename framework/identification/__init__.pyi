from framework.identification.base_parameters import (
    BaseParameters,
    LinkParameters,
    TorqueParameters,
    base_parameters,
    collect_link_parameters,
    torque_parameters,
    with_masses_and_motors,
)
from framework.identification.calibrate import Calibration, FurtherPoses, calibrate
from framework.identification.combinations import Combinations
from framework.identification.conversions import Conversions
from framework.identification.excite import Excitation, PeriodicMotion, excite
from framework.identification.fixtures import Fixture
from framework.identification.geometry import Geometry, Measurements, parametrise_geometry
from framework.identification.identify import Identification, IdentifiedQuantity, Prediction, identify
from framework.identification.recording import Recording, Sensors, read_recording, record_sensors

__all__ = [
    "BaseParameters",
    "Calibration",
    "Combinations",
    "Conversions",
    "Excitation",
    "Fixture",
    "FurtherPoses",
    "Geometry",
    "Identification",
    "IdentifiedQuantity",
    "LinkParameters",
    "Measurements",
    "PeriodicMotion",
    "Prediction",
    "Recording",
    "Sensors",
    "TorqueParameters",
    "base_parameters",
    "calibrate",
    "collect_link_parameters",
    "excite",
    "identify",
    "parametrise_geometry",
    "read_recording",
    "record_sensors",
    "torque_parameters",
    "with_masses_and_motors",
]
