"""Par4: four legs in pairs on two half plates, whose bars turn the tool; motions of pick and place.

The parallelogram of each forearm is one rod between universal joints of parallel axes. Scenes: `cross`
turns the bars, going up, through a pose near a quarter turn where the legs no longer hold their angle (Type
2), `pick` stays clear of it, `cross-unprepared` is the crossing without condition (8).
"""

from __future__ import annotations

from framework.catalogue import CatalogueEntry, own_file

ENTRY = CatalogueEntry(
    file=own_file("par4"),
    summary="Par4, three translations and a turn about z, articulated plate",
    source="mechanism of Nabat, Rodriguez, Company, Krut and Pierrot, IROS 2005",
    singularities=("type_2",),
    why="The motion t_s, a shift with a turn of the bars, changes the length of none of the four "
    "forearms: nothing holds it.",
)
