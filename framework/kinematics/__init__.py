"""The kinematics of a mechanism. Open `linearised_loops` first: everything else uses F(q) = 0 and dF/dq.

What a robot is
    tree_model          pinocchio's model of the open tree; names and limits of its coordinates
    mechanism           a tree with its loop equations, which need not be closed
    parallel_robot      a mechanism with closed loops, a platform and motors; the checks at its construction;
                        the table of its equations and the sparsity pattern of dF/dq
    platform, attitude  the platform's coordinates x and its velocity v; charts of SO(3)
    assembly            closes the loops at the reference
    loop_structure      which loop equations are redundant, which joints are idle
    rounded_loops       loop equations that are redundant except for rounded dimensions

The equations, for stacks of configurations
    pinocchio_memory    pinocchio's working memory as arrays
    frames              poses, screws and motions of frames; steps between configurations
    closures            the loop equations, their derivatives and drift
    single_pose         the loop equations of one configuration at a time, for control cycles
    linearised_loops    F and dF/dq at given configurations

From the platform to the joints, and back
    inverse_kinematics  all joints at prescribed x, or passive joints at prescribed motor joints
    motion_rates        velocities and accelerations of all joints; time derivatives of dF/dq
    motion_changes      exact derivatives of motions; `frame_variations`: of frames and loop forces
    loop_matrices       the dimensionless matrices of Type 1 and Type 2
    kinematic_derivatives   derivatives of pose, A, B, C along motors and springs
    velocity_matrices   A v = B dq_a + C dq_e
    idle_turns          turns that neither the platform nor the loops determine
    modes               signs of working and assembly modes; legs
    continuation/       follows branches along paths, and with the motors (forward kinematics)

For the user
    pose, placements    a pose by the names of the robot file; where joints and frames are drawn
    diagnostics/        `check`: mobility, search for closed poses, advice
"""
