"""The kinematics of a mechanism. Open `linearised_loops` first: all here is made of F(q) = 0 and dF/dq.

What a robot is
    tree_model          pinocchio's tree, the names of its coordinates, their limits
    mechanism           a tree and its loops, not yet closed
    parallel_robot      a mechanism that closes, with platform and motors: what is proved when it is made; the
                        table of its equations and where dF/dq has entries
    platform, attitude  the platform's coordinates x and its velocity v; charts of SO(3)
    assembly            the loops closed at the reference
    loop_structure      which loop equations repeat others, which joints move nothing
    rounded_loops       loops of rounded dimensions that nearly repeat others

The equations, for stacks of configurations
    pinocchio_memory    pinocchio's working memory as arrays
    frames              poses, screws and motions of the frames; steps between configurations
    closures            the loop equations, their derivatives and drift
    single_pose         the loop equations of one configuration after another, for control cycles
    linearised_loops    F and dF/dq at given configurations

From the platform to the joints, and back
    inverse_kinematics  all joints at prescribed x, or the passive ones at prescribed motors
    motion_rates        velocities and accelerations of all joints; how dF/dq changes
    motion_changes      exact derivatives of these; `frame_variations` are those of frames and loop forces
    loop_matrices       the matrices of Type 1 and Type 2, without dimension
    kinematic_derivatives   pose, A, B, C along motors and springs
    velocity_matrices   A v = B dq_a + C dq_e
    idle_turns          turns that neither the platform nor the loops determine
    modes               signs of working and assembly modes, legs
    continuation/       branches followed: along paths, and with the motors (forward kinematics)

What people ask of a pose
    pose, placements    in the words of the robot file; where joints and frames are drawn
    diagnostics/        `check`: mobility, closed poses searched for, advice
"""
