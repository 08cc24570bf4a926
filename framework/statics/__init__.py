"""Stiffness, loads and vibrations of a robot at rest.

Open `stiffness` first: the platform's stiffness with locked motors. `loading` puts a load on little by
little; `vibrations` has the frequencies with free motors.
"""
