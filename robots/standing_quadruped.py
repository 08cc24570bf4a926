"""A quadruped on its four feet, its trunk the platform: a parallel robot declared by a robot file alone.

The feet are points on the ground; 12 motors hold 6 degrees of freedom, and their torques are those of least
norm. Scenes: lower crouches and leans; sway moves the trunk on a curve.
"""

from __future__ import annotations

from framework.catalogue import CatalogueEntry, own_file

ENTRY = CatalogueEntry(
    file=own_file("standing_quadruped"),
    summary="Solo12 standing on four feet, 12 motors for 6 degrees of freedom; needs example-robot-data",
    source="Grimminger et al., IEEE RA-L 5(2), 2020, 10.1109/LRA.2020.2976639; URDF of example-robot-data 6",
)
