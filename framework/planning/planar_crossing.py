"""The crossing of a planar robot as functions of the path coordinate, independent of the motion law.

With ds/dt = v and d2s/dt2 = a the motor torques and t_s . W_p are

    torque = (c0 + cv v^2 + ca a) / g,     t_s . W_p = d0 + dv v^2 + da a,

with coefficients c and d that depend on s alone. t_s is the platform's twist that the motors do not control,
W_p the wrench on the platform that the motion requires. The numerators are smooth through the singular point,
where the measure g vanishes. From samples of the coefficients the page of a lesson can evaluate any law.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from framework.dynamics.path_forces import PathForces
from framework.errors import InvalidInput, NoAnswer
from framework.kinematics.inverse_kinematics import close_loops
from framework.kinematics.linearised_loops import LinearisedLoops
from framework.kinematics.motion_rates import motor_speeds
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.optimal_law import Smoothstep
from framework.laws.path import Path
from framework.numerics.arrays import Array
from framework.planning.optimal.phase_plane import demand
from framework.planning.plan import plan_crossing
from framework.planning.request import SMOOTHNESS
from framework.planning.result import CrossingPlan
from framework.singularity.points_on_path import SearchedPath, SingularPoint, search_path
from framework.singularity.type2 import SingularityMeasure, sign_along, singularity_measure, twist_norm

PATH_SMOOTHNESS = SMOOTHNESS[False]  # derivatives of s that vanish at both ends of the planned laws
STEP_ASIDE = 1e-3  # [robot lengths] displacement of the platform that shows how the joints follow
GRAVITY = {"off": 0.0, "on": 9.81}  # [m/s^2]


class PlanarCrossing(NamedTuple):
    """A planar robot's path across its locus, with a plan for gravity off and on."""

    searched: SearchedPath  # without gravity; poses and twists are the same with gravity
    robots: dict[str, ParallelRobot]  # by "off" and "on"
    plans: dict[str, CrossingPlan]  # of least peak torque in the given duration

    @property
    def point(self) -> SingularPoint:
        """The only singular point of the path."""
        return self.searched.points[0]

    def sample(self, s: Array) -> dict[str, Array]:
        """Sample the crossing at ascending s (M,), none of which may be at the singular point.

        Twists and motions are divided by one number: the norm of the twist at the crossing, signed so that
        t_s points along the path. Motor speeds are G v for a twist v of the platform, so the torques
        (G')^-1 f balance a force f on the platform; they have a pole where g vanishes. Gravity changes
        neither poses nor twists.

        Returns, by key:
            q: (M, nq) configurations.
            q_aside: (n, 2, M, nq) configurations with the platform displaced by STEP_ASIDE along each of its
                axes, forward and back.
            g: (M,) measure, 0 at the crossing.
            t_s: (M, n) twist, of unit speed at the crossing.
            motor_speed: (M, n_a, n) G, motor speeds per twist of the platform.
            torque_of_force: (M, n_a, n) g times the torques that hold a unit force on the platform.
            torque_off, torque_on: (M, 3, n_a) g times the coefficients of the torques without and with
                gravity: constant [N m], per (ds/dt)^2 and per d2s/dt2 [N m s^2].
            power_off, power_on: (M, 3) the same coefficients of t_s . W_p.
        """
        robot, branch = self.robots["off"], self.searched.branch
        closed = branch.close(s)
        measure, twist = _measure_with_twist(robot, closed)
        # the null vector from which t_s is computed has an arbitrary length and sign: those at the crossing
        _measure, at_crossing = _measure_with_twist(robot, branch.close(np.array([self.point.s])))
        nearest = twist[np.argmin(np.abs(measure.g))]  # (n,) of the sign of all samples
        scale = twist_norm(robot, at_crossing[0]) * sign_along(nearest, branch.path(self.point.s, 1))
        steps = STEP_ASIDE * robot.length * np.eye(robot.n)  # (n, n), one along each axis
        G, _joint_rates = motor_speeds(robot, closed)  # (M, n_a, n)
        g = measure.g[:, None, None]
        samples = {
            "q": closed.q,
            "q_aside": np.array(
                [
                    [close_loops(robot, closed.x + side, closed.q).q for side in (step, -step)]
                    for step in steps
                ]
            ),
            "g": measure.g,
            "t_s": twist / scale,
            "motor_speed": G,
            "torque_of_force": g * np.linalg.inv(G.transpose(0, 2, 1)),
        }
        along = Smoothstep(0)  # sigma = s, so that z is (ds/dt)^2 and u is d2s/dt2
        for gravity, moved in self.robots.items():
            branch = replace(branch, robot=moved)
            # powers in the uncontrolled motion of weight and of inertia at ds/dt = 1 and at d2s/dt2 = 1
            static, centrifugal, inertial, *_ = PathForces.compute(branch, s, closed)  # (M, nv) each
            forces = np.stack([static, centrifugal, inertial], axis=1)  # (M, 3, nv)
            samples[f"power_{gravity}"] = np.sum(forces * (measure.motion / scale)[:, None], axis=2)
            torque = demand(branch, along, s).torque
            samples[f"torque_{gravity}"] = g * np.stack([torque.constant, torque.per_z, torque.per_u], axis=1)
        return samples


def _measure_with_twist(robot: ParallelRobot, closed: LinearisedLoops) -> tuple[SingularityMeasure, Array]:
    """Compute the measure of singularity, and the twist (M, n) of the uncontrolled motion."""
    measure = singularity_measure(robot, closed)
    return measure, np.einsum("tnv,tv->tn", closed.platform, measure.motion)


def planar_crossing(robot: ParallelRobot, path: Path, duration: float, upwards: Array) -> PlanarCrossing:
    """Plan the laws of least peak torque with gravity off and on.

    Args:
        robot: a rigid robot without damping, whose platform has two translations and as many motors.
        path: a path that crosses the singular locus once.
        duration: duration of the motion [s].
        upwards: unit vector (3,) against gravity.

    Raises:
        InvalidInput: the robot is of another kind.
        NoAnswer: the path does not cross the singular locus exactly once; or as `plan_crossing` with law
            "optimal".
    """
    requirements = {
        "a rigid robot": robot.n_e == 0,
        "no damping": not robot.is_damped,
        "no springs": not robot.has_springs,
        "a platform with two translations and no turn": robot.n == 2 and bool(robot.translations.all()),
        "as many motors as the platform has axes": robot.n_a == robot.n,
        "passive joints": len(robot.passive) > 0,
    }
    unmet = [requirement for requirement, is_met in requirements.items() if not is_met]
    if unmet:
        raise InvalidInput(f"{robot.name}, {robot.flexibility}: a lesson needs {', '.join(unmet)}")
    # the path must cross the locus once
    searched = search_path(robot, path)
    if [point.contact for point in searched.points] != ["transversal"]:
        met = [f"at s = {point.s:.6g} ({point.contact})" for point in searched.points]
        raise NoAnswer(
            f"a lesson needs a path that crosses the singular locus once (transversal); this "
            f"one meets it {', '.join(met) or 'nowhere'}",
            name=robot.name,
        )
    # a robot and a plan for each gravity
    robots, plans = {}, {}
    for name, acceleration in GRAVITY.items():
        x, y, z = (-acceleration * upwards).tolist()
        robots[name] = ParallelRobot.from_description(replace(robot.description, gravity=(x, y, z)))
        plans[name] = plan_crossing(
            robots[name],
            path,
            duration=duration,
            law="optimal",
            optimize="peak_torque",
            smoothness=PATH_SMOOTHNESS,
            torque_limit=np.inf,  # instead of the file's limits: the reader of a lesson sets them
            speed_limit=np.inf,
            rms_torque_limit=np.inf,
        )
    return PlanarCrossing(searched, robots, plans)
