"""The translational 3-UPU robot with radial outer axes, as the prototype of Seoul National University.

Where its centres stand above one another (x = y = 0) the platform gains two rotations: a constraint
singularity.
Scenes: across and around, beside that axis.
"""

from __future__ import annotations

from framework.catalogue import CatalogueEntry, own_file

ENTRY = CatalogueEntry(
    file=own_file("three_upu"),
    summary="translational 3-UPU, ball screws",
    source="Tsai, ARK 1996; Bonev and Zlatanov, parallemic.org, Review 4",
    singularities=("constraint",),
)
