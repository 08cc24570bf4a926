"""A Delta robot as Tsai built it: each parallelogram of four hinges, on two hinges parallel to the motor's.

No fixed choice of its loop equations suffices in all poses. With all elbows outward no Type 2 singularity was
found in its workspace. Scenes: `pick` and its mirror image.
"""

from __future__ import annotations

from framework.catalogue import CatalogueEntry, own_file

ENTRY = CatalogueEntry(
    file=own_file("delta_hinges"),
    summary="Delta, three translations, hinges throughout",
    source="after Tsai, Walsh and Stamper, ICRA 1996, not checked against the original; own dimensions",
)
