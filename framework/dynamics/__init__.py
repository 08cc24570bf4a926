"""The dynamics of a motion: generalised forces, deflections, motor torques. Open `inverse_dynamics` first.

Torques along a path, with a certificate
    inverse_dynamics        torques of a law on a path, on finer and finer grids until the series are resolved
    forces                  forces of the open tree, and the motor and spring forces that balance them
    elasticity              deflections in balance with their forces, by passes; `elastic_pass` is one pass
    restoration             balance of law and deflections by Gauss-Newton, if the passes do not converge; it
                            uses `balance_equations`, `loaded_balance` and `known_deflections`;
                            `loaded_measure` is the distance of that balance from singularity
    torque_response         first-order change of the torques of such a motion with the law
    singularity_crossings   the instants in a Type 2 singularity, with condition (8)
    residuals, near_misses  checks of the finished motion; `refusals` has the errors
    result                  the result and its certificate
    finite_differences      raw samples without a certificate

One instant
    pointwise_dynamics      torques, loads, inertia; with `reactions`, and on the locus
                            `pointwise_at_singularity`
    forward_dynamics        accelerations under given torques
    dynamics_derivatives    derivatives of torques; by inertial parameters on `body_parameters`
    forward_derivatives     derivatives of accelerations; both on `force_changes`
    tangent_stiffness       stiffness and balance with locked motors

The platform
    platform_wrench         W_p, and the wrenches that the motors can exert; `platform_limits` at one pose
    wrench, action_lines    t_s, W_p and g along a motion; the lines of the motors' forces
    open_loop               growth of errors without feedback
    motor_limits, motor_friction

At rest
    stiffness            of the platform, with locked motors
    static_fold          how soft springs may be before they give way at rest
    loading              equilibria under a growing load; `vibrations`: frequencies with free motors
"""
