"""The Diamond as built: two translations by two legs of two parallelograms each, hinges throughout.

No fixed choice of its loop equations suffices in all poses. Scenes: `cross` through the place where the
rods of both legs lie in one line, `cross-unprepared` without condition (8), `pick` and its mirror image.
"""

from __future__ import annotations

from framework.catalogue import CatalogueEntry, own_file

ENTRY = CatalogueEntry(
    file=own_file("diamond"),
    summary="Diamond, two translations, four parallelograms of hinges",
    source="after Huang, Li, Li, Chetwynd, Gosselin, J. Mech. Design 126, 2004, not checked; own dimensions",
    singularities=("type_2",),
    why="The rods of both legs lie in one line: nothing holds the platform across it, and that is t_s.",
)
