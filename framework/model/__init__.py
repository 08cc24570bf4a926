"""The description of a robot. Open `description` first, whose records readers make and all packages use.

The records
    description         robot, closures, springs, levels, scenes, external wrenches: frozen, without a file
    loop_rows           closures as scalar loop equations
    placement           rigid placements as 4 x 4 matrices

The robot file (YAML)
    robot_file          read a robot file and its URDF
    robot_keys          the keys of a robot file, one table a mapping
    parameters          named parameters, `${...}`
    robot_file_writer   write a description

The URDF
    urdf_elements       joints and links in a tree; locate a URDF, read and check it
    visuals             read its solids
    urdf_edits          edit a tree for a robot file and for springs; write it as a URDF
    documents           parse XML and YAML within limits; attributes of an element

Springs
    beams               stiffness of a link from its section and material

Files of other programs
    readers/            one module for each dialect
"""

from framework.lazy_names import lazy_names

__getattr__, __dir__ = lazy_names(__name__, __file__)
