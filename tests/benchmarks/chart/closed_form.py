"""The paper's 5R in closed form, in fifty digits: what the methods of the chart are measured against.

It knows this one robot and shares no code with the framework: nothing is imported but Python's own `decimal`
(and numpy for what is handed out). Legs are a crank b from the motor to the elbow and a rod p from the elbow
to the payload, both of length L. All but the angles themselves is algebraic:

    b.b = L^2, p.p = (L + eps)^2, b + p = x - base       b and p from x, their rates by differentiation
    p x f = I p x p'' / L^2 + m p x a / 2                moments of the rod, f the force at its tip
    l_1 p_1 + l_2 p_2 = W,  f = l p + ...                the payload: singular where p_1 || p_2
    tau = (rotor + crank) alpha + b x (m a - f)          moments of the crank

A quotient 0/0 at the singular instant costs as many digits as the instant is near; of fifty there are enough.
Source: Briot and Arakelian 2010, section 3; condition (8) is W x p = 0 where the rods are parallel.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from decimal import Decimal, localcontext
from functools import lru_cache
from math import perm
from typing import NamedTuple

import numpy as np

from framework.numerics import Array

DIGITS = 50
BASES = (Decimal("-0.2"), Decimal("0.2"))  # abscissae of the motors [m]
ELBOWS = (1, -1)  # the crank lies left (1) or right (-1) of the line from its motor to the payload
LENGTH = Decimal("0.25")  # of every link [m]
PAYLOAD = Decimal(10)  # [kg]
DRIVE_STIFFNESS, ROD_STIFFNESS = Decimal(25000), Decimal(350000)  # [N m/rad], [N/m]
ROTOR_INERTIA, GEAR_RATIO = Decimal("0.064e-4"), Decimal(50)  # [kg m^2] motor side, -
START, END = (Decimal("0.1"), Decimal("0.345")), (Decimal("-0.05"), Decimal("0.195"))  # scene C [m]
DURATION, CROSSING_TIME, CROSSING_SPEED = Decimal("1.5"), Decimal(1), Decimal("1.5")  # [s], [s], [1/s]
BESIDE = Decimal("1e-25")  # [s] beside the very instant of the crossing, where 0/0 has no value
STEP = Decimal("1e-18")  # of differences for Newton's method, which corrects what they leave

Vector = tuple[Decimal, Decimal]


def cross(a: Vector, b: Vector) -> Decimal:
    """The normal component of the product of two vectors of the plane."""
    return a[0] * b[1] - a[1] * b[0]


def dot(a: Vector, b: Vector) -> Decimal:
    """The inner product."""
    return a[0] * b[0] + a[1] * b[1]


def _sum(*terms: tuple[Decimal, Vector]) -> Vector:
    return sum((k * v[0] for k, v in terms), Decimal(0)), sum((k * v[1] for k, v in terms), Decimal(0))


def _turned(a: Vector) -> Vector:
    return -a[1], a[0]


class Leg(NamedTuple):
    """Crank and rod [m]."""

    crank: Vector
    rod: Vector


def legs(x: Vector, stretch: Sequence[Decimal] = (Decimal(0), Decimal(0))) -> tuple[Leg, Leg]:
    """Both legs for the payload at x [m], elbows outward, with rods longer by `stretch` [m]."""
    found = []
    for base, elbow, longer in zip(BASES, ELBOWS, stretch, strict=True):
        reach = x[0] - base, x[1]
        square = dot(reach, reach)
        along = ((LENGTH**2 - (LENGTH + longer) ** 2) / square + 1) / 2
        across = elbow * (LENGTH**2 / square - along**2).sqrt()
        crank = _sum((along, reach), (across, _turned(reach)))
        found.append(Leg(crank, _sum((Decimal(1), reach), (Decimal(-1), crank))))
    return found[0], found[1]


class Load(NamedTuple):
    """What the motion asks of both rods: W [N], with what the inertia of each leg adds."""

    legs: tuple[Leg, Leg]
    force: Vector  # W = l_1 p_1 + l_2 p_2 [N]
    across: tuple[Vector, Vector]  # the part of each rod's tip force that is across the rod [N]
    centre: tuple[Vector, Vector]  # accelerations of the rods' middles [m/s^2]
    crank: tuple[Decimal, Decimal]  # angular accelerations of the cranks [rad/s^2]


def load(x: Vector, dx: Vector, ddx: Vector, mass: Decimal, payload: Decimal = PAYLOAD) -> Load:
    """The load of a motion of the payload [kg], with rigid rods; `mass` [kg] of each crank and rod."""
    both = legs(x)
    force, across, centre, spun = _sum((-payload, ddx)), [], [], []
    for b, p in both:
        aside = dot(p, _turned(b))
        rate = dot(p, dx) / aside
        dp = _sum((Decimal(1), dx), (-rate, _turned(b)))
        alpha = (dot(p, _sum((Decimal(1), ddx), (rate**2, b))) + dot(dp, dp)) / aside
        ddb = _sum((alpha, _turned(b)), (-(rate**2), b))
        ddp = _sum((Decimal(1), ddx), (Decimal(-1), ddb))
        middle = _sum((Decimal(1), ddb), (Decimal("0.5"), ddp))
        moment = mass * (cross(p, ddp) / 12 + cross(p, middle) / 2)  # p x f, the rod's inertia m L^2 / 12
        across.append(_sum((moment / LENGTH**2, _turned(p))))
        force = _sum((Decimal(1), force), (Decimal(-1), across[-1]))
        centre.append(middle)
        spun.append(alpha)
    return Load(both, force, (across[0], across[1]), (centre[0], centre[1]), (spun[0], spun[1]))


def shares(legs_: tuple[Leg, Leg], force: Vector) -> tuple[Decimal, Decimal]:
    """l_1, l_2 [N/m] with l_1 p_1 + l_2 p_2 = force."""
    (_, left), (_, right) = legs_
    below = cross(left, right)
    return cross(force, right) / below, cross(left, force) / below


def motor_torques(found: Load, mass: Decimal) -> tuple[Decimal, Decimal]:
    """Torques [N m], motor side, with the rotors."""
    torques = []
    for (b, p), share, across, centre, alpha in zip(
        found.legs, shares(found.legs, found.force), found.across, found.centre, found.crank, strict=True
    ):
        elbow = _sum((mass, centre), (-share, p), (Decimal(-1), across))  # by the crank on the rod
        joint = mass * LENGTH**2 / 3 * alpha + cross(b, elbow)
        torques.append(ROTOR_INERTIA * GEAR_RATIO * alpha + joint / GEAR_RATIO)
    return torques[0], torques[1]


def on_line(s: Decimal, order: int = 0) -> Vector:
    """Scene C's path at s, or its derivative by s."""
    way = END[0] - START[0], END[1] - START[1]
    return (START[0] + s * way[0], START[1] + s * way[1]) if order == 0 else way


def singular_s(stretch: Sequence[Decimal] = (Decimal(0), Decimal(0))) -> Decimal:
    """Where scene C's path makes the rods parallel, by the secant method from the paper's 2/3."""

    def area(s: Decimal) -> Decimal:
        left, right = legs(on_line(s), stretch)
        return cross(left.rod, right.rod)

    with localcontext(prec=DIGITS):
        return _secant(area, Decimal("0.66"), Decimal("0.67"))


@dataclass(frozen=True)
class ExactMotion:
    """The exact motion along scene C under the law `powers` (ascending powers of t)."""

    powers: tuple[Decimal, ...]
    s_c: Decimal
    mass: Decimal
    payload: Decimal = PAYLOAD

    def law(self, t: Decimal, order: int = 0) -> Decimal:
        """s or its derivative [1/s^order]."""
        return sum((c * _slope(t, k, order) for k, c in enumerate(self.powers)), Decimal(0))

    def singular_time(self) -> Decimal:
        """The instant [s] at which the path is singular, by Newton's method."""
        t = CROSSING_TIME
        for _ in range(60):
            t -= (self.law(t) - self.s_c) / self.law(t, 1)
        return t

    def platform(self, times: Iterable[float]) -> Array:
        """Payload (T, 2) [m] at times (T,) [s]."""
        with localcontext(prec=DIGITS):
            return np.array(
                [[float(c) for c in on_line(self.law(Decimal(float(t))))] for t in times], dtype=float
            )

    def torque(self, times: Iterable[float]) -> Array:
        """Motor torques (T, 2) [N m] at times (T,) [s]."""
        with localcontext(prec=DIGITS):
            return np.array([self._torque(Decimal(float(t))) for t in times], dtype=float)

    def _torque(self, t: Decimal) -> tuple[float, float]:
        s, ds, dds = (self.law(t, order) for order in range(3))
        left, right = legs(on_line(s))
        if abs(cross(left.rod, right.rod)) < Decimal(10) ** (5 - DIGITS):
            return self._torque(t + BESIDE)
        way = on_line(s, 1)
        found = motor_torques(
            load(on_line(s), _sum((ds, way)), _sum((dds, way)), self.mass, self.payload), self.mass
        )
        return float(found[0]), float(found[1])


@lru_cache(maxsize=64)
def motion(
    mass: float = 0.0, *, payload: float = float(PAYLOAD), offset: float = 0.0, smoothness: int = 2
) -> ExactMotion:
    """Scene C under its law, with condition (8) imposed at the singular point, or `offset` beside it in s."""
    with localcontext(prec=DIGITS):
        s_c, links, carried = singular_s(), Decimal(mass), Decimal(payload)
        imposed = s_c + Decimal(offset)
        powers = law_through(imposed, _condition(s_c, links, carried), smoothness)
        return ExactMotion(powers, s_c, links, carried)


def _condition(s_c: Decimal, mass: Decimal, payload: Decimal) -> Decimal:
    """s" at the crossing by condition (8), which is linear in it."""
    way = on_line(s_c, 1)

    def left_over(dds: Decimal) -> Decimal:
        found = load(on_line(s_c), _sum((CROSSING_SPEED, way)), _sum((dds, way)), mass, payload)
        return cross(found.force, found.legs[0].rod)

    still, moved = left_over(Decimal(0)), left_over(Decimal(1))
    return -still / (moved - still)


def law_through(s_c: Decimal, dds: Decimal, smoothness: int) -> tuple[Decimal, ...]:
    """Powers of the law of least degree at rest at both ends, through (s, s', s") at the crossing."""
    still = [Decimal(0)] * smoothness
    return polynomial(
        [
            (Decimal(0), [Decimal(0), *still]),
            (DURATION, [Decimal(1), *still]),
            (CROSSING_TIME, [s_c, CROSSING_SPEED, dds]),
        ]
    )


def polynomial(conditions: Sequence[tuple[Decimal, Sequence[Decimal]]]) -> tuple[Decimal, ...]:
    """Powers of the polynomial with the value and the first derivatives given at each instant."""
    values = [value for _, given in conditions for value in given]
    rows = [
        [_slope(t, k, order) for k in range(len(values))]
        for t, given in conditions
        for order in range(len(given))
    ]
    return tuple(_solved(rows, values))


def _slope(t: Decimal, k: int, order: int) -> Decimal:
    """The derivative of t^k."""
    return perm(k, order) * (t ** (k - order) if k > order else Decimal(1))


def _solved(rows: list[list[Decimal]], right: Sequence[Decimal]) -> list[Decimal]:
    """Gauss's elimination with pivots."""
    table = [[*row, value] for row, value in zip(rows, right, strict=True)]
    for k in range(len(table)):
        best = max(range(k, len(table)), key=lambda i: abs(table[i][k]))
        table[k], table[best] = table[best], table[k]
        for i in range(len(table)):
            if i != k and table[i][k]:
                factor = table[i][k] / table[k][k]
                table[i] = [a - factor * b for a, b in zip(table[i], table[k], strict=True)]
    return [row[-1] / row[k] for k, row in enumerate(table)]


def _secant(function: Callable[[Decimal], Decimal], one: Decimal, two: Decimal) -> Decimal:
    at_one, at_two = function(one), function(two)
    for _ in range(60):
        if at_one == at_two or abs(two - one) < Decimal(10) ** (4 - DIGITS):
            return two
        one, two = two, two - at_two * (two - one) / (at_two - at_one)
        at_one, at_two = at_two, function(two)
    raise ArithmeticError("the secant method has not ended")
