"""Bricard's mechanism of the IFToMM multibody benchmarks: a ring of six hinges that Gruebler calls rigid.

Five rods and the ground; driven at the first hinge. Scenes: fold, and dead_point, where the first hinge
turns back while all others go on: a Type 2 singularity.
"""

from __future__ import annotations

from framework.catalogue import CatalogueEntry, own_file

ENTRY = CatalogueEntry(
    file=own_file("bricard"),
    summary="overconstrained ring of six hinges, one drive",
    source="IFToMM multibody benchmark A04, Bricard's mechanism",
    singularities=("type_1", "type_2"),
    why="The driven hinge turns back here: it stands still while every second hinge turns on, unheld.",
)
