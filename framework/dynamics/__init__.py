"""The dynamics of a motion: generalised forces, deflections, motor torques. Open `inverse_dynamics` first.

Torques along a path, proved
    inverse_dynamics        from a path and a law to torques, on nodes of time doubled until they resolve
    forces                  forces of the open tree, and the motors and springs that balance them
    elasticity              deflections that their own forces cause; `elastic_pass` is one pass
    restoration             the same as a whole, law and deflections, where the passes do not find them: on
                            `balance_equations`, `loaded_balance` and `known_deflections`; `loaded_measure`
                            is where that balance is singular
    singularity_crossings   when the motion is in a Type 2 singularity, and whether condition (8) holds there
    residuals, near_misses  what is measured on the finished motion; `refusals` are the errors
    result, certificate     the result, and the numbers by which it proves itself
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
    wrench, action_lines    t_s and W_p along a motion; the lines of the motors' forces
    measure_along_path      g along a motion
    open_loop               growth of errors without feedback
    motor_limits, motor_friction
"""
