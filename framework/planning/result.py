"""The result of planning: the crossings, the law with its torques, and the certificate.

t_s . W_p is the power of the required wrench in the uncontrolled motion, which condition (8) sets to zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import import_module
from os import PathLike
from pathlib import Path as FilePath
from typing import IO, Any

import numpy as np

from framework.argument_errors import explain_errors
from framework.dynamics.loaded_measure import LoadedPoint, loaded_point
from framework.dynamics.result import Certificate, InverseDynamics, SingularityCrossing
from framework.errors import format_distinct
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.tree_model import positions_beyond_limits, shares_beyond_limits
from framework.laws.law import PlannedLaw
from framework.laws.path import Path
from framework.lazy_names import notebook_picture
from framework.numerics.arrays import Array, ArrayLike, ReadOnlyArrays
from framework.planning.condition import coefficients_at
from framework.planning.crossing_points import CrossingTime, PathToCross
from framework.planning.motion_table import DEFAULT_ROWS, MotionTable, motion_table, sample_times
from framework.planning.motor_use import MotorUse, motor_uses
from framework.planning.neglected_effects import NeglectedEffect, neglected_effects, neglected_friction
from framework.planning.request import (
    MOTOR_LIMITS,
    PEAK_SAMPLES,
    Request,
    Specification,
    motor_peaks,
    specification_of,
)
from framework.singularity.points_on_path import SingularPoint
from framework.tolerances import SAME_PLACE

Crossing = SingularityCrossing  # its name in a plan


@dataclass(frozen=True, eq=False)
class Optimality(ReadOnlyArrays):
    """The specification of an optimal law, and the quality of the law.

    reference: torques (n_a,) [N m] by which torques are divided in the costs of peak and energy.
    gap: relative excess of the law's cost over the least cost found. The least cost is that of laws on the
        same cells, in at most the same duration, that need not be smooth. It does not bound the cost of all
        laws.
    """

    specification: Specification
    reference: Array
    gap: float


@dataclass(frozen=True, repr=False, eq=False)
class CrossingPlan:
    """A motion law with its torques and its certificate.

    Functions of time take t (T,) [s] and return one row for each instant.
    """

    robot: ParallelRobot
    request: Request  # path and options
    law: PlannedLaw
    crossings: tuple[Crossing, ...]  # in the order of time
    dynamics: InverseDynamics  # the motion under the law, with its torques
    certificate: Certificate
    seconds: float = 0.0  # computing time of planning
    reason: str = ""  # for the choice of the kind of law
    optimality: Optimality | None = None  # of an optimal law

    @property
    def path(self) -> Path:
        """The platform's path."""
        return self.request.path

    @cached_property
    def loaded_points(self) -> tuple[LoadedPoint | None, ...]:
        """The point near each of `crossings` where the robot is singular under its loads.

        Forces deflect the springs, which shifts the singular point along the path. The entries are None for
        robots without springs, and if the forces are those of the undeformed robot (geometry "rigid").
        """
        return tuple(loaded_point(self.dynamics, crossing.time) for crossing in self.crossings)

    @property
    def duration(self) -> float:
        """The duration of the motion [s]."""
        return self.law.duration

    @property
    def is_chain(self) -> bool:
        """Whether it is a chain of plans, the only kind whose s is proportional to time."""
        return self.law.degree == 1

    @property
    def geometry(self) -> str:
        """The geometry of the forces: "rigid" (undeformed robot) or "deformed"."""
        return self.dynamics.geometry

    def torque(self, t: ArrayLike, order: int = 0) -> Array:
        """Evaluate motor torques (T, n_a) [N m or N], motor side, or their time derivatives."""
        return self.dynamics.torque(t, order)

    def motor_angle(self, t: ArrayLike, order: int = 0) -> Array:
        """Evaluate motor angles (T, n_a) [rad, m], gear ratio times joint angle, or their derivatives."""
        return self.dynamics.motor_angle(t, order)

    def deflection(self, t: ArrayLike, order: int = 0) -> Array:
        """Evaluate deflections (T, n_e) of the springs [m, rad], or their derivatives."""
        return self.dynamics.deflection(t, order)

    def platform(self, t: ArrayLike, order: int = 0) -> Array:
        """Evaluate platform coordinates (T, n) [m, rad], or their derivatives up to order 4."""
        return self.dynamics.platform(t, order)

    @explain_errors
    def configuration(self, t: ArrayLike) -> Array:
        """Evaluate all joint coordinates q (T, nq); a scalar t gives (nq,)."""
        q = self.dynamics.configuration(t)
        return q if np.ndim(t) else q[0]

    @explain_errors
    def velocity(self, t: ArrayLike, order: int = 1) -> Array:
        """Evaluate joint velocities (order 1) or accelerations (order 2), (T, nv); a scalar t gives (nv,)."""
        v = self.dynamics.velocity(t, order)
        return v if np.ndim(t) else v[0]

    @explain_errors
    def restart(
        self, t: float, path: Path | Array | Sequence[float] | None = None, **options: Any
    ) -> CrossingPlan:
        """Plan on from an instant t [s], along another path, to a goal, or along the rest of this path.

        The new plan starts with the position, speed and acceleration that this one has at t, and with its
        torques; `chain_plans` makes one motion of both.

        Args:
            t: in (0, duration], where the platform moves.
            path: starts at platform(t), in the direction of its motion and with its curvature; of an elastic
                robot also with its derivatives up to order 4. Platform coordinates (n,) are the goal of a
                curve that does so.
            options: those of `plan_crossing` except start_speed, such as duration, end_speed or limits;
                friction, geometry, wrenches and torque_sharing are those of this plan if not given.

        Raises:
            InvalidInput: the path does not continue the motion, or an option is invalid.
            NoAnswer: as `plan_crossing`.

        Example:
            >>> from framework import Line, load_robot, plan_crossing
            >>> path = Line([0.1, 0.345], [-0.05, 0.195])
            >>> plan = plan_crossing(load_robot("five_bar"), path, duration=1.5)
            >>> slower = plan.restart(0.5, duration=2.0)
            >>> bool(abs(slower.torque(0.0) - plan.torque(0.5)).max() < 1e-9)
            True
        """
        chain = import_module("framework.planning.chain")  # which plans, and so stands above this module
        restarted: CrossingPlan = chain.restart_plan(self, t, path, **options)
        return restarted

    @cached_property
    def peak_torque(self) -> dict[str, float]:
        """Largest |torque| [N m] of each motor, by joint."""
        peaks, _speeds = motor_peaks(self.dynamics)
        return dict(zip(self.robot.actuator_names, peaks.tolist(), strict=True))

    @property
    def neglected_friction(self) -> str:
        """Dry friction that the torques do not contain, by joint; empty without any."""
        return self.robot.friction_sizes(np.flatnonzero(neglected_friction(self.dynamics)))

    @cached_property
    def neglected(self) -> tuple[NeglectedEffect, ...]:
        """The effects that the torques leave out, each with its torque, the largest first."""
        return neglected_effects(self.dynamics)

    @cached_property
    def motor_use(self) -> tuple[MotorUse, ...]:
        """The largest ratio of each motor to each of its limits, margin subtracted."""
        return tuple(motor_uses(self.dynamics, specification_of(self.robot, self.request)))

    @property
    def exceeded(self) -> dict[str, str]:
        """Exceeded limits in words, by joint, motors first.

        Each text has the s of the largest excess. The robot file limits torques and speeds of motors, the
        URDF limits positions of joints.
        """
        excesses: dict[str, list[str]] = {joint: [] for joint in self.robot.actuator_names}
        no_limits: dict[str, Any] = dict.fromkeys(MOTOR_LIMITS)
        of_file = replace(self.request, **no_limits, margin=0.0)
        for use in motor_uses(self.dynamics, specification_of(self.robot, of_file)):
            if use.ratio > 1.0 and use.limit in ("torque", "speed"):
                size, bound = format_distinct(use.size, use.allowed)
                excesses[use.joint].append(f"{use.limit} {size} {use.unit} of {bound} at s = {use.s:.4g}")
            elif use.ratio > 1.0:
                excesses[use.joint].append(f"{use.limit}: {use.sentence}")

        times, limits = np.linspace(0.0, self.duration, PEAK_SAMPLES), self.robot.limits
        q = self.configuration(times)
        shares = shares_beyond_limits(limits, q)  # (T, number of limits)
        s_worst = self.law(times[shares.argmax(axis=0)])  # (number of limits,)
        s_of_joint = dict(zip([limit.joint for limit in limits], s_worst, strict=True))
        for joint, excess in positions_beyond_limits(limits, q).items():
            excesses.setdefault(joint, []).append(f"{excess} at s = {s_of_joint[joint]:.4g}")
        return {joint: ", ".join(texts) for joint, texts in excesses.items() if texts}

    _repr_mimebundle_ = notebook_picture("plan_picture")

    def __repr__(self) -> str:
        """Return robot, law, crossings and tail in one line."""
        degree = f", degree {self.law.degree}" if self.law.kind == "polynomial" else ""
        law = self.reason if self.is_chain else f"{self.law.kind} law{degree}"
        where = ", ".join(f"s = {crossing.s:.9f} at {crossing.time:.6g} s" for crossing in self.crossings)
        return (
            f"CrossingPlan({self.robot.name}, {self.robot.flexibility}, {self.geometry}: {law} over "
            f"{self.duration:g} s, crossings: {where or 'none'}, tail {self.certificate.tail:.1e})"
        )

    @explain_errors
    def samples(
        self,
        count: int = DEFAULT_ROWS,
        *,
        period: float | None = None,
        at: ArrayLike | None = None,
        columns: Sequence[str] | None = None,
    ) -> MotionTable:
        """Sample the motion at equidistant or given instants: the columns and rows of motion.csv.

        Args:
            count: number of instants, unless a period is given.
            period: time [s] between rows; the last row is always at the end of the motion.
            at: instants (T,) [s], instead.
            columns: names of columns, or prefixes that several names share, such as torque; all by default.
        """
        return motion_table(self.dynamics, sample_times(self.duration, count, period, at), columns)

    @explain_errors
    def save(self, folder: str | PathLike[str]) -> FilePath:
        """Write plan.json into a folder, for `load_plan`, and return the file.

        Raises:
            InvalidInput: the path or the law is a function of your own, or the robot a model in memory, which
                cannot be written.
            OutputError: it cannot be written.
        """
        from framework.planning import save_plan

        return save_plan(self, folder)

    @explain_errors
    def to_csv(
        self,
        file: str | PathLike[str] | IO[str],
        samples: int = DEFAULT_ROWS,
        *,
        period: float | None = None,
        columns: Sequence[str] | None = None,
    ) -> None:
        """Write motion.csv to a path or an open text file.

        Args:
            file: path, or file that is open for text.
            samples: number of instants, unless a period is given.
            period: time [s] between rows; the last row is always at the end of the motion.
            columns: names of columns, or prefixes that several names share; all by default.
        """
        text = self.samples(samples, period=period, columns=columns).as_csv()
        if isinstance(file, str | PathLike):
            FilePath(file).write_text(text, encoding="utf-8")
        else:
            file.write(text)


def certified_plan(
    to_cross: PathToCross,
    request: Request,
    dynamics: InverseDynamics,
    law: PlannedLaw,
    timing: Sequence[CrossingTime],
    *,
    crossed: Sequence[SingularPoint] = (),
    reason: str = "",
    optimality: Optimality | None = None,
) -> CrossingPlan:
    """Return the plan of a motion whose torques are computed.

    Args:
        dynamics: the motion under the law, with its torques, crossings and certificate.
        timing: times and speeds of crossings for which the law was made. They replace the numbers of a
            measured crossing that differ only by rounding.
        crossed: the crossing points of a deformed robot in the order of time, with the conditions (8) of the
            last deflections; where the motion meets others, the conditions are computed.
        reason, optimality: fields of the plan.
    """
    crossings = []
    for k, measured in enumerate(dynamics.crossings):
        condition = measured.condition
        if len(crossed) == len(dynamics.crossings):
            condition = crossed[k].condition
        elif condition is not None and request.geometry == "deformed":
            deflection = np.array([dynamics.deflection(measured.time, order) for order in range(3)])
            condition = coefficients_at(to_cross.branch, measured, deflection)
        # the motion of the law replaces the measured one, which differs only by rounding
        motion = measured.time, measured.speed, measured.acceleration
        for time, speed in timing:
            if abs(time - measured.time) < SAME_PLACE * law.duration:
                _s, at_law, acceleration = map(float, law.derivatives(time, 3))
                is_same = abs(speed - at_law) < SAME_PLACE * at_law
                motion = time, speed if is_same else at_law, acceleration
        time, speed, acceleration = motion
        crossings.append(
            replace(measured, condition=condition, time=time, speed=speed, acceleration=acceleration)
        )
    monotone = law.least_speed_ratio(request.smoothness, request.ends) > 0
    return CrossingPlan(
        dynamics.robot,
        request,
        law,
        tuple(crossings),
        dynamics,
        replace(dynamics.certificate, monotone=monotone),
        reason=reason,
        optimality=optimality,
    )
