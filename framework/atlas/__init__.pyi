from framework.atlas.design_study import (
    Designs,
    DesignStudy,
    StudyTask,
    design_study,
    read_designs,
    write_study,
)
from framework.atlas.map_files import write_map
from framework.atlas.nearest import NearestSingularPose, nearest_pose, nearest_singular_pose
from framework.atlas.nonsingular_mode_change import AssemblyModeChange, find_mode_change
from framework.atlas.quantities import Quantity
from framework.atlas.survey import Window, survey_window
from framework.atlas.sweep import PoseReason
from framework.atlas.transmission import LinkageTransmission, MappingError, transmission
from framework.atlas.workspace_map import WorkspaceMap, workspace_map

__all__ = [
    "AssemblyModeChange",
    "DesignStudy",
    "Designs",
    "LinkageTransmission",
    "MappingError",
    "NearestSingularPose",
    "PoseReason",
    "Quantity",
    "StudyTask",
    "Window",
    "WorkspaceMap",
    "design_study",
    "find_mode_change",
    "nearest_pose",
    "nearest_singular_pose",
    "read_designs",
    "survey_window",
    "transmission",
    "workspace_map",
    "write_map",
    "write_study",
]
