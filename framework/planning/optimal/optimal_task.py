"""The task of an optimal law: its specification, and its conditions where the robot is singular."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from framework.errors import NoLaw
from framework.kinematics.continuation.tracking import Branch, escape_error
from framework.laws.optimal_law import Smoothstep, Stretch
from framework.numerics.arrays import Array
from framework.planning.condition import CrossingPoint, Deflection, coefficients_at, crossing_point
from framework.planning.crossing_points import PathToCross
from framework.planning.optimal.phase_plane import Deflections, SquaredSpeed, crossing_rows
from framework.planning.refusals.refusal_proofs import UnmetCondition
from framework.planning.request import Request
from framework.planning.specification import Specification
from framework.singularity.points_on_path import SingularPoint
from framework.tolerances import NO_HOLD


class Task(NamedTuple):
    """The crossing points of a law, its request, and the goal and limits that it is optimised for."""

    to_cross: PathToCross
    request: Request
    specification: Specification

    @property
    def geometry(self) -> str:
        return self.request.geometry

    @property
    def speeds(self) -> Sequence[float] | None:
        """s' at each target [1/s], if asked."""
        return self.request.speeds

    @property
    def branch(self) -> Branch:
        """The path as it was followed."""
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
    """Return the advice to take the polynomial, where it was not tried before."""
    return "law polynomial or " if task.request.kind == "optimal" else ""


def crossing_places(
    task: Task, deflections: Deflections | None, before: Sequence[CrossingPoint] | None
) -> list[CrossingPoint]:
    """Find the crossing points of the robot with these deflections; `before` are points near them."""
    places = []
    for k, target in enumerate(task.targets):
        if not isinstance(target, SingularPoint):
            places.append(target)
            continue
        near = target.s if before is None else before[k].s
        deflection = None
        if deflections is not None and task.geometry == "deformed":
            start = deflections(task.phi.inverse(np.array([near])))[0]
            deflection = Deflection(start, 0 * start, 0 * start)
        places.append(crossing_point(task.branch, target, deflection, near))
    return places


def conditions_at(
    task: Task,
    places: Sequence[CrossingPoint],
    deflections: Deflections | None,
    before: SquaredSpeed | None = None,
) -> tuple[Array, Array]:
    """Return the conditions on a law: sigma (k,) and rows (k, 4) of constant, per z, per u, per sqrt(z).

    They are condition (8) at each place, and the given speeds, z phi'^2 = speed^2.

    Args:
        before: the law about which viscous damping is linearised.
    """
    carrying = deflections if task.geometry == "deformed" else None
    stacks = [crossing_rows(task.branch, task.phi, place, carrying, before) for place in places]
    sigmas = [sigma for sigma, rows in stacks for _ in rows]
    conditions = [row for _, rows in stacks for row in rows]
    for place, speed in zip(places, task.speeds or (), strict=bool(task.speeds)):
        sigma = float(task.phi.inverse(place.s))
        sigmas.append(sigma)
        conditions.append(np.array([-(speed**2), float(task.phi(sigma, 1)) ** 2, 0.0, 0.0]))
    return np.array(sigmas), np.array(conditions).reshape(-1, 4)


def check_speeds(task: Task, places: Sequence[CrossingPoint]) -> None:
    """Raise NoLaw where no speed meets what the conditions at a place leave to it.

    One condition leaves beta s'^2 + gamma = 0 where the path is orthogonal to t_s; two determine s'^2 and s".
    With damping, which adds delta s', the cone program tells.
    """
    if task.branch.robot.is_damped:
        return
    for place in places:
        rows = crossing_rows(task.branch, task.phi, place, None)[1]
        constant, per_z, per_u, _ = rows[0]
        if place.corank > 1:
            _check_common_speed(task, place, rows)
        elif per_u == 0.0 and (per_z != 0.0 or constant != 0.0) and not -constant * per_z > 0.0:
            why = (
                "both pull the same way"
                if constant * per_z > 0.0
                else "one of them is zero and the other not"
            )
            raise NoLaw(
                f"{task.branch.robot.name}: at s = {place.s:.6g} the path runs orthogonal to t_s: condition "
                f"(8) leaves beta s'^2 + gamma = 0, which no speed meets ({why})",
                proof=UnmetCondition(place.s, *coefficients_at(task.branch, place, None)[:3], stop=False),
            )


def _check_common_speed(task: Task, place: CrossingPoint, rows: Array) -> None:
    """Raise UncontrolledMotions unless an s'^2 > 0 and an s" meet all conditions (8) at a place."""
    size = np.abs(rows).max()
    left, values, right = np.linalg.svd(rows[:, 1:3])
    rank = int(np.sum(values > NO_HOLD * size))
    required = -left.T @ rows[:, 0]
    solution = right[:rank].T @ (required[:rank] / values[:rank])
    met = np.abs(required[rank:]).max(initial=0.0) <= NO_HOLD * size
    if not met or (rank == 2 and not solution[0] > 0.0):
        raise escape_error(
            task.branch.robot,
            place.s,
            task.branch.path(place.s),
            place.corank,
            "no s' and s\" meet the condition (8) of each; cross in another direction",
        )


def check_unfolded(task: Task) -> None:
    """Raise NoLaw where small deflections would change what the path meets: two crossings, or none.

    Where the path only touches the locus, or several motions escape at once, that is so.
    """
    if not task.branch.robot.n_e or task.geometry == "rigid":
        return
    for target in task.targets:
        if isinstance(target, SingularPoint) and (target.contact == "tangential" or target.corank > 1):
            what = "touches the locus" if target.corank == 1 else f"lets {target.corank} motions go at once"
            raise NoLaw(
                f"{task.branch.robot.name}: at s = {target.s:.6g} the path {what}; the deflections make two "
                f"crossings of that or none: move the path off the locus or across it, or use geometry rigid"
            )
