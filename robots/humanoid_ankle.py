"""The two-motor ankle of a humanoid: pitch and roll of the foot by two cranks and rods.

Scenes: `swing` of a step, `tilt` from edge to edge. Its Type 2 singularity, with the rods in line with the
pitch axis, lies at 62 degrees of pitch, beyond the 20 that its stops allow.
"""

from __future__ import annotations

from framework.catalogue import CatalogueEntry, own_file

ENTRY = CatalogueEntry(
    file=own_file("humanoid_ankle"),
    summary="ankle of a humanoid, pitch and roll by two motors in the shank",
    source="left ankle of the Booster T1, model T1_23dof_parallel.xml of github.com/IkuoShige/booster_assets",
    why="Both rods are in line with the pitch axis: they push through it and cannot turn the foot.",
)
