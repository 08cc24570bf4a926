"""Clavel's Delta robot with real parallelograms, in the dimensions of a FlexPicker.

With all elbows outward no Type 2 singularity was found in its workspace; the reference has the arm of leg 1
folded across the base. Scenes: `pick` clear of the locus, `cross` through the place where the three forearms
are parallel to one plane, `cross-unprepared` the same path without condition (8).
"""

from __future__ import annotations

from framework.catalogue import CatalogueEntry, own_file

ENTRY = CatalogueEntry(
    file=own_file("delta"),
    summary="Delta, three translations, six rods in parallelograms",
    source="Williams, The Delta Parallel Robot, Ohio University 2015: ABB FlexPicker IRB 360-1/1600",
    singularities=("type_2",),
    why="The three pairs of rods are parallel to one plane: nothing pushes across it, and that is t_s.",
)
