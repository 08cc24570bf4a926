"""Stiffness, loads and vibrations of a robot at rest."""
