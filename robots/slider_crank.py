"""A slider-crank driven at its slider: at the dead centres, crank and rod aligned, the slider has no hold.

Scenes: dead_centre and full_turn cross one and two of them, clear none; unprepared has a pole. Driven at the
crank, with the slider as platform, the same dead centres are Type 1: the slider's path ends there.
"""

from __future__ import annotations

from framework.catalogue import CatalogueEntry, own_file

ENTRY = CatalogueEntry(
    file=own_file("slider_crank"),
    summary="slider-crank turned by its slider, flywheel on the crank",
    source="lengths of Norton, Design of Machinery, Example 4-2; own masses",
    singularities=("type_1", "type_2"),
    why="Crank and rod lie in one line: the rod pushes through the crank's axis and cannot turn it.",
)
