"""The best law along a path: the cone program set up from what the robot asks, and its solution made a law.

Torques at the points of the program are those of a rigid robot, or of one whose deflections are known as
functions of the path parameter. Between the points, and at the crossings themselves where only the limit of
the torque exists, they follow by interpolation; what exceeds a limit there becomes a row of the next round.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev, legendre

from framework.arrays import Array, BoolArray, IntArray
from framework.crossing.phase_plane import Demand
from framework.crossing.specification import Specification
from framework.errors import InvalidInput
from framework.motion.chebyshev import coefficients as series_through
from framework.motion.chebyshev import derivative_matrix, evaluate, nodes
from framework.motion.cone_program import Affine, ConeProgram, Optimum, Unsolved, solve
from framework.motion.exact_duration import adjusted, blended, duration_of
from framework.motion.infeasibility import Infeasible
from framework.motion.optimal_law import OptimalLaw, Stretch

DEGREES = (40, 80)  # of the squared speed; the second where the first finds no law
MANY = 4  # crossings, beyond which the second is tried at once
NEAR = 0.7  # share of the peak from which a torque counts as near its limit
SPARSER = 2  # the first rows are at every other point
BETWEEN = 6  # times as dense as the points, where their values are looked at
ROUNDS = 8  # of solving with further rows where a limit was exceeded
KEPT = 1e-3  # share of the limits that is kept at the rows, for what lies between them
# Weight of the coefficients of z, grown with the square of their degree; ten times as much for each
# derivative of s that is to vanish: an elastic robot's torque differentiates twice what a rigid one's does.
ROUGHNESS = 1e-5
FLOOR = 1e-2  # least z, over the mean speed squared
# times the least peak, what a law that must be slower may take
LAXER = (1.002, 1.005, 1.01, 1.02, 1.05, 1.2, 1.5, 2.0, 4.0)
SLOWER = 8  # steps from the quickest towards the slowest law
SLOWEST = 0.02  # least z of such a law, over the mean speed squared
COMPARABLE = 4.0  # factor between the guessed and the found scale that needs no second solution


class OnPath(NamedTuple):
    """What the robot asks on its path."""

    sigma: Array  # (M,) Chebyshev points of `stretch`, none of them on a crossing
    demand: Demand  # at `sigma`
    crossings: Array  # (k,) sigma
    conditions: Array  # (k, 4): constant + per_z z + per_u u + per_du u' = 0 there
    stretch: Stretch = Stretch()  # xi(sigma), in which z is a Chebyshev series


class Units(NamedTuple):
    """What the program measures times [s] and torques (n_a,) [N m] in: their limits, if they have one."""

    time: float
    torque: Array


class Best(NamedTuple):
    """The best law of its degree; `peak` of torque over `reference` (n_a,) [N m] is what the program saw.

    cost: what was to be least: the duration [s], the peak of torque [N m], or the energy [N2 m2 s].
    bound: the same of the program with rows at few points, which no law of this degree goes below.
    """

    law: OptimalLaw
    peak: float
    reference: Array
    cost: float
    bound: float


def points_of(degree: int, crossings: Array, stretch: Stretch) -> Array:
    """sigma of Chebyshev points that resolve torques of z of this degree and stay clear of the crossings."""
    sizes = [3 * degree + 1 + 2 * extra for extra in range(5)]
    places = stretch(crossings)

    def gap(size: int) -> float:
        return float(np.abs(nodes(size)[:, None] - places).min(initial=1.0)) * size

    sigma = stretch.inverse(nodes(max(sizes, key=gap)))
    sigma[[0, -1]] = 0.0, 1.0
    return sigma


class Basis(NamedTuple):
    """Values of z and u at points, as matrices on the coefficients."""

    z: Array
    u: Array

    @staticmethod
    def at(sigma: Array, degree: int, stretch: Stretch) -> Basis:
        """Of the Chebyshev series of this degree in xi(sigma)."""
        values = np.asarray(chebyshev.chebvander(stretch(sigma), degree), dtype=float)
        slope = 0.5 * stretch(sigma, 1)[:, None]
        return Basis(values, slope * (values @ derivative_matrix(degree + 1)))  # u = z'/2

    def du(self, sigma: Array, stretch: Stretch) -> Array:
        """Values of u' = z"/2."""
        once, twice = (self.z @ derivative_matrix(self.z.shape[1], order) for order in (1, 2))
        return np.asarray(0.5 * (stretch(sigma, 1)[:, None] ** 2 * twice + stretch(sigma, 2)[:, None] * once))


def guessed_units(on_path: OnPath, specification: Specification) -> Units:
    """Units in which the solution may be near 1."""
    demand, limit = on_path.demand, specification.torque_limit
    time = specification.most
    if time is None:  # what the limits allow at half of the points, z constant
        spare = np.maximum(limit - np.abs(demand.torque.constant), 0.1 * limit)
        by_torque = np.sqrt(np.abs(demand.torque.per_z) / spare).max(axis=1)
        time = (
            float(np.median(np.maximum(by_torque, (demand.speed / specification.speed_limit).max(axis=1))))
            or 1.0
        )
    if specification.limited:
        return Units(time, np.where(np.isfinite(limit), limit, limit[np.isfinite(limit)].max()))
    steady = np.abs(demand.torque.constant + demand.torque.per_z / time**2).max(axis=1)
    size = float(np.median(steady)) or float(np.abs(demand.torque.per_u).max()) / time**2 or 1.0
    return Units(time, np.full(len(limit), size))


def better_units(units: Units, specification: Specification, found: Optimum) -> Units:
    """The units that the solution turned out to have; the same object if they were near enough."""
    longer = found.duration if specification.most is None else 1.0
    heavier = 1.0 if specification.limited else found.peak
    if max(longer, 1 / longer, heavier, 1 / heavier) < COMPARABLE:
        return units
    return Units(units.time * longer, units.torque * heavier)


@dataclass(frozen=True, eq=False)
class Setting:
    """The cone program of a specification, for z of one degree, in units."""

    on_path: OnPath
    specification: Specification
    degree: int
    units: Units
    roughness: float = ROUGHNESS

    @cached_property
    def scale(self) -> float:
        """What the coefficients are multiplied with to be a z [1/s^2]."""
        return self.units.time**-2

    @cached_property
    def _torque(self) -> tuple[Array, Array]:
        """Torques at the points as affine functions of the coefficients: (M, n_a, n) and (M, n_a)."""
        constant, per_z, per_u = self.on_path.demand.torque
        basis = Basis.at(self.on_path.sigma, self.degree, self.on_path.stretch)
        matrix = per_z[:, :, None] * basis.z[:, None] + per_u[:, :, None] * basis.u[:, None]
        return self.scale * matrix / self.units.torque[:, None], constant / self.units.torque

    def torque_rows(self, take: Array) -> Affine:
        """Torques of all motors at combinations `take` (R, M) of the points, (R n_a)."""
        matrix, offset = self._torque
        rows = np.tensordot(take, matrix, axes=1)
        return Affine(rows.reshape(-1, self.degree + 1), (take @ offset).ravel())

    @cached_property
    def _between(self) -> Array:
        """Combinations of the points that give the values between them and at the crossings."""
        size = len(self.on_path.sigma)
        at_crossings = evaluate(self.on_path.stretch(self.on_path.crossings), series_through(np.eye(size)))
        return np.concatenate([_dense(size), at_crossings])

    @cached_property
    def _speeds_between(self) -> Array:
        """z between the points, as a matrix on the coefficients."""
        return np.asarray(chebyshev.chebvander(_fine(len(self.on_path.sigma)), self.degree), dtype=float)

    def torques(self, y: Array) -> Array:
        """Sizes of the torques over their units between the points and at the crossings (R, n_a)."""
        matrix, offset = self._torque
        return np.asarray(np.abs(self._between @ (matrix @ y + offset)))

    def conditions(self) -> Affine:
        """What a crossing asks of the coefficients."""
        here = self.on_path
        return conditions_on_speed(here.crossings, here.conditions, self.degree, here.stretch, self.scale)

    def program(self) -> ConeProgram:
        """The program with rows at every other point."""
        specification, degree = self.specification, self.degree
        points, weights = legendre.leggauss(degree + degree // 2)
        every_other = np.eye(len(self.on_path.sigma))[::SPARSER]
        limited = np.isfinite(specification.speed_limit)
        squared = (
            self.scale
            * (self.on_path.demand.speed[::SPARSER, limited] / specification.speed_limit[limited]) ** 2
        )
        z = chebyshev.chebvander(nodes(len(self.on_path.sigma))[::SPARSER], degree)
        power = Affine(np.empty((0, degree + 1)), np.empty(0))
        if specification.goal == "energy":
            power = self.torque_rows(evaluate(points, series_through(np.eye(len(self.on_path.sigma)))))
        return ConeProgram(
            speeds=np.asarray(chebyshev.chebvander(points, degree), dtype=float),
            average=np.eye(len(weights)),
            weights=weights / self.on_path.stretch(self.on_path.stretch.inverse(points), 1),
            positive=np.empty((0, degree + 1)),
            torque=self.torque_rows(every_other),
            bounded=np.tile(specification.limited_motors, len(every_other)),
            below_one=(squared[:, :, None] * z[:, None]).reshape(-1, degree + 1),
            power=power,
            equalities=self.conditions(),
            roughness=self.roughness
            * 10.0 ** (specification.smoothness - 2)
            * np.diag(np.arange(degree + 1.0) ** 2),
            floor=FLOOR,
            kept=KEPT if specification.limited else 0.0,
        )

    def solved(self, program: ConeProgram) -> Optimum | Infeasible | Unsolved:
        """The optimum of the program, or why there is none."""
        most = self.specification.most
        longest = None if most is None else most / self.units.time
        return solve(program, self.specification.goal, longest=longest)

    def off_limits(self) -> tuple[float | None, float | None]:
        """The least peak of torque over its limit in the duration asked, and the least duration [s] within
        all limits, by laws of this degree; None where none was found."""
        specification = self.specification
        free = replace(
            specification, goal="peak_torque", torque_limit=np.full(len(specification.torque_limit), np.inf)
        )
        quickest = replace(specification, goal="time", duration=None, longest=None)
        # a motor without a limit counts for nothing in a peak over the limits
        units = self.units._replace(torque=np.where(specification.limited_motors, self.units.torque, np.inf))
        gentle = (
            replace(self, specification=free, units=units)._best()
            if specification.limited and specification.most is not None
            else None
        )
        quick = replace(self, specification=quickest)._best() if specification.limited else None
        return (None if gentle is None else gentle.peak, None if quick is None else quick.law.duration)

    def _best(self) -> Best | None:
        program = self.program()
        found = self.solved(program)
        best = self.within_limits(program, found) if isinstance(found, Optimum) else None
        return best if isinstance(best, Best) else None

    def within_limits(self, program: ConeProgram, found: Optimum) -> Best | Infeasible | Unsolved:
        """The law of an optimum, solved again with rows where a limit does not hold between the points.

        Rows that are far from their limit are left out of that; where they are needed they come back.
        """
        first = found
        near = np.abs(program.torque(found.y)) > NEAR * _allowed(program.bounded, found.peak)
        rows = Affine(program.torque.matrix[near], program.torque.offset[near])
        program = replace(program, torque=rows, bounded=program.bounded[near])
        limited = self.specification.limited_motors
        for _ in range(ROUNDS):
            allowed = np.where(limited, 1.0, np.inf)
            if self.specification.goal == "peak_torque" or not self.specification.limited:
                allowed = _allowed(limited, found.peak) * (1.0 + 2.0 * KEPT)
            extended = self._with_rows_where_exceeded(program, found.y, allowed)
            if extended is None:
                break
            again = self.solved(extended)
            if not isinstance(again, Optimum):
                return again
            program, found = extended, again
        try:
            y = found.y if self.specification.duration is None else self._lasting(program, found)
            law = OptimalLaw(
                y * self.scale,
                self.specification.smoothness,
                self.specification.duration or 0.0,
                self.on_path.stretch.at,
            )
        except InvalidInput as problem:
            return Unsolved(str(problem))
        peak = float(self.torques(y).max())
        final = found._replace(peak=peak, duration=law.duration / self.units.time)
        return Best(law, peak, self.units.torque, self._cost(final), self._cost(first))

    def _cost(self, found: Optimum) -> float:
        time, torque = self.units.time, float(self.units.torque.max())
        if self.specification.goal == "time":
            return found.duration * time
        return (
            found.peak * torque
            if self.specification.goal == "peak_torque"
            else found.value * torque**2 * time
        )

    def _with_rows_where_exceeded(self, program: ConeProgram, y: Array, allowed: Array) -> ConeProgram | None:
        """The program with rows where torques of y exceed what is allowed (n_a,) or z is low, if it does."""
        over = _peaks((self.torques(y) / allowed).max(axis=1), 1.0)
        low = _peaks(-(self._speeds_between @ y), -0.5 * program.floor)
        if not len(over) and not len(low):
            return None
        return replace(
            program,
            torque=_both(program.torque, self.torque_rows(self._between[over])),
            bounded=np.append(program.bounded, np.tile(self.specification.limited_motors, len(over))),
            positive=np.concatenate([program.positive, self._speeds_between[low]]),
        )

    def _lasting(self, program: ConeProgram, quick: Optimum) -> Array:
        """Coefficients of a law of the duration asked for: between the quick one and a slow one.

        Admissible z are a convex set, and the duration is continuous along a blend of two. The slow law keeps
        to the same peak of the torques but for a small share, grown as far as it must, and to the limits at
        any rate.

        The duration is convex in z, so it is at least its linearisation about any z0: the integral of
        -z0^(-3/2)/2 (z - z0) added to that of z0. The z that makes this largest takes longer than z0, and so
        on (the convex-concave procedure: Yuille and Rangarajan 2003).

        Raises:
            InvalidInput: none of this degree was found.
        """
        duration = (self.specification.duration or 0.0) / self.units.time
        stretch = self.on_path.stretch
        if duration_of(quick.y, stretch) > duration * (1.0 - 1e-6):  # a rounding away, or nearly so
            return adjusted(quick.y, program.equalities, duration, stretch)
        everywhere = self._speeds_between[:: SPARSER * BETWEEN]
        slower = replace(program, positive=np.concatenate([program.positive, everywhere]), floor=SLOWEST)
        for lax in LAXER:
            before, allowed = quick.y, _allowed(self.specification.limited_motors, lax * quick.peak)
            for _ in range(SLOWER):
                rows = _scaled(slower.torque, _allowed(slower.bounded, lax * quick.peak))
                everything = replace(slower, torque=rows, bounded=np.ones_like(slower.bounded))
                slow = solve(everything, "slowest", about=before)
                if not isinstance(slow, Optimum):
                    break
                extended = self._with_rows_where_exceeded(slower, slow.y, allowed * (1.0 + 2.0 * KEPT))
                if extended is not None:
                    slower = extended
                elif duration_of(slow.y, stretch) > duration:
                    blend = blended(before, slow.y, duration, stretch)
                    return adjusted(blend, program.equalities, duration, stretch)
                else:
                    before = slow.y
        raise InvalidInput("no law of this degree advances all the time and takes so long")


def _both(one: Affine, two: Affine) -> Affine:
    return Affine(np.concatenate([one.matrix, two.matrix]), np.concatenate([one.offset, two.offset]))


def _scaled(rows: Affine, units: Array) -> Affine:
    return Affine(rows.matrix / units[:, None], rows.offset / units)


def _allowed(limited: BoolArray, peak: float) -> Array:
    """The peak, or the limit of those that have one where that is less."""
    return np.where(limited, min(peak, 1.0), peak)


def conditions_on_speed(
    sigma: Array, conditions: Array, degree: int, stretch: Stretch, scale: float = 1.0
) -> Affine:
    """constant + per_z z + per_u u + per_du u' at sigma (k,), z of this degree in multiples of `scale`."""
    at = Basis.at(sigma, degree, stretch)
    constant, per_z, per_u, per_du = conditions.T[:, :, None]
    rows = per_z * at.z + per_u * at.u
    if np.any(per_du):
        rows = rows + per_du * at.du(sigma, stretch)
    return Affine(scale * rows, constant[:, 0])


def _fine(size: int) -> Array:
    """Points in (-1, 1), BETWEEN times as dense as `size` Chebyshev points."""
    return np.asarray(-np.cos(np.pi * (np.arange(BETWEEN * size) + 0.5) / (BETWEEN * size)))


@lru_cache(maxsize=8)
def _dense(size: int) -> Array:
    """Values between `size` Chebyshev points, from those at them."""
    return evaluate(_fine(size), series_through(np.eye(size)))


def _peaks(values: Array, allowed: float) -> IntArray:
    """Indices of the local maxima above what is allowed."""
    padded = np.concatenate(([-np.inf], values, [-np.inf]))
    highest = (values >= padded[:-2]) & (values >= padded[2:])
    return np.flatnonzero(highest & (values > allowed))
