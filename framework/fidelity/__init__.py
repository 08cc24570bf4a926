"""The least detailed model of a robot that is enough for a motion.

Open `fidelity_study` first. `framework.model.fidelity_levels` declares the levels. `fidelity_indicators`
computes the torques of each level along one motion and estimates the errors of each level without simulation.
`model_comparison` simulates the torques in the highest model. `chosen_level` chooses the level to plan with.
`capacity` finds the largest load with which the robot still crosses within its limits.
"""
