"""The N-four-bar mechanism in Exudyn, falling freely: problem A02 of the IFToMM library of benchmarks.

M. Gonzalez, D. Dopico, U. Lugris and J. Cuadrado, "A benchmarking system for MBS simulation software:
problem standardization and performance measurement", Multibody System Dynamics 16, 2006. N + 1 rods on the
ground and N bars between their tips, 1 m and 1 kg each, upright at the start, the tips at 1 m/s to the right.
Whenever all links lie on one line, each loop loses a rank and could fold.
"""

import numpy as np

from tests.benchmarks.chart.peers.exudyn_parts import ANGLE, Mechanism

LENGTH, MASS = 1.0, 1.0  # [m], [kg]
INERTIA = MASS * LENGTH**2 / 12
GRAVITY = 9.81
SPEED = 1.0  # [rad/s] of the rods at the start, clockwise


def simulate(loops: int, *, step: float, duration: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Times (T,) [s], angle (T,) [rad] of the last rod from the vertical, clockwise, and wall time [s]."""
    steps = round(duration / step)
    mechanism = Mechanism(gravity=(0.0, -GRAVITY))
    tips, rod = [], None
    for k in range(loops + 1):
        foot = (k * LENGTH, 0.0)
        rates = (SPEED * LENGTH / 2, 0.0, -SPEED)
        rod = mechanism.link(MASS, INERTIA, (foot[0], LENGTH / 2), np.pi / 2, rates)
        mechanism.pin(mechanism.point(mechanism.ground(foot)), mechanism.point(rod, -LENGTH / 2))
        tips.append(mechanism.point(rod, LENGTH / 2))
    for k in range(loops):
        rates = (SPEED * LENGTH, 0.0, 0.0)
        bar = mechanism.link(MASS, INERTIA, ((k + 0.5) * LENGTH, LENGTH), 0.0, rates)
        mechanism.pin(tips[k], mechanism.point(bar, -LENGTH / 2))
        mechanism.pin(tips[k + 1], mechanism.point(bar, LENGTH / 2))
    times, moved, seconds = mechanism.run(rod, steps=steps, duration=duration, at_rest=False)
    return times, -moved[:, ANGLE], seconds
