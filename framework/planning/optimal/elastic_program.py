"""The program that improves an elastic robot's law about a motion in balance.

A law is a squared speed z = (d sigma/dt)^2, one Chebyshev series in xi(sigma) with coefficients y. About a
motion in balance, torques, condition (8) of the loaded robot, and rates and accelerations of the springs at
both ends are linear in y (`dynamics.torque_response`). All goals are modelled by squares:

    duration   T = int z^(-1/2):     -1/2 int z^(-3/2) dz + 3/8 int z^(-5/2) dz^2
    energy     int tau^2 z^(-1/2):   int 2 tau z^(-1/2) dtau - 1/2 tau^2 z^(-3/2) dz
                                     + z^(-1/2) (dtau - tau dz/(2 z))^2 + 1/8 tau^2 z^(-5/2) dz^2
    peak       one unknown above all torques

The merit of a law is free of units:

    log(goal) + eta / p (roughness / reference)^p + EXCESS_WEIGHT excess + w unrest

with the roughness 1 + int z"^2 d sigma over the squared unit of z. The excess is the share by which limits
are exceeded, and the unrest that by which springs move at both ends. The logarithm and the small power p make
one eta serve all robots.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.polynomial.chebyshev import chebvander

from framework.dynamics.motor_friction import speed_signs
from framework.dynamics.restoration import BalanceSolution
from framework.dynamics.torque_response import TorqueResponse, respond_to_law
from framework.errors import InvalidInput
from framework.laws.optimal_law import OptimalLaw
from framework.laws.squared_speed import ONE_CELL, SpeedBasis, SpeedSpace
from framework.numerics.arrays import Array, BoolArray
from framework.numerics.chebyshev import gauss_legendre
from framework.numerics.cone_program import Affine
from framework.numerics.quadratic_program import QuadraticProgram, solve_quadratic_program
from framework.planning.optimal.optimal_task import Task
from framework.planning.request import Specification
from framework.tolerances import LIMIT_MARGIN, MAX_END_RATE

SERIES_DEGREE = 40  # of z
POINTS_PER_DEGREE = 10  # Gauss points of integrals over sigma; laws may wait nearly at rest
SQUARED_SPEED_FLOOR = 1e-3  # of z times the squared duration
POSITIVE_POINTS_PER_DEGREE = 6  # where z may change by a share only
ROUGHNESS_POWER = 0.25  # p; at 1/2 roughness holds quick laws back by 3 %, its logarithm holds none back
ROUGHNESS_REFERENCE = 100.0
EXCESS_WEIGHT = 10.0
# of the bounds of springs at the ends: what programs aim at, and what the merit allows
REST_SHARE, MAX_REST_SHARE = 0.5, 0.9
TANGENT_ROUNDS = 3  # of a required duration, with the curvature found
DURATION_ERROR = 1e-3  # of a required duration in the program; the balance restores it to rounding
IDLE_ROW = 0.3  # share of a limit below which a torque may be left out, less the trusted share of z
KEPT_ROWS = 4  # of such torques one in four stays
REGULARIZATION = 1e-9  # of the unknowns
# unknowns besides the step: relative change of the peak, and what limits and rest are exceeded by
PEAK, EXCESS, UNREST = range(3)
OTHERS = 3


class GoalWeights(NamedTuple):
    """The weights of a merit, and what certificates have taught.

    smoothness: eta.
    rest: of springs that move at the ends.
    limit_ratio: certified peak over that at the points of a program.
    rest_ratio: certified rates at the ends over those of a program.
    """

    smoothness: float
    rest: float = 0.1
    limit_ratio: float = 1.0
    rest_ratio: float = 1.0

    def learn(self, costs: Costs, excess: float, unrest: float) -> GoalWeights:
        """Return the weights after a certificate.

        Args:
            costs: of the law by the program.
            excess: certified torque or speed over its limit.
            unrest: certified rates of the springs at the ends, over what is allowed.
        """
        if excess > 1.0:
            limit_ratio = max(self.limit_ratio, (1.0 + 1e-5) * excess / costs.limit_ratio)
            self = self._replace(limit_ratio=limit_ratio)
        if unrest > 1.0 and costs.end_rate > 1.1 * REST_SHARE:  # the program gave rest away
            self = self._replace(rest=4.0 * self.rest)
        if unrest > 1.0:
            ratio = min(unrest / costs.end_rate, 5.0) if costs.end_rate else 5.0
            self = self._replace(rest_ratio=max(self.rest_ratio, ratio))
        return self


class Costs(NamedTuple):
    """What a law costs: its goal, duration [s], relative roughness, and what it reaches of limits."""

    goal: float
    duration: float
    roughness: float
    limit_ratio: float  # largest torque, speed or duration over its limit
    end_rate: float  # of springs, over what is allowed

    def keeps_limits(self, weights: GoalWeights) -> bool:
        """Return whether limits are kept and springs rest at the ends."""
        return weights.limit_ratio * self.limit_ratio <= 1.0 and weights.rest_ratio * self.end_rate <= 1.0

    def merit(self, weights: GoalWeights) -> float:
        """Return the merit, which is minimised."""
        rough = (self.roughness / ROUGHNESS_REFERENCE) ** ROUGHNESS_POWER
        excess = max(weights.limit_ratio * self.limit_ratio - 1.0, 0.0)
        unrest = max(weights.rest_ratio * self.end_rate - MAX_REST_SHARE, 0.0)
        smooth = weights.smoothness / ROUGHNESS_POWER * rough
        return float(np.log(self.goal)) + smooth + EXCESS_WEIGHT * excess + weights.rest * unrest


class MotorResponse(NamedTuple):
    """Torques and speeds of the motors at M points xi, linearised about a motion."""

    xi: Array
    torque: Array  # (M, n_a) [N m] with dry friction
    slopes: Array  # (M, n_a, n) by y
    speed: Array  # (M, n_a) [rad] over d sigma/dt

    @staticmethod
    def of(response: TorqueResponse, friction: Array, xi: Array) -> MotorResponse:
        """Evaluate a response at xi (M,)."""
        speed = response.speed(xi)
        torque = response.torque(xi)
        slopes = response.slopes(xi).reshape(*torque.shape, -1)
        return MotorResponse(xi, torque + friction * speed_signs(speed), slopes, speed)


class Iterate(NamedTuple):
    """A law with deflections in balance, the response of its torques, and its costs.

    motors: at the nodes of the deflections and between them, where limits are kept.
    """

    law: OptimalLaw
    balance: BalanceSolution
    response: TorqueResponse
    motors: MotorResponse
    costs: Costs


class Proposal(NamedTuple):
    """A law that a program proposes, by its coefficients (n,), and the costs that it foresees.

    step: largest share by which z falls, or by which it rises of the higher value.
    """

    y: Array
    costs: Costs
    step: float


class _Rows(NamedTuple):
    """Rows slopes @ step <= room, where another unknown of the program may make room."""

    slopes: Array  # (k, n)
    room: Array  # (k,)
    other: int | None = None  # index of the unknown

    def of_all(self) -> Array:
        """Return the matrix (k, n + OTHERS) of all unknowns."""
        matrix = np.pad(self.slopes, ((0, 0), (0, OTHERS)))
        if self.other is not None:
            matrix[:, self.slopes.shape[1] + self.other] = -1.0
        return matrix


@dataclass(frozen=True, eq=False)
class ElasticProgram:
    """Costs and programs of a task."""

    task: Task
    reference: Array  # (n_a,) [N m] torques that peaks are relative to
    unit: float  # [1/s^2] of z

    @property
    def specification(self) -> Specification:
        return self.task.specification

    @cached_property
    def basis(self) -> SpeedBasis:
        """The functions of xi whose combination is z."""
        return SpeedBasis(np.array(ONE_CELL), SERIES_DEGREE + 1)

    @property
    def _space(self) -> SpeedSpace:
        return SpeedSpace(self.basis, self.task.stretch)

    @cached_property
    def _quadrature(self) -> tuple[Array, Array]:
        """Gauss points xi (Q,), and weights (Q,) of integrals over sigma."""
        xi, weights = gauss_legendre(POINTS_PER_DEGREE * SERIES_DEGREE)
        return xi, weights / self.task.stretch(self.task.stretch.inverse(xi), 1)

    @cached_property
    def _z(self) -> Array:
        """Rows (Q, n) of z on y at the Gauss points."""
        return _values(self._quadrature[0])

    @cached_property
    def _bends(self) -> Array:
        """Rows (Q, n) whose sum of squares is the integral of (d2z/dsigma2)^2 over sigma."""
        xi, weights = self._quadrature
        sigma = self.task.stretch.inverse(xi)
        slope, bend = (self.basis.matrix(xi, order).toarray() for order in (1, 2))
        dxi, ddxi = (self.task.stretch(sigma, order)[:, None] for order in (1, 2))
        return np.asarray(np.sqrt(weights)[:, None] * (dxi**2 * bend + ddxi * slope))

    def iterate(self, law: OptimalLaw, balance: BalanceSolution) -> Iterate:
        """Linearise the torques of a law in balance, and compute its costs."""
        response = respond_to_law(balance)
        friction = self.specification.friction
        nodes = np.unique(response.torque.splines.nodes.p)
        points = np.sort(np.append(nodes, 0.5 * (nodes[1:] + nodes[:-1])))
        motors = MotorResponse.of(response, friction, points)
        costs = self._costs(response, motors, law.coefficients, law.duration)
        return Iterate(law, balance, response, motors, costs)

    def _costs(self, response: TorqueResponse, motors: MotorResponse, y: Array, duration: float) -> Costs:
        """Compute the costs of coefficients y (n,) by a response."""
        specification = self.specification
        step = y - response.y
        torque = np.abs(motors.torque + motors.slopes @ step)  # (M, n_a)
        _, weights = self._quadrature
        z = self._z @ y
        goal = duration
        if specification.goal == "peak_torque":
            goal = float((torque / self.reference).max())
        elif specification.goal == "energy":
            inside = MotorResponse.of(response, specification.friction, self._quadrature[0])
            ratio = (inside.torque + inside.slopes @ step) / self.reference
            goal = float(weights @ ((ratio**2).sum(axis=1) * z**-0.5))
        speed = np.abs(motors.speed) * np.sqrt(_values(motors.xi) @ y)[:, None]
        ratios = [(torque / specification.torque_limit).max(), (speed / specification.speed_limit).max()]
        ratios.append(duration / (specification.longest or np.inf))
        rest = response.rest + response.rest_slopes @ step
        end_rate = float(np.abs(rest).max(initial=0.0)) / MAX_END_RATE
        roughness = 1.0 + float(((self._bends @ y / self.unit) ** 2).sum())
        return Costs(goal, duration, roughness, float(max(ratios)), end_rate)

    def propose(
        self, iterate: Iterate, weights: GoalWeights, trust: float, equalities: Affine
    ) -> Proposal | None:
        """Find the law of least merit near a motion in balance; None if there is none.

        Args:
            iterate: the motion.
            weights: of the merit.
            trust: share of z by which z may fall anywhere.
            equalities: rows (k, n) on y that must vanish: condition (8) and required speeds.
        """
        solution = self._solve_for_duration(iterate, weights, trust, equalities)
        if solution is None:
            return None
        y, duration = solution
        ratio = (self._z @ y) / (self._z @ iterate.law.coefficients)
        share = 1.0 - float(np.minimum(ratio, 1.0 / ratio).min())
        return Proposal(y, self._costs(iterate.response, iterate.motors, y, duration), share)

    def _solve_for_duration(
        self, iterate: Iterate, weights: GoalWeights, trust: float, equalities: Affine
    ) -> tuple[Array, float] | None:
        """Return coefficients (n,) and the duration [s] of their law, nearly the required one; None without.

        The tangent of a required duration misses the curvature of T(z): the program is solved again with the
        curvature of its last law.
        """
        required = self.specification.duration
        curvature = 0.0  # [s] T - T_lin of the last law
        result = None
        for _ in range(TANGENT_ROUNDS):
            y = self._solve(iterate, weights, trust, equalities, curvature)
            if y is None:
                return None
            try:
                duration = self._space.duration(y)
            except InvalidInput:  # it stands still
                return None
            result = y, duration
            if required is None or abs(duration / required - 1.0) < DURATION_ERROR:
                break
            step = (y - iterate.law.coefficients) / self.unit
            linear = iterate.costs.duration * (1.0 + float(self._duration_slope(iterate) @ step))
            curvature = duration - linear
        return result

    def _solve(
        self, iterate: Iterate, weights: GoalWeights, trust: float, equalities: Affine, curvature: float
    ) -> Array | None:
        """Solve one quadratic program; return the coefficients (n,), or None.

        The step of y is in the unit of z. Other unknowns are the relative change of the peak, and what limits
        and rest are exceeded by.
        """
        y_0, costs, duration = iterate.law.coefficients, iterate.costs, self.specification.duration
        cost, squares = self._model_merit(iterate, weights)
        others = np.zeros(OTHERS)
        others[PEAK] = self.specification.goal == "peak_torque"
        others[EXCESS], others[UNREST] = EXCESS_WEIGHT, weights.rest
        size = len(cost) + OTHERS
        P = np.pad(2.0 * squares.T @ squares, (0, OTHERS)) + REGULARIZATION * np.eye(size)
        equal = [_Rows(self.unit * equalities.matrix, -equalities(y_0))]
        if duration is not None:
            missing = np.array([(duration - costs.duration - curvature) / costs.duration])
            equal.append(_Rows(self._duration_slope(iterate)[None], missing))
        A, b = _stack(equal)
        G, h = _stack(self._limit_rows(iterate, weights, trust))
        x = solve_quadratic_program(QuadraticProgram(P, np.append(cost, others), A, b, G, h))
        return None if x is None else y_0 + self.unit * x[: len(y_0)]

    def _duration_slope(self, iterate: Iterate) -> Array:
        """Compute the slope (n,) of the relative duration by the step: -1/2 int z^(-3/2) dz / T."""
        z_0 = self._z @ iterate.law.coefficients
        slope = -0.5 * (self._quadrature[1] * z_0**-1.5) @ self._z
        return np.asarray(self.unit / iterate.costs.duration * slope)

    def _model_merit(self, iterate: Iterate, weights: GoalWeights) -> tuple[Array, Array]:
        """Compute slopes (n,) of the merit by the step, and rows (k, n) whose squares are its second part.

        The peak is an unknown, and not among them.
        """
        y_0, costs = iterate.law.coefficients, iterate.costs
        z_0 = self._z @ y_0
        dz = self.unit * self._z  # (Q, n) by the step
        slowness = self._quadrature[1] * z_0**-0.5
        # eta / p R^p is concave in the roughness R: its tangent is above
        rough = (costs.roughness / ROUGHNESS_REFERENCE) ** ROUGHNESS_POWER
        eta = weights.smoothness * rough / costs.roughness
        cost = 2.0 * eta / self.unit * (self._bends @ y_0) @ self._bends
        squares = [np.sqrt(eta) * self._bends]
        if self.specification.goal == "time":
            cost += self._duration_slope(iterate)
            squares.append(np.sqrt(0.375 * slowness / costs.duration)[:, None] / z_0[:, None] * dz)
        elif self.specification.goal == "energy":
            share = slowness / costs.goal
            xi, _ = self._quadrature
            inside = MotorResponse.of(iterate.response, self.specification.friction, xi)
            for j, reference in enumerate(self.reference):
                tau, dtau = inside.torque[:, j] / reference, self.unit * inside.slopes[:, j] / reference
                cost += (2.0 * share * tau) @ dtau - 0.5 * (share * tau**2 / z_0) @ dz
                squares.append(np.sqrt(share)[:, None] * (dtau - 0.5 * (tau / z_0)[:, None] * dz))
                squares.append((np.sqrt(0.125 * share) * np.abs(tau) / z_0)[:, None] * dz)
        return cost, np.concatenate(squares)

    def _limit_rows(self, iterate: Iterate, weights: GoalWeights, trust: float) -> list[_Rows]:
        """Return rows of torques, speeds, a longest duration, rest at both ends, and the trust region."""
        y_0, costs, specification = iterate.law.coefficients, iterate.costs, self.specification
        room = (1.0 - LIMIT_MARGIN) / weights.limit_ratio
        motors = iterate.motors
        rows = list[_Rows]()
        for j, limit in enumerate(specification.torque_limit):
            for sign in (1.0, -1.0):
                torque, slopes = sign * motors.torque[:, j], sign * self.unit * motors.slopes[:, j]
                if np.isfinite(limit):
                    near = _near_limit(torque / limit, trust)
                    rows.append(_Rows(slopes[near] / limit, room - torque[near] / limit, EXCESS))
                if specification.goal == "peak_torque":
                    peak = costs.goal * self.reference[j]
                    near = _near_limit(torque / peak, trust)
                    rows.append(_Rows(slopes[near] / peak, 1.0 - torque[near] / peak, PEAK))
        for speed, limit in zip(motors.speed.T, specification.speed_limit, strict=True):
            if np.isfinite(limit):
                half = (0.5 * (speed / limit) ** 2)[:, None] * _values(motors.xi)  # of the squared ratio
                rows.append(_Rows(self.unit * half, 0.5 * room**2 - half @ y_0, EXCESS))
        if specification.longest is not None:
            left = np.array([specification.longest / costs.duration - 1.0])
            rows.append(_Rows(self._duration_slope(iterate)[None], left, EXCESS))
        rest = iterate.response.rest / MAX_END_RATE
        rest_slopes = self.unit * iterate.response.rest_slopes / MAX_END_RATE
        for sign in (1.0, -1.0):
            rows.append(_Rows(sign * rest_slopes, REST_SHARE / weights.rest_ratio - sign * rest, UNREST))
        # 1 - trust <= z / z_0 <= 1 / (1 - trust), and z above a floor, also between the points of integrals
        count = POSITIVE_POINTS_PER_DEGREE * SERIES_DEGREE
        values = _values(-np.cos(np.linspace(0.0, np.pi, count)))
        z_0 = values @ y_0
        relative = self.unit * values / z_0[:, None]
        floor = np.minimum(SQUARED_SPEED_FLOOR / costs.duration**2 / z_0, 1.0)
        rows.append(_Rows(-relative, np.minimum(trust, 1.0 - floor)))
        rows.append(_Rows(relative, np.full(count, trust / (1.0 - trust))))
        # excess and unrest are not negative
        nothing = np.zeros((1, len(y_0)))
        return [*rows, _Rows(nothing, np.zeros(1), EXCESS), _Rows(nothing, np.zeros(1), UNREST)]


def _values(xi: Array) -> Array:
    """Return rows (M, n) of z on y at xi (M,)."""
    return np.asarray(chebvander(xi, SERIES_DEGREE), dtype=float)


def _near_limit(ratio: Array, trust: float) -> BoolArray:
    """Return which ratios (M,) of a torque to its limit a step may bring to 1, and some of the others."""
    return (np.arange(len(ratio)) % KEPT_ROWS == 0) | (ratio > IDLE_ROW - trust)


def _stack(rows: Sequence[_Rows], *, max_entry: float = 100.0) -> tuple[Array, Array]:
    """Return the matrix (k, n + OTHERS) and the room (k,) of rows, large ones scaled down for the solver."""
    matrix = np.concatenate([one.of_all() for one in rows])
    room = np.concatenate([one.room for one in rows])
    factors = 1.0 / np.maximum(1.0, np.abs(matrix).max(axis=1) / max_entry)
    return factors[:, None] * matrix, factors * room
