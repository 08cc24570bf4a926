"""Condition (8) put to work: laws that carry a robot through its Type 2 singularities.

Open `plan` first: `plan_crossing` in four steps.

    1. options, request          the declaration of all options, and the checked record of one request
    2. crossing_points           the points of the path where condition (8) is to hold
       condition                 condition (8) there: alpha s" + beta s'^2 + gamma + delta s' = 0
       crossing_tracker          the same points of the deflected robot, followed from pass to pass
    3. polynomial                the paper's law: one polynomial, with times and speeds of its crossings
       raised_polynomial         one of higher degree, where that one turns back at given times
       optimal/                  the law of free shape: the cone program
    4. result                    a plan: law, crossings, torques (of `dynamics.inverse_dynamics`), certificate

One record follows a crossing: the search of the path makes a `SingularPoint`, `crossing_points` adds its
condition (8), and the motion makes of it a `SingularityCrossing` with instant, s', s" and t_s . W_p.

Beside them, `refusals` lists every reason to refuse a plan, and `remedies` tries what is advised then.
`feasibility` computes the acceleration that a singular point requires of any law, and the least duration.
`path_modification` bends a path where nothing else helps. `neglected_effects` measures the torques that a
plan leaves out, by another model on the same motion; `motor_use` measures the shares of the limits that
motors use. `scenes` plans the scenes of a robot file, `plan_study` one motion for many values of
parameters. `chain` begins plans on the way of others and joins plans; `joint_path` leads into other
working modes. `saved` and `motion_table` write and read plan.json and motion.csv. `plan_facts` describes
a plan in words. `planar_crossing` samples one crossing for a lesson.
"""

from framework.lazy_names import lazy_names

__getattr__, __dir__ = lazy_names(__name__, __file__)
