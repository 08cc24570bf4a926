"""The dynamics of a motion: generalised forces, deflections, motor torques. Open `inverse_dynamics` first.

Torques along a path, with a certificate
    inverse_dynamics        torques of a law on a path, on finer and finer grids until the series are resolved
    forces                  forces of the open tree, the motor and spring forces that balance them, and their
                            first-order changes
    path_forces             the same along a path, as coefficients of s" and s'
    elasticity              deflections in balance with their forces, by passes
    restoration             balance of law and deflections by Gauss-Newton, if the passes do not converge; it
                            uses `balance_equations`, `loaded_balance` and `deflection_splines`;
                            `loaded_measure` is the distance of that balance from singularity
    torque_response         first-order change of the torques of such a motion with the law
    singularity_crossings   the instants in a Type 2 singularity, with condition (8)
    torque_distribution     how redundant motors share the load of a motion
    motion_checks           checks of the finished motion, and the errors if it is not resolved
    result                  the result and its certificate
    finite_differences      raw samples without a certificate

One instant
    pointwise_dynamics      torques of a prescribed motion, also on the locus, and their derivatives by motion
                            and, on `body_parameters`, by inertial parameters
    forward_dynamics        accelerations under given torques, and their derivatives
    instant                 the record of both: loads of loops and joints, inertia
    tangent_stiffness       stiffness and balance with locked motors

The platform
    platform_wrench         W_p, t_s and g; the wrenches of the motors, the lines along which they act, and
                            the admissible wrenches and speeds at one pose
    open_loop               growth of errors without feedback
    motor_limits, drive_limits, motor_friction

At rest
    stiffness               of the platform with locked motors; natural frequencies
    vibrations              along a path, and the response to motor torques
    static_fold             how soft springs may be before they give way at rest
    loading                 equilibria under a growing load
"""

from framework.lazy_names import lazy_names

__getattr__, __dir__ = lazy_names(__name__, __file__)
