"""Polynomial laws of more than the least degree, for times of crossings at which the least one turns back.

With x = 2 t / T - 1 in [-1, 1] a law at rest at both ends has ds/dx = (1 - x^2)^R p(x). An end in motion has
no such factor, and equations for its derivatives of s. Position, speed and acceleration are linear in the
Chebyshev coefficients of p. At given times t_k they are required at each crossing: s_k, a speed v_k, and the
acceleration a(v_k) = -(beta v_k^2 + delta v_k + gamma) / alpha of condition (8). For given v the best p is
that of a linear program: the largest least p, or the least fourth derivative |s""| for p above a bound
(torques of elastic robots contain it). Speeds are improved by programs in which a(v) is replaced by its
tangent, in a trust region.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from framework.laws.law import Ends
from framework.laws.path import HIGHEST_ORDER
from framework.numerics.arrays import Array
from framework.numerics.chebyshev import derivative_matrix, evaluate, extrema, nodes
from framework.numerics.cone_program import AffineRows, ConeProgram, Unsolved, solve_cone_program
from framework.singularity.points_on_path import Condition8

SAMPLES_PER_COEFFICIENT = 8  # of x, at which p is bounded from below and |s""| from above
FIRST_SPEEDS = np.geomspace(0.2, 6.0, 10)  # paths in the duration, tried for all crossings alike
MAX_STEPS = 4  # of improving the speeds, for each of both goals
FIRST_TRUST, LEAST_TRUST = 0.5, 0.1  # largest relative change of a speed in a step
LEAST_GAIN = 1e-2  # relative, of a further step
MAX_CUTS = 6  # rounds of adding samples where p dips between the samples
ADVANCE_SHARE = 0.8  # of the largest advance that the gentlest law has to reach, and of that between samples


class _Candidate(NamedTuple):
    """The law of the best p for given speeds (k,), in paths per duration.

    advance: the least p over that of a constant p.
    bend: the largest |s""| in paths per duration^4.
    p: Chebyshev coefficients.
    """

    speeds: Array
    advance: float
    bend: float
    p: Array


@dataclass(frozen=True, eq=False)
class RaisedDegree:
    """The search for a polynomial law of a degree through crossings at given times.

    degree: of s.
    duration: [s].
    smoothness: number of derivatives of s that are given at both ends.
    ends: those at ends in motion; the others vanish.
    places: s (k,) of the crossings.
    times: (k,) [s].
    conditions: coefficients of condition (8), alpha s" + beta s'^2 + gamma + delta s' = 0, at each crossing.
    enough: advance from which on |s""| is minimised instead.
    """

    degree: int
    duration: float
    smoothness: int
    ends: Ends
    places: Sequence[float]
    times: Sequence[float]
    conditions: Sequence[Condition8]
    enough: float

    def find(self, speeds: Sequence[float] | None) -> tuple[Array, Array] | None:
        """Find a law that advances, with given speeds (k,) [1/s] or open ones; None without one.

        Returns:
            The speeds (k,) [1/s] at the crossings, and the coefficients of the law above its least degree.
        """
        least_degree = self.ends.least_degree(self.smoothness, len(self.places))
        if least_degree >= self.degree:
            return None
        starts = np.tile(FIRST_SPEEDS[:, None], len(self.places))  # (m, k)
        if speeds is not None:
            starts = np.array(speeds)[None] * self.duration
        candidates = [found for start in starts if (found := self._solve(start)) is not None]
        if not candidates:
            return None
        best = max(candidates, key=lambda candidate: candidate.advance)
        if speeds is None:
            best = self._improve(best)
        if best.advance <= 0.0:
            return None
        min_advance = min(self.enough, ADVANCE_SHARE * best.advance)
        gentle = self._solve(best.speeds, unit=best.bend, min_advance=min_advance) or best
        if speeds is None:
            gentle = self._improve(gentle, min_advance=min_advance)
        gentle = self._lift_dips(gentle, min_advance)
        return gentle.speeds / self.duration, (self._to_s @ gentle.p)[least_degree + 1 :]

    def _lift_dips(self, law: _Candidate, min_advance: float) -> _Candidate:
        """Solve again with further samples where p dips below `min_advance` between the samples."""
        further = np.empty(0)
        for _ in range(MAX_CUTS):
            x = extrema(law.p)
            dips = x[evaluate(x, law.p) < ADVANCE_SHARE * min_advance * self._constant]
            if not len(dips):
                break
            further = np.concatenate([further, dips])
            lifted = self._solve(law.speeds, unit=law.bend, min_advance=min_advance, further=further)
            if lifted is None:
                break
            law = lifted
        return law

    def _improve(self, best: _Candidate, min_advance: float | None = None) -> _Candidate:
        """Improve speeds step by step, for the largest advance or, above `min_advance`, the least |s""|."""
        trust = FIRST_TRUST
        for _ in range(MAX_STEPS):
            if trust < LEAST_TRUST or (min_advance is None and best.advance >= 2.0 * self.enough):
                break
            step = self._solve(best.speeds, unit=best.bend, trust=trust, min_advance=min_advance)
            trial = (
                None if step is None else self._solve(step.speeds, unit=best.bend, min_advance=min_advance)
            )
            if trial is not None and min_advance is None:
                is_better = trial.advance > best.advance + LEAST_GAIN * abs(best.advance)
            else:
                is_better = trial is not None and trial.bend < (1.0 - LEAST_GAIN) * best.bend
            if trial is not None and is_better:
                best = trial
            else:
                trust *= 0.3
        return best

    @cached_property
    def _to_s(self) -> Array:
        """The matrix (degree + 1, size) from Chebyshev coefficients of p to those of s, 0 at the start.

        With x in [-1, 1] over the duration, s is the integral of ds/dx = (1 + x)^a (1 - x)^b p(x): the bump
        (1 + x)^a (1 - x)^b gives a law at rest its a and b vanishing derivatives of s at the ends.
        """
        a, b = self.ends.zeros(self.smoothness)
        size = self.degree - a - b  # of p
        bump = chebyshev.chebmul(chebyshev.chebpow([1.0, 1.0], a), chebyshev.chebpow([1.0, -1.0], b))
        matrix = np.zeros((self.degree + 1, size))
        for k, unit in enumerate(np.eye(size)):  # p = T_k
            s = chebyshev.chebint(chebyshev.chebmul(bump, unit), lbnd=-1)
            matrix[: len(s), k] = s
        return matrix

    def _rows_at(self, x: Array, order: int) -> Array:
        """Return the rows (T, size) on p of a derivative of s at x (T,), in paths per duration^order."""
        values = chebyshev.chebvander(x, self.degree)
        return np.asarray(2.0**order * values @ derivative_matrix(self.degree + 1, order) @ self._to_s)

    @cached_property
    def _crossing_rows(self) -> tuple[Array, Array, Array]:
        """Rows (k, size) of s, s' and s" at the crossings."""
        x = 2.0 * np.array(self.times) / self.duration - 1.0
        s, ds, dds = (self._rows_at(x, order) for order in range(3))
        return s, ds, dds

    @cached_property
    def _end_rows(self) -> tuple[Array, Array]:
        """Rows (m, size) of s at the goal and of ends in motion, and values (m,)."""
        rows, values = [self._rows_at(np.ones(1), 0)], [1.0]
        conditions = self.ends.conditions(self.smoothness)
        for x, is_moving, at_end in zip((-1.0, 1.0), self.ends.moving, conditions, strict=True):
            for order in range(1, len(at_end)) if is_moving else ():
                rows.append(self._rows_at(np.array([x]), order))
                values.append(at_end[order] * self.duration**order)
        matrix = np.concatenate(rows)
        sizes = np.abs(matrix).max(axis=1)
        return matrix / sizes[:, None], np.array(values) / sizes

    @cached_property
    def _constant(self) -> float:
        """The p of a law whose p is constant."""
        return 1.0 / float(self._rows_at(np.ones(1), 0)[0, 0])

    @cached_property
    def _samples(self) -> tuple[Array, Array]:
        """Rows (N, size) of p over that of a constant p, and of s"", at Chebyshev nodes."""
        size = self._to_s.shape[1]
        x = nodes(SAMPLES_PER_COEFFICIENT * size)
        return np.asarray(chebyshev.chebvander(x, size - 1) / self._constant), self._rows_at(x, HIGHEST_ORDER)

    def _acceleration(self, speeds: Array) -> tuple[Array, Array]:
        """Return s" (k,) of condition (8) at speeds s' (k,), and its slope, in paths and durations.

        The condition is alpha s" + beta s'^2 + delta s' + gamma = 0 at each crossing.
        """
        v = speeds / self.duration
        values, slopes = np.empty_like(v), np.empty_like(v)
        for k, condition in enumerate(self.conditions):
            values[k] = condition.acceleration(float(v[k])) * self.duration**2
            slope = -(2.0 * condition.beta * v[k] + condition.delta) / condition.alpha
            slopes[k] = slope * self.duration
        return values, slopes

    def _solve(
        self,
        speeds: Array,
        *,
        unit: float = 1.0,
        trust: float = 0.0,
        min_advance: float | None = None,
        further: Array | None = None,
    ) -> _Candidate | None:
        """Find the best p for speeds (k,), which may change by a relative `trust`; None without one.

        Args:
            speeds: in paths per duration; the tangent of s" is taken there.
            unit: of the largest |s""|, with which the program is well scaled.
            min_advance: bound of the advance, above which the largest |s""| is minimised; None maximises the
                advance.
            further: x (m,) at which p is bounded, too.
        """
        s, ds, dds = self._crossing_rows
        at_ends, end_values = self._end_rows
        p_rows, bend_rows = self._samples
        bend_rows = bend_rows / unit
        acceleration, slope = self._acceleration(speeds)
        count, size = s.shape
        samples = len(p_rows)
        if further is not None:
            p_rows = np.vstack([p_rows, chebyshev.chebvander(further, size - 1) / self._constant])
        one = np.ones((samples, 1))
        scale = 1.0 + np.abs(acceleration)[:, None]  # rows of s" may be far larger than the others
        equal = [
            AffineRows({"p": at_ends}, -end_values),
            AffineRows({"p": s}, -np.array(self.places)),
            # s' = speeds + change, s" = acceleration + slope * change
            AffineRows({"p": ds, "change": -np.eye(count)}, -speeds),
            AffineRows({"p": dds / scale, "change": -np.diag(slope) / scale}, -acceleration / scale[:, 0]),
        ]
        bound = trust * speeds
        nonnegative = [
            AffineRows({"p": p_rows, "advance": -np.ones((len(p_rows), 1))}, np.zeros(len(p_rows))),
            *(AffineRows({"change": sign * np.eye(count)}, bound) for sign in (-1.0, 1.0)),
        ]
        cost = {"advance": -np.ones(1)}
        if min_advance is not None:
            nonnegative.append(AffineRows({"advance": np.ones((1, 1))}, np.array([-min_advance])))
            for sign in (-1.0, 1.0):
                bends = AffineRows({"p": sign * bend_rows, "bend": one}, np.zeros(samples))
                nonnegative.append(bends)
            cost = {"bend": np.ones(1)}
        sizes = {"p": size, "change": count, "advance": 1, "bend": 1 if "bend" in cost else 0}
        optimum = solve_cone_program(ConeProgram(sizes, cost, None, equal, nonnegative))
        if isinstance(optimum, Unsolved):
            return None
        p = optimum["p"]
        return _Candidate(
            speeds + optimum["change"] if trust else speeds,
            float((p_rows @ p).min()),
            unit * float(np.abs(bend_rows @ p).max()),
            p,
        )
