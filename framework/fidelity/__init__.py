"""The least model of a robot that is enough for a motion.

Open `fidelity_study` first. The levels themselves are data, in `framework.model.fidelity_levels`;
`model_comparison` simulates each level's torques in the highest model, and `fidelity_indicators` says
beforehand, without simulation, which level that will come to.
"""
