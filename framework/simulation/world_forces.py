"""The generalised forces of wrenches of the world in a simulation, and how they change with the robot.

With J (6, nv) the Jacobian of a frame at its origin on base axes, as pinocchio gives it, a wrench w makes the
forces J' w. Column i of J, (l_i, omega_i), changes with column j by

    (omega_j x l_i, omega_j x omega_i)    where j comes before i or belongs to the same joint,
    (omega_i x l_j, 0)                    where j comes after i,

and a wrench on the axes of its frame by (omega_j x force, omega_j x moment). See `loop_curvature` for the
source of the rule. Nothing of the inverse dynamics is used here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from framework.arrays import Array
from framework.errors import InvalidInput
from framework.kinematics.external_wrenches import ExternalWrenches
from framework.kinematics.frame_variations import tree_columns
from framework.kinematics.mechanism import frame_of
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.pinocchio_memory import scratch_of
from framework.linalg.ordered_sums import cross

AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
PathCoordinate = Callable[[Array], Array]  # (T,) instants [s] to (T,)


@dataclass(frozen=True, eq=False)
class WorldForces:
    """Wrenches of the world on a robot, at instants."""

    wrenches: ExternalWrenches
    path_coordinate: PathCoordinate | None  # None: all are constant

    @staticmethod
    def of(
        robot: ParallelRobot, wrenches: ExternalWrenches, path_coordinate: PathCoordinate | None
    ) -> WorldForces:
        """Return the forces of wrenches on this robot.

        Raises:
            InvalidInput: an unknown frame; a table over s where no motion says what s is.
        """
        wrenches.check_frames(robot)
        tables = [entry.frame for entry in wrenches.entries if entry.rows.ndim == 2]
        if tables and path_coordinate is None:
            raise InvalidInput(
                f"wrenches: {tables[0]}: a table over the path needs a planned motion, which tells s; give 6 "
                f"numbers"
            )
        return WorldForces(wrenches, path_coordinate)

    @property
    def acts(self) -> bool:
        """Whether any wrench acts."""
        return bool(self.wrenches.entries)

    def __call__(
        self, robot: ParallelRobot, t: Array, q: Array, models: Sequence[pin.Model] | None = None
    ) -> Array:
        """Compute the generalised forces (T, nv) at t (T,) and q (T, nq).

        Of the robot's model, or of others of its structure, one for each state.
        """
        force = np.zeros((len(q), robot.model.nv))
        for columns, wrench, _ in self._frame_wrenches(robot, t, q, models):
            force += np.einsum("tvi,ti->tv", columns, wrench)
        return force

    def slope(self, robot: ParallelRobot, t: Array, q: Array) -> Array:
        """Compute their derivative (T, nv, nv) along the tangent of q."""
        nv, before = robot.model.nv, tree_columns(robot).before
        slope = np.zeros((len(q), nv, nv))
        for columns, wrench, turns in self._frame_wrenches(robot, t, q):
            linear, angular = columns[..., :3], columns[..., 3:]
            force, moment = wrench[:, None, :3], wrench[:, None, 3:]
            # entry [i, j]: column i moved by joint j
            turned = np.einsum("tix,tjx->tij", cross(moment, angular), angular).swapaxes(1, 2)
            carried = np.einsum("tix,tjx->tij", cross(force, angular), linear)
            # `before[j, i]`: joint j carries joint i or is the same one
            slope += np.where(before.T, carried.swapaxes(1, 2) + turned, carried)
            if turns:
                slope += np.einsum("tix,tjx->tij", linear, cross(angular, force))
                slope += np.einsum("tix,tjx->tij", angular, cross(angular, moment))
        return slope

    def _frame_wrenches(
        self, robot: ParallelRobot, t: Array, q: Array, models: Sequence[pin.Model] | None = None
    ) -> Iterator[tuple[Array, Array, bool]]:
        """Yield the Jacobian (T, nv, 6) and wrench (T, 6) of each entry, on base axes.

        At t (T,) and q (T, nq); and whether the wrench turns with its frame.
        """
        model, data = robot.model, scratch_of(robot).data
        models = [model] * len(q) if models is None else models
        s = np.zeros(len(q)) if self.path_coordinate is None else self.path_coordinate(t)
        for entry in self.wrenches.entries:
            frame, turns = frame_of(model, entry.frame), entry.turns
            wrench = np.array(entry(s))
            columns = np.empty((len(q), model.nv, 6))
            for k, configuration in enumerate(q):
                columns[k] = pin.computeFrameJacobian(models[k], data, configuration, frame, AXES).T
                if turns:
                    rotation = data.oMf[frame].rotation
                    wrench[k] = (wrench[k].reshape(2, 3) @ rotation.T).ravel()
            yield columns, wrench, turns


NO_FORCES = WorldForces(ExternalWrenches(), None)
