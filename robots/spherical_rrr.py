"""A spherical 3-RRR: the Agile Eye with arcs of 60 instead of 90 degrees at the motors.

Scenes: `cross` through the orientation where the planes of the three distal arcs meet in a line (Type 2),
`clear` away from it, `cross-unprepared` the crossing without condition (8).
"""

from __future__ import annotations

from framework.catalogue import CatalogueEntry, own_file

ENTRY = CatalogueEntry(
    file=own_file("spherical_rrr"),
    summary="spherical 3-RRR, three rotations, arcs of 60 and 90 degrees",
    source="after Gosselin and Hamel, ICRA 1994, with shorter arcs",
    singularities=("type_2",),
    why="The planes of the three distal arcs meet in one line: nothing turns the platform about it.",
)
