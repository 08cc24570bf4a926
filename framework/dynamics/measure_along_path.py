"""The singularity measure g along the path of a motion, of the robot at rest and as it deflects."""

from __future__ import annotations

from typing import NamedTuple

from framework.arrays import Array
from framework.dynamics.result import InverseDynamics
from framework.singularity.points_on_path import SearchedPath, search_path
from framework.singularity.type2 import singularity_measure


class MeasureAlongPath(NamedTuple):
    """g (see `singularity_measure`) as a function of s, springs at rest, and of t, deflected."""

    result: InverseDynamics
    at_rest: SearchedPath

    @staticmethod
    def of(result: InverseDynamics) -> MeasureAlongPath:
        """Follow the path of a motion again, springs at rest."""
        return MeasureAlongPath(result, search_path(result.robot, result.path))

    def evaluate_at_rest(self, s: Array) -> Array:
        """Compute g (T,) at ascending path coordinates s (T,), springs at rest."""
        return singularity_measure(self.result.robot, self.at_rest.branch.close(s).linearised).g

    def evaluate_in_motion(self, t: Array) -> Array:
        """Compute g (T,) at ascending instants t (T,), with the deflections of the motion."""
        return singularity_measure(self.result.robot, self.result.motion(t).linearised).g

    def nearest_at_rest(self, s: float) -> float:
        """Return the singular point at rest that is nearest to path coordinate s."""
        return min((point.s for point in self.at_rest.points), key=lambda place: abs(place - s))
