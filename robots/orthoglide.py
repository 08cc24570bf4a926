"""The Orthoglide: a platform that never turns, on three parallelograms and three orthogonal rails.

Where it is isotropic all legs are orthogonal; in its cube of 200 mm no motor is slower than half or faster
than twice the platform. At x = y = z = 127 mm its three legs are parallel to one plane (Type 2). Scenes:
`cross` leaves the cube and passes there, `mill` stays inside, `cross-unprepared` is the crossing without
condition (8).
"""

from __future__ import annotations

from framework.catalogue import CatalogueEntry, own_file

ENTRY = CatalogueEntry(
    file=own_file("orthoglide"),
    summary="Orthoglide, three translations, parallelograms on orthogonal rails",
    source="after Chablat and Wenger, IEEE Trans. Robotics and Automation 19(3), 2003",
    singularities=("type_1", "type_2"),
    why="The three legs are parallel to one plane: nothing pushes across it, and that is t_s.",
)
