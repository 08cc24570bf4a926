"""Maps of a robot over its workspace, margins, and studies of its dimensions.

Open `workspace_map` first: it reaches the poses of a window from the reference (`survey`, `sweep`), computes
`quantities` there and gives the poses to `framework.singularity.locus_on_map`; `map_files` writes the map.
`design_study` makes a small map for each set of dimensions. `nearest` finds the nearest singular pose;
`nearest_pose` the pose nearest to a platform out of reach; `nonsingular_mode_change` leads the motors around
a cusp.
"""
