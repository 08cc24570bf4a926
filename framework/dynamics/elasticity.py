"""One fixed point for every flexibility: deflections that hold the forces that they cause.

On the time nodes: close the loops at x(t) and q_e(t), take the forces of the tree with all coordinates
and their time derivatives, put q_e = -K^-1 (force on the elastic coordinates), repeat. The first pass,
at q_e = 0, is the small-displacement hypothesis of Briot and Arakelian 2010 (A and B of the rigid
robot). A rigid robot has no springs and needs that pass only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from framework.arrays import Array
from framework.dynamics.forces import Forces, loop_forces
from framework.errors import NotConverged
from framework.kinematics.frames import integrate
from framework.kinematics.inverse_kinematics import Motion, close_loops, joint_rates, motion_at
from framework.kinematics.tracking import Branch
from framework.motion.chebyshev import TimeFunction, TimeGrid
from framework.motion.law import MotionLaw
from framework.motion.path import along

SETTLED = 1e-11  # remaining change of the deflections over the largest one
ROUNDING = 1e-7  # changes that no longer shrink below this share of the deflections are rounding
PASSES = 60
LARGEST = 1.0  # [rad, robot lengths] deflection beyond which a linear spring means nothing
# The law to use when the robot deflects like this, after this law; None before the first pass.
LawChoice = Callable[[TimeFunction | None, MotionLaw | None], MotionLaw]


@dataclass(frozen=True)
class Deflected:
    """The motion on the nodes of `grid`, the forces that cause it and the deflections they cause."""

    grid: TimeGrid
    law: MotionLaw
    motion: Motion
    forces: Forces
    q_e: Array  # (T, n_e) deflections that `forces` cause; `motion` has them up to the last change
    changes: tuple[float, ...]  # largest change of q_e in each pass [m, rad]


def settle(
    branch: Branch,
    grid: TimeGrid,
    choose_law: LawChoice,
    geometry: str,
    start: TimeFunction | None,
    before: MotionLaw,
) -> Deflected:
    """Deflections and forces at the nodes of the grid.

    `geometry` "rigid" takes the forces at q_e = 0 and only moves the motors by what they deflect;
    "deformed" goes on until the deflections settle. `start` and `before` are the deflections and the law
    to begin with.

    Raises:
        NotConverged: the deflections do not settle; NotAssembled: they tear the loops.
    """
    robot = branch.robot
    zero = np.zeros((len(grid.times), robot.n_e))
    q_e = zero if start is None else start(grid.times)
    law = before if start is None else choose_law(start, before)
    motion = _motion(branch, grid, law, q_e, None, zero)
    forces = loop_forces(robot, motion)
    changes: list[float] = []
    rounding_grows = False
    if geometry == "rigid":
        if robot.n_e:
            q_e = _deflections(branch, forces)
            changes.append(float(np.abs(q_e).max()))
            motion = _motion(branch, grid, law, q_e, motion, zero)
        return Deflected(grid, law, motion, forces, q_e, tuple(changes))
    while True:
        new = _deflections(branch, forces)
        if rounding_grows:
            new = grid.smooth(new)
        changes.append(float(np.abs(new - q_e).max()))
        largest = float(np.abs(new).max())
        beyond = np.abs(new / robot.column_scale[robot.elastic]).max(initial=0.0) > LARGEST
        if not np.isfinite(changes[-1]) or len(changes) > PASSES or beyond:
            how = (
                f"would grow to {largest:.3g}" if beyond else f"change by {changes[-1]:.3g} of {largest:.3g}"
            )
            raise NotConverged(
                f"{robot.name}: the deflections do not settle (after {len(changes)} passes they {how} m or "
                f"rad): the springs are too soft for so quick a motion; stiffen them, take more time, or use "
                f"geometry rigid",
                residual=changes[-1],
            )
        ratio = changes[-1] / changes[-2] if len(changes) > 1 and changes[-2] > 0 else 0.5
        remaining = changes[-1] * min(ratio / (1 - ratio), 1.0) if ratio < 1 else np.inf
        # springs that carry inertia feed rounding back through the second derivative, amplified by size^4
        rounding_grows = rounding_grows or (len(changes) > 2 and ratio > 0.2)
        stalled = ratio > 0.5 and changes[-1] <= ROUNDING * largest
        if remaining <= SETTLED * largest or stalled or changes[-1] <= 1e-18 * robot.length:
            return Deflected(grid, law, motion, forces, new, tuple(changes))
        law = choose_law(grid.fit(new), law)
        motion = _motion(branch, grid, law, new, motion, q_e)
        q_e = new
        forces = loop_forces(robot, motion)


def _deflections(branch: Branch, forces: Forces) -> Array:
    """-K^-1 (force on the elastic coordinates), Eq. (3b) with linear springs."""
    return -forces.spring_force / branch.robot.stiffness


def _motion(
    branch: Branch,
    grid: TimeGrid,
    law: MotionLaw,
    q_e: Array,
    before: Motion | None,
    q_e_before: Array,
) -> Motion:
    """All coordinates at the nodes for these deflections; `before` is a motion near it, if any."""
    robot, times = branch.robot, grid.times
    s = [law(times, order) for order in range(3)]
    x, dx, ddx = along(branch.path, s)
    if before is None:
        step = np.zeros((len(times), robot.model.nv))
        step[:, robot.elastic] = q_e - q_e_before
        near = integrate(robot, branch.guess(s[0]), step)
    else:  # along the tangent, by the factors that are there already
        ahead = -robot.platform.residual(before.system.frames, x)
        near = integrate(robot, before.q, joint_rates(robot, before.system, ahead, q_e - q_e_before))
    closed = close_loops(robot, x, near)
    if not robot.n_e:
        return motion_at(robot, closed, dx, ddx)
    return motion_at(robot, closed, dx, ddx, *grid.differentiate(q_e))
