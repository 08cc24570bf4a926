"""The singular locus as curves and surfaces: traced, drawn, with its special points.

Open `traced_locus` first: it searches starts in a region, has `curve_tracing` follow curves of
`locus_equations`, and finds their cusps and branch points. `drawn_locus` draws it;
`nonsingular_mode_change` leads the motors around a cusp. `locus_on_map` traces it over a map.
"""
