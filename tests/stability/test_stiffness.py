"""Springs from 1e2 to 1e12 N m/rad and N/m.

What goes wrong: the torque of a stiff spring taken from its ends, k (q_link - q_motor / n), multiplies the
rounding of two angles by k: with k = 1e12 four digits are left. A fixed point on soft springs runs away, and
returns numbers all the same.
Why: a stiff spring turns by less than the last digit of the angles at its ends; a soft one tears the loops.
What we do: the torque is that of the loads, the deflection is torque / k, and nothing is divided back.
Springs too soft for the motion are refused as such.
"""

from dataclasses import replace
from functools import cache

import numpy as np

import robots
from framework import ParallelRobot, plan_scene
from tests.oracles import five_bar as oracle

STIFFNESSES = 10.0 ** np.arange(2, 13)
TIMES = (0.2, 0.7, 0.999, 1.0, 1.3)  # [s]


@cache
def with_springs(part: str, stiffness: float) -> ParallelRobot:
    """The 5R with drives ("joint") or rods ("link") of this stiffness."""
    description = robots.load("five_bar").description
    springs = tuple(
        replace(spring, stiffness=(float(stiffness),)) if spring.part == part else spring
        for spring in description.springs
    )
    flexibility = "flexible_joints" if part == "joint" else "flexible_links"
    return ParallelRobot.from_description(replace(description, springs=springs), flexibility=flexibility)


def exact_drives(t: float, stiffness: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Motor torques, drive torques (2,) [N m] and link angles (2,) [rad] with elastic drives, exactly.

    The drives stand outside the loops, so the torque is that of the rigid robot plus I n g'' / k.
    """
    rigid = oracle.solve("C", "rigid", "rigid", 4)
    elastic = oracle.solve("C", "flexible_joints", "rigid", 4)
    share = oracle.DRIVE_STIFFNESS / oracle.mp.mpf(stiffness)
    torque = [r + share * (e - r) for r, e in zip(rigid.torque(t), elastic.torque(t), strict=True)]
    drive = [-oracle.DRIVE_STIFFNESS * d for d in elastic.deflection(t)]
    links = [angle / oracle.GEAR_RATIO for angle in rigid.motor_angle(t)]
    return torque, drive, links


def naive_error(stiffness: float) -> float:
    """Relative error of k (q_motor / n - q_link), both angles rounded to the nearest float."""
    worst, largest = 0.0, 0.0
    for t in TIMES:
        _, drive, links = exact_drives(t, stiffness)
        for g, link in zip(drive, links, strict=True):
            motor = float(link + g / oracle.mp.mpf(stiffness))
            worst = max(worst, abs(stiffness * (motor - float(link)) - float(g)))
            largest = max(largest, abs(float(g)))
    return worst / largest


def our_error(stiffness: float) -> float:
    """Relative error of our motor torque with drives of this stiffness."""
    plan = plan_scene(with_springs("joint", stiffness), "C")
    exact = np.array([exact_drives(t, stiffness)[0] for t in TIMES], dtype=float)
    ours = np.array([plan.torque(t) for t in TIMES])
    return float(np.abs(ours - exact).max() / np.abs(exact).max())


def test_torques_have_all_digits_whatever_the_stiffness():
    assert max(map(our_error, STIFFNESSES[::-4])) < 1e-12  # rounding of 64 nodes and two derivatives
