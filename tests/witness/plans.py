"""Planned motions that the witnesses are driven along, and laws that are wrong on purpose."""

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

import robots
from framework import CrossingPlan, plan_scene
from framework.dynamics.finite_differences import finite_difference_torques
from framework.planning.plan import uncertified_law
from framework.planning.scenes import scene_path

ROBOTS = ("five_bar", "five_bar_heavy")
DURATION = 1.5  # [s] of every scene of the 5R
CROSSING = 1.0  # [s], where scene C is singular


@cache
def plan_of(name: str, flexibility: str) -> CrossingPlan:
    """Scene C: through the singularity, on the deformed robot where it is elastic."""
    return plan_scene(robots.load(name, flexibility=flexibility), "C")


class Wrong(NamedTuple):
    """Torques without proof, for a law that misses condition (8)."""

    law: Callable
    path: Callable
    samples: tuple[np.ndarray, np.ndarray]  # [s] (S,), [N m] (S, 2)

    def platform(self, t) -> np.ndarray:
        return self.path(self.law(t))

    def torque(self, t) -> np.ndarray:
        """What lies between the samples, on straight lines."""
        times, torques = self.samples
        return np.column_stack([np.interp(t, times, torque) for torque in torques.T])


@cache
def wrong_law(name: str, flexibility: str, scene: str, samples: int = 3001) -> Wrong:
    """Scene B, without the condition, or C-printed, with it at the paper's rounded point."""
    robot = robots.load(name, flexibility=flexibility)
    said = robot.description.scenes[scene]
    path = scene_path(said)
    law, _ = uncertified_law(
        robot, path, duration=said.duration, times=said.times, speeds=said.speeds, at=said.at
    )
    raw = finite_difference_torques(robot, path, law, samples=samples)
    return Wrong(law, path, (raw.time, raw.torque))
