"""A four-bar linkage driven at its rocker: where crank and coupler are aligned the motor has no hold.

Scenes: dead_point and full_turn cross one and two such points, clear none; unprepared has a pole.
"""

from __future__ import annotations

from framework.catalogue import CatalogueEntry, own_file

ENTRY = CatalogueEntry(
    file=own_file("four_bar"),
    summary="four-bar linkage turned by its rocker, flywheel on the crank",
    source="lengths of Norton, Design of Machinery, Example 4-1; own masses",
    singularities=("type_2",),
    why="Crank and coupler lie in one line: the coupler pushes through the crank's axis and cannot turn it.",
)
