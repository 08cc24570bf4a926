"""Singularities: their measure, rank deficiency, points on a path, classes. Open `points_on_path` first.

The measure
    type2                the measure g of one pose, and the twist t_s that the motors do not hold
    bordered_system      bordered matrices, by which g is smooth and has a sign
    piecewise_measure    g along a path, as Chebyshev series on panels

Along a path
    points_on_path       singular points, classified
    rank_deficiency      all places where a matrix loses rank; `piecewise_measure` its tool
    spring_shift         how far deflections move a singular point

At one pose
    pose_classes         every kind of singularity
    distances            distances from singularities, for design
    jogging              a robot moved by hand

The locus, as curves and surfaces
    traced_locus         traced from starts in a region; its cusps and branch points
    curve_tracing, locus_equations  a curve followed, and the equations that it obeys
    drawn_locus          on a picture; `locus_on_map` over a map
"""
