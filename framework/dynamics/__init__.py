"""The dynamics of a motion: generalised forces, deflections, motor torques. Open `inverse_dynamics` first.

Torques along a path, proved
    inverse_dynamics        from a path and a law to torques, on nodes of time doubled until they resolve
    forces                  forces of the open tree, and the motors and springs that balance them
    elasticity              deflections in balance with their forces; `elastic_pass` is one pass
    restoration             the same as a whole, law and deflections, if the passes do not converge: on
                            `balance_equations`, `loaded_balance` and `known_deflections`; `loaded_measure`
                            measures the distance of that balance from singularity
    torque_response         torques beside such a motion, linear in the law
    singularity_crossings   instants in a Type 2 singularity, and condition (8) at these
    residuals, near_misses  measured on the finished motion; `refusals` are the errors
    result                  the result, with the numbers by which it proves itself
    finite_differences      raw samples without a proof

One instant
    pointwise_dynamics      torques, loads, inertia; with `reactions`, and on the locus
                            `pointwise_at_singularity`
    forward_dynamics        accelerations of given torques
    dynamics_derivatives    derivatives of torques; along inertial parameters on `body_parameters`
    forward_derivatives     derivatives of accelerations; both on `force_changes`
    tangent_stiffness       stiffness and balance with locked motors

The platform
    platform_wrench         W_p, and the wrenches that the motors can give; `platform_limits` at one pose
    wrench, action_lines    t_s, W_p and g along a motion; the lines of the motors' forces
    open_loop               growth of errors without feedback
    motor_limits, motor_friction

At rest
    stiffness            of the platform, with locked motors
    static_fold          how soft springs may be before they give way at rest
    loading              a load put on little by little; `vibrations` has the frequencies with free motors
"""
