"""The least detailed model of a robot that is enough for a motion.

Open `fidelity_study` first. `framework.model.description` declares the levels. `predicted_level` computes
the torques of each level along one motion, estimates their errors without simulation, and chooses the level
to plan with. `model_comparison` simulates the torques in the highest model. `capacity` finds the largest load
with which the robot still crosses within its limits.
"""

from framework.lazy_names import lazy_names

__getattr__, __dir__ = lazy_names(__name__, __file__, ("fidelity_study",))
