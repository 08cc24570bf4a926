"""Maps of a robot over its workspace, margins, and studies of its dimensions.

Open `workspace_map` first. It reaches the poses of a window from the reference (`survey`, `sweep`), computes
`quantities` at these poses, and passes them to `framework.singularity.locus_on_map`. `map_files` writes the
map. `design_study` computes a small map for each set of dimensions. `nearest` finds the nearest singular
pose, and the pose nearest to a platform target out of reach. `nonsingular_mode_change` changes the assembly
mode by a loop of the motors around a cusp. `transmission` describes a linkage as a transmission between
motors and the joints of a platform.
"""

from framework.lazy_names import lazy_names

__getattr__, __dir__ = lazy_names(__name__, __file__, ("design_study", "transmission", "workspace_map"))
