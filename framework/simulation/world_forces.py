"""The generalised forces of external wrenches in a simulation, and their derivatives.

A wrench w on a frame causes the forces J' w, with pinocchio's Jacobian J (6, nv) of the frame's origin on
base axes. Nothing of the inverse dynamics is used here.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from framework.errors import InvalidInput
from framework.kinematics.external_wrenches import ExternalWrenches, wrench_slope
from framework.kinematics.frames import frames_at, scratch_of
from framework.kinematics.mechanism import frame_index
from framework.kinematics.parallel_robot import ParallelRobot
from framework.numerics.arrays import Array

AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
PathCoordinate = Callable[[Array], Array]  # from instants (T,) [s] to path parameters s (T,)


@dataclass(frozen=True, eq=False)
class WorldForces:
    """The generalised forces that external wrenches exert on a robot over time."""

    wrenches: ExternalWrenches
    path_coordinate: PathCoordinate | None  # None if all wrenches are constant

    @staticmethod
    def of(
        robot: ParallelRobot, wrenches: ExternalWrenches, path_coordinate: PathCoordinate | None
    ) -> WorldForces:
        """Return the forces of external wrenches on a robot.

        Args:
            path_coordinate: path parameter s (T,) at instants (T,) [s]; None without a planned motion.

        Raises:
            InvalidInput: a wrench acts on an unknown frame, or is a table over s and there is no motion that
                determines s.
        """
        wrenches.check_frames(robot)
        tables = [entry.frame for entry in wrenches.entries if entry.rows.ndim == 2]
        if tables and path_coordinate is None:
            raise InvalidInput(
                f"wrenches: {tables[0]}: a table over the path needs a planned motion, which determines s; "
                f"give 6 numbers"
            )
        return WorldForces(wrenches, path_coordinate)

    @property
    def acts(self) -> bool:
        """Whether any wrench acts."""
        return bool(self.wrenches.entries)

    def __call__(
        self, robot: ParallelRobot, t: Array, q: Array, models: Sequence[pin.Model] | None = None
    ) -> Array:
        """Compute the generalised forces (T, nv) at t (T,) [s] and q (T, nq).

        Args:
            models: a pinocchio model for each state, all of the robot's structure; by default the robot's.
        """
        data = scratch_of(robot).data
        s = self._path_coordinates(t)
        models = [robot.model] * len(q) if models is None else models
        force = np.zeros((len(q), robot.nv))
        for entry in self.wrenches.entries:
            frame = frame_index(robot.model, entry.frame)
            wrenches = entry(s)  # (T, 6)
            for k, configuration in enumerate(q):
                jacobian = pin.computeFrameJacobian(models[k], data, configuration, frame, AXES)
                wrench = wrenches[k]
                if entry.turns:  # the wrench is given on the frame's axes: rotate force and moment
                    wrench = (wrench.reshape(2, 3) @ data.oMf[frame].rotation.T).ravel()
                force[k] += wrench @ jacobian
        return force

    def slope(self, robot: ParallelRobot, t: Array, q: Array) -> Array:
        """Compute the derivatives (T, nv, nv) of the forces with respect to tangent steps of q."""
        frames = frames_at(robot, q)
        wrenches = self.wrenches.evaluate(robot, frames, self._path_coordinates(t))
        slopes = (wrench_slope(robot, frames.screws, wrench) for wrench in wrenches)
        return sum(slopes, start=np.zeros((len(q), robot.nv, robot.nv)))

    def _path_coordinates(self, t: Array) -> Array:
        """Return s (T,) at t (T,) [s]; 0 if all wrenches are constant."""
        return np.zeros(len(t)) if self.path_coordinate is None else self.path_coordinate(t)


NO_FORCES = WorldForces(ExternalWrenches(), None)
