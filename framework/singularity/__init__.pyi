from framework.singularity.jogging import (
    JoggedPose,
    LooseMotion,
    describe_jogged_pose,
    drag_platform,
    loose_motion,
    move_motor,
    move_platform,
)
from framework.singularity.locus_on_map import MapCurve, MapLocus
from framework.singularity.points_on_path import (
    SearchedPath,
    SingularPoint,
    locate_singularities,
    search_path,
)
from framework.singularity.pose_classes import Classification, classify
from framework.singularity.rank_deficiency import NearMiss
from framework.singularity.traced_locus import LocusCurve, LocusPoint, TracedLocus, trace_locus
from framework.singularity.type2 import Uncontrolled

__all__ = [
    "Classification",
    "JoggedPose",
    "LocusCurve",
    "LocusPoint",
    "LooseMotion",
    "MapCurve",
    "MapLocus",
    "NearMiss",
    "SearchedPath",
    "SingularPoint",
    "TracedLocus",
    "Uncontrolled",
    "classify",
    "describe_jogged_pose",
    "drag_platform",
    "locate_singularities",
    "loose_motion",
    "move_motor",
    "move_platform",
    "search_path",
    "trace_locus",
]
