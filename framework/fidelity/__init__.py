"""The least model of a robot that is enough for a motion.

Open `fidelity_study` first. The levels are data in `framework.model.fidelity_levels`. `level_motions`
computes the torques of each level along one motion, `model_comparison` simulates them in the highest model,
and `fidelity_indicators` predicts the least sufficient level without simulation. `capacity` finds the largest
load that still crosses within the limits.
"""
