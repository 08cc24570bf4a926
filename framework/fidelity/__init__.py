"""The least model of a robot that is enough for a motion.

Open `fidelity_study` first. The levels are data in `framework.model.fidelity_levels`. `model_comparison`
simulates the torques of each level in the highest model; `fidelity_indicators` predicts the least sufficient
level without simulation.
"""
