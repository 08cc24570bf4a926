"""The Agile Eye: a camera that turns about a point, all neighbouring axes of its three legs orthogonal.

It has no surface of Type 2 singularities, only curves on which a leg is stretched or folded (Type 1) as well:
no scene crosses one. `spherical_rrr`, its sister with shorter arcs, does. Scenes: `orient`, `sweep`.
"""

from __future__ import annotations

from framework.catalogue import CatalogueEntry, own_file

ENTRY = CatalogueEntry(
    file=own_file("agile_eye"),
    summary="Agile Eye, spherical 3-RRR, three rotations, all arcs of 90 degrees",
    source="Gosselin and Hamel, ICRA 1994; Bonev, Chablat and Wenger, ICRA 2006",
    singularities=("type_1",),
)
