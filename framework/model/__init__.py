"""The description of a robot. Open `description` first: readers make its records, all else starts there.

The records
    description         robot, closures, springs, scenes: frozen, without a file
    loop_rows           closures as scalar loop equations
    placement           rigid placements as 4 x 4 matrices
    fidelity_levels     which parts of a robot a model keeps
    frame_wrench        a wrench at a frame, constant or a table

The robot file (YAML)
    robot_file          read a robot file and its URDF
    robot_keys          the keys of a robot file, one table a mapping
    parameters          named parameters, `${...}`
    robot_file_writer   write a description

The URDF
    urdf_elements       where it is; its joints, links and inertias, read and checked
    visuals             the solids that it shows
    urdf_edits          its elements, written; changes by a robot file, by springs, and for pinocchio
    documents           XML and YAML within limits; attributes of an element

Springs
    beams               stiffness of a link from its section and material

Files of other programs
    readers/            one file a dialect
"""

from framework.model.robot_file import read_robot_file

__all__ = ["read_robot_file"]
