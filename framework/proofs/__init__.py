"""Proofs by interval arithmetic and continuation: modes, margins, singular sets.

No plan depends on these proofs.

Open first `assembly_modes` (all poses for given motors) or `singular_paving` (all singular poses): each leads
down to one of the tools.

answers      assembly_modes, working_modes; singular_paving; regular_ball (no singular pose about a pose)
search       leg_conditions, study_quadric: what legs ask, as systems of quadrics;
             homotopy, real_displacements: all their solutions
completeness completeness, leg_paving: no other solutions than those known
bounds       derivative_bounds over equation_terms, sharp in small boxes
existence    krawczyk: one solution in a box; passive_joints: near given motors and platform (Kantorovich)
tools        rounding, branch_and_bound, interval_newton
"""
