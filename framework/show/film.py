"""A motion sampled for the screen: poses, torques, and the distance from the singularity.

A proved plan and an unproved law are filmed alike. The torques of an unproved law are raw samples; only a
film whose `proved` is true may claim that its torques are finite.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from framework.argument_errors import explain_errors
from framework.dynamics.finite_differences import finite_difference_torques
from framework.dynamics.motor_limits import motor_limits
from framework.dynamics.platform_wrench import PlatformWrench, platform_wrench, wrench_curves
from framework.dynamics.result import SingularityCrossing
from framework.errors import UnboundedTorque
from framework.kinematics.external_wrenches import AppliedWrench
from framework.kinematics.motion_rates import Motion
from framework.kinematics.parallel_robot import ParallelRobot
from framework.kinematics.placements import (
    joint_poses,
    platform_frame_twists,
    platform_positions,
    platform_wrenches,
)
from framework.laws.law import MotionLaw
from framework.laws.path import Path
from framework.numerics.arrays import Array
from framework.planning.plan import law_before_proof, plan_request
from framework.planning.request import Request
from framework.planning.result import CrossingPlan
from framework.singularity.points_on_path import search_path

FILM_FRAMES = 481
UNPROVED_TORQUE_RATIO = 2.5  # largest unproved torque drawn, over the usual torque away from its pole


@dataclass(frozen=True, eq=False)
class Film:
    """F frames of a motion, with closed loops in each frame.

    `W_p` is the wrench that the motion needs at the platform: W_p = (dq/dx)' r, with r the joint forces of
    the open tree. It counts inertia and weight of all bodies, less the wrenches of the world; with massless
    legs it is the payload's alone. `t_s` is the platform's twist in the uncontrolled motion, or in the motion
    nearest to it, of unit size where |g| is least.
    On the locus, condition (8) is t_s . W_p = 0.
    """

    robot: ParallelRobot
    name: str
    path: Path
    law: MotionLaw
    plan: CrossingPlan | None  # None: the law has no proof
    refusal: str  # why there is no plan, or ""
    time: Array  # (F,) [s]
    q: Array  # (F, nq)
    x: Array  # (F, n)
    torque: Array  # (F, n_a) motor side; not finite where an unproved law divides by zero
    deflection: Array  # (F, n_e)
    g: Array  # (F,)
    t_s: Array  # (F, n)
    W_p: Array  # (F, n)
    motors: PlatformWrench  # forces that the motors can give, (F, ...)
    wrenches: tuple[AppliedWrench, ...]  # of the world, each in F frames
    instants: tuple[SingularityCrossing, ...]
    drawn_rigid: bool = False  # springs were requested, but under an unproved law the loops would tear

    @property
    def proved(self) -> bool:
        """Whether a plan proves the motion."""
        return self.plan is not None

    @property
    def has_measure(self) -> bool:
        """Whether the measure g of singularity exists."""
        return not np.isnan(self.g).any()

    @cached_property
    def platform(self) -> Array:
        """Origin (F, 3) [m] of the platform's frame."""
        return platform_positions(self.robot, joint_poses(self.robot, self.q))

    @cached_property
    def twists(self) -> Array:
        """Twists t_s (F, 6) of the platform's frame, on base axes."""
        return platform_frame_twists(self.robot, self.q, self.t_s)

    @cached_property
    def demands(self) -> Array:
        """Wrenches W_p (F, 6) [N, N m] at the platform's origin, on base axes."""
        return platform_wrenches(self.robot, self.q, self.W_p)

    @property
    def key_frame(self) -> int:
        """Frame of the first singular instant, or else the one in the middle."""
        return self.frame_at(self.instants[0].time) if self.instants else len(self.time) // 2

    @explain_errors
    def frame_at(self, time: float) -> int:
        """Return the frame nearest to a time [s]."""
        return int(np.argmin(np.abs(self.time - time)))


def film_motion(robot: ParallelRobot, request: Request, *, name: str = "") -> Film:
    """Plan and film a motion, as unproved where the torques are unbounded.

    Without a plan the film has raw samples of the law that planning has refused.

    Args:
        name: title of the picture, such as Scene C.

    Raises:
        As `plan_crossing`, except UnboundedTorque.
    """
    path = request.path
    wrenches = request.external_wrenches
    searched = search_path(robot, path).under(wrenches)
    try:
        return film_plan(plan_request(robot, request, searched=searched), name=name)
    except UnboundedTorque as unbounded:
        refusal = str(unbounded)

    # sample the refused law; unbounded deflections would tear the loops, so springs are left out
    law, crossings = law_before_proof(searched, request)
    branch = searched.branch
    if robot.n_e:
        rigid = ParallelRobot.from_description(robot.description, flexibility="rigid")
        branch = search_path(rigid, path).under(wrenches).branch
    raw = finite_difference_torques(branch.robot, path, law, samples=FILM_FRAMES, branch=branch)
    return _sample_film(
        branch.robot,
        raw.motion,
        name=name,
        path=path,
        law=law,
        plan=None,
        refusal=refusal,
        time=raw.time,
        torque=raw.torque,
        deflection=raw.deflection,
        instants=crossings,
        drawn_rigid=robot.n_e > 0,
    )


def film_plan(plan: CrossingPlan, *, name: str = "") -> Film:
    """Film a proved plan, with a frame at each crossing."""
    times = np.linspace(0.0, plan.duration, FILM_FRAMES)  # (F,) [s]
    for crossing in plan.dynamics.crossings:  # the nearest frame is shifted onto each
        times[np.argmin(np.abs(times - crossing.time))] = crossing.time
    return _sample_film(
        plan.robot,
        plan.dynamics.motion(times),
        name=name,
        path=plan.path,
        law=plan.law,
        plan=plan,
        refusal="",
        time=times,
        torque=plan.torque(times),
        deflection=plan.deflection(times),
        instants=plan.dynamics.crossings,
    )


def _sample_film(robot: ParallelRobot, motion: Motion, **facts: Any) -> Film:
    """Film F instants of a motion; `facts` are the other fields of the film."""
    curves = wrench_curves(robot, motion)
    motors = platform_wrench(robot, motion)
    return Film(
        robot=robot,
        q=motion.q,
        x=facts["path"](facts["law"](facts["time"])),
        g=curves.g if len(robot.passive) else np.full_like(curves.g, np.nan),
        t_s=curves.twist,
        W_p=motors.bodies,
        motors=motors,
        wrenches=motion.wrenches,
        **facts,
    )


# ------------------------------------------------------------------ torque limits of pictures


def film_limit(film: Film, films: Sequence[Film]) -> Array:
    """Return the torque limits (n_a,) of a film's picture, common to films with its motors."""
    alike = films_with_motors_of(film, films)
    proved = [np.abs(other.torque).max(axis=0) for other in alike if other.proved]
    return limit_for_picture(alike, np.array(proved or [largest_drawn_torque(film)]))


def films_with_motors_of(film: Film, films: Sequence[Film]) -> list[Film]:
    """Return the films whose robots have the same motors."""
    return [other for other in films if other.robot.actuator_names == film.robot.actuator_names]


def largest_drawn_torque(film: Film) -> float:
    """Return the largest torque to draw; the poles of an unproved motion are cut off."""
    return float(np.abs(film.torque).max()) if film.proved else cut_off_poles(film.torque)


def cut_off_poles(torque: Array) -> float:
    """Return the largest torque to draw of samples (T, n_a) with poles.

    The height of the spikes at poles depends on the sampling alone.
    """
    peaks = np.abs(torque).max(axis=1)  # (T,)
    peaks[np.isnan(peaks)] = np.inf
    usual = float(np.quantile(peaks, 0.8))  # a pole raises fewer than a fifth of the samples
    return UNPROVED_TORQUE_RATIO * usual if np.isfinite(usual) and usual > 0 else 1.0


def stated_limits(films: Sequence[Film]) -> Array:
    """Return the torque limits (n_a,) [N m] of the first plan, else those of the robot file."""
    stated = next((film.plan.request.torque_limit for film in films if film.plan is not None), None)
    return motor_limits(films[0].robot, "torque_limit", stated)


def limit_for_picture(films: Sequence[Film], torque: Array) -> Array:
    """Return the torque limits (n_a,) [N m] drawn beside torques (T, n_a) of films with the same motors.

    A motor without a stated limit gets 1.5 times the largest finite torque.
    """
    peak = np.abs(torque[np.isfinite(torque)]).max(initial=0.0)
    limits = stated_limits(films)
    return np.where(np.isfinite(limits), limits, 1.5 * peak or 1.0)


def peak_torque(films: Sequence[Film]) -> float:
    """Return the largest torque of the proved films; 0 if none is proved."""
    return max((float(np.abs(film.torque).max()) for film in films if film.proved), default=0.0)
