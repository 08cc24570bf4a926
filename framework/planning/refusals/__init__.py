"""All reasons to refuse a plan, in the order in which they are checked.

Each entry has the error, the reason, and below them the functions that decide, in this package or a lower
one, without the prefix `framework.`. Invalid options are refused earlier, by an InvalidInput of
`planning.options` or `planning.request`. Open `refusal_proofs` for the numbers on which a refusal rests;
`turning_back` refuses laws that run backwards or leave the path; `planning.plan` adds the remedy.

On the path, springs at rest:

    NotAssembled: the loops do not close at the reference, or far from it
        kinematics.assembly.close_reference
    OutOfReach: the path leaves the workspace
        kinematics.continuation.tracking.track_path
    Type1Singularity: a leg is stretched or folded on the path
        kinematics.continuation.tracking.track_path
        singularity.points_on_path.search_path
    SingularPath: the path runs along the singular locus
        singularity.piecewise_measure.resolve_panels
    NotConverged: g is not resolved, or needs dropped loop equations
        singularity.piecewise_measure.resolve_panels
        singularity.points_on_path.search_path

At a singular point:

    UncontrolledMotions: motions escape that cannot be told apart
        singularity.points_on_path.search_path
        kinematics.continuation.tracking.escape_error
    NoLaw: a singular point is not of Type 2
        dynamics.singularity_crossings.check_kind
    UncontrolledMotions: several motions escape, not all across the locus
        dynamics.singularity_crossings.check_kind
        kinematics.continuation.tracking.escape_error
    NoLaw: the path starts or ends on the locus
        planning.crossing_points.check_crossable

The polynomial law:

    NoLaw: a touch, or several motions: more than one condition
        planning.crossing_points.check_one_condition_each
    NoLaw: the path is orthogonal to t_s: s" has no effect on t_s . W_p
        planning.condition.require_effect
    NoLaw: too many crossings, or no times and speeds at which a law advances
        planning.timing.choose_timing
    NoLaw: the conditions on the polynomial repeat or contradict each other
        planning.polynomial.plan_polynomial
    NoLaw: the law runs back or leaves the path
        planning.refusals.turning_back.check_advance

The optimal law:

    NoLaw: deflections turn a tangential touch into two crossings, or into none
        planning.optimal.optimal_task.check_single_crossings
    NoLaw: springs and damping with redundant motors or rigid geometry
        planning.optimal.optimal_motion.optimal_motion
    NoLaw: s" has no effect, and no speed meets condition (8)
        planning.optimal.optimal_task.check_speeds
    UncontrolledMotions: no law meets the conditions of several motions
        planning.optimal.optimal_task.check_speeds
        kinematics.continuation.tracking.escape_error
    NoLaw: a motor cannot hold an end of the path, or limits are too low
        planning.optimal.undeformed_law.refuse_law
    NotConverged: no law is found, although the limits are not the reason
        planning.optimal.undeformed_law.refuse_law
    NotConverged: law and damping do not settle
        planning.optimal.undeformed_law.find_law
    NoLaw: the springs give way at an end, at rest
        planning.optimal.optimal_motion.optimal_motion
    NotConverged: law and springs do not settle together
        planning.optimal.optimal_motion.optimal_motion
    NotConverged: springs do not start or stop at rest
        planning.optimal.rest_of_springs.check_rest

The motion, under either law or one of the user's own:

    NoLaw: the motion stops on the locus
        dynamics.singularity_crossings.rigid_crossings
    UnboundedTorque: condition (8) is not met: t_s . W_p is not zero at a crossing
        dynamics.singularity_crossings.check_bounded
    NoLaw: the deflected robot has no singular point near the crossing
        planning.condition.crossing_point
    NotConverged: deflected, the path is orthogonal to t_s: s" has no effect
        planning.condition.condition_at
    NotAssembled: loops do not close along the motion, or rates do not exist
        kinematics.inverse_kinematics.close_loops
        kinematics.motion_rates.motion_at
    NotConverged: no deflections found in equilibrium with their forces
        dynamics.elasticity.solve_deflections
        dynamics.motion_checks.unsettled_error
    NotConverged: no law near this one has deflections in balance
        dynamics.restoration.solve_balance
        planning.optimal.elastic_balance.find_law_in_balance
    SpringsTooSoft: even much stiffer springs would deflect beyond the range of the model
        dynamics.restoration.solve_balance
    NotConverged: springs tear the loops open
        dynamics.inverse_dynamics.resolve
    NotConverged: torques, deflections or a near miss are not resolved
        dynamics.motion_checks.unresolved_error
    NoLaw: the deflected robot meets a singularity that the undeformed robot does not
        dynamics.singularity_crossings.check_crossings
    NotAssembled: the motion opens a loop equation that was redundant at the reference
        dynamics.motion_checks.measure_residuals
    LoadedJoint: a joint is loaded that nothing holds
        dynamics.motion_checks.check_idle_joints

The plan:

    NoLaw: the polynomial that was asked for exceeds the limits of the file
        planning.plan.plan_request
    NoLaw: neither law is found; the message has both reasons
        planning.plan.plan_request
        planning.plan.with_explanation
    NotConverged: neither law is resolved; the message has both reasons
        planning.plan.plan_request
    LimitsExceeded: the plan exceeds limits although `keep_limits` is set
        planning.plan.check_limits
"""
