"""The task of an optimal law: its specification, and its conditions where the robot is singular.

A law s = phi(sigma(t)) is given by its squared speed z = (d sigma/dt)^2; u = d2 sigma/dt2 = z'/2. Condition
(8), t_s . W_p = 0, keeps torques finite at a crossing (`planning.condition`). It is affine in z and u.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from framework.errors import NoLaw
from framework.kinematics.continuation.tracking import Branch, uncontrolled_error
from framework.kinematics.parallel_robot import ParallelRobot
from framework.laws.optimal_law import Smoothstep
from framework.laws.squared_speed import Stretch
from framework.numerics.arrays import Array
from framework.planning.condition import coefficients_at
from framework.planning.crossing_points import PathToCross
from framework.planning.optimal.phase_plane import SquaredSpeed, crossing_rows
from framework.planning.refusals import UnmetCondition
from framework.planning.request import Request, Specification
from framework.singularity.points_on_path import SingularPoint
from framework.tolerances import NO_HOLD


class Task(NamedTuple):
    """The task of an optimal law: the points to cross, the request, and goal and limits."""

    to_cross: PathToCross
    request: Request
    specification: Specification

    @property
    def geometry(self) -> str:
        return self.request.geometry

    @property
    def follows_balance(self) -> bool:
        """Whether law and deflections of an elastic robot are solved for together."""
        return self.geometry == "deformed"

    @property
    def branch(self) -> Branch:
        """The poses along the path."""
        return self.to_cross.branch

    @property
    def robot(self) -> ParallelRobot:
        return self.branch.robot

    @property
    def targets(self) -> Sequence[SingularPoint]:
        """The points of the undeformed robot where condition (8), t_s . W_p = 0, must hold."""
        return self.to_cross.crossing_points

    @property
    def phi(self) -> Smoothstep:
        return self.specification.phi

    @property
    def stretch(self) -> Stretch:
        """The map from sigma to xi, steep at the crossings of the undeformed robot."""
        return Stretch(tuple(float(self.phi.inverse(target.s)) for target in self.targets))


def conditions_at(
    task: Task, z0: SquaredSpeed | None, places: Sequence[float] | None = None
) -> tuple[Array, Array]:
    """Compute the conditions on a law: sigma (k,) and rows (k, 4).

    Each row times (1, z, u, u') must vanish, where z = (d sigma/dt)^2 and u = z'/2 [1/s^2] are those of the
    law at sigma (prime: d/d sigma), and s = phi(sigma) is the path coordinate. The first rows are
    condition (8) at each crossing point, t_s . W_p = 0: the wrench W_p that the platform requires does no
    work [N, N m] in the uncontrolled motion t_s. The last rows are the required speeds s' [1/s^2].

    Args:
        z0: the squared speed about which viscous damping is linearised; None leaves damping out.
        places: s of the required speeds; by default the crossing points.

    Returns:
        The parameter sigma of each condition, and the conditions.
    """
    sigmas = list[float]()
    rows = list[Array]()
    for point in task.targets:
        crossing = crossing_rows(task.branch, task.phi, point, z0)
        rows += list(crossing)
        sigmas += [float(task.phi.inverse(point.s))] * len(crossing)
    if task.request.speeds:
        places = [point.s for point in task.targets] if places is None else places
        for s, speed in zip(places, task.request.speeds, strict=True):
            sigma = float(task.phi.inverse(s))
            slope = float(task.phi(sigma, 1))  # phi' of s = phi(sigma), so that s'^2 = phi'^2 z
            rows.append(np.array([-(speed**2), slope**2, 0.0, 0.0]))
            sigmas.append(sigma)
    return np.array(sigmas), np.array(rows).reshape(-1, 4)


def check_speeds(task: Task) -> None:
    """Raise NoLaw if no speed meets condition (8), t_s . W_p = 0, at a crossing point.

    Where the path is orthogonal to the uncontrolled twist t_s, one condition reduces to
    beta s'^2 + gamma = 0. Two conditions determine s'^2 and s". Damping adds a term delta s', which is left
    to the cone program.
    """
    if task.robot.is_damped:
        return
    for point in task.targets:
        rows = crossing_rows(task.branch, task.phi, point)
        if point.corank > 1:
            _check_common_speed(task, point, rows)
            continue
        constant, per_z, per_u, _ = rows[0]
        is_orthogonal = per_u == 0.0 and (per_z != 0.0 or constant != 0.0)
        product = constant * per_z
        if is_orthogonal and not product < 0.0:
            why = "both pull the same way" if product > 0.0 else "one of them is zero and the other not"
            alpha, beta, gamma, _ = point.condition or coefficients_at(task.branch, point, None)
            raise NoLaw(
                f"at s = {point.s:.6g} the path runs orthogonal to t_s: condition "
                f"(8) leaves beta s'^2 + gamma = 0, which no speed meets ({why})",
                name=task.robot.name,
                proof=UnmetCondition(point.s, alpha, beta, gamma, stop=False),
            )


def _check_common_speed(task: Task, point: SingularPoint, rows: Array) -> None:
    """Raise UncontrolledMotions if no s' > 0 meets all conditions (8) at a point.

    The rows (k, 4) require A (z, u) = -constant with A = [per_z per_u] = U diag(S) V'. The solution of least
    norm is V S^-1 U' (-constant). It exists if the components of U' (-constant) beyond the rank of A vanish.
    """
    size = np.abs(rows).max()  # singular values and residuals far below it are rounding
    U, S, V_rows = np.linalg.svd(rows[:, 1:3])
    rank = int(np.sum(NO_HOLD * size < S))
    required = -U.T @ rows[:, 0]
    z_and_u = V_rows[:rank].T @ (required[:rank] / S[:rank])
    is_solvable = np.abs(required[rank:]).max(initial=0.0) <= NO_HOLD * size
    if not is_solvable or (rank == 2 and not z_and_u[0] > 0.0):
        raise uncontrolled_error(
            task.robot,
            point.s,
            task.branch.path(point.s),
            point.corank,
            "no s' and s\" meet the condition (8) of each; cross in another direction",
        )


def check_single_crossings(task: Task) -> None:
    """Raise NoLaw at a point that deflections turn into two crossings or none.

    This happens where the path only touches the locus, or where several motions are uncontrolled at once.
    """
    if not task.robot.n_e or task.geometry == "rigid":
        return
    for target in task.targets:
        if target.contact == "tangential" or target.corank > 1:
            corank = target.corank
            event = "touches the locus" if corank == 1 else f"leaves {corank} motions uncontrolled"
            raise NoLaw(
                f"at s = {target.s:.6g} the path {event}; the deflected robot has two "
                f"crossings there or none; move the path off the locus or across it",
                name=task.robot.name,
            )
