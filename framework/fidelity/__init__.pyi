from framework.fidelity.capacity import Capacity, largest_load
from framework.fidelity.fidelity_study import FidelityStudy, fidelity_study
from framework.fidelity.model_comparison import Comparison
from framework.fidelity.predicted_level import ChosenLevel, Indicators, LevelError, predict_level

__all__ = [
    "Capacity",
    "ChosenLevel",
    "Comparison",
    "FidelityStudy",
    "Indicators",
    "LevelError",
    "fidelity_study",
    "largest_load",
    "predict_level",
]
