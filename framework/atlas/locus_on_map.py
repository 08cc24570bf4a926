"""The singular locus within a map: where its g changes sign between neighbours that are both reached."""

from __future__ import annotations

import numpy as np

from framework.arrays import Array
from framework.atlas.workspace_map import WorkspaceMap


def locus_on_map(found: WorkspaceMap) -> list[Array]:
    """Curves (m, 2) over the map's two coordinates; none with redundant motors, whose g has no sign.

    As fine as the map: between poses g is taken as linear, which it is at the locus, to the square of a cell.
    """
    from contourpy import contour_generator

    g = found.values.get("g")
    if g is None or not np.isfinite(g).any() or not np.nanmin(g) < 0 < np.nanmax(g):
        return []
    first, second = found.window.spans
    lines = contour_generator(first, second, np.ma.masked_invalid(g).T).lines(0.0)
    return [np.asarray(line) for line in lines if len(line) > 1]
