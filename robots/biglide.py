"""The biglide, a planar 2-PRR robot: actuated sliders on two rails, rods that meet at the end effector.

Scenes: across and bow pass the line where the rods are aligned (Type 2), clear stays beside it, unprepared
has a pole. The workspace ends where a rod is normal to its rail (Type 1).
"""

from __future__ import annotations

from framework.catalogue import CatalogueEntry, own_file

ENTRY = CatalogueEntry(
    file=own_file("biglide"),
    summary="planar 2-PRR, two sliders on parallel rails",
    source="biglide of Centrale Nantes, github.com/oKermorgant/gz_attach_links; own motors and springs",
    singularities=("type_1", "type_2"),
    why="The two rods that carry the platform lie in one line: nothing pushes across it, and that is t_s.",
)
