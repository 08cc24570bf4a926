"""The spherical 3-RRR with short arcs in closed form; `test_closed_forms.py` holds the robot to it."""

import numpy as np

from tests.oracles.closed_form import Crossing, Kinematics
from tests.oracles.spherical import GEAR, Spherical

ORACLE = Spherical(np.pi / 3, (1, 1, 1))
PLACES = [-0.1, 0, -0.1] + 0.25 * np.random.default_rng(2).uniform(-1, 1, (20, 3))
KINEMATICS = Kinematics(PLACES, ORACLE.motor_angles, ORACLE.ratio, 1e-12, 1e-11)
CROSSING = Crossing(
    scene="cross",
    unprepared="cross-unprepared",
    clear="clear",
    lines=lambda x: ORACLE.matrices(x)[0].real,  # normals of the planes of the arcs: these meet in a line
    bracket=(0.1, 0.95),
    rates=ORACLE.rates,
    force=ORACLE.platform_force,
    gear=GEAR,
    share=0.5,
    twist_within=1e-10,
    force_within=lambda force: 1e-11,
    torque_within=lambda torque: 1e-11,
    away=0.1,
    power=1e-11,
)
