"""The planar 5R of the paper: a payload on massless legs, motors behind harmonic drives.

Scenes: A stays clear of the locus, B meets it without condition (8), C crosses it, C-printed keeps the
paper's rounded singular point to show the pole that 72 micrometres leave. The bow crosses it on a bend, where
the force on the platform does not vanish but stands at a right angle to t_s.
"""

from __future__ import annotations

from framework.catalogue import CatalogueEntry, own_file

ENTRY = CatalogueEntry(
    file=own_file("five_bar"),
    summary="planar 5R, 10 kg payload on massless legs",
    source="Briot and Arakelian, ASME IDETC 2010, DETC2010-28207",
    singularities=("type_1", "type_2"),
    why="The two rods that carry the platform lie in one line: nothing pushes across it, and that is t_s.",
)
