"""What planning gives: the crossings, the law with its torques, and how they are written down."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from os import PathLike
from typing import IO, Any

import numpy as np

from framework.arrays import Array, ArrayLike
from framework.catalogue import catalogue
from framework.crossing.condition import Condition8
from framework.crossing.optimal import Wish
from framework.dynamics.certificate import Certificate
from framework.dynamics.result import InverseDynamics
from framework.errors import InvalidInput
from framework.kinematics.joint_limits import positions_beyond_limits
from framework.model import ParallelRobot
from framework.motion.law import PlannedLaw, is_number
from framework.motion.path import Arc, Line, Path, Spline


@dataclass(frozen=True, eq=False)
class Crossing:
    """One way through a Type 2 singularity, measured on the finished motion.

    The law has s(time) = `s`, s'(time) = `speed` and s"(time) = `acceleration`. `condition` holds the
    coefficients of condition (8) that the law was made to meet there, None when nothing was asked and it
    holds all the same. `residual` is |t_s . W_p| over the largest sum of its terms along the motion.
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
class Optimality:
    """What an optimal law was made best at, and what its torques were measured against, (n_a,) [N m]."""

    wish: Wish
    reference: Array

    def to_dict(self) -> dict[str, Any]:
        """As plan.json has it; no limit is null."""
        wish = self.wish
        return {
            "optimize": wish.goal,
            "duration": wish.duration,
            "longest": wish.longest,
            "torque_limit": _with_nulls(wish.torque_limit),
            "speed_limit": _with_nulls(wish.speed_limit),
            "reference": self.reference.tolist(),
        }

    @staticmethod
    def from_dict(saved: dict[str, Any], smoothness: int) -> Optimality:
        """What `to_dict` wrote.

        Raises:
            KeyError, TypeError, ValueError: it is not that.
        """
        torque, speed = (_without_nulls(saved[key]) for key in ("torque_limit", "speed_limit"))
        wish = Wish(str(saved["optimize"]), saved["duration"], saved["longest"], torque, speed, smoothness)
        return Optimality(wish, np.array(saved["reference"], dtype=float))


def _with_nulls(limits: Array) -> list[float | None]:
    return [float(limit) if np.isfinite(limit) else None for limit in limits]


def _without_nulls(limits: list[float | None]) -> Array:
    return np.array([np.inf if limit is None else limit for limit in limits], dtype=float)


def path_points(path: Path) -> dict[str, list[list[float]]] | None:
    """A path as a scene says it, {kind: points}; None for a path of the user's own making."""
    if isinstance(path, Line):
        return {"line": [path.start.tolist(), path.end.tolist()]}
    if isinstance(path, Arc):
        return {"arc": [path.start.tolist(), path.via.tolist(), path.end.tolist()]}
    return {"spline": path.points.tolist()} if isinstance(path, Spline) else None


@dataclass(frozen=True, repr=False, eq=False)
class CrossingPlan:
    """A motion law with its torques and its proof. All times in [s], t (T,) gives (T, n_a)."""

    robot: ParallelRobot
    path: Path
    law: PlannedLaw
    crossings: tuple[Crossing, ...]
    dynamics: InverseDynamics
    certificate: Certificate
    seconds: float  # time that planning took
    reason: str = ""  # why the law is of its kind
    optimality: Optimality | None = None  # of an optimal law

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
        for joint, position in positions_beyond_limits(
            self.robot, self.dynamics.configuration(times)
        ).items():
            found[joint] = f"{found[joint]}, {position}" if joint in found else position
        return found

    def __repr__(self) -> str:
        where = ", ".join(f"s = {crossing.s:.9f} at {crossing.time:.6g} s" for crossing in self.crossings)
        return (
            f"CrossingPlan({self.robot.name}, {self.robot.flexibility}, {self.geometry}: {self.law.kind} "
            f"law, degree {self.law.degree} over {self.duration:g} s, crossings: {where or 'none'}, tail "
            f"{self.certificate.tail:.1e})"
        )

    def samples(self, count: int = 1501) -> tuple[list[str], Array]:
        """Column names and rows (count, columns) of motion.csv, SI units."""
        if not (is_number(count) and int(count) == count >= 2):
            raise InvalidInput(f"samples: needs a whole number of at least 2, got {count!r}")
        robot, times = self.robot, np.linspace(0.0, self.duration, count)
        names = ["time", "s", "ds", "dds"]
        names += [f"platform_{axis}" for axis in robot.axis_names]
        names += [f"motor_angle_{joint}" for joint in robot.actuator_names]
        names += [f"torque_{joint}" for joint in robot.actuator_names]
        names += [f"deflection_{spring}" for spring in robot.elastic_names]
        law = [self.law(times, order) for order in range(3)]
        columns = [
            np.column_stack([times, *law]),
            self.platform(times),
            self.motor_angle(times),
            self.torque(times),
            self.deflection(times),
        ]
        return names, np.concatenate(columns, axis=1)

    def to_csv(self, file: str | PathLike[str] | IO[str], samples: int = 1501) -> None:
        """Write motion.csv to a path or an open text file."""
        names, rows = self.samples(samples)
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(names)
        writer.writerows([[repr(float(value)) for value in row] for row in rows])
        if isinstance(file, str | PathLike):
            with open(file, "w", encoding="utf-8") as stream:
                stream.write(text.getvalue())
        else:
            file.write(text.getvalue())

    def _robot_file(self) -> str:
        """The robot's name if it is one of the catalogue, else the path of its file."""
        name, file = self.robot.name, self.robot.description.file
        entry = catalogue().get(name)
        return name if entry is not None and entry.file.samefile(file) else str(file.resolve())

    def to_dict(self) -> dict[str, Any]:
        """The content of plan.json."""
        certificate = self.certificate
        return {
            "robot": self.robot.name,
            "flexibility": self.robot.flexibility,
            "geometry": self.geometry,
            "duration": self.duration,
            "law": self.law.to_dict(),
            "crossings": [
                {
                    "s": crossing.s,
                    "time": crossing.time,
                    "speed": crossing.speed,
                    "acceleration": crossing.acceleration,
                    "kind": crossing.kind,
                    "twist": crossing.twist.tolist(),
                    "platform": crossing.platform.tolist(),
                    "residual": crossing.residual,
                }
                for crossing in self.crossings
            ],
            "peak_torque": self.peak_torque,
            "exceeded": self.exceeded,
            "certificate": {
                "nodes": certificate.nodes,
                "tail": certificate.tail,
                "passes": certificate.passes,
                "change": certificate.change,
                "max_closure_error": certificate.max_closure_error,
                "max_residual_torque": certificate.max_residual_torque,
                "monotone": certificate.monotone,
            },
            "seconds": self.seconds,
            "robot_file": self._robot_file(),
            "path": path_points(self.path),
            "reason": self.reason,
            "optimality": None if self.optimality is None else self.optimality.to_dict(),
        }
