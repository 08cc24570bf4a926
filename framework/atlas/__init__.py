"""Maps of a robot over its workspace, margins, and studies of its dimensions.

Open `workspace_map` first: it reaches the poses of a `window` from the reference (`survey`, `sweep`),
computes `quantities` there and gives the poses to `framework.singularity.locus_on_map`; `map_files` writes
the map. `nonsingular_mode_change` leads the motors around a cusp.
`nearest` finds the nearest singular pose, the margin; `design_study` makes a small map for each set of
dimensions.
"""
