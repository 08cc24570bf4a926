"""The least model of a robot that is enough for a motion.

Open `fidelity_study` first. The levels are data in `framework.model.fidelity_levels`. `fidelity_indicators`
computes the torques of each level along one motion, and estimates the errors of each without simulation;
`model_comparison` simulates them in the highest model; `chosen_level` is the level to plan with. `capacity`
finds the largest load that still crosses within the limits.
"""
