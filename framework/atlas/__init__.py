"""Maps of a robot over its workspace, margins, and studies of its dimensions.

Open `workspace_map` first: it fills a `window` from the reference on (`survey`, `sweep`) with `quantities`,
and hands its poses to `framework.locus.locus_on_map`; `map_files` writes it. `nearest` finds the nearest
singular pose, the margin; `design_study` makes a small map for each set of dimensions.
"""
