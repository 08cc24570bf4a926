"""Two arms that carry one box, the box the platform: a parallel robot declared by a robot file alone.

Both hands are rigid with the box; 12 motors share the load of 6 degrees of freedom, none is passive. Scenes:
lift and turn the box.
"""

from __future__ import annotations

from framework.catalogue import CatalogueEntry, own_file

ENTRY = CatalogueEntry(
    file=own_file("two_arms"),
    summary="Baxter's arms with one box in both hands, 12 motors for 6 degrees of freedom; needs "
    "example-robot-data",
    source="Baxter of Rethink Robotics; URDF of example-robot-data 6",
)
