"""The N-four-bar mechanism of the IFToMM multibody benchmarks, N = 2, driven at its first rod.

One degree of freedom, planar and overconstrained when built with hinges. Where all its members lie on
one line every loop loses a rank: a singularity of the closures, not of Type 2. Scene: swing, away from it.
Other N: `robots.generators.n_four_bar`.
"""

from __future__ import annotations

from framework.catalogue import CatalogueEntry, own_file

ENTRY = CatalogueEntry(
    file=own_file("n_four_bar"),
    summary="row of two four-bars, overconstrained, one drive",
    source="IFToMM multibody benchmark A02, N-four-bar",
    singularities=("closure",),
)
