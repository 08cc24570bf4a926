"""The planar 5R of the paper with rods of 1 kg: condition (8) must see the inertia of the legs."""

from __future__ import annotations

from framework.catalogue import CatalogueEntry, own_file

ENTRY = CatalogueEntry(
    file=own_file("five_bar_heavy"),
    summary="planar 5R, 10 kg payload on uniform rods of 1 kg",
    source="the same, with our own rods",
    singularities=("type_1", "type_2"),
    why="The two rods that carry the platform lie in one line: nothing pushes across it, and that is t_s.",
)
