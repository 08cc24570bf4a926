"""The task of an optimal law: its specification, and its conditions where the robot is singular."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from framework.errors import NoLaw
from framework.kinematics.continuation.tracking import Branch, escape_error
from framework.laws.optimal_law import Smoothstep, Stretch
from framework.numerics.arrays import Array
from framework.planning.condition import CrossingPoint, coefficients_at, crossing_point
from framework.planning.crossing_points import PathToCross
from framework.planning.optimal.phase_plane import SquaredSpeed, crossing_rows
from framework.planning.refusals.refusal_proofs import UnmetCondition
from framework.planning.request import Request
from framework.planning.specification import Specification
from framework.singularity.points_on_path import SingularPoint
from framework.tolerances import NO_HOLD


class Task(NamedTuple):
    """A law's crossing points and request, and its goal and limits."""

    to_cross: PathToCross
    request: Request
    specification: Specification

    @property
    def geometry(self) -> str:
        return self.request.geometry

    @property
    def follows_balance(self) -> bool:
        """Whether law and deflections of an elastic robot are sought together."""
        robot = self.branch.robot
        return self.geometry == "deformed" and robot.n_a == robot.n

    @property
    def branch(self) -> Branch:
        """The poses along the path."""
        return self.to_cross.branch

    @property
    def targets(self) -> Sequence[SingularPoint | CrossingPoint]:
        """The points at which condition (8) is to hold."""
        return self.to_cross.crossing_points

    @property
    def phi(self) -> Smoothstep:
        return Smoothstep(self.specification.smoothness)

    @property
    def stretch(self) -> Stretch:
        """Dense at the crossings of the undeformed robot."""
        return Stretch(tuple(float(self.phi.inverse(target.s)) for target in self.targets))


def other_law(task: Task) -> str:
    """Return the words that advise the polynomial law; empty where that was tried already."""
    return "law polynomial or " if task.request.kind == "optimal" else ""


def find_crossing_points(task: Task) -> list[CrossingPoint]:
    """Find the crossing points of the undeformed robot."""
    return [
        crossing_point(task.branch, target, None, target.s) if isinstance(target, SingularPoint) else target
        for target in task.targets
    ]


def conditions_at(
    task: Task,
    points: Sequence[CrossingPoint],
    z0: SquaredSpeed | None = None,
    speed_places: Sequence[float] | None = None,
) -> tuple[Array, Array]:
    """Compute the conditions on a law: sigma (k,) and rows (k, 4).

    The rows are per (1, z, u, u'). They are condition (8) at each point, and the required speeds, z phi'^2 =
    speed^2.

    Args:
        z0: the squared speed about which viscous damping is linearised.
        speed_places: s of the required speeds, those of the points by default.
    """
    sigmas = list[float]()
    rows = list[Array]()
    for point in points:
        conditions = crossing_rows(task.branch, task.phi, point, z0)
        rows += list(conditions.rows)
        sigmas += [conditions.sigma] * len(conditions.rows)
    speeds = task.request.speeds or ()
    places = [point.s for point in points] if speed_places is None else speed_places
    for place, speed in zip(places, speeds, strict=bool(speeds)):
        sigma = float(task.phi.inverse(place))
        rows.append(np.array([-(speed**2), float(task.phi(sigma, 1)) ** 2, 0.0, 0.0]))
        sigmas.append(sigma)
    return np.array(sigmas), np.array(rows).reshape(-1, 4)


def check_speeds(task: Task, points: Sequence[CrossingPoint]) -> None:
    """Raise NoLaw where no speed meets the conditions at a crossing point.

    One condition leaves beta s'^2 + gamma = 0 where the path is orthogonal to t_s; two determine s'^2 and s".
    With damping, which adds delta s', the cone program tells.
    """
    if task.branch.robot.is_damped:
        return
    for point in points:
        rows = crossing_rows(task.branch, task.phi, point).rows
        if point.corank > 1:
            _check_common_speed(task, point, rows)
            continue
        constant, per_z, per_u, _ = rows[0]
        is_orthogonal = per_u == 0.0 and (per_z != 0.0 or constant != 0.0)
        if is_orthogonal and not -constant * per_z > 0.0:
            why = "one of them is zero and the other not"
            if constant * per_z > 0.0:
                why = "both pull the same way"
            raise NoLaw(
                f"{task.branch.robot.name}: at s = {point.s:.6g} the path runs orthogonal to t_s: condition "
                f"(8) leaves beta s'^2 + gamma = 0, which no speed meets ({why})",
                proof=UnmetCondition(point.s, *coefficients_at(task.branch, point, None)[:3], stop=False),
            )


def _check_common_speed(task: Task, point: CrossingPoint, rows: Array) -> None:
    """Refuse conditions (8) at a point without a common speed s' > 0.

    Raises UncontrolledMotions unless some s'^2 > 0 and s" meet all. The rows (k, 4) ask for [per_z per_u] (z,
    u) = -constant. With [per_z per_u] = U diag(S) V' the solution of least norm is V S^-1 U' (-constant), and
    there is one if the rest of U' (-constant) is zero.
    """
    size = np.abs(rows).max()
    U, S, V_rows = np.linalg.svd(rows[:, 1:3])
    rank = int(np.sum(NO_HOLD * size < S))
    required = -U.T @ rows[:, 0]
    z_and_u = V_rows[:rank].T @ (required[:rank] / S[:rank])
    is_solvable = np.abs(required[rank:]).max(initial=0.0) <= NO_HOLD * size
    if not is_solvable or (rank == 2 and not z_and_u[0] > 0.0):
        raise escape_error(
            task.branch.robot,
            point.s,
            task.branch.path(point.s),
            point.corank,
            "no s' and s\" meet the condition (8) of each; cross in another direction",
        )


def check_unfolded(task: Task) -> None:
    """Refuse a touch that small deflections turn into two crossings or none.

    Raises NoLaw. That is so where the path only touches the locus, and where several motions escape at once.
    """
    if not task.branch.robot.n_e or task.geometry == "rigid":
        return
    for target in task.targets:
        if isinstance(target, SingularPoint) and (target.contact == "tangential" or target.corank > 1):
            event = "touches the locus" if target.corank == 1 else f"lets {target.corank} motions go at once"
            raise NoLaw(
                f"{task.branch.robot.name}: at s = {target.s:.6g} the path {event}; the deflections make two "
                f"crossings of that or none: move the path off the locus or across it, or use geometry rigid"
            )
