"""Condition (8) put to work: laws that carry a robot through its Type 2 singularities.

Open `plan` first: `plan_crossing` in four steps.

    1. options, request          what is asked: the options declared once, and the record that is checked
    2. crossing_points           where on the path condition (8) is to hold, and
       condition                 condition (8) there: alpha s" + beta s'^2 + gamma = 0
    3. polynomial, timing        the paper's law: one polynomial through the crossings, when and how fast
       optimal/, specification   the law of free shape: the cone program, and what it is best at
    4. result                    a plan: law, crossings, torques (of `dynamics.inverse_dynamics`), certificate

Beside them: `refusals/` has every reason to say no; `feasibility` says what a singular point asks of any
law, and the least duration of one; `path_modification` bends a path where nothing else helps;
`neglected_effects` is what a plan leaves out, measured by `model_on_motion`, the torques of another model;
`scenes` plans the scenes of a robot file, `plan_study` one motion for many values of its parameters; `saved`
and `motion_table` are plan.json and motion.csv; `plan_facts` is a plan in words; `planar_crossing` samples
one crossing for the lesson; `motion_scales` has the sizes that errors are relative to.
"""
