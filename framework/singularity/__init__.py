"""Singularities: their measure, loss of rank, points on a path, kinds and locus. Open `points_on_path` first.

The measure
    type2                the measure g of a pose and its gradient; the twist t_s that the motors do not hold
    bordered_system      bordered matrices, which make g smooth and give it a sign
    piecewise_measure    g along a path, as Chebyshev series on panels

Along a path
    points_on_path       singular points, classified; their shift by deflections
    rank_deficiency      all points where a matrix loses rank, found with `piecewise_measure`

At one pose
    pose_classes         every kind of singularity
    distances            distances from singularities, for design
    jogging              a robot moved by hand

The locus, as curves and surfaces
    traced_locus         curves traced from starts in a region, with cusps and branch points
    curve_tracing        the equations of the locus, and the continuation of a curve
    drawn_locus          the locus in a picture; `locus_on_map` on a map
"""

from framework.lazy_names import lazy_names

__getattr__, __dir__ = lazy_names(__name__, __file__)
