"""Proofs by interval arithmetic and homotopy continuation: modes, margins and singular sets.

No plan depends on these proofs.

Open first `assembly_modes` (all poses for given motor joints) or `singular_paving` (all singular poses): both
lead down to the tools.

answers    assembly_modes, working_modes; singular_paving; regular_ball (a ball without singular poses)
systems    study_quadric: the conditions of the legs, as quadrics in displacements;
           homotopy: all solutions of these quadrics
complete   leg_solutions: all configurations leg by leg, those that show the same once;
           leg_paving: a leg has no solutions besides the known ones
bounds     derivative_bounds over equation_terms: equations and derivatives in boxes of joints
existence  krawczyk: one solution in a box;
           passive_joints: one solution near given motors or a given platform pose
uses       converted_reference: the reference of a converted file, with words for its other modes
tools      rounding, branch_and_bound, interval_newton
"""

from framework.lazy_names import lazy_names

__getattr__, __dir__ = lazy_names(__name__, __file__, ("assembly_modes", "working_modes"))
