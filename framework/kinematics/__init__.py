"""The kinematics of a mechanism. Open `linearised_loops` first: everything else uses F(q) = 0 and dF/dq.

What a robot is
    tree_model          pinocchio's model of the open tree; names and limits of its coordinates
    mechanism           a tree with its loop equations, which need not be closed
    parallel_robot      a mechanism with closed loops, a platform and motors; the checks at its construction;
                        the table of its equations and the sparsity pattern of dF/dq
    platform, attitude  the platform's coordinates x and its velocity v; charts of SO(3)
    assembly            closes the loops at the reference
    assembly_search     closes them within the joints' limits, from several starts, also near a platform pose
    loop_structure      which loop equations are redundant, exactly or except for rounding; idle joints
    loop_ranges         bases of the equations where that changes along a path

The equations, for stacks of configurations
    frames              poses, screws and motions of frames, by pinocchio; steps between configurations
    closures            the loop equations, their derivatives and drift
    couplings           those that are polynomials in joints' coordinates
    linearised_loops    F and dF/dq at given configurations; the dimensionless matrices of Type 1 and Type 2

From the platform to the joints, and back
    inverse_kinematics  all joints at prescribed x, or passive joints at prescribed motor joints; idle turns
    motion_rates        velocities and accelerations of all joints; their exact derivatives
    velocity_matrices   A v = B dq_a + C dq_e; derivatives of pose, A, B, C along motors and springs
    external_wrenches   wrenches of the environment on bodies, and their joint forces
    line_springs        springs and dampers between two points, and their joint forces
    modes               signs of working and assembly modes; legs
    continuation/       follows branches along paths, and with the motors (forward kinematics)

For the user
    placements          where joints and frames are drawn
    diagnostics/        `check`: mobility, advice; a pose by the names of its file
"""

from framework.lazy_names import lazy_names

__getattr__, __dir__ = lazy_names(__name__, __file__)
