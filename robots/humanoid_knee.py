"""The four-bar knee of a humanoid: bent too far, its rod points at the knee and the motor loses hold of it.

Scenes: `deep` through that flexion, `swing` clear of it, `unprepared` without condition (8).
"""

from __future__ import annotations

from framework.catalogue import CatalogueEntry, own_file

ENTRY = CatalogueEntry(
    file=own_file("humanoid_knee"),
    summary="knee of a humanoid, bent by a motor in the thigh through a four-bar linkage",
    source="masses and motor of the Booster T1, github.com/BoosterRobotics/booster_assets; own linkage",
    singularities=("type_2",),
    why="The rod points at the axis of the knee: it pushes through it and cannot bend the leg.",
)
