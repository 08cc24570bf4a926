"""What planning gives: the crossings, the law with its torques, and its proof."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from typing import IO

import numpy as np

from framework.arrays import Array, ArrayLike, ReadOnlyArrays
from framework.crossing.condition import Condition8
from framework.crossing.motion_table import MotionTable, motion_table
from framework.crossing.request import Request
from framework.crossing.specification import Specification
from framework.dynamics.certificate import Certificate
from framework.dynamics.result import InverseDynamics
from framework.kinematics.joint_limits import positions_beyond_limits
from framework.kinematics.parallel_robot import ParallelRobot
from framework.motion.law import PlannedLaw
from framework.motion.path import Path


@dataclass(frozen=True, eq=False)
class Crossing(ReadOnlyArrays):
    """One way through a Type 2 singularity, measured on the finished motion.

    The law has s(time) = `s`, s'(time) = `speed` and s"(time) = `acceleration`. `condition` holds the
    coefficients of condition (8) there where the law was made to meet it, None when nothing was asked and
    it holds all the same. `residual` is |t_s . W_p| over the largest sum of its terms along the motion.
    """

    s: float
    time: float
    speed: float
    acceleration: float
    kind: str
    twist: Array  # (n,) t_s
    platform: Array  # (n,)
    residual: float
    condition: Condition8 | None


@dataclass(frozen=True, eq=False)
class Optimality(ReadOnlyArrays):
    """What an optimal law was made best at, and what its torques were measured against, (n_a,) [N m]."""

    specification: Specification
    reference: Array


@dataclass(frozen=True, repr=False, eq=False)
class CrossingPlan:
    """A motion law with its torques and its proof. All times in [s], t (T,) gives (T, n_a)."""

    robot: ParallelRobot
    request: Request
    law: PlannedLaw
    crossings: tuple[Crossing, ...]
    dynamics: InverseDynamics
    certificate: Certificate
    seconds: float  # time that planning took
    reason: str = ""  # why the law is of its kind
    optimality: Optimality | None = None  # of an optimal law

    @property
    def path(self) -> Path:
        return self.request.path

    @property
    def duration(self) -> float:
        return self.law.duration

    @property
    def geometry(self) -> str:
        return self.dynamics.geometry

    def torque(self, t: ArrayLike, order: int = 0) -> Array:
        """Motor torques [N m], motor side, or their time derivatives."""
        return self.dynamics.torque(t, order)

    def motor_angle(self, t: ArrayLike, order: int = 0) -> Array:
        """Motor angles [rad], motor side (gear ratio times joint angle), or their derivatives."""
        return self.dynamics.motor_angle(t, order)

    def deflection(self, t: ArrayLike, order: int = 0) -> Array:
        """Deflections (T, n_e) of the springs [m, rad], or their derivatives."""
        return self.dynamics.deflection(t, order)

    def platform(self, t: ArrayLike, order: int = 0) -> Array:
        """Platform coordinates (T, n) [m, rad], or their derivatives up to order 4."""
        return self.dynamics.platform(t, order)

    def configuration(self, t: ArrayLike) -> Array:
        """All joint coordinates q (T, nq), a scalar t (nq,); passive and elastic ones too."""
        q = self.dynamics.configuration(t)
        return q if np.ndim(t) else q[0]

    def velocity(self, t: ArrayLike, order: int = 1) -> Array:
        """Joint velocities (order 1) or accelerations (order 2), (T, nv), a scalar t (nv,)."""
        v = self.dynamics.velocity(t, order)
        return v if np.ndim(t) else v[0]

    @property
    def peak_torque(self) -> dict[str, float]:
        """Largest |torque| [N m] of each motor, by joint."""
        times = np.linspace(0.0, self.duration, 2001)
        peaks = np.abs(self.torque(times)).max(axis=0)
        return dict(zip(self.robot.actuator_names, map(float, peaks), strict=True))

    @property
    def exceeded(self) -> dict[str, str]:
        """Limits that the plan does not keep, by joint: those of the robot file's motors (torque and speed),
        and the positions that the URDF allows its joints.
        """
        times = np.linspace(0.0, self.duration, 2001)
        torques = np.abs(self.torque(times)).max(axis=0)
        speeds = np.abs(self.motor_angle(times, 1)).max(axis=0)
        found = {}
        for k, motor in enumerate(self.robot.description.actuators):
            asked = []
            if motor.torque_limit is not None and torques[k] > motor.torque_limit:
                unit = self.robot.torque_units[k]
                asked.append(f"torque {torques[k]:.4g} {unit} of {motor.torque_limit:.4g}")
            if motor.speed_limit is not None and speeds[k] > motor.speed_limit:
                asked.append(f"speed {speeds[k]:.4g} rad/s of {motor.speed_limit:.4g}")
            if asked:
                found[motor.joint] = ", ".join(asked)
        beyond = positions_beyond_limits(self.robot.limits, self.dynamics.configuration(times))
        for joint, position in beyond.items():
            found[joint] = f"{found[joint]}, {position}" if joint in found else position
        return found

    def __repr__(self) -> str:
        where = ", ".join(f"s = {crossing.s:.9f} at {crossing.time:.6g} s" for crossing in self.crossings)
        return (
            f"CrossingPlan({self.robot.name}, {self.robot.flexibility}, {self.geometry}: {self.law.kind} "
            f"law, degree {self.law.degree} over {self.duration:g} s, crossings: {where or 'none'}, tail "
            f"{self.certificate.tail:.1e})"
        )

    def samples(self, count: int = 1501) -> MotionTable:
        """The motion at equidistant instants, as motion.csv has it: columns with units, and rows."""
        return motion_table(self.dynamics, count)

    def to_csv(self, file: str | PathLike[str] | IO[str], samples: int = 1501) -> None:
        """Write motion.csv to a path or an open text file."""
        text = self.samples(samples).as_csv()
        if isinstance(file, str | PathLike):
            with open(file, "w", encoding="utf-8") as stream:
                stream.write(text)
        else:
            file.write(text)
