"""Maps of a robot over its workspace, margins, and studies of its dimensions.

Open `workspace_map` first: it reaches the poses of a `window` from the reference (`survey`, `sweep`),
computes `quantities` there and gives the poses to `framework.locus.locus_on_map`; `map_files` writes the map.
`nearest` finds the nearest singular pose, the margin; `design_study` makes a small map for each set of
dimensions.
"""
